//! How well takes are restored: gaps and noise in a user's own takes, beside simple methods.
//!
//! Each gap is cut into a copy of a segment of a take, is filled, and is compared with what was cut
//! out; noise is added to other segments and removed. They are restored by a model that was trained
//! on other subjects, by one given model, or by the takes alone. The `baselines` are what everybody
//! has: PCHIP, linear interpolation, a Gaussian, a Butterworth filter.

mod baselines;
mod gaps;
mod noise;
mod report;
mod segments;

use crate::io::Model;
use crate::pose::{Poses, Space};
use crate::prior::{Kind, TrainOptions, TrainingSet};
use crate::restore::Restorer;
use crate::{Error, Place, Result};
use baselines::Moments;
pub use gaps::{GapCell, GapLength};
use ndarray::Axis;
pub use noise::NoiseCell;
pub use report::TakesReport;

/// Training poses a second, at most: poses closer in time tell nothing new.
const TRAINING_RATE: f64 = 30.0;

/// What is tested.
#[derive(Debug, Clone, PartialEq)]
pub struct TakesSettings {
    /// Lengths of gaps.
    pub lengths: Vec<GapLength>,
    /// Numbers of points in a gap, each at least 1.
    pub points: Vec<usize>,
    /// Gaps for each length and number of points, at least 1.
    pub gaps: usize,
    /// Standard deviations of noise on every coordinate, cm; 0 shows what a clean take loses.
    pub noise: Vec<f64>,
    /// The seed of all random draws.
    pub seed: u64,
}

impl Default for TakesSettings {
    fn default() -> Self {
        TakesSettings {
            lengths: [0.1, 0.3, 0.6, 1.0, 2.0].map(GapLength::Seconds).to_vec(),
            points: vec![1, 3, 8],
            gaps: 20,
            noise: vec![0.0, 0.1, 0.3, 1.0, 5.0],
            seed: 0,
        }
    }
}

/// What restores the takes.
#[derive(Debug, Clone, Copy)]
pub enum TestedModel<'m> {
    /// For each subject, a model trained on the takes of all other subjects.
    OthersOnly,
    /// One model, which should not have been trained on any of the takes.
    Given(&'m Model),
    /// No model: each take by itself.
    TakeAlone,
}

/// A take with a frame rate.
#[derive(Debug, Clone)]
struct TestTake {
    subject: usize,
    poses: Poses,
    rate: f64,
}

/// Takes to be tested on.
#[derive(Debug, Clone)]
pub struct TestTakes {
    takes: Vec<TestTake>,
    /// Different subjects, in the order of their first take.
    subjects: Vec<String>,
    /// Takes left out: their times give no frame rate.
    pub untimed: Vec<String>,
}

impl TestTakes {
    /// The takes of tables, each with its name. A take's subject is its name up to the first `_`.
    ///
    /// # Errors
    /// [`Error::Data`] for tables with different points, or where no take has a frame rate;
    /// [`Error::Usage`] without a table.
    pub fn new(tables: &[(String, Poses)]) -> Result<TestTakes> {
        let Some((first, poses)) = tables.first() else {
            return Err(Error::usage("no table of poses given"));
        };
        let points = &poses.points;
        let mut out = TestTakes {
            takes: Vec::new(),
            subjects: Vec::new(),
            untimed: Vec::new(),
        };
        for (table, poses) in tables {
            if poses.points != *points {
                let what = format!("has points that differ from those of {first}");
                return Err(Error::data(Place::file(table), what));
            }
            for (range, rate) in poses.takes().into_iter().zip(poses.rates()) {
                let name = poses.take.as_ref().map(|takes| &*takes[range.start]);
                let name = name.unwrap_or(table);
                match rate {
                    Some(rate) => out.push(name, poses.slice(range), rate),
                    None => out.untimed.push(name.to_string()),
                }
            }
        }
        if out.takes.is_empty() {
            let what = "has no take with a frame rate; gaps have a length in time (the option \
                        `fps` gives it)";
            Err(Error::data(Place::file(first), what))
        } else {
            Ok(out)
        }
    }

    fn push(&mut self, name: &str, poses: Poses, rate: f64) {
        let subject = name.split('_').next().unwrap_or(name);
        let known = self.subjects.iter().position(|s| s == subject);
        let subject = known.unwrap_or_else(|| {
            self.subjects.push(subject.to_string());
            self.subjects.len() - 1
        });
        self.takes.push(TestTake {
            subject,
            poses,
            rate,
        });
    }

    /// Tests restoring; `progress` is called with what is being done, and how much of the whole is
    /// done, 0 to 1.
    ///
    /// # Errors
    /// [`Error::Usage`] for settings out of range, or where there is but one subject and models of
    /// the others are asked for; [`Error::Data`] if no model can be trained, or a take cannot
    /// be restored with it.
    pub fn test(
        &self,
        model: TestedModel<'_>,
        settings: &TakesSettings,
        progress: &mut dyn FnMut(&str, f64),
    ) -> Result<TakesReport> {
        settings.check(self.takes[0].poses.points.len())?;
        if matches!(model, TestedModel::OthersOnly) && self.subjects.len() < 2 {
            let what = format!(
                "all takes are of subject \"{}\", and no other is left to learn from; give takes \
                 of more subjects (a take's subject is its name up to the first _), a model that \
                 does not know these with -m, or the option `self`",
                self.subjects[0]
            );
            return Err(Error::usage(what));
        }
        let mut gaps = settings.gap_cells(self);
        let mut noise = settings.noise_cells(self);
        let cells = gaps.len() + noise.len();
        for (subject, name) in self.subjects.iter().enumerate() {
            let mut tell = |what: &str, cell: usize| {
                let done = (subject * cells + cell) as f64 / (self.subjects.len() * cells) as f64;
                progress(&format!("{name}: {what}"), done);
            };
            let others = match model {
                TestedModel::OthersOnly => {
                    tell("training without it", 0);
                    Some(self.train_without(subject)?)
                }
                _ => None,
            };
            let restorer = match (&others, model) {
                (Some(others), _) => Restorer::new(&others.model),
                (None, TestedModel::Given(model)) => Restorer::new(model),
                (None, _) => Restorer::without_model(),
            };
            let poses = others.as_ref().and_then(|o| o.poses.as_ref());
            for (k, cell) in gaps.iter_mut().enumerate() {
                tell("gaps", k);
                cell.test(self, subject, &restorer, poses)?;
            }
            for (k, cell) in noise.iter_mut().enumerate() {
                tell("noise", gaps.len() + k);
                cell.test(self, subject, &restorer, settings.seed)?;
            }
        }
        Ok(TakesReport {
            subjects: self.subjects.clone(),
            takes: self.takes.len(),
            gaps,
            noise,
        })
    }

    /// A model of all subjects but one.
    fn train_without(&self, subject: usize) -> Result<OthersModel> {
        let mut rows = Vec::new();
        let (mut time, mut take) = (Vec::new(), Vec::new());
        for (k, other) in self.takes.iter().enumerate() {
            if other.subject != subject {
                let step = (other.rate / TRAINING_RATE).round().max(1.0);
                for t in (0..other.poses.frames()).step_by(step as usize) {
                    rows.push(other.poses.frame(t));
                    time.push(t as f64 / other.rate);
                    take.push(k.to_string().into());
                }
            }
        }
        let xyz = ndarray::stack(Axis(0), &rows).map_err(|e| Error::usage(e.to_string()))?;
        let poses = Poses {
            points: self.takes[0].poses.points.clone(),
            xyz,
            time: Some(time),
            take: Some(take),
        };
        let name = format!("the takes of all subjects but {}", self.subjects[subject]);
        let poses = TrainingSet::from_poses(&poses, Space::World, &name)?;
        let kind = Kind::for_points(poses.points.len());
        Ok(OthersModel {
            model: kind.train(&poses, &TrainOptions::default())?,
            poses: Moments::of(&poses.xyz.mapv(f64::from)),
        })
    }
}

/// A model, and the moments of the poses that it was trained on, in the pelvis's frame.
struct OthersModel {
    model: Model,
    poses: Option<Moments>,
}

impl TakesSettings {
    fn check(&self, points: usize) -> Result<()> {
        if self.gaps == 0 {
            return Err(Error::usage("the option `gaps`: expected at least one"));
        }
        if let Some(count) = self.points.iter().find(|p| **p == 0 || **p >= points) {
            return Err(Error::usage(format!(
                "the option `points {count}`: expected 1 to {} (one of the table's {points} \
                 points is to stay)",
                points - 1
            )));
        }
        Ok(())
    }

    fn gap_cells(&self, takes: &TestTakes) -> Vec<GapCell> {
        let mut cells = Vec::new();
        for &length in &self.lengths {
            for &points in &self.points {
                let stream = cells.len() as u64;
                cells.push(GapCell::draw(takes, length, points, self, stream));
            }
        }
        cells
    }

    fn noise_cells(&self, takes: &TestTakes) -> Vec<NoiseCell> {
        let dense = self.noise.iter().map(|sd| (*sd, 1.0));
        // Lai et al.'s sparse noise: a fifth of the points at the largest level.
        let sparse = self.noise.iter().copied().fold(0.0, f64::max);
        let sparse = (sparse > 0.0).then_some((sparse, 0.2));
        dense
            .chain(sparse)
            .map(|(sd, share)| NoiseCell::new(takes, sd, share, self))
            .collect()
    }
}

/// The values of a cell by the name of the method, in the order in which methods were first seen.
#[derive(Debug, Clone, Default)]
pub struct ByMethod(Vec<(&'static str, Vec<f64>)>);

impl ByMethod {
    fn push(&mut self, method: &'static str, value: f64) {
        match self.0.iter_mut().find(|(name, _)| *name == method) {
            Some((_, values)) => values.push(value),
            None => self.0.push((method, vec![value])),
        }
    }

    /// The methods.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|(name, _)| *name)
    }

    /// The values of a method; none if it is unknown.
    pub(crate) fn of(&self, method: &str) -> &[f64] {
        let found = self.0.iter().find(|(name, _)| *name == method);
        found.map_or(&[], |(_, values)| values)
    }
}

/// The name of what is tested, in tables.
pub(crate) const RESTORED: &str = "posing";

/// The mean of squares; 0 for none.
fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    if n > 0.0 { sum / n } else { 0.0 }
}

/// The root of the mean of mean squares; `None` for none.
fn rms(mse: &[f64]) -> Option<f64> {
    (!mse.is_empty()).then(|| (mse.iter().sum::<f64>() / mse.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// A chain of points that swings: whole seconds at 60 frames a second.
    pub(crate) fn swinging(subject: &str, seconds: usize, phase: f64) -> (String, Poses) {
        let frames = 60 * seconds;
        let xyz = Array2::from_shape_fn((frames, 15), |(t, c)| {
            let (p, time) = ((c / 3) as f64, t as f64 / 60.0);
            match c % 3 {
                0 => 20.0 * p + 5.0 * (3.0 * time + phase + p).sin(),
                1 => 100.0 - 10.0 * p + 8.0 * (3.0 * time + phase + 0.5 * p).cos(),
                _ => 30.0 * time,
            }
        });
        let name = format!("{subject}_01");
        let poses = Poses {
            points: ["a", "b", "c", "d", "e"].map(String::from).to_vec(),
            xyz,
            time: Some((0..frames).map(|t| t as f64 / 60.0).collect()),
            take: Some(vec![name.as_str().into(); frames]),
        };
        (name, poses)
    }

    #[test]
    fn gaps_and_noise_are_tested_beside_their_rivals() {
        let takes = TestTakes::new(&[swinging("x", 12, 0.0), swinging("y", 12, 1.0)]).unwrap();
        let settings = TakesSettings {
            lengths: vec![GapLength::Seconds(0.3), GapLength::ToTheEnd],
            points: vec![1],
            gaps: 4,
            noise: vec![0.0, 1.0],
            seed: 0,
        };
        let report = takes
            .test(TestedModel::TakeAlone, &settings, &mut |_, _| ())
            .unwrap();
        let [gap, end] = &report.gaps[..] else {
            panic!("two lengths");
        };
        assert_eq!(gap.mse.of(RESTORED).len(), 4);
        assert_eq!(end.mse.of("linear").len(), 4);
        let rms = |cell: &GapCell, method: &str| cell.rms(method).unwrap();
        assert!(rms(gap, RESTORED) < 0.5 * rms(gap, "linear"));
        let [clean, noisy, outliers] = &report.noise[..] else {
            panic!("two levels and outliers");
        };
        assert!(clean.rms(RESTORED).unwrap() < 0.01);
        for cell in [noisy, outliers] {
            assert!(cell.rms(RESTORED).unwrap() < cell.rms("as captured").unwrap());
        }
        let again = takes
            .test(TestedModel::TakeAlone, &settings, &mut |_, _| ())
            .unwrap();
        assert_eq!(report.csv(), again.csv());
    }

    #[test]
    fn one_subject_leaves_nobody_to_learn_from() {
        let takes = TestTakes::new(&[swinging("x", 4, 0.0)]).unwrap();
        let settings = TakesSettings::default();
        let settings = TakesSettings {
            points: vec![1],
            ..settings
        };
        let error = takes
            .test(TestedModel::OthersOnly, &settings, &mut |_, _| ())
            .unwrap_err();
        assert!(error.to_string().contains("subject \"x\""), "{error}");
        let settings = TakesSettings {
            points: vec![5],
            ..settings
        };
        let error = takes.test(TestedModel::TakeAlone, &settings, &mut |_, _| ());
        assert!(error.unwrap_err().to_string().contains("1 to 4"));
    }
}

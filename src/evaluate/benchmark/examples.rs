//! Example poses for the report's figures: two test poses and part of a test take, the same for all methods.
//!
//! Examples belong to the first seed and the first split of the run that holds out whole takes; in a run of `frames` alone,
//! half of the frames shown are training poses. Examples are drawn and enter no table.

use super::config::Settings;
use super::dataset::Dataset;
use super::method::Method;
use super::splits::{Partition, Split};
use super::task::{DamagedPoses, PoseDamage, Task};
use crate::Result;
use crate::numeric::parallel;
use crate::prior::Posterior;
use ndarray::Array2;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Single poses.
const POSES: usize = 2;
/// Largest number of frames of the take, and frames a second: enough for a step or two.
const TAKE_FRAMES: usize = 96;
const RATE: f64 = 60.0;
/// The rate of a table without times.
const DEFAULT_RATE: f64 = 120.0;
/// Smallest distance by which feet pass each other in a step, cm.
const MIN_STEP: f64 = 10.0;
/// Largest number of methods that are drawn.
const MAX_METHODS: usize = 24;

/// The damage to an example pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExampleKind {
    /// A pose with the damage of a task.
    Pose(Task),
    /// A pose whose x and y are observed without noise, and no z: the paper's figure 5.
    Planar,
    /// The take_rows, completed from the observed joints: the paper's figure 6.
    Take,
}

impl ExampleKind {
    /// The kinds in a run of these tasks.
    pub fn of(tasks: &[Task]) -> Vec<ExampleKind> {
        let mut all: Vec<ExampleKind> = tasks.iter().map(|t| ExampleKind::Pose(*t)).collect();
        if tasks.contains(&Task::Complete) {
            all.extend([ExampleKind::Planar, ExampleKind::Take]);
        }
        all
    }

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            ExampleKind::Pose(task) => task.name(),
            ExampleKind::Planar => "flat",
            ExampleKind::Take => "stretch",
        }
    }

    /// The task that it is.
    pub fn task(self) -> Task {
        match self {
            ExampleKind::Pose(task) => task,
            ExampleKind::Planar | ExampleKind::Take => Task::Complete,
        }
    }
}

/// The rows of the example poses.
#[derive(Debug, Clone, PartialEq)]
pub struct ExamplePoses {
    /// The split.
    pub split: Split,
    /// The seed.
    pub seed: u64,
    /// The rows of the single poses.
    pub pose_rows: Vec<usize>,
    /// The rows of the take_rows, in time order.
    pub take_rows: Vec<usize>,
    /// The take_rows's frames a second.
    pub rate: f64,
}

/// The estimates of one method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodExamples {
    /// The method's name.
    pub model: String,
    /// By [`ExampleKind::name`], a pose a row: 3 J numbers, cm, to a tenth of a millimetre. A kind is absent where an answer was
    /// not finite.
    pub answers: BTreeMap<String, Vec<Vec<f64>>>,
}

/// The examples of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExampleSet {
    /// The poses; `None` if none were asked for.
    pub poses: Option<ExamplePoses>,
    /// The estimates of each method, in the settings' order.
    pub methods: Vec<MethodExamples>,
}

/// The split whose examples are kept.
pub fn split(splits: &[Split]) -> Option<Split> {
    let whole = splits.iter().find(|s| **s != Split::Frames);
    whole.or(splits.first()).copied()
}

/// The methods that are drawn: the first `MAX_METHODS`, with a named size or sparsity after the others.
pub fn shown_methods(methods: &[Method]) -> Vec<&str> {
    let (sweeps, plain): (Vec<&str>, Vec<&str>) = methods
        .iter()
        .map(|m| m.name.as_str())
        .partition(|n| n.contains(':'));
    let all = plain.into_iter().chain(sweeps);
    let chosen: Vec<&str> = all.take(MAX_METHODS).collect();
    let names = methods.iter().map(|m| m.name.as_str());
    names.filter(|n| chosen.contains(n)).collect()
}

impl ExamplePoses {
    /// Chooses the poses: two at random from different takes, and the middle of the test take that looks most like a run
    /// or a walk, its feet passing each other most often and most widely.
    pub fn choose(data: &Dataset, partition: &Partition) -> ExamplePoses {
        let mut tested: Vec<usize> = partition.test().iter().map(|&r| data.take_of(r)).collect();
        tested.dedup();
        let walks = tested.iter().copied().max_by(|&a, &b| {
            strides(data, a)
                .total_cmp(&strides(data, b))
                .then(b.cmp(&a))
        });
        let (mut take_rows, mut rate) = (Vec::new(), RATE);
        if let Some(take) = walks.map(|w| &data.takes[w]) {
            let variance = take.rate.unwrap_or(DEFAULT_RATE);
            let every = (variance / RATE).round().max(1.0) as usize;
            let count = TAKE_FRAMES.min(take.rows.len().div_ceil(every));
            let from = take.rows.start + (take.rows.len() - ((count - 1) * every + 1)) / 2;
            take_rows = (0..count).map(|i| from + i * every).collect();
            rate = variance / every as f64;
        }
        let mut rows = partition.test().to_vec();
        rows.shuffle(&mut parallel::rng(partition.seed(), 5));
        let mut pose_rows: Vec<usize> = Vec::new();
        let mut seen: Vec<usize> = walks.into_iter().collect();
        // From takes not seen yet as long as there are any.
        for fresh in [true, false] {
            for &row in &rows {
                let known = seen.contains(&data.take_of(row)) || pose_rows.contains(&row);
                if pose_rows.len() < POSES
                    && if fresh {
                        !known
                    } else {
                        !pose_rows.contains(&row)
                    }
                {
                    pose_rows.push(row);
                    seen.push(data.take_of(row));
                }
            }
        }
        ExamplePoses {
            split: partition.split(),
            seed: partition.seed(),
            pose_rows,
            take_rows,
            rate,
        }
    }

    /// The rows of a kind.
    pub fn rows(&self, kind: ExampleKind) -> &[usize] {
        match kind {
            ExampleKind::Take => &self.take_rows,
            _ => &self.pose_rows,
        }
    }

    /// The true poses of a kind, and what is seen of them.
    ///
    /// # Errors
    /// As [`PoseDamage::apply`].
    pub fn damaged(
        &self,
        data: &Dataset,
        settings: &Settings,
        kind: ExampleKind,
    ) -> Result<(Array2<f64>, DamagedPoses)> {
        let rows = self.rows(kind);
        let truth = data.rows(rows);
        if kind == ExampleKind::Planar {
            let missing = |c: usize| c % 3 == 2;
            let mut damaged = DamagedPoses {
                y: truth.clone(),
                variance: Array2::zeros(truth.dim()),
            };
            for c in (0..truth.ncols()).filter(|c| missing(*c)) {
                damaged.y.column_mut(c).fill(f64::NAN);
                damaged.variance.column_mut(c).fill(f64::INFINITY);
            }
            return Ok((truth, damaged));
        }
        let damage = PoseDamage {
            task: kind.task(),
            points: &data.points,
            observe: &settings.observe,
            base: 0.0,
            seed: self.seed,
            split: self.split,
        };
        let damaged = damage.apply(&truth, rows)?;
        Ok((truth, damaged))
    }

    /// The estimates of a method. `extra_variance` (cm²) is added to the noise variance that the method is given; `restore`
    /// restores poses.
    ///
    /// # Errors
    /// As [`ExamplePoses::damaged`].
    pub fn restored(
        &self,
        data: &Dataset,
        settings: &Settings,
        model: &str,
        extra_variance: &dyn Fn(Task) -> f64,
        restore: &dyn Fn(&DamagedPoses) -> Vec<Posterior>,
    ) -> Result<MethodExamples> {
        let mut answers = BTreeMap::new();
        for kind in ExampleKind::of(&settings.tasks) {
            let (_, mut damaged) = self.damaged(data, settings, kind)?;
            damaged.variance += extra_variance(kind.task());
            let short = |v: &f64| (v * 100.0).round() / 100.0;
            let poses: Vec<Vec<f64>> = restore(&damaged)
                .iter()
                .map(|b| b.mean.iter().map(short).collect())
                .collect();
            if poses.iter().flatten().all(|v| v.is_finite()) {
                answers.insert(kind.name().into(), poses);
            }
        }
        let model = model.into();
        Ok(MethodExamples { model, answers })
    }
}

impl MethodExamples {
    /// The answers to a kind as an array (frames, 3 J); `None` where there are none of that shape.
    pub fn poses(&self, kind: ExampleKind, (frames, width): (usize, usize)) -> Option<Array2<f64>> {
        let rows = self.answers.get(kind.name())?;
        let fits = rows.len() == frames && rows.iter().all(|r| r.len() == width);
        let flat: Vec<f64> = rows.iter().flatten().copied().collect();
        let array = Array2::from_shape_vec((frames, width), flat).ok()?;
        fits.then_some(array)
    }
}

/// How much a take looks like a run or a walk: steps a frame times the distance of the feet. Without feet: the variance of
/// the points.
fn strides(data: &Dataset, take: usize) -> f64 {
    let rows = data.takes[take].rows.clone();
    let foot = |name: &str| data.points.iter().position(|p| p == name);
    let frames = rows.len().max(1) as f64;
    let (Some(left), Some(right)) = (foot("lfoot"), foot("rfoot")) else {
        let poses = data.xyz.slice(ndarray::s![rows, ..]);
        return poses.columns().into_iter().fold(0.0, |sum, c| {
            sum + c.iter().map(|v| f64::from(v * v)).sum::<f64>() / frames
        });
    };
    let (z, x) = (2, 0);
    let apart = |axis: usize| {
        let own = data.xyz.slice(ndarray::s![rows.clone(), ..]);
        let one = own.rows().into_iter();
        one.map(|r| f64::from(r[3 * left + axis] - r[3 * right + axis]))
            .collect::<Vec<f64>>()
    };
    let ahead = apart(z);
    let middle = ahead.iter().sum::<f64>() / frames;
    let (mut steps, mut side) = (0.0, 0.0);
    for v in &ahead {
        let now = if (v - middle).abs() > MIN_STEP {
            (v - middle).signum()
        } else {
            side
        };
        if side != 0.0 && now != side {
            steps += 1.0;
        }
        side = now;
    }
    let rms = |v: &[f64]| {
        let mean = v.iter().sum::<f64>() / frames;
        (v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / frames).sqrt()
    };
    // Feet that also part sideways belong to a dance or a climb.
    steps / frames * (rms(&ahead) - rms(&apart(x))).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::*;

    fn settings() -> Settings {
        Settings {
            methods: ["pca", "ksvd:k=2", "gaussian"]
                .map(|n| Method::parse(n).unwrap())
                .to_vec(),
            ..Settings::default()
        }
    }

    #[test]
    fn examples_are_test_poses_and_repeatable() {
        let data = takes(&[
            ("01_01", 300),
            ("01_02", 250),
            ("01_03", 20),
            ("02_01", 90),
            ("02_02", 7),
        ]);
        for split in Split::ALL {
            for seed in 0..4 {
                let part = Partition::draw(&data, &[], split, seed).unwrap();
                let scenes = ExamplePoses::choose(&data, &part);
                assert_eq!(scenes, ExamplePoses::choose(&data, &part));
                assert_eq!(scenes.pose_rows.len(), POSES);
                assert!(scenes.pose_rows.iter().all(|r| part.test().contains(r)));
                let take = data.take_of(scenes.take_rows[0]);
                assert!(scenes.take_rows.len() <= TAKE_FRAMES);
                assert!(scenes.take_rows.iter().all(|r| data.take_of(*r) == take));
                assert!(scenes.take_rows.windows(2).all(|w| w[1] == w[0] + 2));
                if split != Split::Frames {
                    assert!(scenes.take_rows.iter().all(|r| part.test().contains(r)));
                }
            }
        }
    }

    #[test]
    fn a_walk_is_found_among_others() {
        let mut data = takes(&[("01_01", 200), ("01_02", 200), ("01_03", 200)]);
        let foot = |name: &str| data.points.iter().position(|p| p == name).unwrap();
        let (left, right) = (foot("lfoot"), foot("rfoot"));
        for (t, mut row) in data.xyz.rows_mut().into_iter().enumerate() {
            let swing = if (200..400).contains(&t) { 40.0 } else { 2.0 };
            let phase = (t as f32 * 0.1).sin();
            for (j, sign) in [(left, 1.0), (right, -1.0)] {
                row[3 * j] = 10.0 * sign;
                row[3 * j + 2] = sign * swing * phase;
            }
        }
        let score = |t| strides(&data, t);
        assert!(score(1) > score(0) && score(1) > score(2));
    }

    #[test]
    fn each_kind_has_its_damage() {
        let data = takes(&[("01_01", 60), ("01_02", 60)]);
        let part = Partition::draw(&data, &[], Split::Takes, 0).unwrap();
        let scenes = ExamplePoses::choose(&data, &part);
        let settings = settings();
        for kind in ExampleKind::of(&settings.tasks) {
            let (truth, seen) = scenes.damaged(&data, &settings, kind).unwrap();
            let missing = seen.y.iter().filter(|v| v.is_nan()).count();
            let rows = truth.nrows();
            let ought = match kind {
                ExampleKind::Planar => 23 * rows,
                ExampleKind::Take | ExampleKind::Pose(Task::Complete) => 17 * 3 * rows,
                _ => 0,
            };
            assert_eq!(missing, ought, "{kind:?}");
            assert!(
                seen.y
                    .iter()
                    .zip(&seen.variance)
                    .all(|(y, t)| y.is_nan() == (*t == f64::INFINITY))
            );
        }
        // The kinds of a run without completion need none of its joints.
        assert_eq!(
            ExampleKind::of(&[Task::Dense]),
            [ExampleKind::Pose(Task::Dense)]
        );
    }

    #[test]
    fn estimates_are_rounded_and_finite() {
        let data = takes(&[("01_01", 60), ("01_02", 60)]);
        let part = Partition::draw(&data, &[], Split::Takes, 0).unwrap();
        let (scenes, settings) = (ExamplePoses::choose(&data, &part), settings());
        let answer = |with: f64| {
            move |d: &DamagedPoses| {
                let rows = d.y.rows().into_iter();
                rows.map(|r| Posterior {
                    mean: r
                        .iter()
                        .map(|v| if v.is_nan() { with } else { *v })
                        .collect(),
                    ..Posterior::default()
                })
                .collect::<Vec<_>>()
            }
        };
        let variance = |with| {
            scenes
                .restored(&data, &settings, "x", &|_| 0.0, &answer(with))
                .unwrap()
        };
        let good = variance(1.0 / 3.0);
        assert_eq!(good.answers.len(), 5);
        let poses = good.poses(ExampleKind::Planar, (2, 69)).unwrap();
        assert_eq!(poses[[0, 5]], 0.33);
        assert!(good.poses(ExampleKind::Planar, (3, 69)).is_none());
        let bad = variance(f64::NAN);
        assert!(bad.poses(ExampleKind::Planar, (2, 69)).is_none() && bad.answers.len() == 2);
        let text = serde_json::to_string(&good).unwrap();
        assert_eq!(serde_json::from_str::<MethodExamples>(&text).unwrap(), good);
    }

    #[test]
    fn plain_methods_are_drawn_before_sweeps() {
        let mut settings = settings();
        assert_eq!(
            shown_methods(&settings.methods),
            ["pca", "ksvd:k=2", "gaussian"]
        );
        for k in 3..40 {
            settings
                .methods
                .insert(0, Method::parse(&format!("ksvd:k={k}")).unwrap());
        }
        let drawn = shown_methods(&settings.methods);
        assert!(drawn.len() == MAX_METHODS && drawn.contains(&"gaussian"));
        assert_eq!(
            split(&[Split::Frames, Split::Subjects]),
            Some(Split::Subjects)
        );
        assert_eq!(split(&[Split::Frames]), Some(Split::Frames));
    }
}

//! Poses to look at: a few test poses and a take_rows of one test take, the same for all methods, and what each makes of
//! them. They are drawn, not measured: tables come from [`super::cell`] alone.
//!
//! They are of the first seed, under the first split of the run that holds whole takes out (else under `frames`, where
//! half of what is seen was learnt from).

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

/// Poses that stand still.
const POSES: usize = 2;
/// Frames of the take_rows at most, and how many a second: enough to see a step or two, and small.
const TAKE_FRAMES: usize = 96;
const RATE: f64 = 60.0;
/// The rate where a table tells none.
const UNTOLD: f64 = 120.0;
/// Feet that pass each other by less, cm, make no step.
const STEP: f64 = 10.0;
/// Methods that are drawn at most: more cannot be looked at.
const MOST: usize = 24;

/// What is seen of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExampleKind {
    /// A pose damaged as a task says.
    Pose(Task),
    /// A pose of which x and y are seen, exactly, and no z: the paper's figure 5.
    Planar,
    /// The take_rows, completed from the observed joints: the paper's figure 6.
    Take,
}

impl ExampleKind {
    /// Those that a run of these tasks has.
    pub fn of(tasks: &[Task]) -> Vec<ExampleKind> {
        let mut all: Vec<ExampleKind> = tasks.iter().map(|t| ExampleKind::Pose(*t)).collect();
        if tasks.contains(&Task::Complete) {
            all.extend([ExampleKind::Planar, ExampleKind::Take]);
        }
        all
    }

    /// Its name in files.
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

/// Which poses are looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct ExamplePoses {
    /// Under which split.
    pub split: Split,
    /// With which seed.
    pub seed: u64,
    /// The rows of the poses that stand still.
    pub pose_rows: Vec<usize>,
    /// The rows of the take_rows, in time order.
    pub take_rows: Vec<usize>,
    /// The take_rows's frames a second.
    pub rate: f64,
}

/// What one method makes of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodExamples {
    /// The method's name.
    pub model: String,
    /// By [`ExampleKind::name`], a pose a row: 3 J numbers, cm, to a tenth of a millimetre. A kind is absent where an answer was
    /// not finite.
    pub answers: BTreeMap<String, Vec<Vec<f64>>>,
}

/// What is known after a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExampleSet {
    /// Which poses; `None` where none were asked for.
    pub poses: Option<ExamplePoses>,
    /// What each method made of them, in the settings' order.
    pub methods: Vec<MethodExamples>,
}

/// The split whose examples are kept.
pub fn split(splits: &[Split]) -> Option<Split> {
    let whole = splits.iter().find(|s| **s != Split::Frames);
    whole.or(splits.first()).copied()
}

/// Which methods are drawn: all, or the first so many, those of a named size or sparsity last.
pub fn shown_methods(methods: &[Method]) -> Vec<&str> {
    let (sweeps, plain): (Vec<&str>, Vec<&str>) = methods
        .iter()
        .map(|m| m.name.as_str())
        .partition(|n| n.contains(':'));
    let all = plain.into_iter().chain(sweeps);
    let chosen: Vec<&str> = all.take(MOST).collect();
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
            let variance = take.rate.unwrap_or(UNTOLD);
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

    /// Lets a method answer: `more` is what it is told of noise besides, cm², `answer` restores.
    ///
    /// # Errors
    /// As [`ExamplePoses::damaged`].
    pub fn restored(
        &self,
        data: &Dataset,
        settings: &Settings,
        model: &str,
        more: &dyn Fn(Task) -> f64,
        answer: &dyn Fn(&DamagedPoses) -> Vec<Posterior>,
    ) -> Result<MethodExamples> {
        let mut answers = BTreeMap::new();
        for kind in ExampleKind::of(&settings.tasks) {
            let (_, mut damaged) = self.damaged(data, settings, kind)?;
            damaged.variance += more(kind.task());
            let short = |v: &f64| (v * 100.0).round() / 100.0;
            let poses: Vec<Vec<f64>> = answer(&damaged)
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

/// How much a take looks like a run or a walk: how often a frame the feet pass each other, times how far apart they come.
/// Without feet: how far the points stray.
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
        let now = if (v - middle).abs() > STEP {
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
    // Legs that part sideways as well are a dance or a climb.
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
    fn poses_are_test_poses_and_the_same_each_time() {
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
    fn what_is_seen_is_what_each_sight_says() {
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
    fn answers_are_short_and_finite() {
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
        assert!(drawn.len() == MOST && drawn.contains(&"gaussian"));
        assert_eq!(
            split(&[Split::Frames, Split::Subjects]),
            Some(Split::Subjects)
        );
        assert_eq!(split(&[Split::Frames]), Some(Split::Frames));
    }
}

//! Example poses for the report's figures: two test poses and part of a test take, the same for all
//! methods.
//!
//! Examples belong to the first seed and the first split of the run that holds out whole takes; in
//! a run of `frames` alone, half of the frames shown are training poses. Examples are drawn and
//! enter no table.

use super::dataset::Dataset;
use super::splits::{Partition, Split};
use super::task::{DamagedPoses, PoseDamage, Task};
use crate::Result;
use crate::numeric::parallel;
use rand::seq::SliceRandom;

/// Largest number of frames of the take, and frames a second: enough for a step or two.
const TAKE_FRAMES: usize = 96;
const RATE: f64 = 60.0;
/// The rate of a table without times.
const DEFAULT_RATE: f64 = 120.0;

/// The damage to an example pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ExampleKind {
    /// A pose with the damage of a task.
    Pose(Task),
    /// A pose whose x and y are observed without noise, and no z: Lai et al.'s figure 5.
    Planar,
    /// The part of a take, completed from the observed joints: Lai et al.'s figure 6.
    Take,
}

impl ExampleKind {
    /// The kinds that belong to a task.
    pub(crate) fn of(task: Task) -> Vec<ExampleKind> {
        match task {
            Task::Complete => vec![
                ExampleKind::Pose(task),
                ExampleKind::Planar,
                ExampleKind::Take,
            ],
            _ => vec![ExampleKind::Pose(task)],
        }
    }

    /// The name in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            ExampleKind::Pose(task) => task.name(),
            ExampleKind::Planar => "flat",
            ExampleKind::Take => "stretch",
        }
    }

    /// The task that the kind belongs to.
    pub(crate) fn task(self) -> Task {
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
    /// The rows of two single poses.
    pub pose_rows: Vec<usize>,
    /// The rows of the part of a take, in time order.
    pub take_rows: Vec<usize>,
    /// Frames a second of the part of a take.
    pub rate: f64,
}

impl ExamplePoses {
    /// The split whose examples are kept.
    pub(crate) fn split(splits: &[Split]) -> Option<Split> {
        let whole = splits.iter().find(|s| **s != Split::Frames);
        whole.or(splits.first()).copied()
    }

    /// Chooses two test poses at random, from different takes if there are two, and the middle of
    /// the longest test take.
    pub(crate) fn choose(data: &Dataset, partition: &Partition) -> ExamplePoses {
        let mut rows = partition.test.clone();
        let take_of = |row: &usize| &data.takes[data.take_of(*row)];
        let longest = rows.iter().map(take_of).max_by_key(|t| t.rows.len());
        let (mut take_rows, mut rate) = (Vec::new(), RATE);
        if let Some(take) = longest {
            let captured = take.rate.unwrap_or(DEFAULT_RATE);
            let every = (captured / RATE).round().max(1.0) as usize;
            let count = TAKE_FRAMES.min(take.rows.len().div_ceil(every));
            let from = take.rows.start + (take.rows.len() - ((count - 1) * every + 1)) / 2;
            take_rows = (0..count).map(|i| from + i * every).collect();
            rate = captured / every as f64;
        }
        rows.shuffle(&mut parallel::rng(partition.seed, 5));
        let other = |row: &&usize| take_of(row) != take_of(&rows[0]);
        let second = rows.iter().find(other).or(rows.get(1));
        ExamplePoses {
            split: partition.split,
            seed: partition.seed,
            pose_rows: rows.first().into_iter().chain(second).copied().collect(),
            take_rows,
            rate,
        }
    }

    /// The damaged poses of a kind; `observe` are the points that completion observes.
    ///
    /// # Errors
    /// As [`PoseDamage::apply`].
    pub(crate) fn damaged(
        &self,
        data: &Dataset,
        observe: &[String],
        kind: ExampleKind,
    ) -> Result<DamagedPoses> {
        let rows = match kind {
            ExampleKind::Take => &self.take_rows,
            _ => &self.pose_rows,
        };
        if kind == ExampleKind::Planar {
            let mut damaged = DamagedPoses::undamaged(data, rows);
            for z in (2..damaged.y.ncols()).step_by(3) {
                damaged.y.column_mut(z).fill(f64::NAN);
                damaged.variance.column_mut(z).fill(f64::INFINITY);
            }
            return Ok(damaged);
        }
        let damage = PoseDamage {
            task: kind.task(),
            observe,
            base: 0.0,
            seed: self.seed,
            split: self.split,
        };
        damage.apply(data, rows)
    }
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::*;
    use crate::pose::joints::PAPER_SIX;

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
                let poses = ExamplePoses::choose(&data, &part);
                assert_eq!(poses, ExamplePoses::choose(&data, &part));
                assert_eq!(poses.pose_rows.len(), 2);
                assert!(poses.pose_rows.iter().all(|r| part.test.contains(r)));
                let take = data.take_of(poses.take_rows[0]);
                assert!(poses.take_rows.len() <= TAKE_FRAMES);
                assert!(poses.take_rows.iter().all(|r| data.take_of(*r) == take));
                assert!(poses.take_rows.windows(2).all(|w| w[1] == w[0] + 2));
                if split != Split::Frames {
                    assert!(poses.take_rows.iter().all(|r| part.test.contains(r)));
                }
            }
        }
        let [frames, subjects] = [Split::Frames, Split::Subjects];
        assert_eq!(ExamplePoses::split(&[frames, subjects]), Some(subjects));
        assert_eq!(ExamplePoses::split(&[frames]), Some(frames));
    }

    #[test]
    fn each_kind_has_its_damage() {
        let data = takes(&[("01_01", 60), ("01_02", 60)]);
        let part = Partition::draw(&data, &[], Split::Takes, 0).unwrap();
        let poses = ExamplePoses::choose(&data, &part);
        let observe = PAPER_SIX.map(String::from);
        for kind in Task::ALL.into_iter().flat_map(ExampleKind::of) {
            let damaged = poses.damaged(&data, &observe, kind).unwrap();
            let missing = damaged.y.iter().filter(|v| v.is_nan()).count();
            let rows = damaged.rows.len();
            let expected = match kind {
                ExampleKind::Planar => 23 * rows,
                ExampleKind::Take | ExampleKind::Pose(Task::Complete) => 17 * 3 * rows,
                _ => 0,
            };
            assert_eq!(missing, expected, "{kind:?}");
            let mut both = damaged.y.iter().zip(&damaged.variance);
            assert!(both.all(|(y, v)| y.is_nan() == (*v == f64::INFINITY)));
        }
    }
}

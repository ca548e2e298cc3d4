//! The paper's three tasks (section 4): what is done to a clean pose, and what a method is told of it.

use super::splits::Split;
use crate::evaluate::corruption::Corruption;
use crate::numeric::parallel;
use crate::pose::ASF_UNIT_CM;
use crate::{Error, Result};
use ndarray::Array2;
use rand::RngCore;
use serde::{Deserialize, Serialize};

/// The probability that a joint is hit in [`Task::Sparse`].
pub const SHARE: f64 = 0.2;

/// What is done to a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Noise N(0, 1 asf) on every coordinate; the method is told its variance.
    Dense,
    /// Noise N(0, 1 asf) on every coordinate of a joint with probability 0.2. Which joints is not told: a plain method is
    /// told that all are clean, and reckons with a noise of its own; a treated one finds them.
    Sparse,
    /// Only the six joints of the paper's test are seen, exactly.
    Complete,
}

impl Task {
    /// All there are.
    pub const ALL: [Task; 3] = [Task::Dense, Task::Sparse, Task::Complete];

    /// The name a user types.
    pub fn name(self) -> &'static str {
        match self {
            Task::Dense => "dense",
            Task::Sparse => "sparse",
            Task::Complete => "complete",
        }
    }

    /// The task of a name.
    pub fn parse(name: &str) -> Result<Task> {
        let found = Task::ALL.into_iter().find(|t| t.name() == name);
        found.ok_or_else(|| {
            Error::usage(format!(
                "--tasks {name}: expected dense, sparse or complete"
            ))
        })
    }
}

/// The mean variance of a coordinate's noise in [`Task::Sparse`], cm²: what a plain method without a noise of its own is
/// told on top.
pub const SPARSE_MEAN: f64 = SHARE * ASF_UNIT_CM * ASF_UNIT_CM;

/// What is done to poses, and by which draws.
#[derive(Debug, Clone, Copy)]
pub struct PoseDamage<'a> {
    /// The task.
    pub task: Task,
    /// The points' names, J of them.
    pub points: &'a [String],
    /// The points that [`Task::Complete`] leaves.
    pub observe: &'a [String],
    /// Standard deviation of the noise on every clean or exact coordinate, cm; 0 is none.
    pub base: f64,
    /// Draws depend on the seed, the split and the task; a pose's on its row too, whatever the others are.
    pub seed: u64,
    /// The split.
    pub split: Split,
}

/// DamagedPoses poses and what is told of them.
#[derive(Debug, Clone)]
pub struct DamagedPoses {
    /// (frames, 3 J), cm; NaN where missing.
    pub y: Array2<f64>,
    /// The variance that a plain method is told, (frames, 3 J), cm²: 0 exact, infinite missing.
    pub variance: Array2<f64>,
}

impl PoseDamage<'_> {
    /// Damages poses (frames, 3 J), cm; `rows` are their numbers in the whole data.
    ///
    /// # Errors
    /// [`Error::Usage`] where the data lack a joint that completion is to see, or all would be seen.
    pub fn apply(&self, truth: &Array2<f64>, rows: &[usize]) -> Result<DamagedPoses> {
        let stream = 16 + 8 * self.split as u64 + self.task as u64;
        let mut seeds = parallel::rng(self.seed, stream);
        let (hit_seed, base_seed) = (seeds.next_u64(), seeds.next_u64());
        let hits = Corruption {
            dense: self.when(Task::Dense),
            sparse: self.when(Task::Sparse),
            share: SHARE,
            keep: (self.task == Task::Complete).then(|| self.observe.to_vec()),
            seed: hit_seed,
            ..Corruption::default()
        };
        let hits = hits.check(self.points)?;
        let base = Corruption {
            dense: self.base,
            seed: base_seed,
            ..Corruption::default()
        };
        let base = base.check(self.points)?;
        let mut y = truth.clone();
        let mut variance = Array2::zeros(truth.dim());
        for (i, (clean, row)) in truth.rows().into_iter().zip(rows).enumerate() {
            let mut hit = clean.to_vec();
            hits.apply(*row as u64, &mut hit);
            let mut based = clean.to_vec();
            base.apply(*row as u64, &mut based);
            for c in 0..hit.len() {
                let untouched = hit[c] == clean[c];
                y[[i, c]] = if untouched { based[c] } else { hit[c] };
                variance[[i, c]] = self.variance(hit[c].is_nan());
            }
        }
        Ok(DamagedPoses { y, variance })
    }

    fn when(&self, task: Task) -> f64 {
        if self.task == task { ASF_UNIT_CM } else { 0.0 }
    }

    /// What a plain method is told of a coordinate.
    fn variance(&self, missing: bool) -> f64 {
        let (unit, base) = (ASF_UNIT_CM * ASF_UNIT_CM, self.base * self.base);
        match self.task {
            Task::Dense => unit,
            Task::Complete if missing => f64::INFINITY,
            Task::Sparse | Task::Complete => base,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints::{PAPER_SIX, cmu_names};

    fn damaged(task: Task, base: f64, seed: u64, rows: &[usize]) -> DamagedPoses {
        let (points, observe) = (cmu_names(), PAPER_SIX.map(String::from));
        let damage = PoseDamage {
            task,
            points: &points,
            observe: &observe,
            base,
            seed,
            split: Split::Takes,
        };
        damage.apply(&Array2::ones((rows.len(), 69)), rows).unwrap()
    }

    #[test]
    fn each_task_does_and_tells_what_it_says() {
        let rows: Vec<usize> = (0..400).collect();
        let unit = ASF_UNIT_CM * ASF_UNIT_CM;
        let mse = |d: &DamagedPoses| d.y.mapv(|v| (v - 1.0).powi(2)).mean().unwrap();
        let dense = damaged(Task::Dense, 0.0, 1, &rows);
        assert!((mse(&dense) / unit - 1.0).abs() <= 0.05);
        assert!(dense.variance.iter().all(|v| *v == unit));
        let sparse = damaged(Task::Sparse, 0.0, 1, &rows);
        assert!((mse(&sparse) / unit - 0.2).abs() <= 0.02);
        assert!(sparse.variance.iter().all(|v| *v == 0.0));
        let complete = damaged(Task::Complete, 0.0, 1, &rows);
        let seen = complete.y.iter().filter(|v| !v.is_nan()).count();
        assert_eq!(seen, 400 * 18);
        for (y, told) in complete.y.iter().zip(&complete.variance) {
            assert!(if y.is_nan() {
                *told == f64::INFINITY
            } else {
                *told == 0.0 && *y == 1.0
            });
        }
    }

    #[test]
    fn base_noise_falls_on_what_was_clean_alone() {
        let rows: Vec<usize> = (0..400).collect();
        let (without, with) = (
            damaged(Task::Sparse, 0.0, 1, &rows),
            damaged(Task::Sparse, 0.3, 1, &rows),
        );
        let mut base = Vec::new();
        for (a, b) in without.y.iter().zip(&with.y) {
            if *a == 1.0 {
                base.push(b - 1.0);
            } else {
                assert_eq!(a, b);
            }
        }
        let sd = (base.iter().map(|v| v * v).sum::<f64>() / base.len() as f64).sqrt();
        assert!((sd - 0.3).abs() <= 0.01, "{sd}");
        let complete = damaged(Task::Complete, 0.3, 1, &rows);
        assert!(
            complete
                .variance
                .iter()
                .all(|v| *v == 0.3 * 0.3 || *v == f64::INFINITY)
        );
    }

    #[test]
    fn draws_depend_on_seed_task_and_row_alone() {
        let all = damaged(Task::Dense, 0.0, 1, &[3, 9, 20]);
        let one = damaged(Task::Dense, 0.0, 1, &[9]);
        assert_eq!(all.y.row(1), one.y.row(0));
        assert_ne!(one.y, damaged(Task::Dense, 0.0, 2, &[9]).y);
        assert_ne!(one.y, damaged(Task::Dense, 0.0, 1, &[10]).y);
    }

    #[test]
    fn a_joint_that_is_not_there_is_named() {
        let damage = PoseDamage {
            task: Task::Complete,
            points: &["root".to_string()],
            observe: &["lwrist".to_string()],
            base: 0.0,
            seed: 0,
            split: Split::Frames,
        };
        let e = damage.apply(&Array2::zeros((1, 3)), &[0]).unwrap_err();
        assert!(e.to_string().contains("lwrist"), "{e}");
        assert!(Task::parse("jump").is_err());
    }
}

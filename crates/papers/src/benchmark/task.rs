//! The three tasks of Lai et al. (section 4): the damage to a clean pose, and the noise variance
//! that a method is given.

use super::dataset::Dataset;
use super::splits::Split;
use crate::numeric::parallel;
use crate::pose::ASF_UNIT_CM;
use crate::score::damage::Corruption;
use crate::{Error, Result};
use ndarray::Array2;
use rand::RngCore;
use serde::{Deserialize, Serialize};

/// The probability that [`Task::Sparse`] changes a joint.
pub(crate) const SPARSE_SHARE: f64 = 0.2;

/// The damage to a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Noise N(0, 1 asf) on every coordinate; the method is given its variance.
    Dense,
    /// Noise N(0, 1 asf) on the coordinates of each joint with probability 0.2. The method is not
    /// told which joints: a plain method is given variance 0 and assumes a noise of its own,
    /// one with outlier detection finds the joints.
    Sparse,
    /// Only the observed joints (Lai et al.'s six by default) are given, without noise.
    Complete,
}

names!(Task {
    Dense = "dense",
    Sparse = "sparse",
    Complete = "complete",
});

impl Task {
    /// Parses a name.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown name.
    pub fn parse(name: &str) -> Result<Task> {
        Task::of_name(name).ok_or_else(|| {
            Error::usage(format!(
                "the option `tasks {name}`: expected dense, sparse or complete"
            ))
        })
    }
}

/// The mean noise variance of a coordinate in [`Task::Sparse`], cm². Added for a method that
/// assumes no noise of its own.
pub(crate) const SPARSE_MEAN_VARIANCE: f64 = SPARSE_SHARE * ASF_UNIT_CM * ASF_UNIT_CM;

/// Parameters of the damage to a set of poses.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseDamage<'a> {
    /// The task.
    pub task: Task,
    /// The points that [`Task::Complete`] keeps.
    pub observe: &'a [String],
    /// Standard deviation of the base noise on coordinates that the task leaves clean, cm; 0 is
    /// none.
    pub base: f64,
    /// The seed. Noise depends on seed, split, task and the row of the pose, not on the other
    /// rows.
    pub seed: u64,
    /// The split.
    pub split: Split,
}

/// Damaged poses and the noise variances that a method is given.
#[derive(Debug, Clone)]
pub(crate) struct DamagedPoses {
    /// The poses' rows in the dataset.
    pub rows: Vec<usize>,
    /// The clean poses: (frames, 3 J), cm.
    pub truth: Array2<f64>,
    /// (frames, 3 J), cm; NaN where missing.
    pub y: Array2<f64>,
    /// (frames, 3 J), cm²: 0 is exact, infinity missing.
    pub variance: Array2<f64>,
}

impl PoseDamage<'_> {
    /// Damages some rows of a dataset.
    ///
    /// # Errors
    /// [`Error::Usage`] if an observed point does not exist.
    pub(crate) fn apply(&self, data: &Dataset, rows: &[usize]) -> Result<DamagedPoses> {
        let stream = 16 + 8 * self.split as u64 + self.task as u64;
        let mut seeds = parallel::rng(self.seed, stream);
        let (hit_seed, base_seed) = (seeds.next_u64(), seeds.next_u64());
        let hits = Corruption {
            dense: self.noise_of(Task::Dense),
            sparse: self.noise_of(Task::Sparse),
            share: SPARSE_SHARE,
            keep: (self.task == Task::Complete).then(|| self.observe.to_vec()),
            seed: hit_seed,
            ..Corruption::default()
        };
        let hits = hits.check(&data.points)?;
        let base = Corruption {
            dense: self.base,
            seed: base_seed,
            ..Corruption::default()
        };
        let base = base.check(&data.points)?;
        let mut damaged = DamagedPoses::undamaged(data, rows);
        for (i, &row) in rows.iter().enumerate() {
            let clean = damaged.truth.row(i).to_vec();
            let (mut hit, mut based) = (clean.clone(), clean.clone());
            hits.apply(row as u64, &mut hit);
            base.apply(row as u64, &mut based);
            for c in 0..hit.len() {
                let untouched = hit[c] == clean[c];
                damaged.y[[i, c]] = if untouched { based[c] } else { hit[c] };
                damaged.variance[[i, c]] = self.variance(hit[c].is_nan());
            }
        }
        Ok(damaged)
    }

    fn noise_of(&self, task: Task) -> f64 {
        if self.task == task { ASF_UNIT_CM } else { 0.0 }
    }

    /// The noise variance of a coordinate that a method is given, cm².
    fn variance(&self, missing: bool) -> f64 {
        let (unit, base) = (ASF_UNIT_CM * ASF_UNIT_CM, self.base * self.base);
        match self.task {
            Task::Dense => unit,
            Task::Complete if missing => f64::INFINITY,
            Task::Sparse | Task::Complete => base,
        }
    }
}

impl DamagedPoses {
    /// Rows of a dataset as they are, known exactly.
    pub(crate) fn undamaged(data: &Dataset, rows: &[usize]) -> DamagedPoses {
        let truth = data.rows(rows);
        DamagedPoses {
            rows: rows.to_vec(),
            y: truth.clone(),
            variance: Array2::zeros(truth.dim()),
            truth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::*;
    use crate::pose::joints::PAPER_SIX;

    /// Frames of a take with all coordinates 1.
    fn damaged(task: Task, base: f64, seed: u64, rows: &[usize]) -> DamagedPoses {
        let mut data = takes(&[("01_01", 400)]);
        data.xyz.fill(1.0);
        let observe = PAPER_SIX.map(String::from);
        let damage = PoseDamage {
            task,
            observe: &observe,
            base,
            seed,
            split: Split::Takes,
        };
        damage.apply(&data, rows).unwrap()
    }

    #[test]
    fn each_task_damages_and_states_its_variance() {
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
        for (y, variance) in complete.y.iter().zip(&complete.variance) {
            assert!(if y.is_nan() {
                *variance == f64::INFINITY
            } else {
                *variance == 0.0 && *y == 1.0
            });
        }
    }

    #[test]
    fn base_noise_changes_clean_coordinates_only() {
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
    fn noise_depends_on_seed_task_and_row_only() {
        let all = damaged(Task::Dense, 0.0, 1, &[3, 9, 20]);
        let one = damaged(Task::Dense, 0.0, 1, &[9]);
        assert_eq!(all.y.row(1), one.y.row(0));
        assert_ne!(one.y, damaged(Task::Dense, 0.0, 2, &[9]).y);
        assert_ne!(one.y, damaged(Task::Dense, 0.0, 1, &[10]).y);
    }

    #[test]
    fn an_unknown_joint_is_named() {
        let damage = PoseDamage {
            task: Task::Complete,
            observe: &["tail".to_string()],
            base: 0.0,
            seed: 0,
            split: Split::Frames,
        };
        let e = damage.apply(&takes(&[("01_01", 1)]), &[0]).unwrap_err();
        assert!(e.to_string().contains("tail"), "{e}");
        assert!(Task::parse("jump").is_err());
    }
}

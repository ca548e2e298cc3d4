//! The training pose nearest to the observation.
//!
//! x = argmin_n Σ_o (y_o − x_no)² / (R_o + h²) over the observed coordinates o with noise variances R_o. Its
//! variance is h², the mean squared error per coordinate of held-out poses: one number for each task.
//!
//! Cost: one search of [`BoxTree`]. The answer is never better than the nearest training pose.

use super::box_tree::BoxTree;
use crate::Result;
use crate::io::Model;
use crate::numeric::parallel;
use crate::pose::{Observation, PoseTransform};
use crate::prior::model_arrays;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::tuning::{ASF2, Grid, PriorFamily, Setting, Task, TunedPrior, Tuning};
use crate::prior::{OpenOptions, Posterior, Prior, Want};
use ndarray::{Array2, ArrayView2};
use std::sync::Arc;

/// h² while the error is measured, asf². It matters only if coordinates differ in their noise.
const FIRST: f64 = 0.1;
/// Observations of one chunk; each search starts from the answer before.
const RUN: usize = 64;

/// The prior: the nearest training pose.
#[derive(Debug, Clone)]
pub struct NearestNeighborPrior {
    tree: Arc<BoxTree>,
    /// h², cm².
    width: f64,
    variance: Vec<f64>,
    typical: Arc<Array2<f64>>,
}

impl NearestNeighborPrior {
    /// From a model of kind `nearest`: `poses` (n, D), and its tuning; an inflation of 1 is an error h² of 1 asf².
    ///
    /// # Errors
    /// Data: no such array, a wrong shape, numbers that are not finite.
    pub fn open(model: &Model, options: &OpenOptions, source: &str) -> Result<TunedPrior> {
        model_arrays::open_exemplars(model, options, source, family)
    }

    fn new(tree: Arc<BoxTree>, typical: Arc<Array2<f64>>, width: f64) -> NearestNeighborPrior {
        NearestNeighborPrior {
            variance: vec![width; tree.poses().ncols()],
            tree,
            width,
            typical,
        }
    }

    /// The row of the nearest pose and the log density of the observed; `None` where there are no poses.
    fn nearest(&self, y: &[f64], noise: &[f64], like: &[u32]) -> Option<(u32, f64)> {
        let weight = |n: &f64| 1.0 / (n.max(0.0) + self.width);
        let weights: Vec<f64> = noise.iter().map(weight).collect();
        let near = *self.tree.nearest(y, &weights, 1, like).first()?;
        let observed = weights.iter().filter(|w| **w > 0.0);
        let constant: f64 = observed
            .map(|w| (2.0 * std::f64::consts::PI / w).ln())
            .sum();
        Some((near.index, -0.5 * (near.squared + constant)))
    }

    fn answer(&self, observation: &Observation<'_>, want: Want, like: &mut Vec<u32>) -> Posterior {
        let (y, noise) = (observation.values, observation.variance);
        let Some((row, log_evidence)) = self.nearest(y, noise, like) else {
            return Posterior::default();
        };
        like.clear();
        like.push(row);
        let poses = self.tree.poses();
        let mut posterior = Posterior {
            mean: poses
                .row(row as usize)
                .iter()
                .map(|v| f64::from(*v))
                .collect(),
            log_evidence,
            ..Posterior::default()
        };
        if want != Want::Mean {
            posterior.variance = self.variance.clone();
        }
        if matches!(want, Want::Covariance | Want::CovarianceBelow(_)) {
            posterior.covariance = Array2::from_diag_elem(self.variance.len(), self.width);
        }
        posterior
    }
}

impl Prior for NearestNeighborPrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        self.answer(observation, want, &mut Vec::new())
    }

    fn posterior_batch(&self, batch: &[(Observation<'_>, Want)]) -> Vec<Posterior> {
        let runs = parallel::map_chunks(batch.len(), RUN, |rows| {
            let mut like = Vec::new();
            let run = batch[rows].iter();
            run.map(|(o, want)| self.answer(o, *want, &mut like))
                .collect::<Vec<_>>()
        });
        runs.into_iter().flatten().collect()
    }

    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        self.typical.view()
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        let tree = self.tree.mapped(map);
        let typical = map.apply_rows(self.typical.view());
        Box::new(NearestNeighborPrior::new(
            Arc::new(tree),
            Arc::new(typical),
            self.width,
        ))
    }
}

/// The prior at any width h².
fn family(poses: ArrayView2<'_, f32>, typical: Array2<f64>) -> PriorFamily<'static> {
    let tree = Arc::new(BoxTree::new(poses));
    let typical = Arc::new(typical);
    Box::new(move |setting: Setting| {
        let width = setting.inflation * ASF2;
        Box::new(NearestNeighborPrior::new(
            tree.clone(),
            typical.clone(),
            width,
        ))
    })
}

/// Makes a model of kind `nearest`: the poses, and how far off they are task by task.
///
/// # Errors
/// Data: no poses to learn from.
pub fn train(
    poses: &TrainingSet,
    options: &TrainOptions,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    let grid = Grid {
        inflation: vec![FIRST],
        sparse: vec![0.0],
        complete: vec![0.0],
    };
    let (mut model, mut tuning) =
        model_arrays::train_exemplars("nearest", poses, options, &grid, family, report)?;
    set_widths(&mut tuning);
    tuning.write(&mut model);
    Ok(model)
}

/// Replaces the provisional width by the measured errors.
fn set_widths(tuning: &mut Tuning) {
    let chosen = &mut tuning.chosen;
    for tried in &tuning.curve {
        let setting = match tried.task {
            Task::Dense => &mut chosen.dense,
            Task::Sparse => &mut chosen.sparse,
            Task::Complete => &mut chosen.complete,
            Task::Treated => &mut chosen.treated,
        };
        setting.inflation = (tried.mse / ASF2).max(1e-6);
        setting.noise = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;
    use crate::prior::testdata::Ask;
    use glam::DVec3;

    fn poses(n: usize) -> Array2<f32> {
        Array2::from_shape_fn((n, 6), |(t, c)| {
            (30.0 * (t as f32 * 0.1 + c as f32).sin()) + (t % 3) as f32
        })
    }

    fn prior(n: usize) -> NearestNeighborPrior {
        let typical = poses(2).mapv(f64::from);
        let tree = BoxTree::new(poses(n).view());
        NearestNeighborPrior::new(Arc::new(tree), Arc::new(typical), 0.25)
    }

    #[test]
    fn a_training_pose_is_its_own_answer_seen_whole_or_in_part() {
        let all = poses(90);
        let prior = prior(90);
        for t in [0, 31, 89] {
            let y: Vec<f64> = all.row(t).iter().map(|v| f64::from(*v)).collect();
            let belief = prior.full(&y, &[0.0; 6]);
            assert_eq!(belief.mean, y);
            assert!(belief.covariance.diag().iter().all(|v| *v == 0.25));
            let log = -3.0 * (2.0 * std::f64::consts::PI * 0.25).ln();
            assert!((belief.log_evidence - log).abs() <= 1e-12);
            let mut part = y.clone();
            part[4] = f64::NAN;
            let mut noise = [0.0; 6];
            noise[4] = f64::INFINITY;
            assert_eq!(prior.full(&part, &noise).mean, y);
        }
        let nothing = prior.full(&[f64::NAN; 6], &[f64::INFINITY; 6]);
        assert!(nothing.log_evidence == 0.0 && nothing.mean.iter().all(|v| v.is_finite()));
    }

    #[test]
    fn one_after_another_is_one_by_one() {
        let prior = prior(200);
        let y = poses(150).mapv(f64::from) + 0.4;
        let noise = Array2::from_elem(y.dim(), 1.0);
        for (i, belief) in prior.full_rows(y.view(), noise.view()).iter().enumerate() {
            assert_eq!(*belief, prior.full(&y.row(i).to_vec(), &[1.0; 6]));
        }
    }

    #[test]
    fn turned_poses_are_answered_turned() {
        let prior = prior(100);
        let map = PoseTransform::Rotate(from_rotation_vector(DVec3::new(0.1, 2.0, -0.3)));
        let y = vec![3.0, -4.0, 9.0, 11.0, 2.0, 0.5];
        let (mut turned, mut want) = (vec![0.0; 6], vec![0.0; 6]);
        map.apply(&y, &mut turned);
        map.apply(&prior.full(&y, &[1.0; 6]).mean, &mut want);
        let got = prior.mapped(&map).full(&turned, &[1.0; 6]).mean;
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() <= 1e-4));
    }
}

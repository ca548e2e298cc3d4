//! The training pose nearest to the observation.
//!
//! x = argmin_n Σ_o (y_o − x_no)² / (R_o + h²) over the observed coordinates o with noise variances
//! R_o. Its variance is h², the mean squared error per coordinate of held-out poses: one number for
//! each task.
//!
//! Cost: one search of [`BoxTree`]. The answer is never better than the nearest training pose.

use super::box_tree::BoxTree;
use crate::pose::{Observation, PoseTransform};
use crate::prior::exemplar::ExemplarKind;
use crate::prior::tuning::{ASF2, Grid, PriorFamily, Setting, Tuning};
use crate::prior::{Posterior, Prior, Want};
use ndarray::{Array2, ArrayView2};
use std::f64::consts::PI;
use std::sync::Arc;

/// h² while the error is measured, asf². It matters only if coordinates differ in their noise.
const FIRST: f64 = 0.1;

/// The kind `nearest`; an inflation of 1 is an error h² of 1 asf².
pub(crate) const KIND: ExemplarKind = ExemplarKind {
    name: "nearest",
    grid: || Grid {
        inflation: vec![FIRST],
        sparse: vec![0.0],
        complete: vec![0.0],
    },
    prior,
    adjust: set_widths,
};

fn prior(poses: ArrayView2<'_, f32>) -> PriorFamily {
    let tree = Arc::new(BoxTree::new(poses));
    Box::new(move |inflation| Box::new(NearestNeighborPrior::new(tree.clone(), inflation * ASF2)))
}

/// Replaces the provisional width by the measured errors.
fn set_widths(tuning: &mut Tuning) {
    for tried in &tuning.curve {
        let setting = Setting {
            inflation: (tried.mse / ASF2).max(1e-6),
            noise: 0.0,
        };
        tuning.chosen.set(tried.task, setting);
    }
}

/// The prior: the nearest training pose.
#[derive(Debug, Clone)]
pub(crate) struct NearestNeighborPrior {
    tree: Arc<BoxTree>,
    /// h², cm².
    width: f64,
    variance: Vec<f64>,
}

impl NearestNeighborPrior {
    fn new(tree: Arc<BoxTree>, width: f64) -> NearestNeighborPrior {
        NearestNeighborPrior {
            variance: vec![width; tree.poses().ncols()],
            tree,
            width,
        }
    }
}

impl Prior for NearestNeighborPrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let weight = |n: &f64| 1.0 / (n.max(0.0) + self.width);
        let weights: Vec<f64> = observation.variance.iter().map(weight).collect();
        let found = self.tree.nearest(observation.values, &weights, 1);
        let Some(near) = found.first() else {
            return Posterior::default();
        };
        let observed = weights.iter().filter(|w| **w > 0.0);
        let constant: f64 = observed.map(|w| (2.0 * PI / w).ln()).sum();
        let pose = self.tree.poses().row(near.index as usize).mapv(f64::from);
        let mut posterior = Posterior {
            mean: pose.to_vec(),
            log_evidence: -0.5 * (near.squared + constant),
            ..Posterior::default()
        };
        if want != Want::Mean {
            posterior.variance = self.variance.clone();
        }
        if want == Want::Covariance {
            posterior.covariance = Array2::from_diag_elem(self.variance.len(), self.width);
        }
        posterior
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        let tree = Arc::new(self.tree.mapped(map));
        Box::new(NearestNeighborPrior::new(tree, self.width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::PriorExt;

    fn poses(n: usize) -> Array2<f32> {
        Array2::from_shape_fn((n, 6), |(t, c)| {
            (30.0 * (t as f32 * 0.1 + c as f32).sin()) + (t % 3) as f32
        })
    }

    fn prior(n: usize) -> NearestNeighborPrior {
        NearestNeighborPrior::new(Arc::new(BoxTree::new(poses(n).view())), 0.25)
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
}

//! Local PCA: a Gaussian of the training poses nearest to what was observed (Chai and Hodgins 2005,
//! "Performance animation from low-dimensional control signals", section 5; Lai et al.'s LPCA).
//!
//! The k nearest poses under Σ_o (y_o − x_no)² / (R_o + v) over the observed coordinates o with
//! noise variances R_o give a mean m and a covariance C; the answer is the most probable pose under
//! N(m, a (C + e I)) and the observation, where a (the inverse of Lai et al.'s lambda) is found on
//! held-back poses. Chai and Hodgins cut C to its principal components; the small rest that is left
//! here only makes the prior's own noise e I finer.
//!
//! The neighbors are exact, found by a tree. Cost: the search, and O(k D² + o³) for the Gaussian of
//! o observed coordinates.

use super::box_tree::{BoxTree, Neighbor};
use crate::numeric::gaussian::{ConditionalGaussian, most_probable};
use crate::pose::{Observation, PoseTransform};
use crate::prior::exemplar::ExemplarKind;
use crate::prior::tuning::{Grid, PriorFamily};
use crate::prior::{EXACT_VARIANCE, Posterior, Prior, Want};
use ndarray::{Array1, Array2, ArrayView2, Axis};
use std::sync::Arc;

/// The neighborhood's size in Lai et al. (section 4.1).
const NEIGHBORS: usize = 100;
/// v, cm²: about what a neighbor is off by. It matters only where coordinates differ in their
/// noise.
const OFF: f64 = 1.0;
/// e, cm²: a millimeter's variance, so that neighbors that follow one another in time leave no
/// direction impossible.
const FLOOR: f64 = 0.01;

/// The kind `lpca`.
pub(crate) const KIND: ExemplarKind = ExemplarKind {
    name: "lpca",
    // Neighbors in time are far closer to each other than to the observation: the best inflation
    // may be large.
    grid: || Grid {
        inflation: vec![0.5, 1.0, 2.5, 6.0, 12.0, 40.0, 150.0],
        ..Grid::default()
    },
    prior,
    adjust: |_| (),
};

fn prior(poses: ArrayView2<'_, f32>) -> PriorFamily {
    let tree = Arc::new(BoxTree::new(poses));
    Box::new(move |inflation| Box::new(LocalPcaPrior::new(tree.clone(), inflation)))
}

/// The prior: a Gaussian of the training poses nearest to the observation.
#[derive(Debug, Clone)]
pub(crate) struct LocalPcaPrior {
    tree: Arc<BoxTree>,
    /// a.
    inflation: f64,
    variance: Vec<f64>,
}

impl LocalPcaPrior {
    fn new(tree: Arc<BoxTree>, inflation: f64) -> LocalPcaPrior {
        let mut prior = LocalPcaPrior {
            variance: Vec::new(),
            tree,
            inflation,
        };
        prior.variance = prior.mean_variance();
        prior
    }

    /// The mean variance of each coordinate (D), cm², in neighborhoods spread over the poses.
    fn mean_variance(&self) -> Vec<f64> {
        let poses = self.tree.poses();
        let (n, d) = poses.dim();
        let some = (0..n).step_by(n.div_ceil(20).max(1));
        let mut sum = Array1::<f64>::zeros(d);
        let mut count = 0;
        for row in some {
            let y: Vec<f64> = poses.row(row).iter().map(|v| f64::from(*v)).collect();
            let near = self.tree.nearest(&y, &vec![1.0; d], NEIGHBORS);
            sum += &self.gaussian(&near).1.diag();
            count += 1;
        }
        (sum / f64::from(count.max(1))).to_vec()
    }

    /// m and a (C + e I).
    fn gaussian(&self, near: &[Neighbor]) -> (Array1<f64>, Array2<f64>) {
        let poses = self.tree.poses();
        let d = poses.ncols();
        let mut rows = Array2::<f64>::zeros((near.len(), d));
        for (mut row, near) in rows.rows_mut().into_iter().zip(near) {
            let pose = poses.row(near.index as usize);
            row.iter_mut()
                .zip(pose)
                .for_each(|(r, p)| *r = f64::from(*p));
        }
        let mean = rows.mean_axis(Axis(0));
        let mean = mean.unwrap_or_else(|| Array1::zeros(d));
        rows -= &mean;
        let mut covariance = rows.t().dot(&rows) / near.len().max(1) as f64;
        covariance.diag_mut().mapv_inplace(|v| v + FLOOR);
        (mean, covariance * self.inflation)
    }
}

impl Prior for LocalPcaPrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let (y, noise) = (observation.values, observation.variance);
        let weight = |n: &f64| 1.0 / (n.max(0.0) + OFF);
        let weights: Vec<f64> = noise.iter().map(weight).collect();
        let (mean, covariance) = self.gaussian(&self.tree.nearest(y, &weights, NEIGHBORS));
        if want == Want::Mean {
            return Posterior {
                mean: most_probable(mean.to_vec(), covariance.view(), y, noise),
                ..Posterior::default()
            };
        }
        let noise: Vec<f64> = noise.iter().map(|n| n.max(EXACT_VARIANCE)).collect();
        let conditional = ConditionalGaussian::new(covariance.view(), &noise);
        let rest: Vec<f64> = y.iter().zip(&mean).map(|(y, m)| y - m).collect();
        let update = conditional.mean(&rest);
        Posterior {
            mean: mean.iter().zip(update).map(|(m, t)| m + t).collect(),
            log_evidence: conditional.log_density(&rest),
            covariance: match want {
                Want::Variances => Array2::default((0, 0)),
                _ => conditional.covariance(covariance.view()),
            },
            variance: conditional.variance,
        }
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        let tree = Arc::new(self.tree.mapped(map));
        Box::new(LocalPcaPrior::new(tree, self.inflation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::PriorExt;

    fn poses(n: usize) -> Array2<f32> {
        Array2::from_shape_fn((n, 9), |(t, c)| {
            30.0 * (t as f32 * 0.03 + c as f32).sin() + ((t * 5 + c * 2) % 7) as f32 * 0.3
        })
    }

    fn prior(n: usize) -> LocalPcaPrior {
        LocalPcaPrior::new(Arc::new(BoxTree::new(poses(n).view())), 2.0)
    }

    #[test]
    fn with_few_poses_it_is_the_gaussian_of_them_all() {
        let prior = prior(60);
        let all = poses(60).mapv(f64::from);
        let mean = all.mean_axis(Axis(0)).unwrap();
        let centered = &all - &mean;
        let covariance = (centered.t().dot(&centered) / 60.0 + Array2::<f64>::eye(9) * FLOOR) * 2.0;
        let mut noise = [0.5; 9];
        noise[2] = f64::INFINITY;
        let mut y = all.row(7).to_vec();
        y[2] = f64::NAN;
        let conditional = ConditionalGaussian::new(covariance.view(), &noise);
        let rest: Vec<f64> = y.iter().zip(&mean).map(|(y, m)| y - m).collect();
        let belief = prior.full(&y, &noise);
        let want = conditional.mean(&rest);
        for c in 0..9 {
            assert!((belief.mean[c] - mean[c] - want[c]).abs() <= 1e-8);
        }
        assert!((belief.log_evidence - conditional.log_density(&rest)).abs() <= 1e-6);
        assert!((belief.mean[2] - all[[7, 2]]).abs() <= 2.0);
    }

    #[test]
    fn one_pose_and_copies_of_it_are_enough() {
        for n in [1, 150] {
            let same = Array2::from_elem((n, 9), 4.0f32);
            let tree = Arc::new(BoxTree::new(same.view()));
            let prior = LocalPcaPrior::new(tree, 1.0);
            let belief = prior.full(&[5.0; 9], &[1.0; 9]);
            assert!(belief.mean.iter().all(|v| *v > 4.0 && *v < 4.1));
            assert!(belief.covariance.iter().all(|v| v.is_finite()));
        }
    }
}

//! Local PCA: a Gaussian of the training poses nearest to what was observed (Chai and Hodgins 2005, "Performance
//! animation from low-dimensional control signals", section 5; the paper's LPCA).
//!
//! The k nearest poses under Σ_o (y_o − x_no)² / (R_o + v) over the observed coordinates o with noise variances R_o give a
//! mean m and a covariance C; the answer is the most probable pose under N(m, a (C + e I)) and the observation, where a
//! (the inverse of the paper's lambda) is found on held-back poses. Chai and Hodgins cut C to its principal components;
//! the small rest that is left here only makes the prior's own noise e I finer.
//!
//! The neighbors are exact, found by a tree; frames that follow one another start from the neighbors of the frame
//! before. Cost: the search, and O(k D² + o³) for the Gaussian of o observed coordinates.

use super::box_tree::{BoxTree, Neighbor};
use crate::Result;
use crate::io::Model;
use crate::numeric::gaussian::{ConditionalGaussian, most_probable};
use crate::numeric::parallel;
use crate::pose::{Observation, PoseTransform};
use crate::prior::model_arrays;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::tuning::{Grid, PriorFamily, Setting, TunedPrior};
use crate::prior::{EXACT_VARIANCE, OpenOptions, Posterior, Prior, Want};
use ndarray::{Array1, Array2, ArrayView2, Axis};
use std::sync::Arc;

/// The neighbourhood's size in the paper (section 4.1).
const NEIGHBORS: usize = 100;
/// v, cm²: about what a neighbour is off by. It matters only where coordinates differ in their noise.
const OFF: f64 = 1.0;
/// e, cm²: a millimetre's variance, so that neighbors that follow one another in time leave no direction impossible.
const FLOOR: f64 = 0.01;
/// Observations of one chunk; each search starts from the neighbors of the one before.
const RUN: usize = 32;

/// The prior: a Gaussian of the training poses nearest to the observation.
#[derive(Debug, Clone)]
pub struct LocalPcaPrior {
    tree: Arc<BoxTree>,
    /// a.
    inflation: f64,
    variance: Vec<f64>,
    typical: Arc<Array2<f64>>,
}

impl LocalPcaPrior {
    /// From a model of kind `lpca`: `poses` (n, D), and its tuning.
    ///
    /// # Errors
    /// Data: no such array, a wrong shape, numbers that are not finite.
    pub fn open(model: &Model, options: &OpenOptions, source: &str) -> Result<TunedPrior> {
        model_arrays::open_exemplars(model, options, source, family)
    }

    fn new(tree: Arc<BoxTree>, typical: Arc<Array2<f64>>, inflation: f64) -> LocalPcaPrior {
        let mut prior = LocalPcaPrior {
            variance: Vec::new(),
            tree,
            inflation,
            typical,
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
            let near = self.tree.nearest(&y, &vec![1.0; d], NEIGHBORS, &[]);
            sum += &self.gaussian(&near).1.diag();
            count += 1;
        }
        (sum / f64::from(count.max(1))).to_vec()
    }

    fn neighbors(&self, observation: &Observation<'_>, like: &[u32]) -> Vec<Neighbor> {
        let (y, noise) = (observation.values, observation.variance);
        let weight = |n: &f64| 1.0 / (n.max(0.0) + OFF);
        let weights: Vec<f64> = noise.iter().map(weight).collect();
        self.tree.nearest(y, &weights, NEIGHBORS, like)
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

    fn answer(&self, observation: &Observation<'_>, want: Want, near: &[Neighbor]) -> Posterior {
        let (y, noise) = (observation.values, observation.variance);
        let (mean, covariance) = self.gaussian(near);
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
}

impl Prior for LocalPcaPrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        self.answer(observation, want, &self.neighbors(observation, &[]))
    }

    fn posterior_batch(&self, batch: &[(Observation<'_>, Want)]) -> Vec<Posterior> {
        let runs = parallel::map_chunks(batch.len(), RUN, |rows| {
            let mut like: Vec<u32> = Vec::new();
            let run = batch[rows].iter();
            run.map(|(o, want)| {
                let near = self.neighbors(o, &like);
                like = near.iter().map(|n| n.index).collect();
                self.answer(o, *want, &near)
            })
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
        Box::new(LocalPcaPrior::new(
            Arc::new(tree),
            Arc::new(typical),
            self.inflation,
        ))
    }
}

/// The poses, at any inflation.
fn family(poses: ArrayView2<'_, f32>, typical: Array2<f64>) -> PriorFamily<'static> {
    let tree = Arc::new(BoxTree::new(poses));
    let typical = Arc::new(typical);
    Box::new(move |setting: Setting| {
        let (tree, typical) = (tree.clone(), typical.clone());
        Box::new(LocalPcaPrior::new(tree, typical, setting.inflation))
    })
}

/// Makes a model of kind `lpca`: the poses, and the weight of each task.
///
/// # Errors
/// Data: no poses to learn from.
pub fn train(
    poses: &TrainingSet,
    options: &TrainOptions,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    // Neighbors in time are far closer to each other than to the observation: the best inflation may be large.
    let grid = Grid {
        inflation: vec![0.5, 1.0, 2.5, 6.0, 12.0, 40.0, 150.0],
        ..Grid::default()
    };
    let (mut model, tuning) =
        model_arrays::train_exemplars("lpca", poses, options, &grid, family, report)?;
    tuning.write(&mut model);
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;
    use crate::prior::testdata::Ask;
    use glam::DVec3;

    fn poses(n: usize) -> Array2<f32> {
        Array2::from_shape_fn((n, 9), |(t, c)| {
            30.0 * (t as f32 * 0.03 + c as f32).sin() + ((t * 5 + c * 2) % 7) as f32 * 0.3
        })
    }

    fn prior(n: usize) -> LocalPcaPrior {
        let typical = poses(2).mapv(f64::from);
        LocalPcaPrior::new(
            Arc::new(BoxTree::new(poses(n).view())),
            Arc::new(typical),
            2.0,
        )
    }

    #[test]
    fn with_few_poses_it_is_the_gaussian_of_them_all() {
        let prior = prior(60);
        let all = poses(60).mapv(f64::from);
        let mean = all.mean_axis(Axis(0)).unwrap();
        let centred = &all - &mean;
        let covariance = (centred.t().dot(&centred) / 60.0 + Array2::<f64>::eye(9) * FLOOR) * 2.0;
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
    fn frames_after_one_another_are_answered_as_each_alone() {
        let prior = prior(600);
        let y = poses(90).mapv(f64::from) + 0.2;
        let mut noise = Array2::from_elem(y.dim(), 1.0);
        noise.row_mut(50).fill(f64::INFINITY);
        noise[[51, 3]] = 0.0;
        for threads in [1, 2, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let all = pool
                .unwrap()
                .install(|| prior.full_rows(y.view(), noise.view()));
            let means = prior.mean_rows(y.view(), noise.view());
            for (i, belief) in all.iter().enumerate() {
                let same = means
                    .row(i)
                    .iter()
                    .zip(&belief.mean)
                    .all(|(a, b)| (a - b).abs() <= 1e-7);
                assert!(same);
                let alone = prior.full(&y.row(i).to_vec(), &noise.row(i).to_vec());
                assert_eq!(*belief, alone);
            }
        }
        let none = Array2::zeros((0, 9));
        assert!(prior.full_rows(none.view(), none.view()).is_empty());
    }

    #[test]
    fn one_pose_and_copies_of_it_are_enough() {
        for n in [1, 150] {
            let same = Array2::from_elem((n, 9), 4.0f32);
            let tree = Arc::new(BoxTree::new(same.view()));
            let prior = LocalPcaPrior::new(tree, Arc::new(same.mapv(f64::from)), 1.0);
            let belief = prior.full(&[5.0; 9], &[1.0; 9]);
            assert!(belief.mean.iter().all(|v| *v > 4.0 && *v < 4.1));
            assert!(belief.covariance.iter().all(|v| v.is_finite()));
        }
    }

    #[test]
    fn turned_poses_are_answered_turned() {
        let prior = prior(400);
        let map = PoseTransform::Rotate(from_rotation_vector(DVec3::new(0.4, -1.0, 0.2)));
        let y = (poses(30).mapv(f64::from) + 0.3).row(20).to_vec();
        let (mut turned, mut want) = (vec![0.0; 9], vec![0.0; 9]);
        map.apply(&y, &mut turned);
        map.apply(&prior.full(&y, &[1.0; 9]).mean, &mut want);
        let got = prior.mapped(&map).full(&turned, &[1.0; 9]).mean;
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() <= 1e-3));
    }
}

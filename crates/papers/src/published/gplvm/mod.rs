//! Style-based inverse kinematics: a scaled Gaussian process latent variable model of poses
//! (Grochow, Martin, Hertzmann, Popović 2004, "Style-based inverse kinematics"; Lawrence 2004).
//!
//! Each pose y (D numbers about the mean pose) has a latent point x of three numbers, and each
//! coordinate, times its own scale w_c, is a Gaussian process over x with the kernel k(x, x') =
//! exp(−γ/2 |x − x'|²) and noise ν. With K of the M active poses Y (M, D), prediction at x (their
//! section 4):
//!
//! f(x) = Yᵀ K⁻¹ k(x),  σ²(x) = 1 + ν − k(x)ᵀ K⁻¹ k(x),  y_c ~ N(f_c(x), σ²(x) / w_c²)
//!
//! Learning (`learn`) finds latent points, γ, ν and w. An observation is answered by the latent
//! point that minimizes, with s_c = a σ²(x) / w_c² and noise R_o,
//!
//! ½ Σ_o [(y_o − f_o(x))² / (s_o + R_o)] + ½ D ln σ²(x) + ½ |x|²
//!
//! which is the paper's objective with the pose, Gaussian given x, already minimized over; and by
//! that Gaussian given the observation. The problem has many minima: it is solved from the best
//! active points.

mod file;
mod learn;
mod process;

use crate::io::Model;
use crate::numeric::lbfgs::{Minimum, minimize};
use crate::pose::{Observation, PoseTransform};
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::tuning::{ASF2, Grid, PriorFamily, TunedPrior, tune};
use crate::prior::{EXACT_VARIANCE, OpenOptions, Posterior, Prior, Want};
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2, ArrayView1};
use process::Process;
use std::sync::Arc;

/// Active points from which the minimization starts.
const STARTS: usize = 2;
/// Steps of each minimization.
const STEPS: usize = 15;

/// A scaled GPLVM of poses.
#[derive(Debug, Clone)]
pub(crate) struct GplvmPrior {
    process: Arc<Process>,
    /// a, the inverse of the paper's weight of the prior.
    inflation: f64,
    variance: Vec<f64>,
}

impl GplvmPrior {
    /// From a model of kind `sik`: `active` (M, D) poses, their `latent` (M, L) points, `scales`
    /// (1, D) and `mean` (1, D), and in its details `gamma` and `noise`.
    ///
    /// # Errors
    /// Data: no such array or number, a wrong shape, numbers that are not finite or out of range.
    pub fn open(model: &Model, options: &OpenOptions, source: &str) -> Result<TunedPrior> {
        let learned = file::read(model, source)?;
        let unsound = || {
            let what = "its kernel matrix is not positive definite; train the model again";
            Error::data(Place::file(source).part("latent"), what)
        };
        let process = Process::new(&learned).ok_or_else(unsound)?;
        TunedPrior::open(model, options, source, &family(process))
    }

    fn new(process: Arc<Process>, inflation: f64) -> GplvmPrior {
        let own = process.noise.max(1e-6) * inflation;
        GplvmPrior {
            variance: process.scales.iter().map(|s| s * own).collect(),
            process,
            inflation,
        }
    }

    /// The objective at a latent point for the rest `y` (about the mean pose), and its gradient.
    fn objective(&self, x: &[f64], y: &[f64], noise: &[f64]) -> (f64, Vec<f64>) {
        let p = self.process.predict(x);
        let mut value = 0.5 * y.len() as f64 * p.variance.ln();
        let mut by_variance = 0.5 * y.len() as f64 / p.variance;
        let mut by_f = Array1::<f64>::zeros(y.len());
        for c in (0..y.len()).filter(|&c| noise[c].is_finite()) {
            let scale = self.inflation * self.process.scales[c];
            let sum = scale * p.variance + noise[c].max(EXACT_VARIANCE);
            let rest = y[c] - p.f[c];
            value += 0.5 * rest * rest / sum;
            by_f[c] = -rest / sum;
            by_variance -= 0.5 * rest * rest / (sum * sum) * scale;
        }
        let mut gradient = p.slope.dot(&by_f) + p.variance_slope * by_variance;
        for (g, x) in gradient.iter_mut().zip(x) {
            value += 0.5 * x * x;
            *g += x;
        }
        (value, gradient.to_vec())
    }

    /// The active points at which the objective is least, least first.
    fn starts(&self, y: &[f64], noise: &[f64]) -> Vec<usize> {
        let process = &*self.process;
        let value = |i: usize| {
            let x = process.latent.row(i);
            // At an active point σ² is about the noise.
            let squares = (0..y.len()).filter(|&c| noise[c].is_finite()).map(|c| {
                let sum = self.variance[c] + noise[c].max(EXACT_VARIANCE);
                (y[c] - process.fitted[[i, c]]).powi(2) / sum
            });
            squares.sum::<f64>() + x.dot(&x)
        };
        let mut order: Vec<(f64, usize)> =
            (0..process.latent.nrows()).map(|i| (value(i), i)).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        order.into_iter().take(STARTS).map(|(_, i)| i).collect()
    }
}

impl Prior for GplvmPrior {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let process = &*self.process;
        let noise = observation.variance;
        let y = observation.values.iter().zip(&process.mean);
        let y: Vec<f64> = y.map(|(y, m)| y - m).collect();
        let mut best: Option<Minimum> = None;
        for start in self.starts(&y, noise) {
            let x = process.latent.row(start).to_vec();
            let found = minimize(x, STEPS, learn::TOLERANCE, &mut |x| {
                self.objective(x, &y, noise)
            });
            if best.as_ref().is_none_or(|b| found.value < b.value) {
                best = Some(found);
            }
        }
        let Some(Minimum { at: x, .. }) = best else {
            return Posterior::default();
        };
        let p = process.predict(&x);
        let d = y.len();
        let mut posterior = Posterior {
            mean: process.mean.clone(),
            variance: vec![0.0; d],
            covariance: Array2::default((0, 0)),
            log_evidence: -0.5 * x.iter().map(|x| x * x).sum::<f64>(),
        };
        for c in 0..d {
            let own = self.inflation * process.scales[c] * p.variance;
            let (mut update, mut left) = (0.0, own);
            if noise[c].is_finite() {
                let sum = own + noise[c].max(EXACT_VARIANCE);
                let rest = y[c] - p.f[c];
                update = own / sum * rest;
                left = own * (noise[c].max(EXACT_VARIANCE) / sum);
                posterior.log_evidence -=
                    0.5 * (rest * rest / sum + (2.0 * std::f64::consts::PI * sum).ln());
            }
            posterior.mean[c] += p.f[c] + update;
            posterior.variance[c] = left;
        }
        if want == Want::Covariance {
            posterior.covariance = Array2::from_diag(&ArrayView1::from(&posterior.variance));
        }
        posterior
    }

    /// Poses are carried as they are; the variance of a coordinate becomes the diagonal of the
    /// carried covariance.
    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        let process = Arc::new(self.process.mapped(map));
        Box::new(GplvmPrior::new(process, self.inflation))
    }
}

fn family(process: Process) -> PriorFamily {
    let process = Arc::new(process);
    Box::new(move |inflation| Box::new(GplvmPrior::new(process.clone(), inflation)))
}

/// Makes a model of kind `sik`, and finds the weight of each task.
///
/// # Errors
/// Data: no poses to learn from, or poses no kernel can be made of.
pub fn train(
    poses: &TrainingSet,
    options: &TrainOptions,
    report: &mut dyn FnMut(&str),
) -> Result<Model> {
    let unsound = || {
        let what = "the kernel matrix of the latent points is not positive definite";
        Error::data(Place::file("the training poses"), what)
    };
    let mut model = poses.model("sik")?;
    let grid = Grid {
        inflation: vec![0.3, 1.0, 3.0],
        sparse: vec![0.2 * ASF2],
        complete: vec![1e-2 * ASF2, 0.1 * ASF2],
    };
    let learn = |kept: &TrainingSet| {
        let learned = learn::learn(kept.xyz.view(), &mut |_| {});
        let process = Process::new(&learned).ok_or_else(unsound)?;
        Ok(family(process))
    };
    tune(poses, options, &grid, &learn, report)?.write(&mut model);
    let learned = learn::learn(poses.xyz.view(), report);
    file::write(&learned, &mut model);
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;
    use crate::published::gplvm::process::Learned;
    use crate::testdata::PriorExt;
    use glam::DVec3;

    /// Poses along a closed curve.
    fn poses(n: usize) -> Array2<f32> {
        Array2::from_shape_fn((n, 9), |(t, c)| {
            let turn = t as f32 / n as f32 * std::f32::consts::TAU;
            20.0 * (turn + c as f32).sin() + 5.0 * (2.0 * turn + (c * c) as f32).cos()
        })
    }

    fn prior(n: usize) -> GplvmPrior {
        let learned = learn::learn(poses(n).view(), &mut |_| {});
        GplvmPrior::new(Arc::new(Process::new(&learned).unwrap()), 1.0)
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        let prior = prior(40);
        let y: Vec<f64> = (0..9).map(|c| 3.0 * f64::from(c) - 9.0).collect();
        let mut noise = [2.0; 9];
        noise[3] = f64::INFINITY;
        for x in [[0.3, -0.2, 0.9], [2.0, 1.0, -3.0]] {
            let (_, gradient) = prior.objective(&x, &y, &noise);
            for i in 0..3 {
                let at = |h: f64| {
                    let mut moved = x;
                    moved[i] += h;
                    prior.objective(&moved, &y, &noise).0
                };
                let want = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!((gradient[i] - want).abs() <= 1e-3 * (1.0 + want.abs()));
            }
        }
    }

    #[test]
    fn a_pose_of_the_curve_is_found_from_half_of_it() {
        let prior = prior(60);
        let truth: Vec<f64> = poses(120).row(31).iter().map(|v| f64::from(*v)).collect();
        let mut noise = [0.01; 9];
        noise[5..].fill(f64::INFINITY);
        let mut y = truth.clone();
        y[5..].fill(f64::NAN);
        let belief = prior.full(&y, &noise);
        assert!(
            (0..9).all(|c| (belief.mean[c] - truth[c]).abs() <= 1.5),
            "{:?} {truth:?}",
            belief.mean
        );
        assert!(belief.covariance.diag().iter().all(|v| *v > 0.0));
        assert!(belief.log_evidence.is_finite());
    }

    #[test]
    fn one_pose_is_the_answer_to_nothing_seen() {
        let belief = prior(1).full(&[f64::NAN; 9], &[f64::INFINITY; 9]);
        let want = poses(1);
        assert!((0..9).all(|c| (belief.mean[c] - f64::from(want[[0, c]])).abs() <= 1e-3));
    }

    #[test]
    fn turned_poses_are_answered_turned() {
        let learned = Learned {
            scales: vec![2.0; 9],
            ..learn::learn(poses(30).view(), &mut |_| {})
        };
        let prior = GplvmPrior::new(Arc::new(Process::new(&learned).unwrap()), 1.0);
        let map = PoseTransform::Rotate(from_rotation_vector(DVec3::new(0.2, -0.8, 0.3)));
        let y = (poses(90).mapv(f64::from) + 0.3).row(20).to_vec();
        let (mut turned, mut want) = (vec![0.0; 9], vec![0.0; 9]);
        map.apply(&y, &mut turned);
        map.apply(&prior.full(&y, &[1.0; 9]).mean, &mut want);
        let got = prior.mapped(&map).full(&turned, &[1.0; 9]).mean;
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() <= 1e-2));
    }
}

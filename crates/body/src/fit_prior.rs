//! What is known of a pose and a shape before anything is measured: Gaussians of the joints' twists
//! and of the shape.

use crate::pose::rotation::rotation_vector_jacobian;
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2};

/// The standard deviation of a marker where none is told, centimeters a coordinate.
pub(crate) const NOISE: f64 = 0.18;
/// The least noise that counts: without any the priors would vanish.
const LEAST_NOISE: f64 = 0.01;

/// Independent Gaussians: of each component of the joints' twists, and of mean 0 and variance 1 for
/// each number of the shape.
#[derive(Debug, Clone, PartialEq)]
pub struct FitPrior {
    /// The mean and the standard deviation of each joint's twist, radians.
    pub twists: Vec<(DVec3, DVec3)>,
    /// The standard deviation of a marker, centimeters a coordinate: the larger, the more the
    /// priors count.
    pub noise: f64,
}

/// The normal equations of a step: half of the energy's second derivatives, by Gauss and Newton,
/// and half of its gradient. Three numbers per part (a small rotation of it in the world), then the
/// shape, then what else there is.
pub(super) struct NormalEquations {
    pub(super) hessian: Array2<f64>,
    pub(super) gradient: Array1<f64>,
}

impl NormalEquations {
    pub(super) fn zeros(n: usize) -> NormalEquations {
        NormalEquations {
            hessian: Array2::zeros((n, n)),
            gradient: Array1::zeros(n),
        }
    }
}

impl FitPrior {
    /// The noise squared, cm².
    pub(crate) fn variance(&self) -> f64 {
        self.noise.max(LEAST_NOISE).powi(2)
    }

    /// The squared distance from the mean in standard deviations.
    pub(crate) fn energy(&self, twists: &[DVec3], shape: &[f64]) -> f64 {
        let twists = twists.iter().zip(&self.twists);
        let twists: f64 = twists
            .map(|(t, (mean, sd))| ((*t - *mean) / *sd).length_squared())
            .sum();
        twists + shape.iter().map(|b| b * b).sum::<f64>()
    }

    /// Adds `weight` times half of the derivatives of [`FitPrior::energy`] for joints between
    /// `joints`, whose twists change by `turns` when their second parts turn (see
    /// [`twist_derivatives`]).
    pub(super) fn add(
        &self,
        weight: f64,
        joints: &[[usize; 2]],
        twists: &[DVec3],
        turns: &[DMat3],
        shape: &[f64],
        to: &mut NormalEquations,
    ) {
        for (j, [a, b]) in joints.iter().enumerate() {
            let (mean, sd) = self.twists[j];
            let scale = DMat3::from_diagonal(sd.recip() * sd.recip() * weight);
            let pull = turns[j].transpose() * (scale * (twists[j] - mean));
            let square = turns[j].transpose() * scale * turns[j];
            for r in 0..3 {
                to.gradient[3 * b + r] += pull[r];
                to.gradient[3 * a + r] -= pull[r];
                for c in 0..3 {
                    let v = square.col(c)[r];
                    to.hessian[[3 * a + r, 3 * a + c]] += v;
                    to.hessian[[3 * b + r, 3 * b + c]] += v;
                    to.hessian[[3 * a + r, 3 * b + c]] -= v;
                    to.hessian[[3 * b + r, 3 * a + c]] -= v;
                }
            }
        }
        let first = 3 * (joints.len() + 1);
        for (k, beta) in shape.iter().enumerate() {
            to.hessian[[first + k, first + k]] += weight;
            to.gradient[first + k] += weight * beta;
        }
    }
}

/// How each joint's twist changes when its second part is turned a little in the world; turning the
/// first part does the opposite.
pub(super) fn twist_derivatives(
    joints: &[[usize; 2]],
    twists: &[DVec3],
    rotations: &[DMat3],
) -> Vec<DMat3> {
    (joints.iter().zip(twists))
        .map(|([_, b], t)| rotation_vector_jacobian(*t) * rotations[*b].transpose())
        .collect()
}

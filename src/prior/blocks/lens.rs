//! A covariance seen through noise: one eigendecomposition serves every scale of it.
//!
//! With W = R^-1/2 over the observed coordinates and W C_oo W = V diag(λ) Vᵀ, all that a block at the scale a needs of
//! a C_oo + R is diagonal: for z = Vᵀ W (y − m)_o
//!
//! ```text
//! log N(y_o; m_o, a C_oo + R) = −½ Σ z² / (aλ + 1) − ½ Σ log(aλ + 1) + Σ log W − ½ n log 2π
//! mean                        = m + a C_:o W V (z / (aλ + 1))
//! covariance                  = a C − a² (C_:o W V) diag(1 / (aλ + 1)) (C_:o W V)ᵀ
//! ```

use crate::linalg::symmetric_eigen;
use ndarray::{Array2, ArrayView2};

/// One covariance conditioned on coordinates of given noise, at any scale.
#[derive(Debug, Clone)]
pub struct Lens {
    /// The observed coordinates among the block's own.
    pub observed: Vec<usize>,
    /// W V, by rows of the n directions: (directions, observed).
    directions: Array2<f64>,
    /// λ, never below 0.
    pub values: Vec<f64>,
    /// (C_:o W V)ᵀ: (directions, d).
    gain: Array2<f64>,
    /// Σ log W − ½ n log 2π.
    constant: f64,
}

impl Lens {
    /// Looks at `covariance` (d, d) through the noise variances (d; infinite is missing, none is 0).
    pub fn new(covariance: ArrayView2<'_, f64>, noise: &[f64]) -> Lens {
        let observed: Vec<usize> = (0..noise.len()).filter(|&i| noise[i].is_finite()).collect();
        let n = observed.len();
        let w: Vec<f64> = observed.iter().map(|&i| 1.0 / noise[i].sqrt()).collect();
        let seen = Array2::from_shape_fn((n, n), |(i, j)| {
            w[i] * covariance[[observed[i], observed[j]]] * w[j]
        });
        // Covariances are finite and symmetric, so LAPACK does not give up; nothing is learnt if it does.
        let (values, vectors) =
            symmetric_eigen(&seen).unwrap_or_else(|| (ndarray::Array1::zeros(n), Array2::eye(n)));
        let directions = Array2::from_shape_fn((n, n), |(k, i)| vectors[[i, k]] * w[i]);
        let cross = covariance.select(ndarray::Axis(0), &observed);
        let gain = directions.dot(&cross);
        let log_w: f64 = w.iter().map(|w| w.ln()).sum();
        Lens {
            values: values.iter().map(|v| v.max(0.0)).collect(),
            constant: log_w - 0.5 * n as f64 * (2.0 * std::f64::consts::PI).ln(),
            observed,
            directions,
            gain,
        }
    }

    /// z = Vᵀ W r_o of the residuals `r` (d; read where observed), into `z`.
    pub fn project(&self, r: impl Fn(usize) -> f64, z: &mut Vec<f64>) {
        let seen: Vec<f64> = self.observed.iter().map(|&i| r(i)).collect();
        z.clear();
        for row in self.directions.rows() {
            z.push(row.iter().zip(&seen).map(|(d, s)| d * s).sum());
        }
    }

    /// 1 / (aλ + 1) of each direction.
    pub fn shares(&self, scale: f64) -> Vec<f64> {
        self.values
            .iter()
            .map(|l| 1.0 / (scale * l + 1.0))
            .collect()
    }

    /// The part of the log evidence that no observation changes, given [`Lens::shares`].
    pub fn normaliser(&self, shares: &[f64]) -> f64 {
        self.constant + 0.5 * shares.iter().map(|s| s.ln()).sum::<f64>()
    }

    /// Adds `weight` times a C_:o W V (shares z) to `out` (d).
    pub fn add_gain(&self, scale: f64, shares: &[f64], z: &[f64], weight: f64, out: &mut [f64]) {
        for ((row, s), z) in self.gain.rows().into_iter().zip(shares).zip(z) {
            let step = weight * scale * s * z;
            out.iter_mut().zip(row).for_each(|(o, g)| *o += step * g);
        }
    }

    /// The covariance that is left at a scale: (d, d).
    pub fn covariance(&self, prior: ArrayView2<'_, f64>, scale: f64) -> Array2<f64> {
        let shares = self.shares(scale);
        let mut half = self.gain.clone();
        for (mut row, s) in half.rows_mut().into_iter().zip(&shares) {
            row.mapv_inplace(|g| g * s.sqrt() * scale);
        }
        &prior * scale - half.t().dot(&half)
    }
}

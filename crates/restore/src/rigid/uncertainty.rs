//! The uncertainty of an estimated pose, as far as the projection uses it.

use crate::prior::{EXACT_VARIANCE, Posterior};
use ndarray::Array2;

/// How uncertain a mean (D) is.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Uncertainty<'a> {
    /// The variance of each coordinate.
    Variances(&'a [f64]),
    /// The covariance, and the factor of its correlations, from 0 to 1.
    Covariance(&'a Array2<f64>, f64),
    /// A covariance used for the mean only. The variances stay: posteriors under dense noise
    /// reflect the lengths already.
    Settled(&'a Array2<f64>, f64),
}

impl Uncertainty<'_> {
    /// The variance of each coordinate.
    pub(crate) fn variances(&self) -> Vec<f64> {
        match self {
            Uncertainty::Variances(v) => v.to_vec(),
            Uncertainty::Covariance(c, _) | Uncertainty::Settled(c, _) => c.diag().to_vec(),
        }
    }

    /// The covariance and the factor of its correlations, unless that is 0.
    pub(crate) fn together(&self) -> Option<(&Array2<f64>, f64)> {
        match self {
            Uncertainty::Covariance(c, together) | Uncertainty::Settled(c, together)
                if *together > 0.0 =>
            {
                Some((c, *together))
            }
            _ => None,
        }
    }

    /// Whether all numbers are finite.
    pub(crate) fn is_sound(&self) -> bool {
        match self {
            Uncertainty::Variances(v) => v.iter().all(|v| v.is_finite()),
            Uncertainty::Covariance(c, _) | Uncertainty::Settled(c, _) => {
                c.iter().all(|v| v.is_finite())
            }
        }
    }
}

/// Sets exact coordinates to their values, with no correlation to others.
pub(crate) fn pin_exact(belief: &mut Posterior, y: &[f64], noise: &[f64]) {
    for (i, r) in noise.iter().enumerate() {
        if *r <= EXACT_VARIANCE && y[i].is_finite() {
            belief.mean[i] = y[i];
            belief.covariance.row_mut(i).fill(0.0);
            belief.covariance.column_mut(i).fill(0.0);
            belief.covariance[[i, i]] = EXACT_VARIANCE;
            belief.variance[i] = EXACT_VARIANCE;
        }
    }
}

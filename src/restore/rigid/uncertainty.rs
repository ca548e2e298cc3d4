//! How sure a belief is, as far as rigid distances make use of it.

use crate::prior::{EXACT_VARIANCE, Posterior};
use ndarray::Array2;

/// How sure a mean is.
#[derive(Debug, Clone, Copy)]
pub enum Uncertainty<'a> {
    /// The variance of each coordinate.
    Variances(&'a [f64]),
    /// The covariance, and how much of what it says of two coordinates together is made use of: from 0 to 1.
    Covariance(&'a Array2<f64>, f64),
    /// The same; but the variances are to stay as they are: a belief in what was seen through noise has mostly reckoned
    /// with what the lengths tell.
    Settled(&'a Array2<f64>, f64),
}

impl Uncertainty<'_> {
    /// The variance of each coordinate.
    pub fn variances(&self) -> Vec<f64> {
        match self {
            Uncertainty::Variances(v) => v.to_vec(),
            Uncertainty::Covariance(c, _) | Uncertainty::Settled(c, _) => c.diag().to_vec(),
        }
    }

    /// The covariance and how much of it is made use of, where any is.
    pub fn together(&self) -> Option<(&Array2<f64>, f64)> {
        match self {
            Uncertainty::Covariance(c, together) | Uncertainty::Settled(c, together)
                if *together > 0.0 =>
            {
                Some((c, *together))
            }
            _ => None,
        }
    }

    /// Whether all of it are numbers.
    pub fn is_sound(&self) -> bool {
        match self {
            Uncertainty::Variances(v) => v.iter().all(|v| v.is_finite()),
            Uncertainty::Covariance(c, _) | Uncertainty::Settled(c, _) => {
                c.iter().all(|v| v.is_finite())
            }
        }
    }
}

/// Numbers that are exact are believed as they are.
pub fn pin_exact(belief: &mut Posterior, y: &[f64], noise: &[f64]) {
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

//! How sure a belief is, as far as rigid distances make use of it.

use ndarray::Array2;

/// How sure a mean is.
#[derive(Debug, Clone, Copy)]
pub enum Sure<'a> {
    /// The variance of each coordinate.
    Variances(&'a [f64]),
    /// The covariance, and how much of what it says of two coordinates together is made use of: from 0 to 1.
    Covariance(&'a Array2<f64>, f64),
    /// The same; but the variances are to stay as they are: a belief in what was seen through noise has mostly reckoned
    /// with what the lengths tell.
    Settled(&'a Array2<f64>, f64),
}

impl Sure<'_> {
    /// The variance of each coordinate.
    pub fn variances(&self) -> Vec<f64> {
        match self {
            Sure::Variances(v) => v.to_vec(),
            Sure::Covariance(c, _) | Sure::Settled(c, _) => c.diag().to_vec(),
        }
    }

    /// The covariance and how much of it is made use of, where any is.
    pub fn together(&self) -> Option<(&Array2<f64>, f64)> {
        match self {
            Sure::Covariance(c, together) | Sure::Settled(c, together) if *together > 0.0 => {
                Some((c, *together))
            }
            _ => None,
        }
    }

    /// Whether all of it are numbers.
    pub fn is_sound(&self) -> bool {
        match self {
            Sure::Variances(v) => v.iter().all(|v| v.is_finite()),
            Sure::Covariance(c, _) | Sure::Settled(c, _) => c.iter().all(|v| v.is_finite()),
        }
    }
}

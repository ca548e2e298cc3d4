//! Short calls for the tests of priors.

use crate::pose::Observation;
use crate::prior::{Posterior, Prior, Want, posterior_rows};
use ndarray::ArrayView2;

/// Short calls of a prior.
pub(crate) trait PriorExt {
    /// The posterior with its covariance.
    fn full(&self, values: &[f64], variance: &[f64]) -> Posterior;
    /// The posteriors of observations in rows (n, 3 J), with their covariances.
    fn full_rows(
        &self,
        values: ArrayView2<'_, f64>,
        variance: ArrayView2<'_, f64>,
    ) -> Vec<Posterior>;
}

impl<P: Prior + ?Sized> PriorExt for P {
    fn full(&self, values: &[f64], variance: &[f64]) -> Posterior {
        self.posterior(&Observation { values, variance }, Want::Covariance)
    }

    fn full_rows(
        &self,
        values: ArrayView2<'_, f64>,
        variance: ArrayView2<'_, f64>,
    ) -> Vec<Posterior> {
        posterior_rows(self, values, variance, Want::Covariance)
    }
}

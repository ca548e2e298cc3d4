//! One Gaussian: the mean and the covariance of the training poses. Its posterior mean is
//! the MAP pose. Cost and limits: see [`super`].

use super::em::moments_of;
use super::{MixtureKind, MixtureParams};
use crate::Result;
use crate::prior::tuning::ASF2;
use ndarray::{Array2, ArrayView2, Axis};

/// Ridge added to every variance, cm². Without it coordinates that never vary (the root in body
/// space) have none.
pub(crate) const RIDGE: f64 = 1e-3 * ASF2;

/// The kind `gaussian`.
pub(crate) const KIND: MixtureKind = MixtureKind::new("gaussian", learn);

fn learn(xyz: ArrayView2<'_, f32>, _seed: u64) -> Result<MixtureParams> {
    let (mean, covariance) = of(xyz);
    Ok(MixtureParams::of_covariances(
        vec![1.0],
        mean,
        &[covariance],
    ))
}

/// The mean (1, D) and the covariance (D, D) of poses, with the ridge.
pub(super) fn of(xyz: ArrayView2<'_, f32>) -> (Array2<f64>, Array2<f64>) {
    let mut all = moments_of(xyz, &vec![0; xyz.nrows()], 1);
    let moments = all.remove(0);
    let mut covariance = moments.covariance;
    covariance.diag_mut().mapv_inplace(|v| v + RIDGE);
    (moments.mean.insert_axis(Axis(0)), covariance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::factors;

    #[test]
    fn it_is_the_mean_and_the_covariance_with_the_ridge() {
        let x = factors().mapv(f64::from);
        let parts = learn(factors().view(), 0).unwrap();
        let mean = x.mean_axis(Axis(0)).unwrap();
        let away = &x - &mean;
        let want = away.t().dot(&away) / 600.0 + Array2::<f64>::eye(9) * RIDGE;
        assert_eq!((parts.len(), parts.weights[0]), (1, 1.0));
        assert!(
            (&parts.means.row(0) - &mean)
                .iter()
                .all(|d| d.abs() <= 1e-9)
        );
        assert!((parts.covariance(0) - want).iter().all(|d| d.abs() <= 1e-9));
    }
}

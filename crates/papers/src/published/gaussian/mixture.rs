//! A mixture of Gaussians with full covariances, fitted by EM from k-means, each covariance shrunk
//! toward that of all poses.
//!
//! C_j = 0.7 S_j + 0.3 S, with S_j as EM left it and S the covariance of all poses: twenty
//! covariances of 69 coordinates overfit the training takes.

use super::em::{self, Gaussian, Moments, Stop, clusters, weights};
use super::single::{self, RIDGE};
use super::{MixtureKind, MixtureParams};
use crate::Result;
use ndarray::{Array2, ArrayView2};

/// The number of Gaussians.
const COMPONENTS: usize = 20;
/// Smallest mean number of poses per component; fewer training poses give fewer components.
const LEAST: usize = 50;
/// Share of S_j that is kept.
const OWN: f64 = 0.7;

/// The kind `mixture`.
pub(crate) const KIND: MixtureKind = MixtureKind::new("mixture", learn);

fn learn(xyz: ArrayView2<'_, f32>, seed: u64) -> Result<MixtureParams> {
    let start = full(&clusters(xyz, COMPONENTS, LEAST, seed)?);
    let fitted = em::fit(xyz, start, Stop::default(), &mut full);
    Ok(shrunk(&fitted.mixture, &single::of(xyz).1, OWN))
}

/// The components with their covariances shrunk: `own` C_j + (1 − `own`) `whole`.
fn shrunk(mixture: &[Gaussian], whole: &Array2<f64>, own: f64) -> MixtureParams {
    let mut means = Array2::zeros((mixture.len(), whole.ncols()));
    let (mut weights, mut covariances) = (Vec::new(), Vec::new());
    for (g, mut row) in mixture.iter().zip(means.rows_mut()) {
        row.assign(&g.mean);
        weights.push(g.weight);
        covariances.push(&g.covariance * own + whole * (1.0 - own));
    }
    MixtureParams::of_covariances(weights, means, &covariances)
}

/// The M step for full covariances, with a ridge.
pub fn full(moments: &[Moments]) -> Vec<Gaussian> {
    let components = moments.iter().zip(weights(moments));
    let components = components.map(|(m, weight)| {
        let mut covariance = m.covariance.clone();
        covariance.diag_mut().mapv_inplace(|v| v + RIDGE);
        Gaussian {
            weight,
            mean: m.mean.clone(),
            covariance,
        }
    });
    components.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::blobs;

    fn near(a: &Array2<f64>, b: &Array2<f64>) -> bool {
        (a - b).iter().all(|d| d.abs() <= 1e-9)
    }

    #[test]
    fn it_is_shrunk_between_its_own_and_the_whole_covariance() {
        let x = blobs();
        let start = full(&clusters(x.view(), 3, LEAST, 0).unwrap());
        let mixture = em::fit(x.view(), start, Stop::default(), &mut full).mixture;
        let whole = single::of(x.view()).1;
        let of = |own: f64| shrunk(&mixture, &whole, own);
        for (j, g) in mixture.iter().enumerate() {
            assert!(near(&of(1.0).covariance(j), &g.covariance));
            assert!(near(&of(0.0).covariance(j), &whole));
            let half = (&g.covariance + &whole) * 0.5;
            assert!(near(&of(0.5).covariance(j), &half));
            assert_eq!(of(0.3).means.row(j), g.mean);
            assert_eq!(of(0.3).weights[j], g.weight);
            assert!(!near(&g.covariance, &whole));
        }
    }
}

//! Clustered Gaussians (Lai et al.'s CG): k-means into 20 clusters, with a Gaussian each.
//! The posterior is that of the most likely Gaussian alone.

use super::em::{clusters, weights};
use super::single::RIDGE;
use super::{MixtureKind, MixtureParams, Readout, Style};
use crate::Result;
use ndarray::{Array2, ArrayView2};

/// Number of clusters, from Lai et al.
const CLUSTERS: usize = 20;
/// Smallest mean number of poses per cluster; fewer training poses give fewer clusters.
const LEAST: usize = 20;

/// The kind `clustered`.
pub(crate) const KIND: MixtureKind = MixtureKind {
    name: "clustered",
    style: Style {
        answer: Readout::Best,
        estimates_rest: true,
    },
    learn,
};

fn learn(xyz: ArrayView2<'_, f32>, seed: u64) -> Result<MixtureParams> {
    let moments = clusters(xyz, CLUSTERS, LEAST, seed)?;
    let mut means = Array2::zeros((moments.len(), xyz.ncols()));
    let weights = weights(&moments);
    let mut covariances = Vec::new();
    for (m, mut row) in moments.into_iter().zip(means.rows_mut()) {
        row.assign(&m.mean);
        let mut covariance = m.covariance;
        covariance.diag_mut().mapv_inplace(|v| v + RIDGE);
        covariances.push(covariance);
    }
    Ok(MixtureParams::of_covariances(weights, means, &covariances))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::gaussian::GaussianMixturePrior;
    use crate::published::gaussian::em::moments_of;
    use crate::testdata::{PriorExt, normal};
    use ndarray::{Array1, s};

    /// Two clusters 100 cm apart, in turn.
    fn apart() -> Array2<f32> {
        let x = normal(80, 6, 5);
        Array2::from_shape_fn((80, 6), |(i, c)| {
            (x[[i, c]] * (1.0 + c as f64) + 100.0 * (i % 2) as f64) as f32
        })
    }

    #[test]
    fn each_cluster_has_its_own_gaussian() {
        let x = apart();
        let labels: Vec<u32> = (0..80).map(|i| i % 2).collect();
        let want = moments_of(x.view(), &labels, 2);
        // 80 poses are enough for 4 clusters of 20; two lie apart.
        let parts = learn(x.view(), 0).unwrap();
        assert_eq!(parts.len(), 4);
        let of = |mean: &Array1<f64>| -> f64 {
            let near = |j: &usize| (parts.means[[*j, 0]] - mean[0]).abs() < 50.0;
            (0..4).filter(near).map(|j| parts.weights[j]).sum()
        };
        assert!(want.iter().all(|m| (of(&m.mean) - 0.5).abs() <= 1e-12));
        // With as many clusters as there are: their moments.
        let some = x.slice(s![..40, ..]);
        let parts = learn(some, 0).unwrap();
        let want = moments_of(some, &labels[..40], 2);
        assert_eq!(parts.weights, [0.5, 0.5]);
        for m in &want {
            let j = usize::from((parts.means[[1, 0]] - m.mean[0]).abs() < 50.0);
            let covariance = &m.covariance + &(Array2::<f64>::eye(6) * RIDGE);
            assert!(
                (&parts.means.row(j) - &m.mean)
                    .iter()
                    .all(|d| d.abs() <= 1e-4)
            );
            assert!(
                (parts.covariance(j) - covariance)
                    .iter()
                    .all(|d| d.abs() <= 1e-3)
            );
        }
    }

    #[test]
    fn the_likeliest_alone_answers() {
        let parts = learn(apart().slice(s![..40, ..]), 0).unwrap();
        let all = GaussianMixturePrior::new(&parts, KIND.style, 1.0);
        let far = usize::from(parts.means[[1, 0]] > 50.0);
        let one = MixtureParams {
            weights: vec![1.0],
            means: parts.means.slice(s![far..=far, ..]).to_owned(),
            factors: parts
                .factors
                .slice(s![6 * far..6 * (far + 1), ..])
                .to_owned(),
            rest: parts.rest.slice(s![far..=far, ..]).to_owned(),
        };
        let one = GaussianMixturePrior::new(&one, KIND.style, 1.0);
        // Nearer to the far one, though both have a say in it.
        let (y, noise) = ([55.0; 6], [900.0; 6]);
        assert_eq!(all.full(&y, &noise).mean, one.full(&y, &noise).mean);
    }
}

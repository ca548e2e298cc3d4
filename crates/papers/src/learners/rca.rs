//! Relevant component analysis (Bar-Hillel, Hertz, Shental, Weinshall: Learning a Mahalanobis
//! Metric from Equivalence Constraints. JMLR 6, 2005).
//!
//! Poses that are alike by a chain of pairs form a chunklet. With C the covariance of poses about
//! the means of their own chunklets (d, d), the distance is (x − y)ᵀ C⁻¹ (x − y): what varies among
//! alike poses counts little.
//!
//! C⁻¹ = W Wᵀ at full rank, so distances are those of the paper's C^(−1/2), which is W up to a
//! rotation. Below full rank W keeps the directions w of the largest ratio of total to within
//! variance, wᵀ T w / wᵀ C w (the paper's constrained Fisher discriminant), scaled so that Wᵀ C W =
//! I. Cost: O(n d² + d³).

use super::components::components;
use super::scatter::{add_ridge, total_scatter};
use super::{Needs, Settings, check};
use crate::Result;
use crate::metric::train::TrainingPairs;
use crate::numeric::linalg::generalized_eigen;
use crate::numeric::product::transposed_product;
use ndarray::{Array2, ArrayView2, Axis, s};

/// Learns W (d, at most rank), the most relevant direction first. Uses alike pairs only; poses
/// without a label count in the total variance.
///
/// # Errors
/// [`crate::Error::Unfit`]: no alike pairs, or pairs, poses or settings that cannot be used.
pub(crate) fn fit(pairs: &TrainingPairs<'_>, settings: &Settings) -> Result<Array2<f64>> {
    check(pairs, "rca", Needs::Alike, settings.rank)?;
    let mut within = chunklet_covariance(pairs.x, pairs.alike);
    add_ridge(&mut within, settings.ridge)?;
    let eigen = generalized_eigen(&total_scatter(pairs.x), &within);
    let (_, w) =
        eigen.ok_or("rca needs a larger ridge: alike poses do not vary in all directions")?;
    let rank = settings.rank.min(w.ncols());
    Ok(w.slice(s![.., ..rank]).to_owned())
}

/// The covariance of poses about the means of their own chunklets, over all their members: (d, d).
fn chunklet_covariance(x: ArrayView2<'_, f64>, alike: &[[usize; 2]]) -> Array2<f64> {
    let mut rest = Vec::new();
    for members in components(x.nrows(), alike).groups {
        let chunklet = x.select(Axis(0), &members);
        let mean = chunklet.mean_axis(Axis(0)).expect("has members");
        rest.extend(chunklet - &mean);
    }
    let n = rest.len() / x.ncols();
    let rest = Array2::from_shape_vec((n, x.ncols()), rest).expect("whole rows");
    transposed_product(rest.view(), rest.view()) / n.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::testdata::Planted;
    use super::*;
    use ndarray::array;

    #[test]
    fn the_metric_is_the_inverse_of_the_chunklets_covariance() {
        let data = Planted::new(3, 2);
        let settings = Settings {
            rank: 99,
            ridge: 0.01,
            ..Settings::default()
        };
        let w = fit(&data.pairs(), &settings).unwrap();
        let mut within = chunklet_covariance(data.x.view(), &data.alike);
        add_ridge(&mut within, 0.01).unwrap();
        let error = w.dot(&w.t()).dot(&within) - Array2::<f64>::eye(5);
        assert!(error.iter().all(|e| e.abs() <= 1e-10));
        // A lower rank keeps the first of the same directions.
        let two = fit(
            &data.pairs(),
            &Settings {
                rank: 2,
                ..settings
            },
        )
        .unwrap();
        assert_eq!(two, w.slice(s![.., ..2]));
    }

    #[test]
    fn a_chunklet_varies_about_its_own_mean() {
        let x = array![[0.0], [2.0], [50.0], [54.0], [1000.0]];
        let within = chunklet_covariance(x.view(), &[[0, 1], [2, 3]]);
        assert_eq!(within, array![[(1.0 + 1.0 + 4.0 + 4.0) / 4.0]]);
    }

    #[test]
    fn alike_poses_that_are_the_same_are_told() {
        let fit = |pairs: &TrainingPairs<'_>, settings: &Settings| {
            fit(pairs, settings).map_err(|e| e.to_string())
        };
        let x = array![[0.0, 1.0], [0.0, 1.0], [5.0, 2.0]];
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &[[0, 1]],
            unlike: &[],
        };
        assert!(
            fit(&pairs, &Settings::default())
                .unwrap_err()
                .contains("the same")
        );
        // A pair of a pose with itself holds nothing either.
        let itself = TrainingPairs {
            alike: &[[2, 2]],
            ..pairs
        };
        assert!(fit(&itself, &Settings::default()).is_err());
        // A singular covariance without a ridge.
        let one = TrainingPairs {
            alike: &[[0, 2]],
            ..pairs
        };
        let without = Settings {
            rank: 2,
            ridge: 0.0,
            ..Settings::default()
        };
        assert!(fit(&one, &without).unwrap_err().contains("ridge"));
    }
}

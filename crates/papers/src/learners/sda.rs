//! Semi-supervised discriminant analysis (Cai, He, Han: Semi-supervised Discriminant Analysis. ICCV
//! 2007), for labels of pairs.
//!
//! Maximizes Tr(Wᵀ S_B W) under Wᵀ (S_W + β J + ridge) W = I, where
//! - S_B is the mean of (x_i − x_j)(x_i − x_j)ᵀ over unlike pairs (d, d), S_W over alike pairs;
//! - J is the same mean over the edges of the graph of nearest neighbors of all poses. That is Xᵀ L
//!   X for the graph's Laplacian L, up to a factor: a good direction changes little from a pose to
//!   its neighbors. J is scaled to the trace of S_W, so that β means the same for any number of
//!   poses.
//!
//! The paper has S_B + S_W in place of S_W, which gives the same directions: A w = λ (A + C) w is A
//! w = λ / (1 − λ) C w. Only their scale differs. Here what should be small has the scale 1 in each
//! direction, so the directions that tell poses apart best count most.
//!
//! Without poses that have no label there is nothing that the graph adds: J is left out, and the
//! method is linear discriminant analysis. Cost: O(n² d) for the graph, O(d³).

use super::neighbors::edges;
use super::scatter::{add_ridge, pair_scatter};
use super::{Needs, Settings, check, labeled_rows};
use crate::Result;
use crate::metric::train::TrainingPairs;
use crate::numeric::linalg::generalized_eigen;
use ndarray::{Array2, s};

/// An eigenvalue of at most this share of the largest is 0 but for rounding.
const LEAST_RATIO: f64 = 1e-10;

/// Learns W (d, at most rank), the most discriminative direction first.
///
/// W has no more columns than the rank of S_B, which is at most the number of unlike pairs.
///
/// # Errors
/// [`crate::Error::Unfit`]: no pairs of one label, or pairs, poses or settings that cannot be used.
pub(crate) fn fit(pairs: &TrainingPairs<'_>, settings: &Settings) -> Result<Array2<f64>> {
    check(pairs, "sda", Needs::Both, settings.rank)?;
    let between = pair_scatter(pairs.x, pairs.unlike);
    let mut small = pair_scatter(pairs.x, pairs.alike);
    if labeled_rows(pairs).len() < pairs.x.nrows() && settings.beta > 0.0 {
        let graph = pair_scatter(pairs.x, &edges(pairs.x, settings.neighbors));
        let (size, full) = (graph.diag().sum(), small.diag().sum());
        if size > 0.0 {
            small.scaled_add(settings.beta * full / size, &graph);
        }
    }
    add_ridge(&mut small, settings.ridge)?;
    let eigen = generalized_eigen(&between, &small);
    let (ratios, w) =
        eigen.ok_or("sda needs a larger ridge: alike poses do not vary in all directions")?;
    if !(ratios[0] > 0.0) {
        return Err("sda needs pairs of label 0 whose poses differ".into());
    }
    // Directions in which no unlike pair differs are arbitrary.
    let tell = ratios.iter().filter(|&&r| r > LEAST_RATIO * ratios[0]);
    let rank = settings.rank.min(tell.count());
    Ok(w.slice(s![.., ..rank]).to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::testdata::Planted;
    use super::*;
    use crate::numeric::linalg::cholesky_solve;
    use ndarray::{Array1, Axis, array};

    /// wᵀ A w / wᵀ B w.
    fn ratio(w: &Array1<f64>, a: &Array2<f64>, b: &Array2<f64>) -> f64 {
        w.dot(&a.dot(w)) / w.dot(&b.dot(w))
    }

    #[test]
    fn with_labels_alone_it_is_linear_discriminant_analysis() {
        // Two classes: the direction is S_W⁻¹ (m₁ − m₂).
        let x = array![[0.0, 0.0], [2.0, 1.0], [1.0, 4.0], [3.0, 5.0]];
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &[[0, 1], [2, 3]],
            unlike: &[[0, 2], [0, 3], [1, 2], [1, 3]],
        };
        let settings = Settings {
            rank: 1,
            ridge: 1e-3,
            beta: 5.0,
            ..Settings::default()
        };
        let w = fit(&pairs, &settings).unwrap().column(0).to_owned();
        let mut within = pair_scatter(x.view(), pairs.alike);
        add_ridge(&mut within, 1e-3).unwrap();
        let between = pair_scatter(x.view(), pairs.unlike);
        let fisher = cholesky_solve(within.clone(), array![1.0, 4.0]).unwrap();
        let cosine = w.dot(&fisher) / (w.dot(&w) * fisher.dot(&fisher)).sqrt();
        assert!(1.0 - cosine.abs() <= 1e-4, "{cosine}");
        assert!((w.dot(&within.dot(&w)) - 1.0).abs() <= 1e-12);
        for turn in 0..100 {
            let other = array![(turn as f64 * 0.0314).cos(), (turn as f64 * 0.0314).sin()];
            assert!(ratio(&other, &between, &within) <= ratio(&w, &between, &within) + 1e-9);
        }
    }

    #[test]
    fn columns_are_white_and_ordered() {
        let data = Planted::new(3, 3);
        let settings = Settings {
            rank: 6,
            ..Settings::default()
        };
        let w = fit(&data.pairs(), &settings).unwrap();
        let between = pair_scatter(data.x.view(), &data.unlike);
        let along = w.t().dot(&between).dot(&w);
        let diagonal = along.diag().to_vec();
        assert!(diagonal.windows(2).all(|p| p[0] >= p[1]));
        let off = along - Array2::from_diag(&Array1::from(diagonal));
        assert!(off.iter().all(|e| e.abs() <= 1e-9));
    }

    #[test]
    fn the_graph_counts_only_beside_poses_without_a_label() {
        let data = Planted::new(3, 3);
        let with = |beta| Settings {
            rank: 3,
            beta,
            ..Settings::default()
        };
        let whole = data.pairs();
        let fit = |pairs: &TrainingPairs<'_>, beta| fit(pairs, &with(beta)).unwrap();
        assert_ne!(fit(&whole, 0.0), fit(&whole, 1.0));
        let rows = labeled_rows(&whole);
        let x = data.x.select(Axis(0), &rows);
        let among = |pairs: &[[usize; 2]]| -> Vec<[usize; 2]> {
            let at = |i| rows.binary_search(&i).unwrap();
            pairs.iter().map(|p| p.map(at)).collect()
        };
        let (alike, unlike) = (among(whole.alike), among(whole.unlike));
        let labeled = TrainingPairs {
            x: x.view(),
            alike: &alike,
            unlike: &unlike,
        };
        assert_eq!(fit(&labeled, 0.0), fit(&labeled, 1.0));
        assert_eq!(fit(&labeled, 1.0), fit(&whole, 0.0));
    }

    #[test]
    fn there_are_no_more_directions_than_unlike_pairs() {
        let data = Planted::new(3, 3);
        let pairs = TrainingPairs {
            unlike: &data.unlike[..2],
            ..data.pairs()
        };
        assert_eq!(fit(&pairs, &Settings::default()).unwrap().dim(), (6, 2));
        let same = TrainingPairs {
            unlike: &[[3, 3]],
            ..pairs
        };
        let error = fit(&same, &Settings::default()).unwrap_err();
        assert!(error.to_string().contains("differ"), "{error}");
    }
}

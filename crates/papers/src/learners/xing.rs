//! A full metric that spreads unlike poses (Xing, Ng, Jordan, Russell: Distance Metric Learning,
//! with Application to Clustering with Side-information. NIPS 2003).
//!
//! Maximize g(M) = Σ over unlike pairs of √(δᵀ M δ) under Σ over alike pairs of δᵀ M δ ≤ 1, M
//! positive semi-definite (d, d), where δ is the difference of a pair.
//!
//! The paper climbs the gradient and projects onto the two constraints in turn, which takes many
//! decompositions. Here one change of variables makes both hold always. With A the alike pairs'
//! scatter, to which a ridge is added as the problem is unbounded where A is singular, A = L Lᵀ, u
//! = L⁻¹ δ and M = L⁻ᵀ N L⁻¹, the constraints are Tr N ≤ 1, N ⪰ 0. All of those N are F Fᵀ / |F|²
//! for some F (d, d), so L-BFGS maximizes
//!
//! ln Σ |Fᵀ u| − ½ ln |F|²
//!
//! without constraints. g is concave, so a bound tells how far N is from the best: for G = ∂g/∂N,
//! no N has more than g(N) + λ_max(G) − Tr(G N). The search converged when that is at most a
//! thousandth above g(N).
//!
//! Cost: O(q d² + d³) a step for q unlike pairs.

use super::scatter::{add_ridge, differences, pair_scatter};
use super::{LearnedMap, Needs, Settings, check};
use crate::Result;
use crate::metric::train::TrainingPairs;
use crate::numeric::lbfgs::minimize;
use crate::numeric::linalg::{Cholesky, symmetric_eigen};
use crate::numeric::product::{product, transposed_product};
use ndarray::{Array1, Array2, ArrayView2, Axis, s};

/// Steps between two looks at the bound, and how often it is looked at.
const STEPS: usize = 30;
const ROUNDS: usize = 10;
/// Largest relative distance from the best that counts as converged.
const GAP: f64 = 1e-3;

/// Learns W (d, at most rank): the leading eigenvectors of M, each times the root of its
/// eigenvalue, so M is about W Wᵀ.
///
/// # Errors
/// [`crate::Error::Unfit`]: no pairs of one label, or pairs, poses or settings that cannot be used.
pub(crate) fn fit(pairs: &TrainingPairs<'_>, settings: &Settings) -> Result<LearnedMap> {
    check(pairs, "xing", Needs::Both, settings.rank)?;
    let mut alike = pair_scatter(pairs.x, pairs.alike) * pairs.alike.len() as f64;
    add_ridge(&mut alike, settings.ridge)?;
    let singular = "xing needs a larger ridge: alike poses do not vary in all directions";
    let factor = Cholesky::new(alike).ok_or(singular)?;
    let apart = differences(pairs.x, pairs.unlike);
    let white = factor.half_solve(&apart.t().as_standard_layout().into_owned());
    let white = different(white.ok_or(singular)?.t());
    if white.is_empty() {
        return Err("xing needs pairs of label 0 whose poses differ".into());
    }
    let (root, converged) = spread(white.view());
    let root = factor.half_solve_transposed(&root).ok_or(singular)?;
    let w = leading(&root, settings.rank).ok_or("xing cannot decompose its metric")?;
    Ok(LearnedMap { w, converged })
}

/// The rows that are not zero. A pair of copies adds nothing, and its distance has no gradient.
fn different(rows: ArrayView2<'_, f64>) -> Array2<f64> {
    let differs = |&i: &usize| rows.row(i).iter().any(|&v| v != 0.0);
    let kept: Vec<usize> = (0..rows.nrows()).filter(differs).collect();
    rows.select(Axis(0), &kept)
}

/// F / |F| of the best N for differences u (q, d), and whether it is known to be the best.
fn spread(u: ArrayView2<'_, f64>) -> (Array2<f64>, bool) {
    let d = u.ncols();
    let mut f = Array2::eye(d) / (d as f64).sqrt();
    for _ in 0..ROUNDS {
        let start = f.iter().copied().collect();
        let end = minimize(start, STEPS, 0.0, &mut |f| objective(f, u));
        f = Array2::from_shape_vec((d, d), end.at).expect("as many as at the start");
        f /= norm(&f);
        if gap(&f, u).is_some_and(|gap| gap <= GAP) {
            return (f, true);
        }
    }
    (f, false)
}

fn norm(f: &Array2<f64>) -> f64 {
    f.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Lengths of the rows.
fn lengths(rows: &Array2<f64>) -> Array1<f64> {
    rows.rows().into_iter().map(|r| r.dot(&r).sqrt()).collect()
}

/// ½ ln |F|² − ln Σ |Fᵀ u| and its gradient, for F (d, d) row by row.
fn objective(f: &[f64], u: ArrayView2<'_, f64>) -> (f64, Vec<f64>) {
    let d = u.ncols();
    let f = ArrayView2::from_shape((d, d), f).expect("d by d");
    let mut along = product(u, f);
    let lengths = lengths(&along);
    let (sum, squares) = (lengths.sum(), f.iter().map(|v| v * v).sum::<f64>());
    for (mut row, length) in along.rows_mut().into_iter().zip(&lengths) {
        row /= length.max(f64::MIN_POSITIVE);
    }
    let gradient = &f / squares - transposed_product(u, along.view()) / sum;
    (
        0.5 * squares.ln() - sum.ln(),
        gradient.iter().copied().collect(),
    )
}

/// How much more, relative to g, any N could have than N = F Fᵀ with |F| = 1, by the bound in the
/// module's head.
fn gap(f: &Array2<f64>, u: ArrayView2<'_, f64>) -> Option<f64> {
    let lengths = lengths(&product(u, f.view()));
    let roots = lengths.mapv(|l| l.max(f64::MIN_POSITIVE).sqrt());
    let scaled = &u / &roots.insert_axis(Axis(1));
    let slope = transposed_product(scaled.view(), scaled.view()) / 2.0;
    let (values, _) = symmetric_eigen(&slope)?;
    let g = lengths.sum();
    // Tr(G N) is g / 2, as g is homogeneous of degree ½.
    Some((values[values.len() - 1] - g / 2.0) / g)
}

/// The leading eigenvectors of R Rᵀ, each times the root of its eigenvalue: (d, at most rank).
fn leading(root: &Array2<f64>, rank: usize) -> Option<Array2<f64>> {
    let (values, vectors) = symmetric_eigen(&product(root.view(), root.t()))?;
    let w = vectors * values.mapv(|v| v.max(0.0).sqrt());
    let first = w.slice(s![.., ..;-1]);
    Some(first.slice(s![.., ..rank.min(w.ncols())]).to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::testdata::Planted;
    use super::*;
    use ndarray::array;

    fn distances(x: ArrayView2<'_, f64>, pairs: &[[usize; 2]], w: &Array2<f64>) -> Array1<f64> {
        lengths(&differences(x, pairs).dot(w))
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        let u = Array2::from_shape_fn((9, 3), |(i, j)| ((i * 5 + j * 7) as f64).sin());
        let f: Vec<f64> = (0..9).map(|i| (i as f64 * 1.7).cos()).collect();
        let (_, gradient) = objective(&f, u.view());
        for i in 0..9 {
            let at = |h: f64| {
                let mut moved = f.clone();
                moved[i] += h;
                objective(&moved, u.view()).0
            };
            let want = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (gradient[i] - want).abs() <= 1e-8,
                "{i}: {} {want}",
                gradient[i]
            );
        }
    }

    #[test]
    fn the_constraint_is_met_and_no_other_metric_is_better() {
        let data = Planted::new(2, 3);
        let settings = Settings {
            rank: 5,
            ridge: 1e-9,
            ..Settings::default()
        };
        let learned = fit(&data.pairs(), &settings).unwrap();
        assert!(learned.converged);
        let g = |w: &Array2<f64>| {
            let alike = distances(data.x.view(), &data.alike, w);
            let w = w / alike.dot(&alike).sqrt();
            distances(data.x.view(), &data.unlike, &w).sum()
        };
        let alike = distances(data.x.view(), &data.alike, &learned.w);
        assert!((alike.dot(&alike) - 1.0).abs() <= 1e-6);
        let best = g(&learned.w);
        assert!(
            (distances(data.x.view(), &data.unlike, &learned.w).sum() - best).abs() <= 1e-6 * best
        );
        for k in 0..200 {
            let change =
                Array2::from_shape_fn((5, 5), |(i, j)| ((k * 31 + i * 7 + j) as f64).sin());
            let size = norm(&learned.w) * [0.01, 0.1, 1.0][k % 3];
            assert!(
                g(&(&learned.w + &(change * size))) <= best * (1.0 + GAP),
                "{k}"
            );
        }
        assert!(best > 1.2 * g(&Array2::eye(5)));
    }

    #[test]
    fn one_direction_is_scaled_to_the_constraint() {
        let x = array![[0.0], [3.0], [4.0], [0.0]];
        let (alike, unlike) = ([[0, 1], [1, 2]], [[0, 2], [0, 3]]);
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &alike,
            unlike: &unlike,
        };
        let learned = fit(
            &pairs,
            &Settings {
                rank: 3,
                ridge: 0.0,
                ..Settings::default()
            },
        )
        .unwrap();
        assert!(learned.converged && (learned.w[[0, 0]].abs() - 0.1f64.sqrt()).abs() <= 1e-12);
        let copies = TrainingPairs {
            unlike: &[[0, 3]],
            ..pairs
        };
        assert!(
            fit(&copies, &Settings::default())
                .unwrap_err()
                .to_string()
                .contains("differ")
        );
    }
}

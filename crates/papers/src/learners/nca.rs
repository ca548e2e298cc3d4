//! Neighborhood component analysis (Goldberger, Roweis, Hinton, Salakhutdinov: Neighborhood
//! Components Analysis. NIPS 2005).
//!
//! Each labeled pose i picks a neighbor k among the other labeled poses with probability
//!
//! p_ik = exp(−|z_i − z_k|²) / Σ_{l ≠ i} exp(−|z_i − z_l|²), z = Wᵀ x,
//!
//! and W (d, r) maximizes Σ log p_i, where p_i = Σ p_ik over the k that are alike to i by a chain
//! of alike pairs. That is the paper's second objective (its equation 6). Its first, Σ p_i, hardly
//! changes where all p_i are small, as at a start among many poses.
//! Poses of different chains count as different, also where no pair says so; a pose that only
//! unlike pairs name is one to be kept away from.
//!
//! By L-BFGS from the first r principal directions, in which alike poses are 1 apart. The objective
//! has other maxima; the result is one near that start. Cost: O(m² r + m d r) a step for m labeled
//! poses.

use super::components::components;
use super::scatter::centered;
use super::start::principal_start;
use super::{LearnedMap, Needs, Settings, check, labeled_rows};
use crate::Result;
use crate::metric::train::TrainingPairs;
use crate::numeric::lbfgs::minimize;
use crate::numeric::parallel::map_chunks;
use crate::numeric::product::{product, transposed_product};
use ndarray::{Array1, Array2, ArrayView2, ArrayViewMut1, Axis, Zip, s};
use std::ops::Range;

/// Poses that are worked on together.
const ROWS: usize = 128;
/// Parts of the gradient that are held at one time: (m, r) each.
const PARTS: usize = 16;
/// A neighbor with less than e^−30 of the nearest one's probability has none: little would be lost
/// in rounding too.
const FARTHEST: f64 = 30.0;
/// A step that gains at most this share is the last.
const TOLERANCE: f64 = 1e-5;

/// Learns W (d, at most rank). It converged when a step gained too little, before the largest
/// number of steps.
///
/// # Errors
/// [`crate::Error::Unfit`]: no alike pairs, or all labeled poses alike by a chain; pairs, poses or
/// settings that cannot be used.
pub(crate) fn fit(pairs: &TrainingPairs<'_>, settings: &Settings) -> Result<LearnedMap> {
    check(pairs, "nca", Needs::Alike, settings.rank)?;
    let rows = labeled_rows(pairs);
    let of = components(pairs.x.nrows(), pairs.alike).of;
    let class: Vec<usize> = rows.iter().map(|&row| of[row]).collect();
    if class.iter().all(|c| *c == class[0]) {
        return Err("nca needs at least 2 groups: pairs of label 1 link all labeled poses".into());
    }
    let start = principal_start(pairs, settings.rank)?;
    let (d, r) = start.directions.dim();
    let x = centered(pairs.x.select(Axis(0), &rows).view()) * start.scale;
    let first = start.directions.iter().copied().collect();
    let end = minimize(first, settings.steps, TOLERANCE, &mut |w| {
        let w = ArrayView2::from_shape((d, r), w).expect("d by r");
        let (value, gradient) = objective(x.view(), &class, w);
        (value, gradient.iter().copied().collect())
    });
    let w = Array2::from_shape_vec((d, r), end.at).expect("as many as at the start");
    Ok(LearnedMap {
        w: w * start.scale,
        converged: end.converged,
    })
}

/// −Σ log p_i and its gradient (d, r), of labeled poses x (m, d), their classes (m) and W.
fn objective(
    x: ArrayView2<'_, f64>,
    class: &[usize],
    w: ArrayView2<'_, f64>,
) -> (f64, Array2<f64>) {
    let z = product(x, w);
    let m = z.nrows();
    let squares: Array1<f64> = z.rows().into_iter().map(|row| row.dot(&row)).collect();
    let (mut sum, mut by_z) = (0.0, Array2::zeros(z.dim()));
    for from in (0..m).step_by(ROWS * PARTS) {
        let len = (m - from).min(ROWS * PARTS);
        let parts = map_chunks(len, ROWS, |rows| {
            let rows = from + rows.start..from + rows.end;
            add_poses(rows, class, &z, &squares)
        });
        for (value, part) in parts {
            sum += value;
            by_z += &part;
        }
    }
    (sum, transposed_product(x, by_z.view()) * 2.0)
}

/// Σ −log p_i over some poses i, and half of its gradient by z (m, r).
fn add_poses(
    poses: Range<usize>,
    class: &[usize],
    z: &Array2<f64>,
    squares: &Array1<f64>,
) -> (f64, Array2<f64>) {
    let own = z.slice(s![poses.clone(), ..]);
    let mut c = own.dot(&z.t());
    let mut value = 0.0;
    for (i, mut row) in poses.clone().zip(c.rows_mut()) {
        Zip::from(&mut row)
            .and(squares)
            .for_each(|p, square| *p = squares[i] - 2.0 * *p + square);
        value += by_distances(i, row, class);
    }
    // Σ c_ik |z_i − z_k|² has half the gradient Σ_k c_ik (z_i − z_k) at i, and less that at k.
    let mut by_z = c.t().dot(&own) * -1.0;
    by_z += &(z * &c.sum_axis(Axis(0)).insert_axis(Axis(1)));
    let at_own = &own * &c.sum_axis(Axis(1)).insert_axis(Axis(1)) - c.dot(z);
    let mut rows = by_z.slice_mut(s![poses, ..]);
    rows += &at_own;
    (value, by_z)
}

/// −log p_i; turns the squared distances of pose i to all (m) into its derivatives by them. 0 for a
/// pose that no other is alike to.
fn by_distances(i: usize, mut apart: ArrayViewMut1<'_, f64>, class: &[usize]) -> f64 {
    let is_alike = |k: usize| class[k] == class[i];
    // So that i is no neighbor of its own.
    apart[i] = f64::INFINITY;
    let (mut nearest, mut nearest_alike) = (f64::INFINITY, f64::INFINITY);
    for (k, &a) in apart.iter().enumerate() {
        nearest = nearest.min(a);
        if is_alike(k) {
            nearest_alike = nearest_alike.min(a);
        }
    }
    if nearest_alike.is_infinite() {
        apart.fill(0.0);
        return 0.0;
    }
    // Each sum of exponentials is taken about its own largest, so that none is 0.
    let ratio = |a: f64| if a <= FARTHEST { (-a).exp() } else { 0.0 };
    let (mut all, mut kin) = (0.0, 0.0);
    for (k, &a) in apart.iter().enumerate() {
        all += ratio(a - nearest);
        if is_alike(k) {
            kin += ratio(a - nearest_alike);
        }
    }
    for (k, a) in apart.iter_mut().enumerate() {
        let p = ratio(*a - nearest) / all;
        let among_alike = if is_alike(k) {
            ratio(*a - nearest_alike) / kin
        } else {
            0.0
        };
        *a = among_alike - p;
    }
    nearest_alike - nearest + all.ln() - kin.ln()
}

#[cfg(test)]
mod tests {
    use super::super::testdata::Planted;
    use super::*;

    #[test]
    fn the_gradient_is_that_of_differences() {
        let x = Array2::from_shape_fn((300, 4), |(i, j)| ((i * 5 + j * 7) as f64 * 1.1).sin());
        let class: Vec<usize> = (0..300).map(|i| i * i % 4).collect();
        let w = Array2::from_shape_fn((4, 3), |(i, j)| ((i * 3 + j) as f64 * 1.3).cos() * 2.0);
        let (_, gradient) = objective(x.view(), &class, w.view());
        for ((i, j), got) in gradient.indexed_iter() {
            let at = |h: f64| {
                let mut moved = w.clone();
                moved[[i, j]] += h;
                objective(x.view(), &class, moved.view()).0
            };
            let want = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!(
                (got - want).abs() <= 1e-7 * (1.0 + want.abs()),
                "{i} {j}: {got} {want}"
            );
        }
    }

    #[test]
    fn probabilities_are_those_of_the_definition() {
        // Two classes at 0, 1 and 2: with p ∝ exp(−distance²).
        let x = ndarray::array![[0.0], [1.0], [2.0]];
        let (value, _) = objective(x.view(), &[0, 0, 2], Array2::eye(1).view());
        let (e1, e4) = ((-1.0f64).exp(), (-4.0f64).exp());
        let want = -((e1 / (e1 + e4)).ln() + 0.5f64.ln());
        assert!((value - want).abs() <= 1e-15);
        // Copies share their probability; alike poses far apart have one that is too small for a
        // number, not for its log.
        let x = ndarray::array![[0.0], [0.0], [0.0], [100.0]];
        let (value, gradient) = objective(x.view(), &[0, 1, 2, 2], Array2::eye(1).view());
        let want = 1e4 + 2f64.ln() + 3f64.ln();
        assert!((value - want).abs() <= 1e-10 && gradient[[0, 0]].is_finite());
    }

    #[test]
    fn steps_make_alike_neighbors_likelier() {
        let data = Planted::new(2, 3);
        let after = |steps| {
            let learned = fit(
                &data.pairs(),
                &Settings {
                    rank: 2,
                    steps,
                    ..Settings::default()
                },
            )
            .unwrap();
            let rows = labeled_rows(&data.pairs());
            let class: Vec<usize> = rows.iter().map(|i| i % 10).collect();
            let x = data.x.select(Axis(0), &rows);
            objective(x.view(), &class, learned.w.view()).0
        };
        let (start, end) = (after(0), after(50));
        assert!(end < 0.2 * start, "{start} {end}");
    }

    #[test]
    fn one_chain_is_too_few() {
        let data = Planted::new(2, 1);
        let pairs = TrainingPairs {
            alike: &[[0, 1], [1, 2]],
            unlike: &[],
            ..data.pairs()
        };
        let error = fit(&pairs, &Settings::default()).unwrap_err();
        assert!(error.to_string().contains("at least 2 groups"), "{error}");
        let pairs = TrainingPairs {
            unlike: &[[1, 3]],
            ..pairs
        };
        assert!(fit(&pairs, &Settings::default()).is_ok());
    }
}

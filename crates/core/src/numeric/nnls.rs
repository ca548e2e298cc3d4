//! Least squares with unknowns of at least 0, on the Gram matrix.
//!
//! minimize ½ wᵀ G w − bᵀ w over w ≥ 0,
//!
//! for a positive definite G (k, k) and b (k). Coordinate descent (Franc, Hlaváč, Navara 2005)
//! finds the unknowns that are above 0; those are then solved for exactly (Lawson and Hanson 1974,
//! chapter 23). Cost: O(k³) a round; a handful of rounds are needed.

use crate::numeric::linalg::cholesky_solve;
use ndarray::{Array1, Array2, Axis};

/// Largest error of the optimality conditions, for G of unit diagonal and b of about 1.
const TOLERANCE: f64 = 1e-9;
/// Sweeps of coordinate descent before each exact solution.
const SWEEPS: usize = 20;
/// Rounds of sweeps and exact solution; a handful are needed.
const ROUNDS: usize = 1000;

/// Minimizes ½ wᵀ G w − bᵀ w over w ≥ 0, for a positive definite G (k, k), best of unit diagonal,
/// and b (k).
///
/// `None`: G is not positive definite, a value is not finite, or no minimum was found.
pub fn nonnegative_least_squares(g: &Array2<f64>, b: &Array1<f64>) -> Option<Array1<f64>> {
    let mut w = Array1::zeros(b.len());
    for _ in 0..ROUNDS {
        let mut gradient = g.dot(&w) - b;
        for _ in 0..SWEEPS {
            for j in 0..b.len() {
                let to = (w[j] - gradient[j] / g[[j, j]]).max(0.0);
                gradient.scaled_add(to - w[j], &g.row(j));
                w[j] = to;
            }
        }
        solve_support(g, b, &mut w)?;
        let error = suboptimality(&(g.dot(&w) - b), &w);
        if error <= TOLERANCE {
            return Some(w);
        }
    }
    None
}

/// Moves to the exact minimum over the weights above 0; those that would fall below on the way
/// become 0.
fn solve_support(g: &Array2<f64>, b: &Array1<f64>, w: &mut Array1<f64>) -> Option<()> {
    loop {
        let support: Vec<usize> = (0..w.len()).filter(|&j| w[j] > 0.0).collect();
        let sub = g.select(Axis(0), &support).select(Axis(1), &support);
        let best = cholesky_solve(sub, b.select(Axis(0), &support))?;
        let along = support.iter().zip(&best);
        let share = |(&j, &to): (&usize, &f64)| w[j] / (w[j] - to);
        let blocked = along.clone().filter(|(_, to)| **to <= 0.0);
        let step = blocked.map(share).fold(1.0, f64::min);
        let whole = best.iter().all(|&to| to > 0.0);
        for (&j, &to) in along {
            let stays = to > 0.0 || w[j] / (w[j] - to) > step;
            w[j] = if whole { to } else { w[j] + step * (to - w[j]) };
            w[j] = if stays { w[j].max(0.0) } else { 0.0 };
        }
        if whole {
            return Some(());
        }
    }
}

/// How far the conditions of a minimum are broken: the gradient is 0 where w > 0, and at least 0
/// where w = 0.
fn suboptimality(gradient: &Array1<f64>, w: &Array1<f64>) -> f64 {
    let errors = gradient
        .iter()
        .zip(w)
        .map(|(&g, &w)| if w > 0.0 { g.abs() } else { -g });
    // A fold by `max` would pass over NaN.
    errors.fold(
        0.0,
        |most, e| if most.is_nan() || e <= most { most } else { e },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn the_minimum_meets_its_conditions() {
        let g = array![[1.0, 0.6, -0.2], [0.6, 1.0, 0.3], [-0.2, 0.3, 1.0]];
        for b in [array![1.0, 0.1, 0.5], array![-1.0, 2.0, 0.0]] {
            let w = nonnegative_least_squares(&g, &b).unwrap();
            let gradient = g.dot(&w) - &b;
            assert!(w.iter().any(|v| *v == 0.0) && w.iter().all(|v| *v >= 0.0));
            assert!(suboptimality(&gradient, &w) <= 1e-12);
        }
        let none = nonnegative_least_squares(&g, &array![-1.0, -1.0, -1.0]).unwrap();
        assert_eq!(none, Array1::<f64>::zeros(3));
    }

    #[test]
    fn what_cannot_be_solved_is_told() {
        assert!(nonnegative_least_squares(&array![[f64::NAN]], &array![1.0]).is_none());
        let singular = array![[1.0, 1.0], [1.0, 1.0]];
        assert!(nonnegative_least_squares(&singular, &array![f64::NAN, 1.0]).is_none());
    }
}

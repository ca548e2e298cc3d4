//! The largest ratio of two traces (Chen et al., section 4.3): W (d, r) with orthonormal columns
//! that maximizes
//!
//! ```text
//! η(W) = tr(Wᵀ A W) / tr(Wᵀ B W)
//! ```
//!
//! for symmetric A and B (d, d), B positive definite. With f(η) = max tr(Wᵀ (A - η B) W), the sum
//! of the r largest eigenvalues, the optimum is the root of f, which falls. Each step is one
//! eigendecomposition, O(d³): η becomes the ratio at the best W for the η before, a Newton step on
//! f (Jia, Nie, Zhang 2009), some five steps. (Chen et al. bisect between (29) and (30), some 50.)

use crate::numeric::linalg::symmetric_eigen;
use ndarray::{Array2, s};

/// The optimum.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TraceRatio {
    /// The ratio.
    pub ratio: f64,
    /// W (d, r).
    pub w: Array2<f64>,
    /// Eigendecompositions.
    pub steps: usize,
}

/// The relative change at which the steps end.
const TOLERANCE: f64 = 1e-12;
/// Steps, at most.
const STEPS: usize = 200;

/// Maximizes the ratio. The rank is at most d. `None` when a matrix is not finite, B has no
/// positive trace, or LAPACK gives up.
pub(crate) fn maximize(a: &Array2<f64>, b: &Array2<f64>, rank: usize) -> Option<TraceRatio> {
    let rank = rank.min(a.nrows());
    let trace = |m: &Array2<f64>| m.diag().sum();
    let mut before = trace(a) / trace(b);
    if !before.is_finite() || trace(b) <= 0.0 {
        return None;
    }
    for steps in 1.. {
        let (_, w) = best(a, b, before, rank)?;
        let ratio = trace_of(a, &w) / trace_of(b, &w);
        if ratio - before <= TOLERANCE * ratio.abs() || steps == STEPS {
            return Some(TraceRatio { ratio, w, steps });
        }
        before = ratio;
    }
    None
}

/// f(η) and the W that it is of.
fn best(a: &Array2<f64>, b: &Array2<f64>, eta: f64, rank: usize) -> Option<(f64, Array2<f64>)> {
    let (values, vectors) = symmetric_eigen(&(a - &(b * eta)))?;
    let from = values.len() - rank;
    let w = vectors.slice(s![.., from..;1]).to_owned();
    Some((values.slice(s![from..]).sum(), w))
}

/// tr(Wᵀ M W).
fn trace_of(m: &Array2<f64>, w: &Array2<f64>) -> f64 {
    (m.dot(w) * w).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;

    fn positive(d: usize, seed: u64) -> Array2<f64> {
        use rand::Rng;
        let mut rng = parallel::rng(seed, 0);
        let root = Array2::from_shape_fn((2 * d, d), |(_, j)| {
            rng.random_range(-1.0..1.0) * (1.0 + j as f64)
        });
        root.t().dot(&root)
    }

    #[test]
    fn the_optimum_is_the_root_and_has_orthonormal_columns() {
        for (d, rank) in [(12, 3), (30, 10), (5, 5), (4, 9)] {
            let (a, b) = (positive(d, 1), positive(d, 2));
            let newton = maximize(&a, &b, rank).unwrap();
            // f falls through 0 there.
            let f = |by: f64| best(&a, &b, newton.ratio * by, rank.min(d)).unwrap().0;
            assert!(f(1.0 - 1e-8) > 0.0 && f(1.0 + 1e-8) < 0.0);
            let unit = newton.w.t().dot(&newton.w) - Array2::<f64>::eye(newton.w.ncols());
            assert!(unit.iter().all(|v| v.abs() <= 1e-10));
            // No other W that is tried is better.
            for seed in 3..9 {
                let (_, other) = symmetric_eigen(&positive(d, seed)).unwrap();
                let w = other.slice(s![.., ..rank.min(d)]).to_owned();
                assert!(trace_of(&a, &w) / trace_of(&b, &w) <= newton.ratio * (1.0 + 1e-9));
            }
        }
    }

    #[test]
    fn no_ratio_without_a_positive_trace() {
        let a = positive(3, 1);
        assert!(maximize(&a, &Array2::zeros((3, 3)), 2).is_none());
        assert!(maximize(&a, &(&a * f64::NAN), 2).is_none());
    }
}

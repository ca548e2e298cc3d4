//! The largest ratio of two traces (Chen et al., section 4.3): W (d, r) with orthonormal columns
//! that maximizes
//!
//! ```text
//! η(W) = tr(Wᵀ A W) / tr(Wᵀ B W)
//! ```
//!
//! for symmetric A and B (d, d), B positive definite. With f(η) = max tr(Wᵀ (A - η B) W), the sum
//! of the r largest eigenvalues, the optimum is the root of f, which falls. Each step is one
//! eigendecomposition, O(d³).

use crate::numeric::linalg::symmetric_eigen;
use ndarray::{Array2, s};

/// How the root is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TraceRatioMethod {
    /// Bisection between (29) and (30), the paper's: some 50 steps.
    Bisection,
    /// η becomes the ratio at the best W for the η before, a Newton step on f (Jia, Nie, Zhang
    /// 2009): some five steps.
    Newton,
}

/// The optimum.
#[derive(Debug, Clone, PartialEq)]
pub struct TraceRatio {
    /// The ratio.
    pub ratio: f64,
    /// W (d, r).
    pub w: Array2<f64>,
    /// Eigendecompositions.
    pub steps: usize,
}

/// The relative width at which bisection ends, and the relative change at which Newton's steps do.
const TOLERANCE: f64 = 1e-12;
/// Steps, at most.
const STEPS: usize = 200;

/// Maximizes the ratio. The rank is at most d. `None` when a matrix is not finite, B has no
/// positive trace, or LAPACK gives up.
pub fn maximize(
    a: &Array2<f64>,
    b: &Array2<f64>,
    rank: usize,
    method: TraceRatioMethod,
) -> Option<TraceRatio> {
    let rank = rank.min(a.nrows());
    let trace = |m: &Array2<f64>| m.diag().sum();
    let best = |eta: f64| -> Option<(f64, Array2<f64>)> {
        let (values, vectors) = symmetric_eigen(&(a - &(b * eta)))?;
        let from = values.len() - rank;
        let w = vectors.slice(s![.., from..;1]).to_owned();
        Some((values.slice(s![from..]).sum(), w))
    };
    let ratio = |w: &Array2<f64>| trace_of(a, w) / trace_of(b, w);
    let mut lower = trace(a) / trace(b);
    if !lower.is_finite() || trace(b) <= 0.0 {
        return None;
    }
    let mut steps = 0;
    match method {
        TraceRatioMethod::Newton => loop {
            let (_, w) = best(lower)?;
            let next = ratio(&w);
            steps += 1;
            if next - lower <= TOLERANCE * next.abs() || steps == STEPS {
                return Some(TraceRatio {
                    ratio: next,
                    w,
                    steps,
                });
            }
            lower = next;
        },
        TraceRatioMethod::Bisection => {
            let (above, _) = symmetric_eigen(a)?;
            let (below, _) = symmetric_eigen(b)?;
            let largest = above.slice(s![above.len() - rank..]).sum();
            let smallest = below.slice(s![..rank]).sum();
            let mut upper = largest / smallest;
            if !(upper.is_finite() && smallest > 0.0) {
                return None;
            }
            while upper - lower > TOLERANCE * upper.abs() && steps < STEPS {
                let middle = 0.5 * (lower + upper);
                match best(middle)?.0 > 0.0 {
                    true => lower = middle,
                    false => upper = middle,
                }
                steps += 1;
            }
            let (_, w) = best(0.5 * (lower + upper))?;
            Some(TraceRatio {
                ratio: ratio(&w),
                w,
                steps: steps + 1,
            })
        }
    }
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
    fn both_methods_find_one_optimum_with_orthonormal_columns() {
        for (d, rank) in [(12, 3), (30, 10), (5, 5), (4, 9)] {
            let (a, b) = (positive(d, 1), positive(d, 2));
            let newton = maximize(&a, &b, rank, TraceRatioMethod::Newton).unwrap();
            let bisection = maximize(&a, &b, rank, TraceRatioMethod::Bisection).unwrap();
            let difference = (newton.ratio - bisection.ratio).abs();
            assert!(difference <= 1e-8 * newton.ratio);
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
        assert!(maximize(&a, &Array2::zeros((3, 3)), 2, TraceRatioMethod::Newton).is_none());
        assert!(maximize(&a, &(&a * f64::NAN), 2, TraceRatioMethod::Newton).is_none());
    }
}

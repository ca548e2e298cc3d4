//! Regularized distance metric learning with sparse representation (Chen et al., section 4), and
//! what makes it work on people that it has not seen.
//!
//! From poses x (N, d), of which pairs are alike, W (d, rank) for the distance |Wᵀ(x_i - x_j)|:
//!
//! ```text
//! A = scatter of x, a mean                                           (24)
//! B = mean of r_i r_iᵀ + α S_W + ridge tr(·)/d I,  r_i = x_i - Σ_j a_ij x_j   (17), (26)
//! S_W = mean of (x_k - x_l)(x_k - x_l)ᵀ over pairs that are alike     (13)
//! ```
//!
//! Both terms of B are means, so that α means the same for any number of poses and pairs. Chen et
//! al. maximize the ratio of traces tr(WᵀAW) / tr(WᵀBW) with orthonormal W
//! ([`Criterion::TraceRatio`]). Without much of a ridge its columns are the directions in which
//! B is nearly 0, whatever A is there: neighbors across people are then hardly better than chance.
//! The default is the ratio trace, A w = λ B w, WᵀBW = I ([`Criterion::RatioTrace`]): each
//! direction counts by its own ratio.

use super::sparse_graph::SparseGraph;
use super::stopwatch::Stopwatch;
use super::trace_ratio::maximize;
use crate::Result;
use crate::numeric::linalg::{generalized_eigen, symmetric_eigen};
use crate::numeric::product::{gram, product};
use ndarray::{Array2, ArrayView2, Axis, s};

/// What W maximizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// The ratio of traces, W orthonormal: Chen et al.'s (26).
    TraceRatio,
    /// The trace of the ratio, WᵀBW = I.
    RatioTrace,
}

/// Settings of the learning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RdsrSettings {
    /// What is maximized.
    pub criterion: Criterion,
    /// Columns of W.
    pub rank: usize,
    /// The weight of pairs against the sparse graph.
    pub alpha: f64,
    /// The sparsity of the graph, 0 to 1; see [`super::sparse_graph`].
    pub gamma: f64,
    /// The violation of optimality that the graph may have.
    pub tolerance: f64,
    /// The share of B's mean eigenvalue that is added to all.
    pub ridge: f64,
}

/// What was learned.
#[derive(Debug, Clone)]
pub(crate) struct Rdsr {
    /// W (d, rank).
    pub w: Array2<f64>,
    /// The largest violation of optimality of the sparse graph; `None` without unlabeled poses.
    pub violation: Option<f64>,
    /// Seconds of each step, by name, in order.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Learns W from poses `x` (N, d) and the scatter `alike` (d, d) of pairs that are alike, a mean.
/// Without poses it is the supervised form (46): the directions in which pairs differ least.
///
/// # Errors
/// [`crate::Error::Unfit`]: numbers are not finite, or the poses do not vary.
pub(crate) fn learn(
    x: ArrayView2<'_, f64>,
    alike: &Array2<f64>,
    settings: &RdsrSettings,
) -> Result<Rdsr> {
    let d = alike.nrows();
    let rank = settings.rank.min(d);
    let failed = || "the poses do not vary, or are not finite".to_string();
    if x.nrows() == 0 {
        let (_, vectors) = symmetric_eigen(alike).ok_or_else(failed)?;
        return Ok(Rdsr {
            w: vectors.slice(s![.., ..rank]).to_owned(),
            violation: None,
            seconds: Vec::new(),
        });
    }
    let mut clock = Stopwatch::default();
    let products = product(x, x.t());
    clock.lap("products of poses");
    let graph = SparseGraph::code(products.view(), settings.gamma, settings.tolerance);
    clock.lap("sparse graph");
    let a = scatter(x);
    clock.lap("A");
    let mut b = unexplained(x, &graph) + alike * settings.alpha;
    let ridge = settings.ridge * b.diag().sum() / d as f64;
    b.diag_mut().mapv_inplace(|v| v + ridge);
    clock.lap("B");
    let w = match settings.criterion {
        Criterion::TraceRatio => maximize(&a, &b, rank).map(|t| t.w),
        Criterion::RatioTrace => {
            generalized_eigen(&a, &b).map(|(_, w)| w.slice(s![.., ..rank]).to_owned())
        }
    }
    .ok_or_else(failed)?;
    clock.lap("optimum");
    Ok(Rdsr {
        violation: Some(graph.violation),
        w,
        seconds: clock.laps,
    })
}

/// The scatter of poses about their mean (d, d), a mean.
pub(super) fn scatter(x: ArrayView2<'_, f64>) -> Array2<f64> {
    let mean = x.mean_axis(Axis(0)).unwrap_or_default();
    gram((&x - &mean).view()) / x.nrows().max(1) as f64
}

/// The mean scatter of what the graph leaves of each pose: X S_L Xᵀ / N.
fn unexplained(x: ArrayView2<'_, f64>, graph: &SparseGraph) -> Array2<f64> {
    let mut rest = x.to_owned();
    for (mut rest, weights) in rest.rows_mut().into_iter().zip(&graph.weights) {
        for (j, weight) in weights {
            rest.scaled_add(-weight, &x.row(*j));
        }
    }
    gram(rest.view()) / x.nrows() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use rand::Rng;

    /// Poses whose first two coordinates are what they do, the others who does it.
    fn people() -> (Array2<f64>, Array2<f64>) {
        let mut rng = parallel::rng(3, 0);
        let mut noise = |width: f64| rng.random_range(-width..width);
        let x = Array2::from_shape_fn((200, 6), |(_, j)| noise(if j < 2 { 1.0 } else { 3.0 }));
        let differences =
            Array2::from_shape_fn((300, 6), |(_, j)| noise(if j < 2 { 0.1 } else { 4.0 }));
        let alike = gram(differences.view()) / 300.0;
        (x, alike)
    }

    fn settings(criterion: Criterion) -> RdsrSettings {
        RdsrSettings {
            criterion,
            rank: 2,
            alpha: 1.0,
            gamma: 0.05,
            tolerance: 1e-6,
            ridge: 0.01,
        }
    }

    #[test]
    fn directions_in_which_alike_poses_differ_are_left_out() {
        let (x, alike) = people();
        for criterion in [Criterion::RatioTrace, Criterion::TraceRatio] {
            let w = learn(x.view(), &alike, &settings(criterion)).unwrap().w;
            let weight = |rows: std::ops::Range<usize>| w.slice(s![rows, ..]).mapv(|v| v * v).sum();
            assert!(weight(2..6) < 0.05 * weight(0..2));
        }
        let w = learn(
            x.slice(s![..0, ..]),
            &alike,
            &settings(Criterion::RatioTrace),
        )
        .unwrap()
        .w;
        assert!(w.slice(s![2.., ..]).iter().all(|v| v.abs() < 0.2));
    }

    #[test]
    fn the_ratio_trace_has_unit_columns_in_b() {
        let (x, alike) = people();
        let settings = settings(Criterion::RatioTrace);
        let w = learn(x.view(), &alike, &settings).unwrap().w;
        let graph = SparseGraph::code(x.dot(&x.t()).view(), 0.05, 1e-6);
        let mut b = unexplained(x.view(), &graph) + &alike;
        let ridge = 0.01 * b.diag().sum() / 6.0;
        b.diag_mut().mapv_inplace(|v| v + ridge);
        let unit = w.t().dot(&b).dot(&w) - Array2::<f64>::eye(2);
        assert!(unit.iter().all(|v| v.abs() <= 1e-8));
    }

    #[test]
    fn the_graph_term_is_the_laplacian_form() {
        let (x, _) = people();
        let x = x.slice(s![..20, ..]);
        let graph = SparseGraph::code(x.dot(&x.t()).view(), 0.05, 1e-8);
        let mut rest = Array2::<f64>::eye(20);
        for (i, weights) in graph.weights.iter().enumerate() {
            weights.iter().for_each(|(j, w)| rest[[*j, i]] -= w);
        }
        let laplacian = rest.dot(&rest.t());
        let expected = x.t().dot(&laplacian).dot(&x) / 20.0;
        let difference = unexplained(x, &graph) - expected;
        assert!(difference.iter().all(|v| v.abs() <= 1e-12));
    }
}

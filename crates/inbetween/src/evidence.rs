//! Whether known motion may fill a gap, and how sure that is: by gaps that are simulated in the
//! windows nearest to it.
//!
//! The residual of such a window is predicted like that of the gap, from windows that do not
//! overlap it (of the take itself), or are of other people (of a library; of other takes where
//! all are one person's). With a the weights of the simulated gaps, by how alike their distances d
//! to what is known are; r and p their residuals and predictions; y that of the gap:
//!
//! ```text
//! a ∝ .02 + exp(-ln²(d / dᵢ) / .18)
//! ρ = -.13 + .74 Σ a ln(|rᵢ - pᵢ| / |rᵢ|) - .36 Σ a ln(dᵢ / d) - .30 ln(|y| / √Σ a pᵢ²)
//! ```
//!
//! e^ρ is the error that is expected, as a share of that of the bridge; the weight of y falls from
//! 1 at ρ = -.75 to 0 at -.35. The variance of a coordinate is .87² that of the simulated gaps,
//! shared by the points as there, and over time as (4 u (1 - u))^1.5.

use super::body_tree::BodyTree;
use super::regression::{Blend, Known, Window, blend};
use ndarray::Array1;
use std::collections::HashMap;

/// Simulated gaps, of the take's own windows and of others', and the fewest that say something.
const SIMULATED: usize = 8;
const FEWEST: usize = 3;
/// The windows that a simulated gap leaves, at least.
const LEFT: usize = 40;
/// Windows of one take of others, at most.
const A_TAKE: usize = 2;
/// Frames between two of the take itself, at least.
const OWN_APART: usize = 8;
/// What a gap weighs whose distance is quite another, and the variance of the logarithms.
const LEAST: f64 = 0.02;
const SPREAD: f64 = 0.18;
/// The forecast: constant, by simulated gaps, by distances, by size. Fitted to the gaps of 17
/// people, 611 windows; halves of them give .03, .07, .07 and .06 others.
const FORECAST: [f64; 4] = [-0.13, 0.74, -0.36, -0.30];
/// ρ at which the weight is 1 and 0.
const FULL: f64 = -0.75;
const NONE: f64 = -0.35;
/// The deviation over that of simulated gaps.
const DEVIATION: f64 = 0.87;

/// The residuals of windows, as they are needed.
#[derive(Default)]
pub(crate) struct Residuals(HashMap<Window, Array1<f64>>);

impl Residuals {
    fn of(&mut self, tree: &BodyTree, known: &Known<'_>, window: Window) -> &Array1<f64> {
        self.0.entry(window).or_insert_with(|| {
            let windows = known.of(window);
            windows.map_or_else(|| Array1::zeros(0), |w| w.residual(tree, window.index))
        })
    }

    /// The sum that a blend is.
    pub(crate) fn blended(
        &mut self,
        tree: &BodyTree,
        known: &Known<'_>,
        blend: &Blend,
    ) -> Array1<f64> {
        let mut sum = Array1::zeros(0);
        for (window, w) in blend.windows.iter().zip(&blend.weights) {
            let own = self.of(tree, known, *window);
            if sum.is_empty() {
                sum = Array1::zeros(own.len());
            }
            sum.scaled_add(*w, own);
        }
        sum
    }
}

/// A simulated gap.
struct Simulated {
    /// Sums over its frames and points: |r - p|², |p|², |r|², cm².
    miss: f64,
    predicted: f64,
    size: f64,
    /// The distance to the third nearest window.
    distance: f64,
    /// The mean square of each point's miss, and of its residual, cm².
    miss_of: Vec<f64>,
    size_of: Vec<f64>,
}

/// What simulated gaps say of a gap.
#[derive(Debug, Clone)]
pub(crate) struct Evidence {
    /// The error expected, as a share of that of the bridge.
    pub expected: f64,
    /// The weight of the residual.
    pub weight: f64,
    /// The variance of a coordinate of each point, the mean over the gap, cm².
    pub variance: Vec<f64>,
}

/// The evidence for a gap of which `blend` gives the residual `y`, from all windows with their
/// squared distances to it; `None` where too little can be simulated.
pub(crate) fn evidence(
    tree: &BodyTree,
    known: &Known<'_>,
    residuals: &mut Residuals,
    (gap, y): (&Blend, &Array1<f64>),
    near: &[(f64, Window)],
) -> Option<Evidence> {
    let mut near = near.to_vec();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut simulated = Vec::new();
    for is_own in [true, false] {
        for window in chosen(known, &near, is_own) {
            simulated.extend(simulate(tree, known, residuals, window));
        }
    }
    if simulated.len() < FEWEST {
        return None;
    }
    let alike = |s: &Simulated| {
        let log = (gap.distance.max(1e-9) / s.distance.max(1e-9)).ln();
        LEAST + (-log * log / SPREAD).exp()
    };
    let weights: Array1<f64> = simulated.iter().map(alike).collect();
    let weights = &weights / weights.sum();
    let mean = |of: &dyn Fn(&Simulated) -> f64| -> f64 {
        simulated.iter().zip(&weights).map(|(s, a)| a * of(s)).sum()
    };
    let half_log = |a: f64, b: f64| 0.5 * (a.max(1e-12) / b.max(1e-12)).ln();
    let missed = mean(&|s| half_log(s.miss, s.size));
    let farther = mean(&|s| (s.distance.max(1e-9) / gap.distance.max(1e-9)).ln());
    let larger = half_log(y.dot(y) + 1e-3, mean(&|s| s.predicted) + 1e-3);
    let [constant, by_miss, by_distance, by_size] = FORECAST;
    let forecast = constant + by_miss * missed + by_distance * farther + by_size * larger;
    let weight = ((NONE - forecast) / (NONE - FULL)).clamp(0.0, 1.0);
    // |r - w p|² = w |r - p|² + (1 - w) |r|² - w (1 - w) |p|².
    let left = |s: &Simulated| {
        weight * s.miss + (1.0 - weight) * s.size - weight * (1.0 - weight) * s.predicted
    };
    let level = DEVIATION.powi(2) * (mean(&left) / y.len() as f64 + 1e-4);
    let mut shares = Array1::zeros(tree.points());
    for (s, a) in simulated.iter().zip(&weights) {
        let own: Array1<f64> = (s.miss_of.iter().zip(&s.size_of))
            .map(|(miss, size)| weight * miss + (1.0 - weight) * size)
            .collect();
        let mean = own.mean().unwrap_or(1.0).max(1e-12);
        shares.scaled_add(a / mean, &own);
    }
    let mean_share = shares.mean().unwrap_or(1.0).max(1e-12);
    Some(Evidence {
        expected: forecast.exp(),
        weight,
        variance: shares.iter().map(|s| level * s / mean_share).collect(),
    })
}

/// The windows nearest to the gap in which one is simulated, apart from each other.
fn chosen(known: &Known<'_>, near: &[(f64, Window)], is_own: bool) -> Vec<Window> {
    let mut out: Vec<Window> = Vec::new();
    for (_, window) in near.iter().filter(|(_, w)| w.is_own == is_own) {
        let Some(windows) = known.of(*window) else {
            continue;
        };
        let (take, start) = (
            windows.origin(window.index).take,
            windows.gap_start(window.index),
        );
        let least = if is_own { OWN_APART } else { 0 };
        let apart = (windows.steps / 2).max(least);
        let same_take = |w: &&Window| windows.origin(w.index).take == take;
        let is_beside = |w: &Window| windows.gap_start(w.index).abs_diff(start) < apart;
        let is_full = !is_own && out.iter().filter(same_take).count() >= A_TAKE;
        if !is_full && !out.iter().filter(same_take).any(is_beside) {
            out.push(*window);
        }
        if out.len() == SIMULATED {
            break;
        }
    }
    out
}

/// A gap simulated in a window; `None` where too little is left without what is too near to it.
fn simulate(
    tree: &BodyTree,
    known: &Known<'_>,
    residuals: &mut Residuals,
    window: Window,
) -> Option<Simulated> {
    let windows = known.of(window)?;
    let features = windows.row(window.index);
    let (clip, start) = (
        windows.origin(window.index),
        windows.gap_start(window.index),
    );
    let is_one = windows.is_of_one();
    let is_out = |other: &Window| {
        if other.is_own != window.is_own {
            return false;
        }
        let others = windows.origin(other.index);
        if window.is_own {
            let gap = windows.gap_start(other.index);
            gap.abs_diff(start) < windows.apart()
        } else if is_one {
            others.take == clip.take
        } else {
            others.person == clip.person
        }
    };
    let mut left = known.distances(features);
    left.retain(|(_, other)| !is_out(other));
    if left.len() < LEFT {
        return None;
    }
    let blend = blend(known, features, left)?;
    let p = residuals.blended(tree, known, &blend);
    let r = residuals.of(tree, known, window).clone();
    let off = &r - &p;
    Some(Simulated {
        miss: off.dot(&off),
        predicted: p.dot(&p),
        size: r.dot(&r),
        distance: blend.distance,
        miss_of: mean_squares(tree, &off),
        size_of: mean_squares(tree, &r),
    })
}

/// The mean square of a coordinate of each point, whose residuals are about the root's.
fn mean_squares(tree: &BodyTree, residual: &Array1<f64>) -> Vec<f64> {
    let points = tree.points();
    let mut sums = vec![0.0; points];
    let values = residual.as_slice().unwrap_or_default();
    for frame in values.chunks_exact(3 * points) {
        let root = &frame[3 * tree.root..3 * tree.root + 3];
        for (p, own) in frame.chunks_exact(3).enumerate() {
            let about = |c: usize| if p == tree.root { 0.0 } else { root[c] };
            sums[p] += (0..3).map(|c| (own[c] + about(c)).powi(2)).sum::<f64>();
        }
    }
    let count = values.len() / points;
    sums.iter().map(|s| s / count.max(1) as f64).collect()
}

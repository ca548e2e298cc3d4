//! How noisy most points of a frame are and whose lengths it shows, by its rigid distances alone.
//!
//! A distance deviates by what it does by itself and by the base noise; where an end is corrupt, by more:
//!
//! ```text
//! p(d) ∝ Π_k [ .64 N(d_k − L_k; V_k + b_i² + b_j²) + .36 Σ_s w_s N(d_k − L_k; V_k + b_i² + b_j² + S_s) ]
//! ```

use super::bodies::{Bodies, Lengths};
use super::bones::{SHARE, SLAB, deviations, log_normal};
use crate::prior::EXACT;
use crate::prior::pairs::RigidPairs;
use crate::prior::small::log_sum;

/// Standard deviations of base noise that are tried, cm.
const BASES: [f64; 12] = [
    0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.2, 3.6, 6.0,
];
/// What corrupt ends add to the variance of a distance, cm², with its weight. A marker that was taken for another's is off by
/// much more than one that a few trembling pixels moved.
pub const SLABS: [(f64, f64); 4] = [
    (0.5, SLAB),
    (0.25, 4.0 * SLAB),
    (0.15, 16.0 * SLAB),
    (0.1, 64.0 * SLAB),
];
/// Fewer distances tell no noise.
const FEWEST: usize = 6;

/// The noise of most points of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseNoise {
    /// The standard deviation of a coordinate, cm, outliers aside.
    pub sd: f64,
    /// Whether the distances are likelier with some points corrupt than with more noise on all.
    pub has_outliers: bool,
}

/// The log likelihood of the distances seen under the lengths of each body, its share included; `share` of the points are
/// corrupt.
fn logs(bodies: &Bodies, seen: &[(usize, f64, f64)], share: f64) -> Vec<f64> {
    let clean = (1.0 - share).powi(2);
    let of = |l: &Lengths, &(k, d, base): &(usize, f64, f64)| {
        let (off, v) = (d - l.mean[k], l.variance[k] + base);
        let near = clean.ln() + log_normal(off, v);
        if share == 0.0 {
            return near;
        }
        let far = |(w, s): (f64, f64)| ((1.0 - clean) * w).ln() + log_normal(off, v + s);
        let [a, b, c, d] = SLABS.map(far);
        log_sum(&[near, a, b, c, d])
    };
    let all = bodies.all.iter();
    all.map(|(share, l)| share + seen.iter().map(|s| of(l, s)).sum::<f64>())
        .collect()
}

/// The lengths of the bodies that explain most distances, whatever points are corrupt; `told` holds the base variance of each
/// coordinate, infinite where it is missing.
pub fn lengths(pairs: &RigidPairs, bodies: &Bodies, y: &[f64], told: &[f64]) -> Lengths {
    let seen: Vec<(usize, f64, f64)> = deviations(pairs, y, told).collect();
    bodies.given(&logs(bodies, &seen, SHARE))
}

/// The base noise of a frame by itself: the one under which its distances are most likely. `None` where too few are seen, or
/// the body is a stranger's: its lengths would explain anything.
pub fn base(pairs: &RigidPairs, bodies: &Bodies, y: &[f64]) -> Option<BaseNoise> {
    let all = vec![EXACT; y.len()];
    let seen: Vec<(usize, f64, f64)> = deviations(pairs, y, &all).collect();
    if seen.len() < FEWEST {
        return None;
    }
    let best = |share: f64| {
        let mut best = (f64::NEG_INFINITY, None);
        for sd in BASES {
            let seen: Vec<_> = (seen.iter())
                .map(|&(k, d, _)| (k, d, 2.0 * sd * sd))
                .collect();
            for (at, log) in logs(bodies, &seen, share).into_iter().enumerate() {
                if log > best.0 {
                    best = (log, (!bodies.is_stranger(at)).then_some(sd));
                }
            }
        }
        best
    };
    let (with, without) = (best(SHARE), best(0.0));
    Some(BaseNoise {
        sd: with.1?,
        has_outliers: with.0 > without.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::pairs::Pair;
    use ndarray::Array2;

    #[test]
    fn the_base_noise_is_told_from_outliers() {
        let pairs = RigidPairs {
            pairs: (0..20)
                .map(|k| Pair {
                    ends: [k, k + 1],
                    sd: 0.0,
                    still: false,
                })
                .collect(),
            bodies: Array2::from_elem((1, 20), 10.0),
            shares: vec![1.0],
        };
        let bodies = Bodies::of(&pairs);
        let mut y: Vec<f64> = (0..21).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        for p in [3, 9, 10, 16] {
            y[3 * p] += 6.0;
            y[3 * p + 1] -= 4.0;
        }
        assert!(base(&pairs, &bodies, &y).unwrap().sd <= 0.02);
        let noisy = |sd: f64| -> Vec<f64> {
            let wave = |i: usize| ((i * i * 7 + 3 * i) as f64).sin() * std::f64::consts::SQRT_2;
            y.iter()
                .enumerate()
                .map(|(i, v)| v + sd * wave(i))
                .collect()
        };
        let found = |sd: f64| base(&pairs, &bodies, &noisy(sd)).unwrap();
        assert!((0.1..=0.8).contains(&found(0.3).sd), "{:?}", found(0.3));
        assert!(found(0.3).has_outliers);
        assert!(found(6.0).sd >= 2.0);
        // Noise that is everywhere is no outlier; one that is far off is no noise, and tells nothing of the others'.
        let y: Vec<f64> = (0..21).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        let mut far = y.clone();
        for off in [9.0, 30.0, 90.0, 300.0] {
            far[3 * 11 + 1] = off;
            let base = base(&pairs, &bodies, &far).unwrap();
            assert!(base.sd <= 0.02 && base.has_outliers, "{off} {base:?}");
        }
        for sd in [0.5, 2.0, 6.0] {
            let wave = |i: usize| ((i * i * 7 + 3 * i) as f64).sin() * std::f64::consts::SQRT_2;
            let all: Vec<f64> = (y.iter().enumerate())
                .map(|(i, v)| v + sd * wave(i))
                .collect();
            let base = base(&pairs, &bodies, &all).unwrap();
            assert!(!base.has_outliers, "{sd} {base:?}");
        }
        assert!(base(&pairs, &bodies, &vec![f64::NAN; 63]).is_none());
    }
}

//! The noise floor of a frame: the noise of most of its points, by rigid distances alone.
//!
//! A distance d_k deviates from its length L_k by its own variance V_k and by the noise floor b² of
//! both ends; an outlier at either end adds a variance S:
//!
//! ```text
//! p(d | b) ∝ Π_k [ .64 N(d_k − L_k; V_k + 2 b²) + .36 Σ_s w_s N(d_k − L_k; V_k + 2 b² + S_s) ]
//! ```
//!
//! b and the body (L, V) maximize it over a grid.

use super::body_lengths::{BodyMixture, Lengths};
use super::distances::deviations;
use super::tuning::{noise_floor::*, outliers::OUTLIER_SHARE};
use crate::numeric::simd;
use crate::numeric::small_linalg::log_product;
use crate::prior::EXACT_VARIANCE;
use crate::prior::rigid_pairs::RigidPairs;

/// The noise of most points of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NoiseFloor {
    /// Standard deviation of a coordinate, cm, outliers aside.
    pub sd: f64,
    /// Log likelihood of some outliers minus that of more noise on all points, nats.
    pub outlier_evidence: f64,
}

impl NoiseFloor {
    /// Whether outliers explain the distances better.
    #[cfg(test)]
    pub(crate) fn has_outliers(&self) -> bool {
        self.outlier_evidence > 0.0
    }
}

/// The lengths of the bodies that explain most of the distances `seen` ([`deviations`]), outliers
/// or not.
pub(crate) fn lengths(bodies: &BodyMixture, seen: &[(usize, f64, f64)]) -> Lengths {
    let of = |(share, l): &(f64, Lengths)| {
        let logs = seen.iter().map(|&(k, d, base)| {
            let off = d - l.mean[k];
            DistanceDensity::of(l.variance[k] + base).log(off * off)
        });
        share + logs.sum::<f64>()
    };
    bodies.given(&bodies.all.iter().map(of).collect::<Vec<_>>())
}

/// Density of a deviation: Σ heights exp(−rates deviation²); the first term is that of clean ends.
#[derive(Debug, Clone, Copy)]
struct DistanceDensity {
    heights: [f64; 1 + SLABS.len()],
    rates: [f64; 1 + SLABS.len()],
}

impl DistanceDensity {
    /// The density of a distance whose variance with clean ends is `variance`, cm².
    fn of(variance: f64) -> DistanceDensity {
        let clean = (1.0 - OUTLIER_SHARE).powi(2);
        let part = |s: usize| match s {
            0 => (clean, variance),
            s => ((1.0 - clean) * SLABS[s - 1].0, variance + SLABS[s - 1].1),
        };
        DistanceDensity {
            heights: std::array::from_fn(|s| part(s).0 / part(s).1.sqrt()),
            rates: std::array::from_fn(|s| 0.5 / part(s).1),
        }
    }

    /// Log density by the square of the deviation.
    fn log(&self, square: f64) -> f64 {
        let parts = self.heights.iter().zip(&self.rates);
        let sum: f64 = parts.map(|(h, r)| h * (-r * square).exp()).sum();
        sum.max(f64::MIN_POSITIVE).ln()
    }

    /// Log density of no deviation, given clean ends.
    fn log_of_clean(&self) -> f64 {
        (self.heights[0] / (1.0 - OUTLIER_SHARE).powi(2)).ln()
    }
}

/// The densities of all distances of a body under one noise floor, stored term by term.
#[derive(Debug, Clone)]
struct DistanceDensities {
    /// Heights and rates of each term.
    parts: Vec<(Vec<f64>, Vec<f64>)>,
    clean: Vec<f64>,
}

impl DistanceDensities {
    /// The densities of distances, by their variances with clean ends, cm².
    fn of(variances: impl Iterator<Item = f64>) -> DistanceDensities {
        let each: Vec<DistanceDensity> = variances.map(DistanceDensity::of).collect();
        let part = |s: usize| {
            let heights = each.iter().map(|d| d.heights[s]).collect();
            (heights, each.iter().map(|d| d.rates[s]).collect())
        };
        DistanceDensities {
            parts: (0..=SLABS.len()).map(part).collect(),
            clean: each.iter().map(DistanceDensity::log_of_clean).collect(),
        }
    }

    /// Log likelihood of the distances `seen` with any outliers, by the `squares` of all
    /// deviations. `sums` is scratch.
    fn log_likelihood(&self, seen: &[usize], squares: &[f64], sums: &mut Vec<f64>) -> f64 {
        sums.clear();
        sums.resize(squares.len(), 0.0);
        for (heights, rates) in &self.parts {
            simd::add_decays(heights, rates, squares, sums);
        }
        log_product(seen.iter().map(|&k| sums[k].max(f64::MIN_POSITIVE)))
    }

    /// Log likelihood of the distances `seen` without outliers.
    fn log_likelihood_of_clean(&self, seen: &[usize], squares: &[f64]) -> f64 {
        let rates = &self.parts[0].1;
        let logs = seen.iter().map(|&k| self.clean[k] - rates[k] * squares[k]);
        logs.sum()
    }
}

/// The densities of all distances of each body, under each noise floor.
#[derive(Debug, Clone, Default)]
pub(crate) struct NoiseFloorSearch(Vec<Vec<DistanceDensities>>);

impl NoiseFloorSearch {
    /// A search over the lengths of `bodies`.
    pub(crate) fn of(bodies: &BodyMixture) -> NoiseFloorSearch {
        let under = |l: &Lengths, sd: f64| {
            DistanceDensities::of(l.variance.iter().map(|v| v + 2.0 * sd * sd))
        };
        let all = bodies.all.iter();
        NoiseFloorSearch(
            all.map(|(_, l)| BASES.map(|sd| under(l, sd)).to_vec())
                .collect(),
        )
    }

    /// The most likely noise floor of a frame. `None` where too few distances are seen, or the
    /// unknown body fits best: its lengths would explain anything.
    pub(crate) fn base(
        &self,
        pairs: &RigidPairs,
        bodies: &BodyMixture,
        y: &[f64],
    ) -> Option<NoiseFloor> {
        let all = vec![EXACT_VARIANCE; y.len()];
        let seen: Vec<(usize, f64)> = deviations(pairs, y, &all).map(|(k, d, _)| (k, d)).collect();
        if seen.len() < FEWEST {
            return None;
        }
        let (mut with, mut without) = ((f64::NEG_INFINITY, None), f64::NEG_INFINITY);
        let mut likeliest = 0;
        let which: Vec<usize> = seen.iter().map(|(k, _)| *k).collect();
        // Squares of distances that are not seen are never read.
        let (mut squares, mut sums) = (vec![0.0; pairs.pairs.len()], Vec::new());
        for (at, ((share, lengths), noise_floors)) in bodies.all.iter().zip(&self.0).enumerate() {
            for &(k, d) in &seen {
                squares[k] = (d - lengths.mean[k]).powi(2);
            }
            let of_clean = |d: &DistanceDensities| d.log_likelihood_of_clean(&which, &squares);
            let clean: Vec<f64> = noise_floors.iter().map(of_clean).collect();
            let best = clean.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            without = without.max(share + best);
            // Outliers explain what noise would have to: with them the noise is no larger than
            // without.
            let largest = clean.iter().rposition(|c| *c == best).unwrap_or(0);
            let mut log = |base: usize| {
                let densities: &DistanceDensities = &noise_floors[base];
                share + densities.log_likelihood(&which, &squares, &mut sums)
            };
            // Most bodies are so unlikely at the best noise floor so far that no other makes up for
            // it.
            if log(likeliest) < with.0 - HOPELESS {
                continue;
            }
            for base in 0..=largest {
                let log = log(base);
                if log > with.0 {
                    with = (log, (!bodies.is_stranger(at)).then_some(BASES[base]));
                    likeliest = base;
                }
            }
        }
        Some(NoiseFloor {
            sd: with.1?,
            outlier_evidence: with.0 - without,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rigid_pairs::Pair;
    use ndarray::Array2;

    #[test]
    fn distances_side_by_side_are_as_likely_as_one_by_one() {
        let variances = [1e-4, 0.3, 5.0, 80.0];
        let squares = [1e-3, 40.0, 2e4, 1.0];
        let all = DistanceDensities::of(variances.into_iter());
        // The last distance is not seen.
        let seen = [0, 1, 2];
        let whatever = all.log_likelihood(&seen, &squares, &mut Vec::new());
        let clean = all.log_likelihood_of_clean(&seen, &squares);
        let each = variances.iter().zip(squares).take(3);
        let one = each.clone().map(|(v, x)| DistanceDensity::of(*v).log(x));
        let want: f64 = one.sum();
        assert!((whatever - want).abs() <= 1e-9 * want.abs(), "{whatever}");
        let normal = each.map(|(v, x)| -0.5 * (v.ln() + x / v));
        let want: f64 = normal.sum();
        assert!((clean - want).abs() <= 1e-9 * want.abs(), "{clean}");
    }

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
        let bodies = BodyMixture::of(&pairs);
        let noise_floors = NoiseFloorSearch::of(&bodies);
        let mut y: Vec<f64> = (0..21).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        for p in [3, 9, 10, 16] {
            y[3 * p] += 6.0;
            y[3 * p + 1] -= 4.0;
        }
        assert!(noise_floors.base(&pairs, &bodies, &y).unwrap().sd <= 0.02);
        let noisy = |sd: f64| -> Vec<f64> {
            let noise = |i: usize| ((i * i * 7 + 3 * i) as f64).sin() * std::f64::consts::SQRT_2;
            y.iter()
                .enumerate()
                .map(|(i, v)| v + sd * noise(i))
                .collect()
        };
        let found = |sd: f64| noise_floors.base(&pairs, &bodies, &noisy(sd)).unwrap();
        assert!((0.1..=0.8).contains(&found(0.3).sd), "{:?}", found(0.3));
        assert!(found(0.3).has_outliers());
        assert!(found(6.0).sd >= 2.0);
        // Noise on all points is no outlier; a point far off is no noise and does not raise the
        // floor.
        let y: Vec<f64> = (0..21).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        let mut far = y.clone();
        for off in [9.0, 30.0, 90.0, 300.0] {
            far[3 * 11 + 1] = off;
            let base = noise_floors.base(&pairs, &bodies, &far).unwrap();
            assert!(base.sd <= 0.02 && base.has_outliers(), "{off} {base:?}");
        }
        for sd in [0.5, 2.0, 6.0] {
            let noise = |i: usize| ((i * i * 7 + 3 * i) as f64).sin() * std::f64::consts::SQRT_2;
            let all: Vec<f64> = (y.iter().enumerate())
                .map(|(i, v)| v + sd * noise(i))
                .collect();
            let base = noise_floors.base(&pairs, &bodies, &all).unwrap();
            assert!(!base.has_outliers(), "{sd} {base:?}");
        }
        assert!(
            noise_floors
                .base(&pairs, &bodies, &vec![f64::NAN; 63])
                .is_none()
        );
    }
}

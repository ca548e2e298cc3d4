//! The likelihood of outliers by rigid distances alone.
//!
//! Each point is clean or an outlier, z_j in {0, 1} (odds .8 : .2). A distance d_k between points i
//! and j deviates from its length L_k by its own variance V_k, by the noise b² of both ends, and by
//! the variance S of each end that is an outlier:
//!
//! ```text
//! p(z, d) ∝ Π_j (.8 or .2) Π_k N(d_k − L_k; shift, V_k + b_i² + b_j² + z_i S_i + z_j S_j)
//! ```
//!
//! Marginals of z come from the best assignments of a beam search over the points.

use super::tuning::rigid_likelihood::*;
use crate::numeric::small_linalg::log_sum;
use crate::prior::rigid_pairs::RigidPairs;
use crate::rigid::body_lengths::{BodyMixture, Lengths};
use crate::rigid::distances::{deviations, is_seen};
use crate::rigid::noise_floor;
use crate::rigid::tuning::outliers::{MIN_OUTLIER_VARIANCE, OUTLIER_SHARE};

/// Prior log odds of an outlier.
pub(crate) fn log_odds() -> f64 {
    (OUTLIER_SHARE / (1.0 - OUTLIER_SHARE)).ln()
}

/// log N(x; 0, v) without the constant.
fn log_normal(x: f64, v: f64) -> f64 {
    -0.5 * (x * x / v + v.ln())
}

/// The likelihood of one distance.
#[derive(Debug, Clone)]
pub(crate) struct DistanceTerm {
    /// Its ends.
    pub ends: [usize; 2],
    /// Log density by which ends are outliers: none, the first, the second, both.
    logs: [f64; 4],
    /// Log density with clean ends, relative to that under a prior alone.
    pub clean: f64,
}

/// The likelihood of a frame's distances.
#[derive(Debug, Clone)]
pub(crate) struct RigidLikelihood {
    /// The distances between seen points.
    pub terms: Vec<DistanceTerm>,
    /// The probability of each point to be an outlier; 0 where not seen.
    pub corrupt: Vec<f64>,
    /// Variance of a coordinate of each point if it is an outlier, cm².
    pub outlier_variance: Vec<f64>,
    /// Square of the worst deviation among each point's distances, cm².
    pub farthest: Vec<f64>,
    /// The lengths of the body.
    pub lengths: Lengths,
}

/// Variance of a coordinate of each point if it is an outlier: its least squared deviation, as all
/// distances of an outlier deviate, and only some of its neighbors'. Distances to likely outliers
/// (`corrupt`) count where there are no others.
fn outlier_variances(
    pairs: &RigidPairs,
    seen: &[(usize, f64, f64)],
    lengths: &Lengths,
    corrupt: &[f64],
) -> Vec<f64> {
    let mut least = vec![[f64::INFINITY; 2]; corrupt.len()];
    for &(k, d, _) in seen {
        let [i, j] = pairs.pairs[k].ends;
        for (p, other) in [(i, j), (j, i)] {
            let least = &mut least[p][usize::from(corrupt[other] > 0.5)];
            *least = least.min((d - lengths.mean[k]).powi(2));
        }
    }
    let of = |[clean, any]: [f64; 2]| if clean.is_finite() { clean } else { any };
    least
        .into_iter()
        .map(|l| match of(l) {
            l if l.is_finite() => l.max(MIN_OUTLIER_VARIANCE),
            _ => MIN_OUTLIER_VARIANCE,
        })
        .collect()
}

/// Square of the worst deviation among each point's distances.
fn farthest(
    pairs: &RigidPairs,
    seen: &[(usize, f64, f64)],
    lengths: &Lengths,
    points: usize,
) -> Vec<f64> {
    let mut out = vec![0.0f64; points];
    for &(k, d, _) in seen {
        for p in pairs.pairs[k].ends {
            out[p] = out[p].max((d - lengths.mean[k]).powi(2));
        }
    }
    out
}

/// The likelihood of each distance.
fn terms(
    pairs: &RigidPairs,
    seen: &[(usize, f64, f64)],
    lengths: &Lengths,
    outlier_variance: &[f64],
) -> Vec<DistanceTerm> {
    seen.iter()
        .map(|&(k, d, base)| {
            let ends = pairs.pairs[k].ends;
            let (off, v) = (d - lengths.mean[k], lengths.variance[k] + base);
            let log = |z: usize| {
                let more = if z & 1 > 0 {
                    outlier_variance[ends[0]]
                } else {
                    0.0
                } + if z & 2 > 0 {
                    outlier_variance[ends[1]]
                } else {
                    0.0
                };
                // Noise across a bone makes it longer.
                let shift = (more / lengths.mean[k].max(1.0)).min(more.sqrt());
                let near = log_normal(off - shift, v + more);
                if z == 0 {
                    return near;
                }
                let far = log_normal(off, v + more.max(off * off));
                log_sum(&[(1.0 - FAR).ln() + near, FAR.ln() + far])
            };
            DistanceTerm {
                ends,
                logs: std::array::from_fn(log),
                clean: log_normal(off, v) - log_normal(off, v + PRIOR_KNOWS),
            }
        })
        .collect()
}

impl RigidLikelihood {
    /// The likelihood of a frame (3 J, cm); `noise_variance` is that of clean coordinates, cm²,
    /// infinite where missing.
    pub(crate) fn new(
        pairs: &RigidPairs,
        bodies: &BodyMixture,
        y: &[f64],
        noise_variance: &[f64],
    ) -> Self {
        let points = y.len() / 3;
        let seen: Vec<(usize, f64, f64)> = deviations(pairs, y, noise_variance).collect();
        let lengths = noise_floor::lengths(bodies, &seen);
        let unary: Vec<f64> = (0..points)
            .map(|p| {
                if is_seen(y, noise_variance, p) {
                    log_odds()
                } else {
                    f64::NEG_INFINITY
                }
            })
            .collect();
        let outlier_variance = outlier_variances(pairs, &seen, &lengths, &vec![0.0; points]);
        let mut likelihood = RigidLikelihood {
            terms: terms(pairs, &seen, &lengths, &outlier_variance),
            corrupt: Vec::new(),
            outlier_variance,
            farthest: farthest(pairs, &seen, &lengths, points),
            lengths,
        };
        likelihood.corrupt = likelihood.marginals(&unary);
        // A distance to another outlier does not measure the deviation.
        let again = outlier_variances(pairs, &seen, &likelihood.lengths, &likelihood.corrupt);
        if again != likelihood.outlier_variance {
            likelihood.terms = terms(pairs, &seen, &likelihood.lengths, &again);
            likelihood.outlier_variance = again;
            likelihood.corrupt = likelihood.marginals(&unary);
        }
        likelihood
    }

    /// The probability of each point to be an outlier, given its log odds (−∞: it is none).
    pub(crate) fn marginals(&self, unary: &[f64]) -> Vec<f64> {
        let points = unary.len();
        let mut ending: Vec<Vec<&DistanceTerm>> = vec![Vec::new(); points];
        for term in &self.terms {
            ending[term.ends[0].max(term.ends[1])].push(term);
        }
        let mut beam: Vec<(u128, f64)> = vec![(0, 0.0)];
        for p in 0..points {
            let mut next = Vec::with_capacity(2 * beam.len());
            for &(z, score) in &beam {
                for c in 0..2u128 {
                    if c == 1 && unary[p] == f64::NEG_INFINITY {
                        continue;
                    }
                    let z = z | c << p;
                    let bit = |q: usize| (z >> q & 1) as usize;
                    let of = |t: &&DistanceTerm| t.logs[bit(t.ends[0]) + 2 * bit(t.ends[1])];
                    let more: f64 = ending[p].iter().map(of).sum();
                    next.push((z, score + more + if c == 1 { unary[p] } else { 0.0 }));
                }
            }
            if next.len() > WIDTH {
                next.select_nth_unstable_by(WIDTH, |a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                next.truncate(WIDTH);
            }
            beam = next;
        }
        beam.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let best = beam.first().map_or(0.0, |b| b.1);
        let mut out = vec![0.0; points];
        let mut total = 0.0;
        for (z, score) in &beam {
            let w = (score - best).exp();
            total += w;
            for (p, o) in out.iter_mut().enumerate() {
                *o += w * (z >> p & 1) as f64;
            }
        }
        out.iter_mut().for_each(|o| *o /= total);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rigid_pairs::Pair;
    use ndarray::Array2;

    /// A chain of five points, 10 cm apart.
    pub(in super::super) fn chain() -> (RigidPairs, Vec<f64>) {
        let pairs = (0..4).map(|k| Pair {
            ends: [k, k + 1],
            sd: 0.0,
            still: false,
        });
        let pairs = RigidPairs {
            pairs: pairs.collect(),
            bodies: Array2::from_elem((1, 4), 10.0),
            shares: vec![1.0],
        };
        let pose = (0..5).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        (pairs, pose)
    }

    #[test]
    fn a_point_within_the_chain_is_found_and_a_tip_is_in_doubt() {
        let (pairs, pose) = chain();
        let bodies = BodyMixture::of(&pairs);
        let none = RigidLikelihood::new(&pairs, &bodies, &pose, &[0.0; 15]);
        assert!(none.corrupt.iter().all(|q| *q < 0.05), "{:?}", none.corrupt);
        let mut y = pose.clone();
        y[7] += 9.0;
        y[6] += 3.0;
        let one = RigidLikelihood::new(&pairs, &bodies, &y, &[0.0; 15]);
        assert!(one.corrupt[2] > 0.97, "{:?}", one.corrupt);
        assert!([0, 1, 3, 4].iter().all(|p| one.corrupt[*p] < 0.05));
        let mut y = pose.clone();
        y[12] += 4.0;
        let tip = RigidLikelihood::new(&pairs, &bodies, &y, &[0.0; 15]);
        assert!((0.3..1.0).contains(&tip.corrupt[4]), "{:?}", tip.corrupt);
        // A missing point is no outlier, and its neighbors lose a distance.
        let mut y = pose;
        y[6] = f64::NAN;
        let gap = RigidLikelihood::new(&pairs, &bodies, &y, &[0.0; 15]);
        assert!(gap.corrupt[2] == 0.0 && gap.terms.len() == 2);
    }

    #[test]
    fn how_far_off_a_point_is_is_not_told_by_corrupt_neighbors() {
        // Points 2 and 3 both deviate; their mutual distance is nearly right.
        let (pairs, pose) = chain();
        let lengths = &BodyMixture::of(&pairs).all[0].1;
        let mut y = pose.clone();
        y[7] += 90.0;
        y[10] += 94.0;
        let seen: Vec<_> = deviations(&pairs, &y, &[0.0; 15]).collect();
        let outlier_variance =
            |corrupt: &[f64]| outlier_variances(&pairs, &seen, lengths, corrupt)[3];
        assert_eq!(outlier_variance(&[0.0; 5]), MIN_OUTLIER_VARIANCE);
        assert!(outlier_variance(&[0.0, 0.0, 1.0, 0.0, 0.0]) > 80.0 * 80.0);
        assert_eq!(
            outlier_variance(&[0.0, 0.0, 1.0, 1.0, 1.0]),
            MIN_OUTLIER_VARIANCE
        );
        // However far they deviate, the first of them is found.
        let look = RigidLikelihood::new(&pairs, &BodyMixture::of(&pairs), &y, &[0.0; 15]);
        assert!(look.corrupt[2] > 0.9 && look.corrupt[..2].iter().all(|q| *q < 0.1));
    }
}

//! The bodies that rigid distances are those of.

use crate::prior::EXACT_VARIANCE;
use crate::prior::rigid_pairs::RigidPairs;

/// The share of bodies nobody has seen, and how much their lengths differ from the mean of those seen.
const STRANGER: (f64, f64) = (0.02, 0.06);

/// The lengths of pairs, and their variances.
#[derive(Debug, Clone, PartialEq)]
pub struct Lengths {
    /// n of them, cm.
    pub mean: Vec<f64>,
    /// cm²; never below [`EXACT_VARIANCE`].
    pub variance: Vec<f64>,
}

/// The bodies a pose may be of: those seen, and a stranger's.
#[derive(Debug, Clone, Default)]
pub struct BodyMixture {
    /// Log share and lengths; the stranger, if there is one, comes last.
    pub all: Vec<(f64, Lengths)>,
    has_stranger: bool,
}

impl BodyMixture {
    /// Those of what was learnt alone.
    pub fn known(pairs: &RigidPairs) -> BodyMixture {
        let own = |k: usize| (pairs.pairs[k].sd * pairs.pairs[k].sd).max(EXACT_VARIANCE);
        let n = pairs.pairs.len();
        let all = (pairs.bodies.rows().into_iter().zip(&pairs.shares))
            .map(|(row, share)| {
                let lengths = Lengths {
                    mean: row.to_vec(),
                    variance: (0..n).map(own).collect(),
                };
                (share.ln(), lengths)
            })
            .collect();
        BodyMixture {
            all,
            has_stranger: false,
        }
    }

    /// The same and a stranger's.
    pub fn of(pairs: &RigidPairs) -> BodyMixture {
        let mut all = BodyMixture::known(pairs).all;
        let weights: Vec<f64> = pairs.shares.iter().map(|s| s.max(0.0)).collect();
        let mut stranger = mixed(&all, &weights);
        for (v, l) in stranger.variance.iter_mut().zip(&stranger.mean) {
            *v += (STRANGER.1 * l).powi(2);
        }
        all.iter_mut()
            .for_each(|(share, _)| *share += (1.0 - STRANGER.0).ln());
        all.push((STRANGER.0.ln(), stranger));
        BodyMixture {
            all,
            has_stranger: true,
        }
    }

    /// A body that is known.
    pub fn one(lengths: Lengths) -> BodyMixture {
        BodyMixture {
            all: vec![(0.0, lengths)],
            has_stranger: false,
        }
    }

    /// The same bodies by other lengths.
    pub fn of_others(&self, other: impl Fn(&Lengths) -> Lengths) -> BodyMixture {
        BodyMixture {
            all: self.all.iter().map(|(w, l)| (*w, other(l))).collect(),
            has_stranger: self.has_stranger,
        }
    }

    /// Whether a body is nobody's that was seen.
    pub fn is_stranger(&self, body: usize) -> bool {
        self.has_stranger && body + 1 == self.all.len()
    }

    /// The lengths, given how likely each body is (logs, to a constant; their shares included).
    pub fn given(&self, logs: &[f64]) -> Lengths {
        let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|l| (l - best).exp()).collect();
        mixed(&self.all, &weights)
    }
}

/// Mean and variance of a mixture; the weights need not add up to one.
fn mixed(all: &[(f64, Lengths)], weights: &[f64]) -> Lengths {
    let total: f64 = weights.iter().sum();
    let n = all.first().map_or(0, |a| a.1.mean.len());
    let (mut mean, mut variance) = (vec![0.0; n], vec![0.0; n]);
    for ((_, l), w) in all.iter().zip(weights).filter(|(_, w)| **w > 1e-12 * total) {
        for k in 0..n {
            mean[k] += w / total * l.mean[k];
        }
    }
    for ((_, l), w) in all.iter().zip(weights).filter(|(_, w)| **w > 1e-12 * total) {
        for k in 0..n {
            variance[k] += w / total * (l.variance[k] + (l.mean[k] - mean[k]).powi(2));
        }
    }
    Lengths { mean, variance }
}

//! Lengths of rigid pairs: a mixture over the bodies that a pose may show.
//!
//! Each known body has a share and a Gaussian N(L, V) of its n lengths (cm, cm²); an unknown body
//! has the mean of the known lengths and 6% of each as its standard deviation.

use super::tuning::body_lengths::*;
use crate::prior::EXACT_VARIANCE;
use crate::prior::rigid_pairs::RigidPairs;

/// Independent Gaussians of n lengths.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lengths {
    /// Means (n), cm.
    pub mean: Vec<f64>,
    /// Variances (n), cm²; never below [`EXACT_VARIANCE`].
    pub variance: Vec<f64>,
}

/// A mixture of bodies.
#[derive(Debug, Clone, Default)]
pub(crate) struct BodyMixture {
    /// Log share and lengths; the unknown body, if there is one, comes last.
    pub all: Vec<(f64, Lengths)>,
    has_stranger: bool,
}

impl BodyMixture {
    /// The known bodies alone.
    pub(crate) fn known(pairs: &RigidPairs) -> BodyMixture {
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

    /// The known bodies and an unknown one.
    pub(crate) fn of(pairs: &RigidPairs) -> BodyMixture {
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

    /// One body.
    pub(crate) fn one(lengths: Lengths) -> BodyMixture {
        BodyMixture {
            all: vec![(0.0, lengths)],
            has_stranger: false,
        }
    }

    /// Maps the lengths of each body.
    pub(crate) fn of_others(&self, other: impl Fn(&Lengths) -> Lengths) -> BodyMixture {
        BodyMixture {
            all: self.all.iter().map(|(w, l)| (*w, other(l))).collect(),
            has_stranger: self.has_stranger,
        }
    }

    /// Whether a component is the unknown body.
    pub(crate) fn is_stranger(&self, body: usize) -> bool {
        self.has_stranger && body + 1 == self.all.len()
    }

    /// Mean and variance of the lengths, given the log weight of each body up to a constant, shares
    /// included.
    pub(crate) fn given(&self, logs: &[f64]) -> Lengths {
        let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = logs.iter().map(|l| (l - best).exp()).collect();
        mixed(&self.all, &weights)
    }
}

/// Mean and variance of a mixture. The weights need not add up to one.
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

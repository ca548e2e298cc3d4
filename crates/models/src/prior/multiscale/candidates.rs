//! The components that explain an observation of a part: what a search finds.

use super::conditioned::ConditionedCluster;

/// Components whose log weight is this much (nats) below the best one's are left out of the
/// posterior.
pub(crate) const NEGLIGIBLE: f64 = 6.0;

/// A component that may explain an observation.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// log (mixture weight × evidence), nats.
    pub log: f64,
    /// Its cluster's index in [`Candidates::clusters`].
    pub cluster: usize,
    /// The exemplar among the cluster's; `None` for the cluster itself.
    pub exemplar: Option<usize>,
    /// Its sub-mixture's index in the part.
    pub sub_mixture: usize,
}

impl Candidate {
    /// Where it stands among all components.
    pub(crate) fn indices(&self) -> (usize, Option<usize>, usize) {
        (self.cluster, self.exemplar, self.sub_mixture)
    }
}

/// A cluster that was evaluated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EvaluatedCluster {
    /// Its level.
    pub level: usize,
    /// Its index in the level.
    pub index: usize,
    /// The largest log evidence at any scale, with its proportion and fade, nats.
    pub best: f64,
    /// Where its z begins in [`Candidates::zs`].
    start: usize,
}

/// The best components for an observation, and the evidence of all that were evaluated.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    /// log p(y): the log sum over all sub-mixtures, nats.
    pub evidence: f64,
    /// The log evidence of each sub-mixture, without its weight.
    pub sub_mixture_evidences: Vec<f64>,
    /// The best components, in no order.
    pub best: Vec<Candidate>,
    /// The clusters that were evaluated.
    pub clusters: Vec<EvaluatedCluster>,
    /// The observation less each cluster's mean, along the axes of its noisy covariance, one after
    /// another.
    zs: Vec<f32>,
}

impl Candidates {
    /// For a part that is not evaluated.
    pub(crate) fn none() -> Candidates {
        Candidates {
            evidence: f64::NEG_INFINITY,
            ..Candidates::default()
        }
    }

    /// Adds a cluster with its z.
    pub(crate) fn push_cluster(&mut self, level: usize, index: usize, best: f64, z: &[f32]) {
        let start = self.zs.len();
        self.clusters.push(EvaluatedCluster {
            level,
            index,
            best,
            start,
        });
        self.zs.extend_from_slice(z);
    }

    /// z of the observation less a cluster's mean.
    pub(crate) fn z(&self, cluster: usize, conditioned: &ConditionedCluster) -> &[f32] {
        let start = self.clusters[cluster].start;
        &self.zs[start..start + conditioned.noisy.stride()]
    }

    /// Each candidate's responsibility, in the order of [`best`](Candidates::best); they sum to 1.
    /// The weight of a candidate at the limit of [`NEGLIGIBLE`] is subtracted first, so that
    /// candidates come and go without a jump.
    pub(crate) fn responsibilities(&self) -> Vec<f64> {
        let logs = self.best.iter().map(|c| c.log);
        let top = logs.fold(f64::NEG_INFINITY, f64::max);
        let least = (-NEGLIGIBLE).exp();
        let weights = self.best.iter().map(|c| (c.log - top).exp() - least);
        let mut weights: Vec<f64> = weights.collect();
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= total);
        weights
    }

    /// Indices in [`best`](Candidates::best), sorted by cluster, exemplar and sub-mixture.
    pub(crate) fn by_cluster(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.best.len()).collect();
        order.sort_unstable_by_key(|&i| self.best[i].indices());
        order
    }
}

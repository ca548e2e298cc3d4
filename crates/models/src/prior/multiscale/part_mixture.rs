//! The mixture of one part of the body: the clusters of several levels and the exemplars, each at
//! several scales.

use super::cluster_level::ClusterLevel;
use super::exemplars::{ClusterExemplars, ExemplarPoses, Exemplars};
use crate::pose::PoseTransform;
use std::sync::Arc;

/// Sub-mixtures of less weight than this are not worth evaluating.
const MIN_WEIGHT: f64 = 2e-3;

/// Components that share a weight: those of one level, or the exemplars, at one scale of their
/// covariances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SubMixture {
    /// The level of the clusters, 0 the coarsest; `None` for exemplars.
    pub level: Option<usize>,
    /// The factor a of every covariance (an exemplar's is that of its finest cluster).
    pub scale: f64,
    /// The factor b of the outer product of an exemplar's step; 0 for clusters.
    pub step_scale: f64,
    /// The log weight.
    pub log_weight: f64,
}

/// The mixture of one part.
#[derive(Debug, Clone)]
pub(crate) struct PartMixture {
    /// The part's coordinates among the 3 J of a pose: d of them.
    pub coordinates: Vec<usize>,
    /// The levels of clusters, from the coarsest to the finest.
    pub levels: Vec<ClusterLevel>,
    /// The exemplars, by the clusters of the finest level.
    pub exemplars: Exemplars,
    /// The sub-mixtures.
    pub sub_mixtures: Vec<SubMixture>,
}

impl PartMixture {
    /// `labels` gives the finest cluster of each exemplar.
    pub(crate) fn new(
        coordinates: Vec<usize>,
        levels: Vec<ClusterLevel>,
        poses: Arc<ExemplarPoses>,
        labels: &[u32],
        sub_mixtures: Vec<SubMixture>,
    ) -> PartMixture {
        let finest = levels.last().map_or(0, ClusterLevel::len);
        PartMixture {
            exemplars: Exemplars::new(poses, labels, finest),
            sub_mixtures,
            levels,
            coordinates,
        }
    }

    /// The log weight of each sub-mixture.
    pub(crate) fn log_weights(&self) -> Vec<f64> {
        self.sub_mixtures.iter().map(|s| s.log_weight).collect()
    }

    /// Sets the log weight of each sub-mixture.
    pub(crate) fn set_log_weights(&mut self, log_weights: impl IntoIterator<Item = f64>) {
        let both = self.sub_mixtures.iter_mut().zip(log_weights);
        both.for_each(|(s, log)| s.log_weight = log);
    }

    /// Leaves out sub-mixtures of little weight, except those of the coarsest level, which explain
    /// any pose.
    pub(crate) fn leave_out_light(&mut self) {
        self.sub_mixtures
            .retain(|s| s.level == Some(0) || s.log_weight.exp() >= MIN_WEIGHT);
    }

    /// The part of poses transformed by `map`; `poses` are the transformed exemplars.
    pub(crate) fn mapped(
        &self,
        map: &Arc<PoseTransform>,
        poses: &Arc<ExemplarPoses>,
    ) -> PartMixture {
        let levels = self.levels.iter().map(|l| l.mapped(map, &self.coordinates));
        PartMixture {
            levels: levels.collect(),
            exemplars: self.exemplars.mapped(poses.clone()),
            ..self.clone()
        }
    }

    /// The exemplars of a cluster of the finest level.
    pub(crate) fn exemplars_of(&self, cluster: usize) -> &ClusterExemplars {
        self.exemplars.of_cluster(cluster, &self.coordinates)
    }

    /// The finest level.
    pub(crate) fn finest(&self) -> &ClusterLevel {
        &self.levels[self.levels.len() - 1]
    }

    /// The sub-mixtures of a level, or (`None`) of the exemplars, each with its index among all.
    pub(crate) fn sub_mixtures_of(
        &self,
        level: Option<usize>,
    ) -> impl Iterator<Item = (usize, &SubMixture)> {
        let all = self.sub_mixtures.iter().enumerate();
        all.filter(move |(_, s)| s.level == level)
    }

    /// The scales of these sub-mixtures, equal neighbors once. Without any it is 1: the clusters of
    /// the finest level are evaluated for their exemplars' sake, too.
    pub(crate) fn scales(&self, level: Option<usize>) -> Vec<f64> {
        let mut scales: Vec<f64> = self.sub_mixtures_of(level).map(|(_, s)| s.scale).collect();
        scales.dedup();
        if scales.is_empty() {
            scales.push(1.0);
        }
        scales
    }
}

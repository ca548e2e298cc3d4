//! The mixture of one part of the body: the clusters of several levels and the exemplars, each at several scales.

use super::cluster_level::ClusterLevel;
use super::exemplars::{ClusterExemplars, ExemplarPoses, Exemplars};
use crate::pose::PoseTransform;
use std::sync::Arc;

/// Sub-mixtures of less weight than this are not evaluated.
const MIN_WEIGHT: f64 = 2e-3;

/// Components that share a weight: those of one level, at one scale of their covariances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SubMixture {
    /// The clusters of a level.
    Clusters {
        /// The level: 0 is the coarsest.
        level: usize,
        /// The factor a of every covariance.
        scale: f64,
    },
    /// The exemplars.
    Exemplars {
        /// The factor a of the covariance of the exemplar's finest cluster.
        scale: f64,
        /// The factor b of the outer product of the exemplar's step.
        step_scale: f64,
    },
}

/// A sub-mixture that is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct ActiveSubMixture {
    /// Its place in [`PartMixture::sub_mixtures`].
    pub index: usize,
    /// Its scale's place in [`PartMixture::scales`].
    pub scale_index: usize,
    /// b; 0 for clusters.
    pub step_scale: f64,
}

/// The mixture of one part.
#[derive(Debug, Clone)]
pub struct PartMixture {
    /// The part's coordinates among the 3 J of a pose: d of them.
    pub coordinates: Vec<usize>,
    /// The levels of clusters, from the coarsest to the finest.
    pub levels: Vec<ClusterLevel>,
    /// The exemplars, by the clusters of the finest level.
    pub exemplars: Exemplars,
    /// All sub-mixtures.
    pub sub_mixtures: Vec<SubMixture>,
    /// The log weight of each sub-mixture.
    pub log_weights: Vec<f64>,
    /// The sub-mixtures of each level that are evaluated; behind them those of the exemplars.
    active: Vec<Vec<ActiveSubMixture>>,
    /// Their scales, each once.
    scales: Vec<Vec<f64>>,
}

impl PartMixture {
    /// A mixture with equal weights. `labels` gives the finest cluster of each exemplar.
    pub fn new(
        coordinates: Vec<usize>,
        levels: Vec<ClusterLevel>,
        poses: Arc<ExemplarPoses>,
        labels: &[u32],
        sub_mixtures: Vec<SubMixture>,
    ) -> PartMixture {
        let finest = levels.last().map_or(0, ClusterLevel::len);
        let equal = vec![-(sub_mixtures.len() as f64).ln(); sub_mixtures.len()];
        let mut part = PartMixture {
            exemplars: Exemplars::new(poses, labels, finest),
            log_weights: Vec::new(),
            active: Vec::new(),
            scales: Vec::new(),
            sub_mixtures,
            levels,
            coordinates,
        };
        part.set_log_weights(equal);
        part
    }

    /// Sets the log weights. Sub-mixtures of little weight are not evaluated, except those of the coarsest level, which
    /// explain any pose.
    pub fn set_log_weights(&mut self, log_weights: Vec<f64>) {
        self.active = vec![Vec::new(); self.levels.len() + 1];
        self.scales = vec![Vec::new(); self.levels.len() + 1];
        for (index, (sub_mixture, log)) in self.sub_mixtures.iter().zip(&log_weights).enumerate() {
            let (level, scale, step_scale) = match *sub_mixture {
                SubMixture::Clusters { level, scale } => (level, scale, 0.0),
                SubMixture::Exemplars { scale, step_scale } => {
                    (self.levels.len(), scale, step_scale)
                }
            };
            if level > 0 && log.exp() < MIN_WEIGHT {
                continue;
            }
            let scales = &mut self.scales[level];
            let scale_index = scales.iter().position(|s| *s == scale).unwrap_or_else(|| {
                scales.push(scale);
                scales.len() - 1
            });
            self.active[level].push(ActiveSubMixture {
                index,
                scale_index,
                step_scale,
            });
        }
        self.log_weights = log_weights;
    }

    /// The part of poses transformed by `map`; `poses` are the transformed exemplars.
    pub fn mapped(&self, map: &Arc<PoseTransform>, poses: &Arc<ExemplarPoses>) -> PartMixture {
        let levels = self.levels.iter().map(|l| l.mapped(map, &self.coordinates));
        PartMixture {
            levels: levels.collect(),
            exemplars: self.exemplars.mapped(poses.clone()),
            ..self.clone()
        }
    }

    /// The exemplars of a cluster of the finest level.
    pub fn exemplars_of(&self, cluster: usize) -> &ClusterExemplars {
        let covariance = || self.finest().covariance(cluster, &self.coordinates);
        let mean = self.finest().mean(cluster);
        (self.exemplars).open(cluster, &self.coordinates, mean, covariance)
    }

    /// The finest level.
    pub fn finest(&self) -> &ClusterLevel {
        &self.levels[self.levels.len() - 1]
    }

    /// The sub-mixtures of a level that are evaluated.
    pub fn active(&self, level: usize) -> &[ActiveSubMixture] {
        &self.active[level]
    }

    /// The sub-mixtures of the exemplars that are evaluated.
    pub fn active_exemplars(&self) -> &[ActiveSubMixture] {
        &self.active[self.levels.len()]
    }

    /// The scales at which a level's clusters are evaluated. Clusters of the finest level may be evaluated for the sake of
    /// their exemplars only: then there is one scale, 1.
    pub fn scales(&self, level: usize) -> Vec<f64> {
        match &self.scales[level][..] {
            [] => vec![1.0],
            scales => scales.to_vec(),
        }
    }

    /// The scales at which exemplars are evaluated.
    pub fn exemplar_scales(&self) -> Vec<f64> {
        self.scales[self.levels.len()].clone()
    }
}

//! A part's components conditioned on one vector of noise variances; a cluster is prepared when a
//! search first needs it.

use super::cluster_level::ClusterLevel;
use super::noise_pattern::NoisePattern;
use super::noisy_covariance::NoisyCovariance;
use super::part_mixture::PartMixture;
use super::scaled_precision::ScaledPrecisions;
use crate::numeric::simd::padded;
use std::sync::{Arc, OnceLock};

/// A part under one noise.
#[derive(Debug)]
pub(crate) struct ConditionedPart {
    /// The noise variance of each coordinate (d), cm², infinite where missing.
    noise: Vec<f64>,
    pattern: NoisePattern,
    /// The observed coordinates.
    observed: Arc<[usize]>,
    /// 1 / (mean variance within the clusters of a level + noise), 0 where missing (d, padded); by
    /// level.
    pub distance_weights: Vec<Vec<f32>>,
    clusters: Vec<Vec<OnceLock<Box<ConditionedCluster>>>>,
}

/// A cluster under the noise.
#[derive(Debug)]
pub(crate) struct ConditionedCluster {
    /// Its covariance with the noise.
    pub noisy: NoisyCovariance,
    /// The precisions at the scales of the cluster's level.
    pub precisions: ScaledPrecisions,
    /// The precisions at the scales of the exemplars, where they were asked for.
    exemplar_precisions: OnceLock<ScaledPrecisions>,
}

impl ConditionedPart {
    /// `noise` (d) is that of the part's coordinates.
    pub(crate) fn new(part: &PartMixture, noise: Vec<f64>) -> ConditionedPart {
        let weights = |level: &ClusterLevel| {
            let weight = |(v, n): (&f64, &f64)| (1.0 / (v + n)) as f32;
            let mut weights: Vec<f32> = level.within.iter().zip(&noise).map(weight).collect();
            weights.resize(padded(weights.len()), 0.0);
            weights
        };
        let empty = |level: &ClusterLevel| (0..level.len()).map(|_| OnceLock::new()).collect();
        ConditionedPart {
            distance_weights: part.levels.iter().map(weights).collect(),
            pattern: NoisePattern::of(&noise),
            observed: (0..noise.len()).filter(|&i| noise[i].is_finite()).collect(),
            clusters: part.levels.iter().map(empty).collect(),
            noise,
        }
    }

    /// Whether any coordinate is observed.
    pub(crate) fn observes_any(&self) -> bool {
        !self.observed.is_empty()
    }

    /// Whether three quarters of the coordinates are: then near clusters are likely ones.
    pub(crate) fn observes_most(&self) -> bool {
        4 * self.observed.len() >= 3 * self.noise.len()
    }

    /// An observation, or a direction, (d) in single precision, padded; 0 where missing.
    pub(crate) fn masked(&self, y: &[f64]) -> Vec<f32> {
        let mut masked = Vec::with_capacity(padded(y.len()));
        let each = y.iter().zip(&self.noise);
        masked.extend(each.map(|(y, n)| if n.is_finite() { *y as f32 } else { 0.0 }));
        masked.resize(padded(masked.len()), 0.0);
        masked
    }

    /// A cluster of a level under the noise.
    pub(crate) fn cluster(
        &self,
        part: &PartMixture,
        level: usize,
        cluster: usize,
    ) -> &ConditionedCluster {
        self.clusters[level][cluster].get_or_init(|| {
            let covariance = part.levels[level].covariance(cluster, &part.coordinates);
            let noisy =
                NoisyCovariance::new(&covariance, &self.noise, &self.observed, &self.pattern);
            Box::new(ConditionedCluster {
                precisions: noisy.precisions(part.scales(Some(level))),
                exemplar_precisions: OnceLock::new(),
                noisy,
            })
        })
    }

    /// The precisions for the exemplars of a cluster of the finest level.
    pub(crate) fn exemplar_precisions(
        &self,
        part: &PartMixture,
        cluster: usize,
    ) -> &ScaledPrecisions {
        let conditioned = self.cluster(part, part.levels.len() - 1, cluster);
        let make = || conditioned.noisy.precisions(part.scales(None));
        conditioned.exemplar_precisions.get_or_init(make)
    }
}

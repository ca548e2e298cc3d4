//! The settings of training a multi-scale mixture; the model file keeps them, since its scales are
//! among them.

use super::part_mixture::SubMixture;
use crate::pose::ASF_UNIT_CM;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// How a mixture is trained. Aliases are the names in files of the former kind `blocks`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainSettings {
    /// The number of clusters of each level, rising.
    #[serde(alias = "cells")]
    pub clusters: Vec<usize>,
    /// The scales a of the clusters' covariances, above 0.
    pub scales: Vec<f64>,
    /// The scales a (above 0) and b (at least 0) of exemplars: of the finest cluster's covariance,
    /// and of the outer product of the exemplar's step.
    #[serde(alias = "leaves")]
    pub exemplars: Vec<(f64, f64)>,
    /// The weight of a cluster's own covariance, 0 to 1; the rest is that of the covariance pooled
    /// over its level.
    #[serde(alias = "own")]
    pub own_share: f64,
    /// Added to every variance, cm².
    #[serde(alias = "least")]
    pub min_variance: f64,
    /// The exponent of the factorizations' evidences in the average over them.
    pub temperature: f64,
    /// EM iterations.
    #[serde(alias = "steps")]
    pub em_steps: usize,
    /// The number of held-out poses that the weights are learned from, for each of the two tasks.
    #[serde(alias = "tested")]
    pub held_out_poses: usize,
    /// At most this many training poses are exemplars: of more, every second (third, ...) of each
    /// take.
    #[serde(alias = "leaves_kept")]
    pub max_exemplars: usize,
    /// Takes are held out in turn, in this many groups.
    pub folds: usize,
}

impl Default for TrainSettings {
    fn default() -> Self {
        TrainSettings {
            clusters: vec![1, 5, 20, 80, 300],
            scales: vec![1.0, 2.5, 6.0, 15.0],
            exemplars: vec![(0.3, 0.0), (0.03, 0.0), (0.03, 1.0), (0.001, 1.0)],
            own_share: 0.8,
            min_variance: 1e-4 * ASF_UNIT_CM * ASF_UNIT_CM,
            temperature: 0.3,
            em_steps: 60,
            max_exemplars: 80_000,
            held_out_poses: 400,
            folds: 4,
        }
    }
}

impl TrainSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Usage`], with the ranges.
    pub(crate) fn check(&self) -> Result<()> {
        let positive = |list: &[f64]| list.iter().all(|s| s.is_finite() && *s > 0.0);
        let steps = self.exemplars.iter().all(|l| l.1.is_finite() && l.1 >= 0.0);
        let scales: Vec<f64> = self.exemplars.iter().map(|l| l.0).collect();
        let rising = self.clusters.windows(2).all(|w| w[0] < w[1]);
        if self.clusters.is_empty()
            || self.max_exemplars == 0
            || self.clusters[0] == 0
            || !rising
            || self.scales.is_empty()
        {
            return Err(Error::usage(
                "multiscale: clusters must be given, at least 1 and rising, scales, and at least \
                 1 exemplar",
            ));
        }
        if !positive(&self.scales)
            || !positive(&scales)
            || !steps
            || !positive(&[self.min_variance, self.temperature])
        {
            return Err(Error::usage(
                "multiscale: scales, min_variance and temperature must be above 0",
            ));
        }
        if !(0.0..=1.0).contains(&self.own_share) || self.folds == 0 {
            return Err(Error::usage(
                "multiscale: own_share must be from 0 to 1, folds at least 1",
            ));
        }
        Ok(())
    }

    /// The sub-mixtures of a part with that many levels of clusters, of equal weights.
    pub(super) fn sub_mixtures(&self, levels: usize) -> Vec<SubMixture> {
        let count = levels * self.scales.len() + self.exemplars.len();
        let log_weight = -(count as f64).ln();
        let sub_mixture = |level, (scale, step_scale)| SubMixture {
            level,
            scale,
            step_scale,
            log_weight,
        };
        let level = |level| {
            let scales = self.scales.iter();
            scales.map(move |&scale| sub_mixture(Some(level), (scale, 0.0)))
        };
        let exemplars = self.exemplars.iter().map(|&e| sub_mixture(None, e));
        (0..levels).flat_map(level).chain(exemplars).collect()
    }
}

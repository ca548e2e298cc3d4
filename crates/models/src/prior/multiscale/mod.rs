//! The default model: a Gaussian mixture at many scales, factored into parts of the body.
//!
//! # The model
//!
//! A pose x has 3 J numbers (J points), cm. The body divides into parts; a part p has d_p of the
//! coordinates, x_p. Several factorizations F, sets of parts that cover every coordinate once
//! ({whole body}, {legs, upper body}, ...), compete, so that known legs can combine with known
//! arms:
//!
//! ```text
//! p(x)     = Σ_F φ_F Π_{p ∈ F} p_p(x_p)
//! p_p(x_p) = Σ_l w_pl Σ_{j ∈ l} π_j N(x_p; m_j, C_j)
//! ```
//!
//! - φ_F: the weight of a factorization; Σ φ_F = 1.
//! - l: a sub-mixture, with the weight w_pl. There are two sorts, each at several scales a:
//!   - the clusters of one k-means level (1, 5, 20, 80, 300 of them): π_j is the cluster's
//!     proportion of the training poses, m_j (d_p, cm) its mean, C_j = a C (d_p, d_p, cm²) with its
//!     covariance C;
//!   - the exemplars, N training poses: π_j = 1 / N, m_j is the pose, C_j = a C + b v vᵀ with the
//!     covariance C of its cluster in the finest level and v half the step from the frame before to
//!     the frame after.
//! - φ and w are learned by EM on held-out takes ([`train()`]).
//!
//! In the terms of Lai et al.: the scaled eigenvectors of a covariance are a sub-dictionary
//! with unit Gaussian coefficients, so that a pose is a sparse code with one active block. Other
//! than theirs, the answer is not the single best code but the posterior mean over all.
//!
//! # A query
//!
//! An observation is y (3 J, cm) with independent noise of the variances R (3 J, cm²; infinite
//! where missing). The evidence and the posterior are those of a Gaussian mixture with the
//! covariances C_j + R on the observed coordinates o:
//!
//! ```text
//! log p(y)  = log Σ_F φ_F Π_p Σ_j w π_j N(y_o; m_j, C_j + R)
//! p(x | y)  ≈ the Gaussian with the mixture's posterior mean and covariance
//! ```
//!
//! | step | file |
//! |---|---|
//! | round the noise variances, so that frames share what is prepared for them | `noise_pattern` |
//! | components given the noise | `conditioned`, `noisy_covariance`, `scaled_precision` |
//! | find the components of each part that explain y | `search`, `top_k`, `candidates` |
//! | add up the evidence of the factorizations | `factorization` |
//! | sum the posteriors of a part's components | `posterior` |
//! | average over the factorizations | `factorization` |
//!
//! What the components are made of is in `part_mixture`, `cluster_level`, `exemplars` and
//! `eigen_covariance`. For placing a pose there is `evidence_gradient`, for poses unlike the
//! training poses `novelty`.
//!
//! # Cost and limits
//!
//! A frame takes about 0.5 to 1.5 ms, a single frame with new noise some 10 ms. Memory: the
//! exemplars (N 3 J numbers of 16 bits) and the eigenvectors of all clusters.
//!
//! The mean of competing components may lie between two poses. Far from all training poses the
//! widest cluster alone answers: see [`Prior::novelty`]. Noise below 0.03 cm² counts as 0.03 cm².

mod candidates;
mod cluster_level;
mod conditioned;
mod eigen_covariance;
mod evidence_gradient;
mod exemplars;
mod factorization;
mod file;
mod noise_pattern;
mod noisy_covariance;
mod novelty;
mod part_mixture;
mod posterior;
mod scaled_precision;
mod search;
mod settings;
mod top_k;
mod train;

use super::noise_cache::NoiseCache;
use super::{EvidenceGradient, Posterior, Prior, Reconstruction, Want};
use crate::pose::{Observation, PoseTransform};
use conditioned::ConditionedPart;
use exemplars::ExemplarPoses;
use ndarray::{Array2, ArrayView2};
use noise_pattern::{PLACEMENT_TOLERANCE, POSTERIOR_TOLERANCE, quantize};
use novelty::NoveltyDetector;
use part_mixture::PartMixture;
use std::sync::Arc;

pub use settings::TrainSettings;
pub use train::{model, train};

/// Noise vectors of the whole body whose conditioned components are kept; for smaller parts more
/// are.
const CACHED_NOISES: usize = 16;

/// The mixtures of all parts of a body.
#[derive(Debug, Clone)]
pub struct MultiscaleMixture {
    width: usize,
    /// The first is the whole body.
    parts: Vec<PartMixture>,
    /// Sets of parts that cover every coordinate once.
    factorizations: Vec<Vec<usize>>,
    /// The log weight of each factorization.
    log_factorization_weights: Vec<f64>,
    /// The exponent of the factorizations' evidences where they are averaged.
    temperature: f64,
    /// The mean variance of each coordinate within the finest clusters of the whole body (3 J),
    /// cm².
    variance: Vec<f64>,
    /// A few poses, far apart, (k, 3 J), cm.
    representative_poses: Array2<f64>,
    /// The exemplars of all parts.
    poses: Arc<ExemplarPoses>,
    /// Each part conditioned on the noises of before.
    cache: Arc<Vec<NoiseCache<ConditionedPart>>>,
    novelty: NoveltyDetector,
}

impl MultiscaleMixture {
    /// A mixture of these parts, the first of which is the whole body; what does not follow from
    /// them is left empty.
    fn of_parts(parts: Vec<PartMixture>, poses: Arc<ExemplarPoses>) -> MultiscaleMixture {
        MultiscaleMixture {
            width: parts[0].coordinates.len(),
            variance: parts[0].finest().within.clone(),
            cache: Arc::new(parts.iter().map(|_| NoiseCache::default()).collect()),
            parts,
            factorizations: Vec::new(),
            log_factorization_weights: Vec::new(),
            temperature: 1.0,
            representative_poses: Array2::zeros((0, 0)),
            poses,
            novelty: NoveltyDetector::default(),
        }
    }

    /// Each part conditioned on the noise variances (3 J). Parts are cached apart: a limb's noise
    /// recurs more often than the whole body's.
    fn conditioned_parts(&self, noise: &[f64]) -> Vec<Arc<ConditionedPart>> {
        let noise = quantize(noise, POSTERIOR_TOLERANCE);
        (0..self.parts.len())
            .map(|p| self.conditioned(p, &noise))
            .collect()
    }

    /// The whole body conditioned on noise variances that are quantized coarsely.
    fn conditioned_for_placement(&self, noise: &[f64]) -> Arc<ConditionedPart> {
        self.conditioned(0, &quantize(noise, PLACEMENT_TOLERANCE))
    }

    fn conditioned(&self, p: usize, noise: &[f64]) -> Arc<ConditionedPart> {
        let part = &self.parts[p];
        let noise: Vec<f64> = part.coordinates.iter().map(|&i| noise[i]).collect();
        let smaller = self.width / noise.len().max(1);
        let most = CACHED_NOISES * smaller * smaller;
        self.cache[p].get(&noise, most, || ConditionedPart::new(part, noise.clone()))
    }
}

impl Prior for MultiscaleMixture {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let evaluated = self.evaluate(observation.values, observation.variance);
        let moments = self.average(&evaluated, want != Want::Mean);
        let log_evidence = evaluated.evidence();
        let Some(covariance) = moments.covariance else {
            return Posterior {
                mean: moments.mean,
                log_evidence,
                ..Posterior::default()
            };
        };
        let mut posterior = Posterior::full(moments.mean, covariance, log_evidence);
        if want == Want::Variances {
            posterior.covariance = Array2::zeros((0, 0));
        }
        posterior
    }

    /// By the clusters of the whole body alone: the search for the placement of 2-D input asks many
    /// times per frame.
    fn reconstruct(
        &self,
        observation: &Observation<'_>,
        _previous: Option<&Reconstruction>,
    ) -> Reconstruction {
        let y = observation.values;
        let (whole, conditioned) = (
            &self.parts[0],
            self.conditioned_for_placement(observation.variance),
        );
        let candidates = whole.cluster_candidates(&conditioned, y);
        let pose = whole.posterior(&conditioned, y, &candidates, false).mean;
        Reconstruction {
            objective: super::misfit(self, observation, &pose),
            support: Vec::new(),
            pose,
        }
    }

    fn evidence_gradient(
        &self,
        observation: &Observation<'_>,
        directions: &[Vec<f64>],
    ) -> Option<EvidenceGradient> {
        let conditioned = self.conditioned_for_placement(observation.variance);
        Some(self.parts[0].evidence_gradient(&conditioned, observation.values, directions))
    }

    fn novelty(&self, pose: &[f64]) -> Option<f64> {
        self.novelty.novelty(&self.parts[0], pose)
    }

    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        self.representative_poses.view()
    }

    fn training_poses(&self) -> Option<Array2<f64>> {
        Some(self.poses.all())
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        if map.is_identity() {
            return Box::new(self.clone());
        }
        let map = &Arc::new(map.clone());
        let poses = Arc::new(self.poses.mapped(map));
        let parts = self.parts.iter().map(|p| p.mapped(map, &poses));
        Box::new(MultiscaleMixture {
            factorizations: self.factorizations.clone(),
            log_factorization_weights: self.log_factorization_weights.clone(),
            temperature: self.temperature,
            representative_poses: map.apply_rows(self.representative_poses.view()),
            novelty: self.novelty.mapped(&self.parts[0], map),
            ..MultiscaleMixture::of_parts(parts.collect(), poses)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use crate::pose::joints;
    use crate::prior::testdata::PriorExt;
    use crate::prior::training_set::{TrainOptions, TrainingSet};
    use rand::Rng;

    pub(super) fn poses() -> TrainingSet {
        let mut generator = parallel::rng(3, 0);
        let factorizations: Vec<f32> = (0..4 * 69)
            .map(|_| generator.random::<f32>() - 0.5)
            .collect();
        let xyz = Array2::from_shape_fn((400, 69), |(t, c)| {
            let phase = t as f32 * 0.05;
            let waves = [
                phase.sin(),
                phase.cos(),
                (2.3 * phase).sin(),
                (0.7 * phase).cos(),
            ];
            let sum: f32 = (0..4).map(|k| factorizations[69 * k + c] * waves[k]).sum();
            20.0 * sum + c as f32
        });
        TrainingSet {
            points: joints::cmu_names(),
            xyz,
            takes: vec![0..150, 150..280, 280..400],
            body: None,
            anchor: None,
            up: None,
            incomplete: 0,
            unplaced: 0,
        }
    }

    pub(super) fn trained(poses: &TrainingSet) -> (MultiscaleMixture, crate::io::Model) {
        let settings = TrainSettings {
            clusters: vec![1, 4, 10],
            held_out_poses: 30,
            ..TrainSettings::default()
        };
        let options = TrainOptions {
            seed: 1,
            ..TrainOptions::default()
        };
        let model = model(poses, &options, &settings, &mut |_| ()).unwrap();
        (
            MultiscaleMixture::from_model(&model, "test").unwrap(),
            model,
        )
    }

    #[test]
    fn recovers_a_training_pose_from_noise_and_from_few_points() {
        let poses = poses();
        let (mixture, _) = trained(&poses);
        let pose: Vec<f64> = poses.xyz.row(77).iter().map(|v| f64::from(*v)).collect();
        let mut generator = parallel::rng(5, 0);
        let y: Vec<f64> = pose
            .iter()
            .map(|v| v + generator.random_range(-5.0..5.0))
            .collect();
        let off = |b: &Posterior| {
            let sum: f64 = b
                .mean
                .iter()
                .zip(&pose)
                .map(|(a, b)| (a - b) * (a - b))
                .sum();
            (sum / 69.0).sqrt()
        };
        let dense = mixture.full(&y, &[25.0 / 3.0; 69]);
        assert!(off(&dense) <= 1.5, "{}", off(&dense));
        let noise: Vec<f64> = (0..69)
            .map(|c| if c < 18 { 0.0 } else { f64::INFINITY })
            .collect();
        let filled = mixture.full(&pose, &noise);
        assert!(off(&filled) <= 0.5, "{}", off(&filled));
        // The further from all that was learned, the less evidence; nothing seen says nothing.
        let far: Vec<f64> = y.iter().map(|v| v + 60.0).collect();
        assert!(mixture.full(&far, &[25.0 / 3.0; 69]).log_evidence < dense.log_evidence - 50.0);
        let none = mixture.full(&y, &[f64::INFINITY; 69]);
        assert!(
            none.mean
                .iter()
                .chain(none.covariance.diag())
                .all(|v| v.is_finite())
        );
    }

    #[test]
    fn the_gradient_equals_finite_differences() {
        let poses = poses();
        let (mixture, _) = trained(&poses);
        let y: Vec<f64> = poses
            .xyz
            .row(40)
            .iter()
            .map(|v| f64::from(*v) + 0.4)
            .collect();
        let moves: Vec<Vec<f64>> = (0..3)
            .map(|k| (0..69).map(|c| f64::from(u8::from(c % 3 == k))).collect())
            .collect();
        // Much noise, where directions share one; little; and of many kinds, with gaps.
        let mixed = (0..69).map(|c| match c {
            0..30 => f64::INFINITY,
            c => 0.5 + c as f64,
        });
        // And few gaps, and a point worse than the others.
        let exceptions = (0..69).map(|c| match c {
            0..12 => f64::INFINITY,
            30..33 => 30.0,
            _ => 4.0,
        });
        let noises = [
            vec![400.0; 69],
            vec![4.0; 69],
            mixed.collect(),
            exceptions.collect(),
        ];
        for noise in noises {
            let gradient = |values: &[f64], moves: &[Vec<f64>]| {
                let variance = &noise[..];
                let seen = Observation { values, variance };
                mixture.evidence_gradient(&seen, moves).unwrap()
            };
            let at = |k: usize, by: f64| -> f64 {
                let moved: Vec<f64> = y.iter().zip(&moves[k]).map(|(y, m)| y + by * m).collect();
                gradient(&moved, &[]).log_evidence
            };
            let slope = gradient(&y, &moves);
            for k in 0..3 {
                let detail = 0.5 * (at(k, 1.0) - at(k, -1.0));
                let scale = 0.05 * detail.abs().max(0.2);
                assert!(
                    (slope.gradient[k] - detail).abs() <= scale,
                    "{} {detail}",
                    slope.gradient[k]
                );
                assert!(slope.curvature[4 * k] > 0.0);
            }
        }
    }

    #[test]
    fn a_file_gives_the_same_posterior() {
        let poses = poses();
        let (mixture, model) = trained(&poses);
        let bytes = model.to_bytes().unwrap();
        let again = crate::io::Model::from_bytes(bytes, "m").unwrap();
        let again = MultiscaleMixture::from_model(&again, "m").unwrap();
        let y: Vec<f64> = poses
            .xyz
            .row(9)
            .iter()
            .map(|v| f64::from(*v) + 0.3)
            .collect();
        assert_eq!(mixture.full(&y, &[1.0; 69]), again.full(&y, &[1.0; 69]));
    }

    #[test]
    fn nan_gives_nan() {
        let (mixture, _) = trained(&poses());
        let broken = Observation {
            values: &[f64::NAN; 69],
            variance: &[1.0; 69],
        };
        let broken = mixture.posterior(&broken, Want::Variances);
        assert!(
            broken
                .mean
                .iter()
                .chain(&broken.variance)
                .all(|v| v.is_nan())
        );
    }
}

//! The default model: a sparse code in blocks at many scales, averaged over its supports.
//!
//! A block is a mean and a covariance; the scaled eigenvectors of the covariance are a sub-dictionary whose coefficients
//! are unit Gaussians, so a pose is a code with one active block. Blocks are the cells of k-means at many levels, at
//! several scales, and every training pose with the covariance of its cell at small scales (the paper's "poses as
//! atoms", with a width and a direction). Unseen poses combine known legs with known arms, so the same is learnt for
//! parts of the body, and several ways to make a body of parts compete:
//!
//! ```text
//! p(x) = Σ_F φ_F Π_{p in F} Σ_l w_pl Σ_{j in l} (n_j / N) N(x_p; m_j, C_j)
//! ```
//!
//! The answer is the posterior mean over all blocks and ways, not the single best: in that it parts from the paper.
//! Level and way weights are learnt by EM on takes held back from the training.

mod batched_cholesky;
mod body_parts;
mod candidates;
mod cluster_level;
mod eigen_covariance;
mod evidence_gradient;
mod exemplars;
mod factorization;
mod file;
mod noise_quantization;
mod noisy_covariance;
mod novelty;
mod part_mixture;
mod posterior;
mod scaled_precision;
mod search;
mod top_k;
mod train;

use super::noise_cache::NoiseCache;
use super::{EvidenceGradient, Posterior, Prior, Reconstruction, Want};
use crate::pose::{ASF_UNIT_CM, Observation, PoseTransform};
use exemplars::ExemplarPoses;
use ndarray::{Array2, ArrayView2};
use noise_quantization::{PLACEMENT_TOLERANCE, POSTERIOR_TOLERANCE};
use noisy_covariance::NoisePattern;
use novelty::NoveltyDetector;
use part_mixture::{ConditionedPart, PartMixture};
use posterior::Detail;
use std::sync::Arc;
use train::variance_of;

pub use train::{TrainSettings, model, train};

/// No coordinate is taken for more exact than this variance, cm² (1e-3 asf²): blocks are no truer than that.
const MIN_NOISE: f64 = 1e-3 * ASF_UNIT_CM * ASF_UNIT_CM;
/// So many noise patterns of the whole body are remembered; of parts more, as they are smaller.
const CACHED_PATTERNS: usize = 16;
/// So many kinds of noise that is everywhere the same are.
const CACHED_VARIANCES: usize = 16;

/// The blocks of all parts of a body.
#[derive(Debug, Clone)]
pub struct MultiscaleMixture {
    width: usize,
    parts: Vec<PartMixture>,
    /// Which parts make a whole body: each lists parts that cover every coordinate once.
    factorizations: Vec<Vec<usize>>,
    /// The log weight of each way.
    log_factorization_weights: Vec<f64>,
    /// What the log evidences of ways are multiplied by where they are averaged.
    temperature: f64,
    variance: Vec<f64>,
    typical: Array2<f64>,
    /// The training poses: what leaves are made of.
    poses: Arc<ExemplarPoses>,
    /// Each part's views met before.
    conditioned_cache: Arc<Vec<NoiseCache<ConditionedPart>>>,
    /// Those through noise that is everywhere the same: what the others are made from.
    isotropic: Arc<Vec<NoiseCache<ConditionedPart>>>,
    /// What is unlike all that was seen.
    limit: NoveltyDetector,
}

/// No view of any part is made yet.
fn empty_caches(parts: usize) -> Arc<Vec<NoiseCache<ConditionedPart>>> {
    Arc::new((0..parts).map(|_| NoiseCache::default()).collect())
}

impl MultiscaleMixture {
    /// How each part is seen through the noise (3 J). A limb is often seen as it was before where the body is not.
    fn conditioned_parts(&self, noise: &[f64]) -> Vec<Arc<ConditionedPart>> {
        let noise = noise_quantization::quantize(noise, POSTERIOR_TOLERANCE);
        (0..self.parts.len())
            .map(|p| self.conditioned(p, &noise))
            .collect()
    }

    fn conditioned(&self, p: usize, noise: &[f64]) -> Arc<ConditionedPart> {
        let part = &self.parts[p];
        let noise: Vec<f64> = part.coordinates.iter().map(|&i| noise[i]).collect();
        if let NoisePattern::NearIsotropic {
            base_variance,
            exceptions,
        } = NoisePattern::of(&noise)
            && exceptions.is_empty()
        {
            return self.isotropic(p, base_variance);
        }
        let smaller = self.width / noise.len().max(1);
        let most = CACHED_PATTERNS * smaller * smaller;
        self.conditioned_cache[p].get(&noise, most, || {
            ConditionedPart::new(part, noise.clone(), |base_variance| {
                self.isotropic(p, base_variance)
            })
        })
    }

    /// How a part is seen through noise that is everywhere the same.
    fn isotropic(&self, p: usize, base_variance: f64) -> Arc<ConditionedPart> {
        let make = || ConditionedPart::isotropic(&self.parts[p], base_variance);
        self.isotropic[p].get(&[base_variance], CACHED_VARIANCES, make)
    }
}

impl Prior for MultiscaleMixture {
    fn residual_variance(&self) -> &[f64] {
        &self.variance
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        let evaluated = self.evaluate_parts(observation.values, observation.variance);
        let answer = |detail| {
            self.average_factorizations(&evaluated, detail)
                .posterior(&evaluated, detail)
        };
        match want {
            Want::Mean => answer(Detail::Mean),
            Want::Variances => answer(Detail::Variances),
            Want::CovarianceBelow(most) if most.is_finite() => {
                let variances = answer(Detail::Variances);
                if variances.variance.iter().sum::<f64>() >= most {
                    return variances;
                }
                answer(Detail::Covariance)
            }
            Want::Covariance | Want::CovarianceBelow(_) => answer(Detail::Covariance),
        }
    }

    /// By the clusters of the whole body alone: the search for the placement of 2-D input asks many times a frame.
    fn reconstruct(
        &self,
        observation: &Observation<'_>,
        _previous: Option<&Reconstruction>,
    ) -> Reconstruction {
        let (y, noise) = (observation.values, observation.variance);
        let (part, conditioned) = (
            &self.parts[0],
            &self.conditioned(0, &noise_quantization::quantize(noise, PLACEMENT_TOLERANCE)),
        );
        let candidates = part.candidates_among_clusters(conditioned, y);
        let pose = part.answer(conditioned, y, &candidates, Detail::Mean).mean;
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
        let noise = noise_quantization::quantize(observation.variance, PLACEMENT_TOLERANCE);
        let conditioned = self.conditioned(0, &noise);
        Some(self.parts[0].evidence_gradient(&conditioned, observation.values, directions))
    }

    /// By the cells of the whole body alone, and measured on takes that were held back from the training.
    fn novelty(&self, pose: &[f64]) -> Option<f64> {
        self.limit.unlike(&self.parts[0], pose)
    }

    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        self.typical.view()
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        if map.is_identity() {
            return Box::new(self.clone());
        }
        let map = &Arc::new(map.clone());
        let poses = Arc::new(self.poses.mapped(map));
        let parts = self.parts.iter().map(|p| p.mapped(map, &poses));
        let parts: Vec<PartMixture> = parts.collect();
        Box::new(MultiscaleMixture {
            variance: variance_of(&parts[0]),
            parts,
            typical: map.apply_rows(self.typical.view()),
            poses,
            conditioned_cache: empty_caches(self.parts.len()),
            isotropic: empty_caches(self.parts.len()),
            limit: self.limit.mapped(&self.parts[0], map),
            ..self.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use crate::pose::joints;
    use crate::prior::posterior_rows;
    use crate::prior::testdata::Ask;
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
    fn a_known_pose_is_found_under_noise_and_from_a_few_points() {
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
        // The further from all that was learnt, the less evidence; nothing seen says nothing.
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
    fn a_file_gives_the_same_answers_and_damage_is_told() {
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
        // What is left out because it follows is found again.
        let mut single = model.clone();
        for (p, l) in (0..again.parts.len()).flat_map(|p| (0..3).map(move |l| (p, l))) {
            assert!(single.get(&format!("within.{p}.{l}")).is_some());
            single.remove(&format!("within.{p}.{l}"));
        }
        let single = MultiscaleMixture::from_model(&single, "m").unwrap();
        let (all, single) = (again.full(&y, &[1.0; 69]), single.full(&y, &[1.0; 69]));
        let both = all.mean.iter().zip(&single.mean);
        assert!(both.clone().all(|(a, b)| (a - b).abs() <= 1e-3));
        for name in [
            "poses",
            "takes",
            "labels",
            "weights",
            "ways",
            "directions.0.1",
        ] {
            let mut broken = model.clone();
            broken.remove(name);
            let detail = MultiscaleMixture::from_model(&broken, "m")
                .unwrap_err()
                .to_string();
            assert!(detail.contains(name), "{detail}");
        }
    }

    #[test]
    fn covariance_below_a_total_variance() {
        let poses = poses();
        let (mixture, _) = trained(&poses);
        let y = poses
            .xyz
            .slice(ndarray::s![40..42, ..])
            .mapv(|v| f64::from(v) + 0.5);
        let noise = Array2::from_elem((2, 69), 4.0);
        let variances = posterior_rows(&mixture, y.view(), noise.view(), Want::Variances);
        let full = mixture.full_rows(y.view(), noise.view());
        let sum = |row: usize| variances[row].variance.iter().sum::<f64>();
        for row in 0..2 {
            let below = |most: f64| {
                let want = Want::CovarianceBelow(most);
                posterior_rows(&mixture, y.view(), noise.view(), want).remove(row)
            };
            assert_eq!(below(f64::INFINITY), full[row]);
            assert_eq!(below(sum(row) * 1.01), full[row]);
            assert_eq!(below(sum(row)), variances[row]);
            assert!(!below(0.0).has_covariance());
        }
    }

    #[test]
    fn what_is_no_number_has_no_answer() {
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

    #[test]
    fn a_turned_model_gives_turned_answers() {
        let poses = poses();
        let (mixture, _) = trained(&poses);
        let step_coordinates = PoseTransform::Rotate(crate::pose::rotation::from_rotation_vector(
            glam::DVec3::new(0.3, 1.0, -0.2),
        ));
        let y: Vec<f64> = poses
            .xyz
            .row(200)
            .iter()
            .map(|v| f64::from(*v) + 1.0)
            .collect();
        let mut turned = y.clone();
        step_coordinates.apply(&y, &mut turned);
        let mut want = y.clone();
        step_coordinates.apply(&mixture.full(&y, &[9.0; 69]).mean, &mut want);
        let got = mixture
            .mapped(&step_coordinates)
            .full(&turned, &[9.0; 69])
            .mean;
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() <= 1e-2));
    }
}

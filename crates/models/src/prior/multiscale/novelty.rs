//! Novelty: how much less likely a pose is than nearly all held-out poses.
//!
//! ```text
//! u(x) = max(0, q − log p(x))
//! ```
//!
//! x: a whole pose (3 J numbers, cm); log p: its log evidence in nats by the clusters of the whole
//! body, with a fixed reference noise: it does not depend on what was observed, and one threshold
//! serves every task. q: the 0.1 % quantile of log p over held-out poses, under a mixture learned
//! without them and the final weights. Poses that were learned from would set q far too high.

use super::conditioned::ConditionedPart;
use super::exemplars::{ExemplarPoses, Exemplars};
use super::part_mixture::PartMixture;
use crate::numeric::parallel;
use crate::pose::{ASF_UNIT_CM, PoseTransform};
use ndarray::Array2;
use std::sync::{Arc, OnceLock};

/// The reference noise variance of each coordinate, cm²: (0.1 asf)², about the error of the best
/// restored poses.
const REFERENCE: f64 = 0.01 * ASF_UNIT_CM * ASF_UNIT_CM;
/// The share of held-out poses below the threshold.
const QUANTILE: f64 = 1e-3;
/// At most this many poses of each fold are measured: the quantile is then the fifth smallest.
const MEASURED: usize = 5000;

/// The threshold, and the whole body that evaluates poses.
#[derive(Debug, Clone, Default)]
pub(crate) struct NoveltyDetector {
    /// q, nats; `None` where no take could be held out.
    pub threshold: Option<f64>,
    /// The whole body under the reference noise.
    conditioned: Arc<OnceLock<ConditionedPart>>,
    /// For transformed poses: the whole body as it was learned, and the transforms back to it.
    origin: Option<(Arc<PartMixture>, Vec<PoseTransform>)>,
}

/// The whole body learned without some takes, and poses of those takes.
pub(crate) struct HeldOutPoses {
    whole: PartMixture,
    /// (n, 3 J), cm.
    poses: Array2<f32>,
}

impl HeldOutPoses {
    /// `whole` was learned without the takes of `poses` (n, 3 J), cm.
    pub(crate) fn new(mut whole: PartMixture, poses: Array2<f32>) -> HeldOutPoses {
        // Only clusters are evaluated, after all folds: exemplars would fill the memory until then.
        let none = ExemplarPoses::new(Array2::zeros((0, poses.ncols())), Vec::new());
        whole.exemplars = Exemplars::new(Arc::new(none), &[], 0);
        HeldOutPoses { whole, poses }
    }

    /// Every n-th row, so that at most [`MEASURED`] remain.
    pub(crate) fn spread(rows: &[usize]) -> Vec<usize> {
        let step = rows.len().div_ceil(MEASURED).max(1);
        rows.iter().copied().step_by(step).collect()
    }

    /// The log evidence of each pose with these log weights of the sub-mixtures.
    fn evidences(&self, log_weights: &[f64]) -> Vec<f64> {
        let mut whole = self.whole.clone();
        whole.set_log_weights(log_weights.iter().copied());
        whole.leave_out_light();
        let detector = NoveltyDetector::default();
        let of = |row: usize| {
            let pose = self.poses.row(row);
            let pose: Vec<f64> = pose.iter().map(|v| f64::from(*v)).collect();
            detector.evidence(&whole, &pose)
        };
        parallel::map_chunks(self.poses.nrows(), 64, |range| {
            range.map(of).collect::<Vec<_>>()
        })
        .concat()
    }
}

impl NoveltyDetector {
    /// A detector with a known threshold, nats, or none.
    pub(crate) fn new(threshold: Option<f64>) -> NoveltyDetector {
        NoveltyDetector {
            threshold,
            ..NoveltyDetector::default()
        }
    }

    /// Learns the threshold from the held-out poses of all folds, with the final log weights of the
    /// whole body.
    pub(crate) fn learn(held: &[HeldOutPoses], log_weights: &[f64]) -> NoveltyDetector {
        let mut all: Vec<f64> = held
            .iter()
            .flat_map(|h| h.evidences(log_weights))
            .filter(|e| e.is_finite())
            .collect();
        all.sort_unstable_by(f64::total_cmp);
        let at = (QUANTILE * all.len() as f64) as usize;
        NoveltyDetector::new(all.get(at).copied())
    }

    /// The detector for poses transformed by `map`; `whole` is the whole body before it. Poses are
    /// transformed back first, since a density changes with the size of a body.
    pub(crate) fn mapped(&self, whole: &PartMixture, map: &PoseTransform) -> NoveltyDetector {
        let (origin, mut back) = match &self.origin {
            Some((origin, back)) => (origin.clone(), back.clone()),
            None => (Arc::new(whole.clone()), Vec::new()),
        };
        back.insert(0, map.inverse());
        NoveltyDetector {
            origin: Some((origin, back)),
            ..self.clone()
        }
    }

    /// u(x) of a pose (3 J, cm), nats; `None` without a threshold.
    pub(crate) fn novelty(&self, whole: &PartMixture, pose: &[f64]) -> Option<f64> {
        let threshold = self.threshold?;
        let mut pose = pose.to_vec();
        let (whole, back) = match &self.origin {
            Some((origin, back)) => (&**origin, &back[..]),
            None => (whole, &[][..]),
        };
        for map in back {
            let from = pose.clone();
            map.apply(&from, &mut pose);
        }
        let by = threshold - self.evidence(whole, &pose);
        // NaN is unlike anything.
        Some(if by <= 0.0 { 0.0 } else { by })
    }

    fn evidence(&self, whole: &PartMixture, pose: &[f64]) -> f64 {
        let conditioned = self
            .conditioned
            .get_or_init(|| ConditionedPart::new(whole, vec![REFERENCE; pose.len()]));
        whole.cluster_candidates(conditioned, pose).evidence
    }
}

#[cfg(test)]
mod tests {
    use super::super::MultiscaleMixture;
    use super::super::tests::{poses, trained};
    use crate::io::Model;
    use crate::pose::{Body, PoseTransform};
    use crate::prior::Prior;

    /// A training pose with coordinates moved by ± `far`, and the training pose itself.
    fn two(far: f64) -> [Vec<f64>; 2] {
        let known: Vec<f64> = poses().xyz.row(77).iter().map(|v| f64::from(*v)).collect();
        let moved = known.iter().enumerate();
        let moved = moved.map(|(i, v)| v + if i % 2 == 0 { far } else { -far });
        [moved.collect(), known]
    }

    #[test]
    fn novelty_grows_with_the_distance() {
        let (mixture, _) = trained(&poses());
        let [near, known] = two(20.0);
        let [far, _] = two(60.0);
        assert_eq!(mixture.novelty(&known), Some(0.0));
        let (near, far) = (
            mixture.novelty(&near).unwrap(),
            mixture.novelty(&far).unwrap(),
        );
        assert!(near > 50.0 && far > near, "{near} {far}");
    }

    #[test]
    fn transformed_poses_keep_their_novelty() {
        let (mixture, _) = trained(&poses());
        let body = Body {
            parents: (0..23).map(|p: usize| p.checked_sub(1)).collect(),
            lengths: vec![10.0; 23],
        };
        let taller = Body {
            lengths: vec![12.0; 23],
            ..body.clone()
        };
        let reshape = PoseTransform::reshape(&body, &taller);
        let rotation =
            PoseTransform::Rotate(crate::pose::rotation::from_rotation_vector(glam::DVec3::Y));
        let mapped = mixture.mapped(&reshape).mapped(&rotation);
        for pose in two(20.0) {
            let (mut tall, mut carried) = (pose.clone(), pose.clone());
            reshape.apply(&pose, &mut tall);
            rotation.apply(&tall, &mut carried);
            let want = mixture.novelty(&pose).unwrap();
            let got = mapped.novelty(&carried).unwrap();
            assert!((got - want).abs() <= 1e-3 * want, "{got} {want}");
        }
    }

    #[test]
    fn a_file_keeps_the_threshold_and_old_files_have_none() {
        let (mixture, model) = trained(&poses());
        let again = Model::from_bytes(model.to_bytes().unwrap(), "m").unwrap();
        let again = MultiscaleMixture::from_model(&again, "m").unwrap();
        let [moved, _] = two(20.0);
        assert!(mixture.novelty(&moved).is_some_and(|u| u > 0.0));
        assert_eq!(mixture.novelty(&moved), again.novelty(&moved));
        let mut old = model.clone();
        old.remove("limit");
        let old = MultiscaleMixture::from_model(&old, "m").unwrap();
        assert_eq!(old.novelty(&moved), None);
        let mut broken = model.clone();
        broken.insert("limit", ndarray::Array2::from_elem((1, 1), f32::NAN));
        let detail = MultiscaleMixture::from_model(&broken, "m")
            .unwrap_err()
            .to_string();
        assert!(detail.contains("limit"), "{detail}");
    }

    #[test]
    fn a_single_take_gives_no_threshold() {
        let mut poses = poses();
        poses.takes = std::iter::once(0..400).collect();
        let (mixture, model) = trained(&poses);
        assert!(model.get("limit").is_none());
        assert_eq!(mixture.novelty(&two(60.0)[0]), None);
    }
}

//! How little evidence a pose may have before it is unlike all that was seen.
//!
//! ```text
//! u(x) = max(0, q − log p(x))
//! ```
//!
//! x: a whole pose (3 J numbers, cm); log p: its log evidence in nats by the cells of the whole body, each coordinate
//! with the reference noise. So it does not depend on what was observed, and one number serves every task. q: the 0.1 %
//! quantile of log p over poses of takes that were held back, under blocks learnt without them and the weights of all:
//! of poses as like the training as those, one in a thousand is flagged. Poses that were learnt from would set it far
//! too high.

use super::exemplars::{ExemplarPoses, Exemplars};
use super::part_mixture::{ConditionedPart, PartMixture};
use crate::numeric::parallel;
use crate::pose::{ASF_UNIT_CM, PoseTransform};
use ndarray::Array2;
use std::sync::{Arc, OnceLock};

/// The variance that each coordinate is taken to have, cm²: of 0.1 asf, about what a restored pose is off at best.
const REFERENCE: f64 = 0.01 * ASF_UNIT_CM * ASF_UNIT_CM;
/// The share of held-back poses that are told to be unlike those seen.
const QUANTILE: f64 = 1e-3;
/// At most so many poses of each group of held-back takes are measured: five make the quantile.
const MEASURED: usize = 5000;

/// The least evidence of a pose that is like those seen.
#[derive(Debug, Clone, Default)]
pub struct NoveltyDetector {
    /// q, nats; `None` where no take could be held back.
    pub threshold: Option<f64>,
    /// The whole body through the reference noise.
    conditioned: Arc<OnceLock<ConditionedPart>>,
    /// For poses that went through maps: the whole body as it was learnt, and the way back to it.
    origin: Option<(Arc<PartMixture>, Vec<PoseTransform>)>,
}

/// The whole body learnt without some takes, and poses of these.
pub struct HeldOutPoses {
    whole: PartMixture,
    /// (n, 3 J), cm.
    poses: Array2<f32>,
}

impl HeldOutPoses {
    /// `whole` is what was learnt without the takes of `poses` (n, 3 J).
    pub fn new(mut whole: PartMixture, poses: Array2<f32>) -> HeldOutPoses {
        // Only cells are asked, and this waits for the weights: the leaves would only fill the memory.
        let none = ExemplarPoses::new(Array2::zeros((0, poses.ncols())).into(), Vec::new());
        whole.exemplars = Exemplars::new(Arc::new(none), &[], 0);
        HeldOutPoses { whole, poses }
    }

    /// Every pose of so many that at most [`MEASURED`] are left.
    pub fn spread(rows: &[usize]) -> Vec<usize> {
        let step = rows.len().div_ceil(MEASURED).max(1);
        rows.iter().copied().step_by(step).collect()
    }

    /// The log evidence of each pose with these weights of the levels.
    fn evidences(&self, log_weights: &[f64]) -> Vec<f64> {
        let mut whole = self.whole.clone();
        whole.set_log_weights(log_weights.to_vec());
        let limit = NoveltyDetector::default();
        let of = |row: usize| {
            let pose = self.poses.row(row);
            let pose: Vec<f64> = pose.iter().map(|v| f64::from(*v)).collect();
            limit.evidence(&whole, &pose)
        };
        parallel::map_chunks(self.poses.nrows(), 64, |range| {
            range.map(of).collect::<Vec<_>>()
        })
        .concat()
    }
}

impl NoveltyDetector {
    /// A limit that is known, nats, or none.
    pub fn new(threshold: Option<f64>) -> NoveltyDetector {
        NoveltyDetector {
            threshold,
            ..NoveltyDetector::default()
        }
    }

    /// From held-back poses of all groups; `log_weights` are those of the whole body's levels.
    pub fn learn(held: &[HeldOutPoses], log_weights: &[f64]) -> NoveltyDetector {
        let mut all: Vec<f64> = held
            .iter()
            .flat_map(|h| h.evidences(log_weights))
            .filter(|e| e.is_finite())
            .collect();
        all.sort_unstable_by(f64::total_cmp);
        let at = (QUANTILE * all.len() as f64) as usize;
        NoveltyDetector::new(all.get(at).copied())
    }

    /// The same for a model whose poses went through a map, `whole` before it: they are judged where they come from, since
    /// a density changes where a body does.
    pub fn mapped(&self, whole: &PartMixture, map: &PoseTransform) -> NoveltyDetector {
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

    /// By how many nats a pose (3 J, cm) has less evidence than the limit, at least 0; `None` without a limit.
    pub fn unlike(&self, whole: &PartMixture, pose: &[f64]) -> Option<f64> {
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
        // What is no number is like nothing.
        Some(if by <= 0.0 { 0.0 } else { by })
    }

    fn evidence(&self, whole: &PartMixture, pose: &[f64]) -> f64 {
        let conditioned = self
            .conditioned
            .get_or_init(|| ConditionedPart::isotropic(whole, REFERENCE));
        whole.candidates_among_clusters(conditioned, pose).evidence
    }
}

#[cfg(test)]
mod tests {
    use super::super::MultiscaleMixture;
    use super::super::tests::{poses, trained};
    use crate::io::Model;
    use crate::pose::{Body, PoseTransform};
    use crate::prior::Prior;

    /// A pose that was learnt from, and one whose points were moved `far`, in turn one way and the other.
    fn two(far: f64) -> [Vec<f64>; 2] {
        let known: Vec<f64> = poses().xyz.row(77).iter().map(|v| f64::from(*v)).collect();
        let moved = known.iter().enumerate();
        let moved = moved.map(|(i, v)| v + if i % 2 == 0 { far } else { -far });
        [moved.collect(), known]
    }

    #[test]
    fn the_further_from_all_that_was_seen_the_more_unlike() {
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
    fn poses_of_another_body_turned_too_are_judged_where_they_come_from() {
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
        let step_coordinates =
            PoseTransform::Rotate(crate::pose::rotation::from_rotation_vector(glam::DVec3::Y));
        let mapped = mixture.mapped(&reshape).mapped(&step_coordinates);
        for pose in two(20.0) {
            let (mut tall, mut map_covariance) = (pose.clone(), pose.clone());
            reshape.apply(&pose, &mut tall);
            step_coordinates.apply(&tall, &mut map_covariance);
            let want = mixture.novelty(&pose).unwrap();
            let got = mapped.novelty(&map_covariance).unwrap();
            assert!((got - want).abs() <= 1e-3 * want, "{got} {want}");
        }
    }

    #[test]
    fn the_file_keeps_the_limit_and_old_files_have_none() {
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
    fn a_single_take_gives_no_limit() {
        let mut poses = poses();
        poses.takes = std::iter::once(0..400).collect();
        let (mixture, model) = trained(&poses);
        assert!(model.get("limit").is_none());
        assert_eq!(mixture.novelty(&two(60.0)[0]), None);
    }
}

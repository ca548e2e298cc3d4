//! A model's prior and rigid distances, carried to the body of one take.

use super::frame_estimator::{FrameEstimate, FrameEstimator};
use super::placement::PlacementSolution;
use super::pose_model::length_sd;
use super::rigid::{OwnLength, RigidModel};
use super::take::PointMapping;
use super::tuning::adapted_prior::*;
use super::upright::UprightPoses;
use crate::label::marker_distances::Distance;
use crate::numeric::parallel;
use crate::pose::{Observation, Similarity};
use crate::prior::Prior;
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::borrow::Cow;

/// A model's prior and rigid distances, carried to the body of one take.
pub(crate) struct AdaptedPrior<'a> {
    /// The model, and the points of the table that are its own.
    pub mapping: &'a PointMapping<'a>,
    /// `None`: the body is the model's own, or the model does not say what its own is.
    prior: Option<Box<dyn Prior>>,
    /// The rigid distances of the body, with what is uncertain about them.
    pub rigid: Cow<'a, RigidModel>,
}

impl<'a> AdaptedPrior<'a> {
    /// The prior for the body that `frames` (m, 3 J, in the model's order; cm) of one take show;
    /// `noise` is the standard deviation of a coordinate, cm. The rigid distances are still those
    /// of the model's own body.
    pub(crate) fn new(
        mapping: &'a PointMapping<'a>,
        frames: ArrayView2<'_, f64>,
        noise: f64,
    ) -> AdaptedPrior<'a> {
        let model = mapping.model;
        AdaptedPrior {
            mapping,
            prior: model.prior_for(frames, noise),
            rigid: Cow::Borrowed(&model.rigid),
        }
    }

    /// The prior and the rigid distances of the body that `frames` (m, 3 J, in the model's order;
    /// cm) of one take show, seen with `noise` (standard deviation of a coordinate, cm).
    pub(crate) fn measured(
        mapping: &'a PointMapping<'a>,
        frames: ArrayView2<'_, f64>,
        noise: f64,
    ) -> AdaptedPrior<'a> {
        AdaptedPrior::new(mapping, frames, noise).with_lengths_from(frames, noise)
    }

    /// The prior and the rigid distances of the body that a smoothed take shows at `mean` (frames,
    /// 3 J, in the table's order; cm), in which so much noise is left: standard deviation of a
    /// coordinate, cm.
    pub(crate) fn of_smoothed(
        mapping: &'a PointMapping<'a>,
        mean: ArrayView2<'_, f64>,
        noise: f64,
    ) -> AdaptedPrior<'a> {
        let seen = mapping.gather(mean);
        AdaptedPrior::new(mapping, seen.view(), 0.0).with_lengths_from(seen.view(), noise)
    }

    /// Rigid distances of the body too, as uncertain as lengths are that were measured in `frames`
    /// with `noise` (standard deviation of a coordinate, cm).
    pub(crate) fn with_lengths_from(
        mut self,
        frames: ArrayView2<'_, f64>,
        noise: f64,
    ) -> AdaptedPrior<'a> {
        let model = self.mapping.model;
        let Some(prior) = self.prior.as_ref().filter(|_| !model.rigid.is_empty()) else {
            return self;
        };
        let is_seen = |ends: [usize; 2], row: ArrayView1<'_, f64>| {
            let mut all = ends.iter().flat_map(|p| 3 * p..3 * p + 3);
            all.all(|i| row[i].is_finite())
        };
        let own = |ends: [usize; 2], length: f64| {
            let count = frames
                .rows()
                .into_iter()
                .filter(|r| is_seen(ends, *r))
                .count();
            if !model.is_bone(ends) {
                return measured_length(&Distance::measure(frames, ends)?, noise);
            }
            // Under a map's names even a bone may be none.
            let found = Distance::measure(frames, ends).filter(|_| noise <= JUDGED_NOISE);
            if let Some(found) = found.filter(|d| d.frames >= MEASURED_FRAMES) {
                return measured_length(&found, noise);
            }
            let sd = length_sd(length, noise, count);
            Some(OwnLength::Transformed { sd })
        };
        let from = model.prior.representative_poses();
        let to = prior.representative_poses();
        self.rigid = Cow::Owned(model.rigid.mapped(from, to, own));
        self
    }

    /// Whether the body is the model's own.
    pub(crate) fn is_own_body(&self) -> bool {
        self.prior.is_none()
    }

    /// The training poses as the body would take them, in the table's order of points (n, 3 J), cm;
    /// points that the model does not know are NaN. `None` where the model keeps none, or not in
    /// the pelvis's frame.
    pub(crate) fn training_poses(&self) -> Option<Array2<f64>> {
        let estimator = self.estimator();
        estimator.anchor.filter(|a| a.root.is_some())?;
        let poses = estimator.prior.training_poses()?;
        Some(self.mapping.rows_of_table(poses.view()))
    }

    /// The training poses as the body would take them, upright, for frames (m, 3 J, in the model's
    /// order; cm) of one take, or for one frame, that never show some of the points; `None` where
    /// they show most, where y is not up in them, or where the model does not say which way is up.
    pub(crate) fn upright_poses(
        &self,
        frames: ArrayView2<'_, f64>,
        whole_take: bool,
    ) -> Option<UprightPoses> {
        let few = if whole_take {
            FEW_OF_TAKE
        } else {
            FEW_OF_FRAME
        };
        let points = frames.ncols() / 3;
        let is_seen = |p: &usize| {
            let mut rows = frames.rows().into_iter();
            rows.any(|row| (3 * p..3 * p + 3).any(|i| row[i].is_finite()))
        };
        let never_seen = points - (0..points).filter(is_seen).count();
        if (never_seen as f64) < few * points as f64 {
            return None;
        }
        let up = self.mapping.model.up()?;
        let estimator = self.estimator();
        estimator.anchor.filter(|a| a.root.is_some())?;
        let poses = estimator.prior.training_poses()?;
        Some(UprightPoses::new(poses.view(), up)).filter(|u| u.are_upright(frames))
    }

    /// Whether at most half of the complete frames of a take (frames, 3 J, in the table's order;
    /// cm) are unlike all training poses. Under more than a little `noise` (standard deviation of
    /// a coordinate, cm) every pose is unlike them, which says nothing: then it counts as known.
    pub(crate) fn knows(&self, take: ArrayView2<'_, f64>, noise: f64) -> bool {
        if noise > JUDGED_NOISE {
            return true;
        }
        let take = self.mapping.gather(take);
        let is_complete = |t: &usize| take.row(*t).iter().all(|v| v.is_finite());
        let complete: Vec<usize> = (0..take.nrows()).filter(is_complete).collect();
        let step = complete.len().div_ceil(JUDGED_FRAMES).max(1);
        let estimator = self.estimator();
        let judged = parallel::map_chunks(complete.len().div_ceil(step), 1, |range| {
            let pose = take.row(complete[range.start * step]).to_vec();
            estimator.novelty(&pose, &Similarity::IDENTITY) > 0.0
        });
        2 * judged.iter().filter(|is_novel| **is_novel).count() <= judged.len()
    }

    /// Estimates frames with the prior alone, no rigid distance kept.
    pub(crate) fn estimator(&self) -> FrameEstimator<'_> {
        let own = self.mapping.model.estimator();
        FrameEstimator {
            prior: self.prior.as_deref().unwrap_or(own.prior),
            ..own
        }
    }

    /// Estimates a frame: `y` (3 J, cm) and the noise variance of each coordinate (cm², infinite
    /// where missing); by upright poses, where there are some and they can be placed. `None` when
    /// too little is seen.
    pub(crate) fn estimate(
        &self,
        upright: Option<&UprightPoses>,
        y: &[f64],
        noise: &[f64],
    ) -> Option<FrameEstimate> {
        let estimator = self.rigid_estimator();
        let seen = Observation {
            values: y,
            variance: noise,
        };
        // A picture, of which whole points say little, is placed by its parts.
        let upright = upright.filter(|_| !seen.is_partial());
        let Some((upright, placement)) = upright.and_then(|u| Some((u, u.place(&seen)?))) else {
            return estimator.estimate(y, noise);
        };
        let estimator = FrameEstimator {
            prior: upright,
            ..estimator
        };
        let placed = PlacementSolution::from_placement(placement);
        Some(estimator.estimate_placed(seen, &placed))
    }

    /// Estimates frames with the prior and the rigid distances.
    pub(crate) fn rigid_estimator(&self) -> FrameEstimator<'_> {
        self.estimator().with_rigid_model(&self.rigid)
    }
}

/// The distance between two points that no bone joins, if `frames` (m, 3 J; cm) show it to be
/// rigid; `noise` is the standard deviation of a coordinate, cm. People differ in it more than in
/// their bones: the model's own says nothing of it.
fn measured_length(found: &Distance, noise: f64) -> Option<OwnLength> {
    if found.frames < MEASURED_FRAMES {
        return None;
    }
    // Both ends are noisy; twice their variance still may be noise.
    let noise_variance = 2.0 * noise * noise;
    let variance = found.spread.max(found.tails).powi(2);
    let is_rigid = variance <= 2.0 * noise_variance + MOST_SPREAD * MOST_SPREAD;
    is_rigid.then(|| OwnLength::Measured {
        length: found.median,
        // Noise is overestimated where a body is fast.
        sd: ((variance - noise_variance).max(variance / 2.0) + variance / found.frames as f64)
            .sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Model;
    use crate::pose_model::PoseModel;
    use crate::prior::{OpenOptions, builtin_model};

    #[test]
    fn models_that_do_not_say_which_way_is_up_have_no_upright_poses() {
        let mut model = builtin_model().unwrap();
        let names = model.meta.points.clone();
        let pose = model.get("poses").unwrap().row(9).mapv(f64::from);
        let mut frame = pose.insert_axis(ndarray::Axis(0));
        let open = |model: &Model, world| {
            PoseModel::open(model, &OpenOptions::default(), "m", world).unwrap()
        };
        let is_upright = |model: &PoseModel, frame: &Array2<f64>| {
            let mapping = PointMapping::new(model, "m", &names, false).unwrap();
            let adapted = AdaptedPrior::new(&mapping, frame.view(), 0.0);
            adapted.upright_poses(frame.view(), true).is_some()
        };
        // A whole pose needs none; one without arms, whose pelvis is as upright as most, has some.
        let with = open(&model, true);
        assert!(!is_upright(&with, &frame));
        frame.slice_mut(ndarray::s![.., 3 * 15..]).fill(f64::NAN);
        assert!(is_upright(&with, &frame));
        assert!(!is_upright(&open(&model, false), &frame));
        model.remove("up");
        assert!(!is_upright(&open(&model, true), &frame));
    }
}

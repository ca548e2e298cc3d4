//! A pose model ready for use: prior, root frame, body and rigid distances, all in the model's
//! order of points.

use super::body_adaptation;
use super::frame_restorer::FrameRestorer;
use super::placed_prior::PlacedPrior;
use super::placement::PlacementSolver;
use super::rigid::RigidModel;
use super::rigid::noise_floor::NoiseFloor;
use crate::Result;
use crate::io::Model;
use crate::numeric::parallel;
use crate::pose::{BonePoints, Similarity};
use crate::prior::{OpenOptions, Prior};
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::borrow::Cow;

/// Frames by which a model is judged to know a take.
const JUDGED_FRAMES: usize = 50;
/// Noise under which that can be judged, cm.
const JUDGED_NOISE: f64 = 0.3;

/// A pose model in memory.
pub struct LoadedModel {
    placed: PlacedPrior,
    /// Where its points stand on their bones.
    bone_points: BonePoints,
    solver: PlacementSolver,
    /// Empty where the model has no rigid pairs or restores as published.
    rigid: RigidModel,
    /// Rigid distances of a person who has not been measured.
    unknown_body: RigidModel,
}

impl LoadedModel {
    /// Opens a model named `source`. In world space each pose is placed first; in body space poses
    /// are used as they are.
    ///
    /// # Errors
    /// As [`PlacedPrior::open`] and [`RigidModel::read`]: arrays that are missing, of a wrong shape
    /// or not finite.
    pub fn new(
        model: &Model,
        options: &OpenOptions,
        source: &str,
        world: bool,
    ) -> Result<LoadedModel> {
        let placed = PlacedPrior::open(model, options, source, world)?;
        let rigid = match options.published {
            true => RigidModel::default(),
            false => RigidModel::read(model, source)?,
        };
        let typical = placed.prior.representative_poses();
        Ok(LoadedModel {
            bone_points: BonePoints::of(&model.meta.points, typical),
            placed,
            solver: PlacementSolver::default(),
            unknown_body: rigid.for_unknown_body(),
            rigid,
        })
    }

    /// Where its points stand on their bones.
    pub fn bone_points(&self) -> BonePoints {
        self.bone_points
    }

    /// The number of points.
    pub fn points(&self) -> usize {
        self.placed.points()
    }

    /// The rigid distances to judge one frame by before its body is measured, and the frame's noise
    /// floor by them.
    pub fn noise_floor(&self, y: &[f64]) -> Option<(&RigidModel, NoiseFloor)> {
        // In world space the body may be anyone's; body space holds the training bodies.
        let own = (!self.placed.is_for_any_body()).then_some(&self.rigid);
        let mut all = own.into_iter().chain([&self.unknown_body]);
        all.find_map(|rigid| Some((rigid, rigid.noise_floor(y)?)))
    }

    /// Restores single frames of the model's own body.
    pub fn frame_restorer(&self) -> FrameRestorer<'_> {
        FrameRestorer {
            prior: &*self.placed.prior,
            anchor: self.placed.anchor.as_ref(),
            solver: &self.solver,
            rigid: None,
        }
        .with_rigid_model(&self.rigid)
    }

    /// The model for the model's own body.
    pub fn unadapted(&self) -> AdaptedModel<'_> {
        AdaptedModel {
            model: self,
            prior: None,
            rigid: Cow::Borrowed(&self.rigid),
        }
    }

    /// The model for the body that `frames` (m, 3 J) of one take show; `noise` is the standard
    /// deviation of a coordinate, cm.
    pub fn adapt(&self, frames: ArrayView2<'_, f64>, noise: f64) -> AdaptedModel<'_> {
        self.adapt_prior(frames, noise)
            .with_lengths_from(frames, noise)
    }

    /// Adapts the prior alone; the rigid distances stay those of the model's own body.
    pub fn adapt_prior(&self, frames: ArrayView2<'_, f64>, noise: f64) -> AdaptedModel<'_> {
        AdaptedModel {
            model: self,
            prior: self.placed.for_body(frames, noise),
            rigid: Cow::Borrowed(&self.rigid),
        }
    }
}

/// A model carried to the body of one take.
pub struct AdaptedModel<'a> {
    model: &'a LoadedModel,
    /// `None`: the body is the model's own.
    prior: Option<Box<dyn Prior>>,
    /// The rigid distances of the body, with what is uncertain about them.
    pub rigid: Cow<'a, RigidModel>,
}

impl<'a> AdaptedModel<'a> {
    /// Whether the body is the model's own.
    pub fn is_own_body(&self) -> bool {
        self.prior.is_none()
    }

    /// Rigid distances as uncertain as lengths are that were measured in `frames` with `noise`
    /// (standard deviation of a coordinate, cm).
    pub fn with_lengths_from(
        mut self,
        frames: ArrayView2<'_, f64>,
        noise: f64,
    ) -> AdaptedModel<'a> {
        let Some(prior) = self.prior.as_ref().filter(|_| !self.model.rigid.is_empty()) else {
            return self;
        };
        let length_sd = |ends: [usize; 2], length: f64| {
            let is_seen = |row: ArrayView1<'_, f64>| {
                let mut all = ends.iter().flat_map(|p| 3 * p..3 * p + 3);
                all.all(|i| row[i].is_finite())
            };
            let count = frames.rows().into_iter().filter(|r| is_seen(*r)).count();
            body_adaptation::length_sd(length, noise, count)
        };
        let (from, to) = (
            self.model.placed.prior.representative_poses(),
            prior.representative_poses(),
        );
        self.rigid = Cow::Owned(self.model.rigid.mapped(from, to, length_sd));
        self
    }

    /// The training poses (n, 3 J) as the body would take them, cm; `None` where the model keeps
    /// none, or not in the pelvis's frame.
    pub fn training_poses(&self) -> Option<Array2<f64>> {
        let prior = self.prior.as_deref().unwrap_or(&*self.model.placed.prior);
        let anchor = self.model.placed.anchor.as_ref();
        anchor.filter(|a| a.root.is_some())?;
        prior.training_poses()
    }

    /// Whether at most half of the complete frames of a take (frames, 3 J; cm) are unlike all
    /// training poses. Under more than a little `noise` (standard deviation of a coordinate,
    /// cm) every pose is unlike them, which says nothing: then it counts as known.
    pub fn knows(&self, take: ArrayView2<'_, f64>, noise: f64) -> bool {
        if noise > JUDGED_NOISE {
            return true;
        }
        let is_complete = |t: &usize| take.row(*t).iter().all(|v| v.is_finite());
        let complete: Vec<usize> = (0..take.nrows()).filter(is_complete).collect();
        let step = complete.len().div_ceil(JUDGED_FRAMES).max(1);
        let restorer = self.restorer();
        let judged = parallel::map_chunks(complete.len().div_ceil(step), 1, |range| {
            let pose = take.row(complete[range.start * step]).to_vec();
            restorer.novelty(&pose, &Similarity::IDENTITY) > 0.0
        });
        2 * judged.iter().filter(|is_novel| **is_novel).count() <= judged.len()
    }

    /// Restores frames with the prior alone, no rigid distance kept.
    pub fn restorer(&self) -> FrameRestorer<'_> {
        FrameRestorer {
            prior: self.prior.as_deref().unwrap_or(&*self.model.placed.prior),
            anchor: self.model.placed.anchor.as_ref(),
            solver: &self.model.solver,
            rigid: None,
        }
    }

    /// Restores frames with the prior and the rigid distances.
    pub fn rigid_restorer(&self) -> FrameRestorer<'_> {
        self.restorer().with_rigid_model(&self.rigid)
    }
}

//! A table and a model put together: which point of the one is which of the other, whose body, which space.

use super::body_adaptation;
use super::frame_restorer::FrameRestorer;
use super::placement::alternating::PlacementSolver;
use super::rigid::RigidModel;
use super::rigid::noise_floor::NoiseFloor;
use crate::io::Model;
use crate::pose::{Anchor, Body, PoseTransform, joints};
use crate::prior::{self, OpenOptions, Prior};
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::borrow::Cow;

/// Bodies within this share of the model's bones are the model's.
const SAME_BODY: f64 = 0.002;

/// A model made ready for the points of a table. Everything inside is in the model's order of points.
pub struct BoundModel {
    prior: Box<dyn Prior>,
    anchor: Option<Anchor>,
    /// The model's bones, for world space; the captured body's replace them.
    body: Option<Body>,
    mirror: Vec<Option<usize>>,
    /// Where each point of the model stands in the table.
    index: Vec<Option<usize>>,
    solver: PlacementSolver,
    /// Empty where the model knows of none, or answers as published.
    rigid: RigidModel,
    /// The same before anybody's lengths are measured.
    unknown_body: RigidModel,
}

impl BoundModel {
    /// Opens `model` for a table of `points`. In world space poses are placed; else rows are used as they are.
    pub fn new(
        model: &Model,
        choice: &OpenOptions,
        source: &str,
        points: &[String],
        world: bool,
    ) -> Result<BoundModel> {
        let prior = prior::open(model, choice, source)?;
        let rigid = match choice.published {
            true => RigidModel::default(),
            false => RigidModel::read(model, source)?,
        };
        let names = &model.meta.points;
        let index: Vec<_> = names
            .iter()
            .map(|n| points.iter().position(|p| p == n))
            .collect();
        if index.iter().all(Option::is_none) {
            let shown =
                |list: &[String]| list.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
            let what = format!(
                "the table has none of the model's points ({}, …); it has {}; convert the names, or train a model with prior-train",
                shown(names),
                shown(points)
            );
            return Err(Error::data(Place::file(source), what));
        }
        let anchor = world.then(|| match Anchor::pelvis(names) {
            Some(pelvis) => pelvis,
            None => Anchor::mean(&prior.representative_poses().row(0).to_vec()),
        });
        let body = if world {
            model.meta.body.as_ref().map(Body::from)
        } else {
            None
        };
        let mirror = (0..names.len())
            .map(|i| joints::mirrored(names, i))
            .collect();
        Ok(BoundModel {
            prior,
            anchor,
            mirror,
            index,
            solver: PlacementSolver::default(),
            unknown_body: rigid.for_unknown_body(),
            body,
            rigid,
        })
    }

    /// How many points the model has.
    pub fn points(&self) -> usize {
        self.index.len()
    }

    /// Where a point of the model stands in the table.
    pub fn in_table(&self, point: usize) -> Option<usize> {
        self.index[point]
    }

    /// Whether a frame (in the model's order) lacks nothing that the table could hold.
    pub fn is_whole(&self, y: &[f64]) -> bool {
        let seen = |p: usize| y[3 * p..3 * p + 3].iter().all(|v| v.is_finite());
        (0..self.points()).all(|p| self.index[p].is_none() || seen(p))
    }

    /// The bones between the model's points, as far as they are known.
    pub fn parents(&self) -> Vec<Option<usize>> {
        self.body
            .as_ref()
            .map_or_else(|| vec![None; self.points()], |b| b.parents.clone())
    }

    /// Rows of the table in the model's order; points that the table lacks are missing.
    pub fn gather(&self, rows: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = Array2::from_elem((rows.nrows(), 3 * self.points()), f64::NAN);
        for (i, at) in self.index.iter().enumerate() {
            let Some(at) = at else { continue };
            for axis in 0..3 {
                out.column_mut(3 * i + axis)
                    .assign(&rows.column(3 * at + axis));
            }
        }
        out
    }

    /// The prior for the body that these frames (of one take, in the model's order) show; `None`: the model's own fits.
    pub fn prior_for(&self, frames: ArrayView2<'_, f64>, noise: f64) -> Option<Box<dyn Prior>> {
        let map = body_adaptation::map_to(self.body.as_ref()?, frames, noise, &self.mirror);
        let same = match &map {
            PoseTransform::Reshape { ratios, .. } => {
                ratios.iter().all(|r| (r - 1.0).abs() <= SAME_BODY)
            }
            PoseTransform::Rotate(_) => false,
        };
        (!same).then(|| self.prior.mapped(&map))
    }

    /// What is known of a frame's rigid distances before its body is measured, and its base noise by that. In world space
    /// the body may be anyone's; rows that are used as they are may be of the bodies that the model knows.
    pub fn noise_floor_of(&self, y: &[f64]) -> Option<(&RigidModel, NoiseFloor)> {
        let own = self.body.is_none().then_some(&self.rigid);
        let mut all = own.into_iter().chain([&self.unknown_body]);
        all.find_map(|t| Some((t, t.noise_floor(y)?)))
    }

    /// What is known of rigid distances of that body; `noise` is what the lengths were measured with, the standard
    /// deviation of a coordinate, cm.
    pub fn treatment_for(
        &self,
        adapted: &Option<Box<dyn Prior>>,
        frames: ArrayView2<'_, f64>,
        noise: f64,
    ) -> Cow<'_, RigidModel> {
        let Some(adapted) = adapted.as_ref().filter(|_| !self.rigid.is_empty()) else {
            return Cow::Borrowed(&self.rigid);
        };
        let length_sd = |ends: [usize; 2], length: f64| {
            let seen = |row: ArrayView1<'_, f64>| {
                let all = ends.iter().flat_map(|p| 3 * p..3 * p + 3);
                all.into_iter().all(|i| row[i].is_finite())
            };
            let count = frames.rows().into_iter().filter(|r| seen(*r)).count();
            body_adaptation::length_sd(length, noise, count)
        };
        let (from, to) = (
            self.prior.representative_poses(),
            adapted.representative_poses(),
        );
        Cow::Owned(self.rigid.mapped(from, to, length_sd))
    }

    /// What restores frames, with the prior that [`BoundModel::prior_for`] gave, and without a treatment.
    pub fn restorer<'a>(&'a self, adapted: &'a Option<Box<dyn Prior>>) -> FrameRestorer<'a> {
        FrameRestorer {
            prior: adapted.as_deref().unwrap_or(&*self.prior),
            anchor: self.anchor.as_ref(),
            solver: self.solver.clone(),
            rigid: None,
        }
    }
}

//! Takes and their restored frames, and a model bound to the points of a table.

use super::loaded_model::LoadedModel;
use crate::pose::FillMethod;
use crate::pose::{NameMap, Status};
use crate::prior::EXACT_VARIANCE;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// One take of a table.
#[derive(Debug, Clone, Copy)]
pub struct Take<'a> {
    /// The names of the points (J).
    pub names: &'a [String],
    /// (frames, 3 J), cm; NaN missing.
    pub xyz: ArrayView2<'a, f64>,
    /// Its ranges of consecutive frames.
    pub runs: &'a [Range<usize>],
    /// Frames a second.
    pub rate: f64,
}

/// A method that restores the frames of a table: [`super::Complete`] or [`super::Denoise`]. What it
/// answers is in the table's order of points.
pub trait Method {
    /// Restores each frame of `xyz` (frames, 3 J; cm, NaN missing) by itself.
    fn frames(&self, bound: &BoundModel<'_>, xyz: ArrayView2<'_, f64>) -> RestoredFrames;

    /// Restores one take, with a model or without. `done` is called with numbers of frames that are
    /// finished.
    fn take(
        &self,
        bound: Option<&BoundModel<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames;
}

/// A model bound to the points of a table.
pub struct BoundModel<'a> {
    /// The model.
    pub model: &'a LoadedModel,
    /// The table's column of each point of the model.
    index: Vec<Option<usize>>,
    /// Whether the points are those of another skeleton: the model knows roughly what their poses
    /// look like, and nothing of how they are placed on the body.
    pub is_mapped: bool,
}

impl<'a> BoundModel<'a> {
    /// Binds a model with points `known`, named `source`, to a table of `points`.
    ///
    /// # Errors
    /// [`Error::Data`] if the table has none of the model's points.
    pub fn new(
        model: &'a LoadedModel,
        known: &[String],
        source: &str,
        points: &[String],
    ) -> Result<BoundModel<'a>> {
        let column = |name: &String| points.iter().position(|p| p == name);
        let index: Vec<_> = known.iter().map(column).collect();
        if index.iter().all(Option::is_none) {
            let listed =
                |list: &[String]| list.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
            let what = format!(
                "the table has none of the model's points ({}, …); it has {}; {}; or train a \
                 model with prior-train, or use the option `self`: the take's own frames alone",
                listed(known),
                listed(points),
                NameMap::advice(points)
            );
            return Err(Error::data(Place::file(source), what));
        }
        Ok(BoundModel {
            model,
            index,
            is_mapped: false,
        })
    }

    /// Says that the points are those of another skeleton.
    pub fn mapped(mut self, is_mapped: bool) -> BoundModel<'a> {
        self.is_mapped = is_mapped;
        self
    }

    /// The table's point that is `point` of the model.
    pub fn in_table(&self, point: usize) -> Option<usize> {
        self.index[point]
    }

    /// The model's point that is `point` of the table.
    pub fn in_model(&self, point: usize) -> Option<usize> {
        self.index.iter().position(|i| *i == Some(point))
    }

    /// Points of the model, frame by frame, as points of the table.
    pub fn to_table(&self, points: &[Vec<usize>]) -> Vec<Vec<usize>> {
        let of_frame = |points: &Vec<usize>| points.iter().filter_map(|p| self.index[*p]).collect();
        points.iter().map(of_frame).collect()
    }

    /// Whether a frame (3 J, in the model's order) lacks nothing that the table could hold.
    pub fn is_complete(&self, y: &[f64]) -> bool {
        let is_seen = |p: usize| y[3 * p..3 * p + 3].iter().all(|v| v.is_finite());
        (0..self.index.len()).all(|p| self.index[p].is_none() || is_seen(p))
    }

    /// Frames in the model's order of points, restored, as frames of the table; `xyz` is what the
    /// table holds.
    pub fn scatter(&self, xyz: ArrayView2<'_, f64>, restored: &RestoredFrames) -> RestoredFrames {
        let mut out = RestoredFrames::captured(xyz);
        out.too_little = restored.too_little;
        out.noise = restored.noise;
        out.novelty.clone_from(&restored.novelty);
        for (p, column) in self.index.iter().enumerate() {
            let Some(column) = *column else { continue };
            for t in 0..xyz.nrows() {
                let (status, sd) = restored.of_point(t, p);
                out.set(t, column, status, sd);
                for axis in 0..3 {
                    let value = restored.xyz[[t, 3 * p + axis]];
                    if value.is_finite() {
                        out.xyz[[t, 3 * column + axis]] = value;
                    }
                }
            }
        }
        out
    }

    /// Rows in the model's order of points (n, 3 J) as rows of a table of `points` points; those
    /// that the model does not know are NaN.
    pub fn scatter_rows(&self, rows: ArrayView2<'_, f64>, points: usize) -> Array2<f64> {
        let mut out = Array2::from_elem((rows.nrows(), 3 * points), f64::NAN);
        for (p, column) in self.index.iter().enumerate() {
            let Some(column) = *column else { continue };
            for axis in 0..3 {
                (out.column_mut(3 * column + axis)).assign(&rows.column(3 * p + axis));
            }
        }
        out
    }

    /// Rows of the table in the model's order of points; points that the table lacks are missing.
    pub fn gather(&self, rows: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = Array2::from_elem((rows.nrows(), 3 * self.index.len()), f64::NAN);
        for (p, column) in self.index.iter().enumerate() {
            let Some(column) = column else { continue };
            for axis in 0..3 {
                out.column_mut(3 * p + axis)
                    .assign(&rows.column(3 * column + axis));
            }
        }
        out
    }
}

/// Restored frames.
#[derive(Debug, Clone, Default)]
pub struct RestoredFrames {
    /// (frames, 3 J), cm.
    pub xyz: Array2<f64>,
    /// (frames x J).
    status: Vec<Status>,
    /// Standard deviation of a coordinate, cm (frames x J); NaN where unknown.
    sd: Vec<f64>,
    /// How each missing point was filled (frames x J).
    method: Vec<Option<FillMethod>>,
    /// Whether the model knows so little of the take that it was restored without.
    pub take_alone: bool,
    /// Frames with too little seen to restore them.
    pub too_little: usize,
    /// Standard deviation of the noise that was assumed, cm; the mean over the frames.
    pub noise: f64,
    /// Novelty of each frame's pose, nats (frames); see [`crate::prior::Prior::novelty`]. NaN
    /// where the model has no threshold or the frame is not restored.
    pub novelty: Vec<f64>,
}

impl RestoredFrames {
    /// Frames as they were captured.
    pub fn of(xyz: Array2<f64>) -> RestoredFrames {
        let count = xyz.nrows() * xyz.ncols() / 3;
        RestoredFrames {
            novelty: vec![f64::NAN; xyz.nrows()],
            xyz,
            status: vec![Status::Observed; count],
            sd: vec![EXACT_VARIANCE.sqrt(); count],
            method: vec![None; count],
            take_alone: false,
            too_little: 0,
            noise: 0.0,
        }
    }

    /// Frames as they were captured, their missing points unknown.
    pub fn captured(xyz: ArrayView2<'_, f64>) -> RestoredFrames {
        let mut out = RestoredFrames::of(xyz.to_owned());
        for t in 0..xyz.nrows() {
            for p in 0..out.points() {
                if (3 * p..3 * p + 3).any(|i| xyz[[t, i]].is_nan()) {
                    out.set(t, p, Status::Unknown, f64::NAN);
                }
            }
        }
        out
    }

    /// Sets how a point was filled.
    pub fn set_method(&mut self, frame: usize, point: usize, method: Option<FillMethod>) {
        let at = frame * self.points() + point;
        self.method[at] = method;
    }

    /// How a point was filled; `None` where it was not, or the frame was restored by itself.
    pub fn method(&self, frame: usize, point: usize) -> Option<FillMethod> {
        self.method[frame * self.points() + point]
    }

    /// The number of points of a frame.
    pub fn points(&self) -> usize {
        self.xyz.ncols() / 3
    }

    /// Sets the status of a point and the standard deviation of its coordinates, cm.
    pub fn set(&mut self, frame: usize, point: usize, status: Status, sd: f64) {
        let at = frame * self.points() + point;
        (self.status[at], self.sd[at]) = (status, sd);
    }

    /// The status of a point, and the standard deviation of its coordinates, cm.
    pub fn of_point(&self, frame: usize, point: usize) -> (Status, f64) {
        let at = frame * self.points() + point;
        (self.status[at], self.sd[at])
    }
}

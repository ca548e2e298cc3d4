//! Frames restored in the model's order of points, before they go back into a table.

use super::loaded_model::LoadedModel;
use crate::pose::Status;
use crate::prior::EXACT_VARIANCE;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// A method that restores the frames of a table: [`super::Complete`] or [`super::Denoise`].
pub trait Method {
    /// Restores each frame of `xyz` (frames, 3 J; cm, NaN missing) by itself.
    fn frames(&self, bound: &BoundModel<'_>, xyz: ArrayView2<'_, f64>) -> RestoredFrames;

    /// Restores one take: `runs` are its ranges of consecutive frames, `rate` is in frames a second. `done` is called with
    /// numbers of frames that are finished.
    fn take(
        &self,
        bound: &BoundModel<'_>,
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        rate: f64,
        done: &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames;
}

/// A model bound to the points of a table.
pub struct BoundModel<'a> {
    /// The model.
    pub model: &'a LoadedModel,
    /// The table's column of each point of the model.
    index: Vec<Option<usize>>,
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
                "the table has none of the model's points ({}, …); it has {}; convert the names, or train a model with prior-train",
                listed(known),
                listed(points)
            );
            return Err(Error::data(Place::file(source), what));
        }
        Ok(BoundModel { model, index })
    }

    /// The table's point that is `point` of the model.
    pub fn in_table(&self, point: usize) -> Option<usize> {
        self.index[point]
    }

    /// Whether a frame (3 J, in the model's order) lacks nothing that the table could hold.
    pub fn is_complete(&self, y: &[f64]) -> bool {
        let is_seen = |p: usize| y[3 * p..3 * p + 3].iter().all(|v| v.is_finite());
        (0..self.index.len()).all(|p| self.index[p].is_none() || is_seen(p))
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

/// Restored frames, in the model's order of points.
#[derive(Debug, Clone, Default)]
pub struct RestoredFrames {
    /// (frames, 3 J), cm.
    pub xyz: Array2<f64>,
    /// (frames x J).
    status: Vec<Status>,
    /// Standard deviation of a coordinate, cm (frames x J); NaN where unknown.
    sd: Vec<f64>,
    /// Frames with too little seen to restore them.
    pub too_little: usize,
    /// Standard deviation of the noise that was assumed, cm; the mean over the frames.
    pub noise: f64,
    /// Novelty of each frame's pose, nats (frames); see [`crate::prior::Prior::unlike`]. NaN where the model has no threshold
    /// or the frame is not restored.
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
            too_little: 0,
            noise: 0.0,
        }
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

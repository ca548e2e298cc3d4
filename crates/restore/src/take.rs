//! A take of a table, the points of it that a model knows, and what becomes of its frames.

use super::known_motion::{BodyGap, KnownMotion};
use super::pose_model::PoseModel;
use crate::numeric::parallel;
use crate::numeric::statistics::median;
use crate::pose::repeated_frames::RepeatedFrames;
use crate::pose::{FillMethod, NameMap, Status, point_at};
use crate::prior::EXACT_VARIANCE;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, Axis, s};
use std::ops::Range;

/// Frames of one parallel task.
pub(crate) const FRAMES_PER_TASK: usize = 8;

/// What was told of a point's deviation may be noise if that much of it was found.
const TAKEN_OUT: f64 = 0.5;

/// A point of a frame that repeats another is that frame's to so many cm.
const REPEATED: f64 = 1e-6;

/// One take of a table.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Take<'a> {
    /// The names of the points (J).
    pub names: &'a [String],
    /// (frames, 3 J), cm; NaN missing.
    pub xyz: ArrayView2<'a, f64>,
    /// Its ranges of consecutive frames.
    pub runs: &'a [Range<usize>],
    /// Frames a second.
    pub rate: f64,
    /// Standard deviation of a coordinate of each point (frames, J), cm; NaN where unknown. `None`:
    /// what is seen is exact.
    pub sd: Option<ArrayView2<'a, f64>>,
    /// What may fill gaps of a whole body.
    pub motion: KnownMotion<'a>,
}

impl<'a> Take<'a> {
    /// The take with other coordinates, some of which may be missing. `names` and `sd` stay: they
    /// fit only where `xyz` has the same points in the same order.
    pub(crate) fn with_xyz<'b>(&self, xyz: ArrayView2<'b, f64>) -> Take<'b>
    where
        'a: 'b,
    {
        Take { xyz, ..*self }
    }

    /// The median standard deviation of a coordinate of the points that are seen, cm; `None` where
    /// they are exact.
    pub(crate) fn typical_sd(&self) -> Option<f64> {
        let sd = self.sd?;
        let is_seen = |((t, p), _): &((usize, usize), &f64)| point_at(self.xyz, *t, *p).is_finite();
        let known = sd.indexed_iter().filter(is_seen).map(|(_, sd)| *sd);
        let typical = median(known.filter(|sd| sd.is_finite()).collect())?;
        (typical * typical > EXACT_VARIANCE).then_some(typical)
    }
}

/// Frames (3 J) with the given points of each missing.
pub(crate) fn without(xyz: ArrayView2<'_, f64>, points: &[Vec<usize>]) -> Array2<f64> {
    let mut out = xyz.to_owned();
    for (t, points) in points.iter().enumerate() {
        for &p in points {
            out.slice_mut(s![t, 3 * p..3 * p + 3]).fill(f64::NAN);
        }
    }
    out
}

/// A method that restores the frames of a table, in the table's order of points:
/// [`super::Complete`], [`super::Denoise`] or [`super::Clean`].
pub trait Method {
    /// Restores each frame of `xyz` (frames, 3 J; cm, NaN missing) by itself.
    fn restore_frames(&self, mapping: &PointMapping<'_>, xyz: ArrayView2<'_, f64>) -> TakeResult;

    /// Restores one take, with a model or without. `done` is called with numbers of frames that are
    /// finished.
    fn restore_take(
        &self,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult;
}

/// Restores each frame of a table (frames, 3 J; cm, NaN missing) by itself, in the model's order of
/// points: `restore` is given a frame (1, 3 J), and `put` writes what it found.
pub(crate) fn restore_each_frame<F: Send>(
    mapping: &PointMapping<'_>,
    table: ArrayView2<'_, f64>,
    restore: impl Fn(ArrayView2<'_, f64>) -> F + Sync,
    put: impl Fn(&mut TakeResult, usize, F),
) -> TakeResult {
    let xyz = mapping.gather(table);
    let found = parallel::map_chunks(xyz.nrows(), FRAMES_PER_TASK, |range| {
        let frame = |t: usize| restore(xyz.slice(s![t..t + 1, ..]));
        range.map(frame).collect::<Vec<F>>()
    });
    let mut out = TakeResult::of(xyz);
    for (t, found) in found.into_iter().flatten().enumerate() {
        put(&mut out, t, found);
    }
    mapping.scatter(table, &out)
}

/// The points of a table that are those of a model.
pub(crate) struct PointMapping<'a> {
    /// The model.
    pub model: &'a PoseModel,
    /// The table's point that is each of the model's.
    points: Vec<Option<usize>>,
    /// The number of points of the table.
    table_points: usize,
    /// Whether a map names the points: they may stand elsewhere on the body than the model's.
    pub is_mapped: bool,
}

impl<'a> PointMapping<'a> {
    /// Finds the points of a model named `source` among those of a table, which the model knows as
    /// `names`.
    ///
    /// # Errors
    /// [`Error::Data`] if the table has none of the model's points.
    pub(crate) fn new(
        model: &'a PoseModel,
        source: &str,
        names: &[String],
        is_mapped: bool,
    ) -> Result<PointMapping<'a>> {
        let in_table = |name: &String| names.iter().position(|p| p == name);
        let points: Vec<_> = model.points.iter().map(in_table).collect();
        if points.iter().all(Option::is_none) {
            let listed =
                |list: &[String]| list.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
            let what = format!(
                "the table has none of the model's points ({}, …); it has {}; {}; or train a \
                 model with prior-train, or use the option `self`: the take's own frames alone",
                listed(&model.points),
                listed(names),
                NameMap::advice(names)
            );
            return Err(Error::data(Place::file(source), what));
        }
        Ok(PointMapping {
            model,
            points,
            table_points: names.len(),
            is_mapped,
        })
    }

    /// The model's points that the table has: of the model, of the table.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let pairs = self.points.iter().enumerate();
        pairs.filter_map(|(p, in_table)| Some((p, (*in_table)?)))
    }

    /// Whether the table has points that the model does not know: then it is of another skeleton,
    /// and even those that the model knows may stand elsewhere on the body.
    pub(crate) fn has_others(&self) -> bool {
        self.pairs().count() < self.table_points
    }

    /// The table's points that are the ends of a bone of the model.
    pub(crate) fn bones(&self) -> Vec<[usize; 2]> {
        let ends = self
            .model
            .bones()
            .filter_map(|[a, b]| Some([self.points[a]?, self.points[b]?]));
        ends.collect()
    }

    /// [`PointMapping::bones`] of which both ends have a counterpart on the other side.
    pub(crate) fn limb_bones(&self) -> Vec<[usize; 2]> {
        let is_paired = |p: &usize| self.model.mirror[*p].is_some();
        let ends = self.model.bones().filter(|ends| ends.iter().all(is_paired));
        ends.filter_map(|[a, b]| Some([self.points[a]?, self.points[b]?]))
            .collect()
    }

    /// The model's point that is `point` of the table.
    pub(crate) fn in_model(&self, point: usize) -> Option<usize> {
        self.points.iter().position(|i| *i == Some(point))
    }

    /// Points of the model, frame by frame, as points of the table.
    pub(crate) fn points_of_table(&self, points: &[Vec<usize>]) -> Vec<Vec<usize>> {
        let of_frame =
            |points: &Vec<usize>| points.iter().filter_map(|p| self.points[*p]).collect();
        points.iter().map(of_frame).collect()
    }

    /// Frames in the model's order of points, restored, as frames of the table; `xyz` is what the
    /// table holds.
    pub(crate) fn scatter(&self, xyz: ArrayView2<'_, f64>, restored: &TakeResult) -> TakeResult {
        let mut out = TakeResult::captured(xyz);
        out.too_little = restored.too_little;
        out.noise = restored.noise;
        out.novelty.clone_from(&restored.novelty);
        for (p, in_table) in self.pairs() {
            for t in 0..xyz.nrows() {
                let state = restored.state(t, p);
                out.set(t, in_table, state.status, state.sd);
                for axis in 0..3 {
                    let value = restored.xyz[[t, 3 * p + axis]];
                    if value.is_finite() {
                        out.xyz[[t, 3 * in_table + axis]] = value;
                    }
                }
            }
        }
        out
    }

    /// Rows in the model's order of points (n, 3 J) as rows of the table; points that the model
    /// does not know are NaN.
    pub(crate) fn rows_of_table(&self, rows: ArrayView2<'_, f64>) -> Array2<f64> {
        moved(rows, self.table_points, self.pairs())
    }

    /// Rows of the table in the model's order of points; points that the table lacks are missing.
    pub(crate) fn gather(&self, rows: ArrayView2<'_, f64>) -> Array2<f64> {
        let moves = self.pairs().map(|(p, in_table)| (in_table, p));
        moved(rows, self.points.len(), moves)
    }
}

/// Rows (n, 3 J) with other `points`, each from where to where it goes; the others are NaN.
fn moved(
    rows: ArrayView2<'_, f64>,
    points: usize,
    moves: impl Iterator<Item = (usize, usize)>,
) -> Array2<f64> {
    let mut out = Array2::from_elem((rows.nrows(), 3 * points), f64::NAN);
    for (from, to) in moves {
        let from = rows.slice(s![.., 3 * from..3 * from + 3]);
        out.slice_mut(s![.., 3 * to..3 * to + 3]).assign(&from);
    }
    out
}

/// What became of a point in a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointState {
    /// Its status.
    pub status: Status,
    /// Standard deviation of a coordinate, cm; NaN where unknown.
    pub sd: f64,
    /// How it was filled; `None` where it was not, or the frame was restored by itself.
    pub method: Option<FillMethod>,
}

impl PointState {
    /// This state, of a point of which another was known before. What is left as it was, and an
    /// estimate that moves, stay what they were; and a point is no surer than it was, unless so
    /// much `noise` was taken out of it: standard deviation of a coordinate, cm.
    pub(crate) fn after(&self, before: &PointState, noise: f64) -> PointState {
        let was_estimated = matches!(before.status, Status::Inferred | Status::Rejected);
        let is_kept = match self.status {
            Status::Observed => true,
            Status::Changed => was_estimated,
            _ => return *self,
        };
        let is_surer = noise >= before.sd * TAKEN_OUT && !was_estimated;
        let sd = if is_surer {
            self.sd
        } else {
            self.sd.max(before.sd)
        };
        if is_kept {
            PointState { sd, ..*before }
        } else {
            PointState { sd, ..*self }
        }
    }
}

/// The frames of a take, or of a table, restored.
#[derive(Debug, Clone, Default)]
pub(crate) struct TakeResult {
    /// (frames, 3 J), cm.
    pub xyz: Array2<f64>,
    /// (frames x J).
    pub states: Vec<PointState>,
    /// Whether the model knows no poses like most of the take's.
    pub is_unknown: bool,
    /// Frames with too little seen to restore them.
    pub too_little: usize,
    /// The gaps of a whole body.
    pub bodies: Vec<BodyGap>,
    /// How often two points bore each other's names, and were put back.
    pub exchanged: usize,
    /// Frames and points whose value was another's, which has it now, and that stay missing.
    pub vacated: Vec<(usize, usize)>,
    /// Standard deviation of the noise that was assumed, cm; the mean over the frames.
    pub noise: f64,
    /// Standard deviation of the noise that stays in a coordinate of keypoints, cm; 0 for others.
    pub noise_left: f64,
    /// What the noise is at most, where it cannot be told from motion: standard deviation of a
    /// coordinate, cm.
    pub doubtful_noise: Option<f64>,
    /// Novelty of each frame's pose, nats (frames); see [`crate::prior::Prior::novelty`]. NaN
    /// where the model has no threshold or the frame is not restored.
    pub novelty: Vec<f64>,
}

impl TakeResult {
    /// Frames as they were captured.
    pub(crate) fn of(xyz: Array2<f64>) -> TakeResult {
        let captured = PointState {
            status: Status::Observed,
            sd: EXACT_VARIANCE.sqrt(),
            method: None,
        };
        TakeResult {
            novelty: vec![f64::NAN; xyz.nrows()],
            states: vec![captured; xyz.nrows() * xyz.ncols() / 3],
            xyz,
            ..TakeResult::default()
        }
    }

    /// Frames as they were captured, their missing points unknown.
    pub(crate) fn captured(xyz: ArrayView2<'_, f64>) -> TakeResult {
        let mut out = TakeResult::of(xyz.to_owned());
        for t in 0..xyz.nrows() {
            for p in 0..out.points() {
                if (3 * p..3 * p + 3).any(|i| xyz[[t, i]].is_nan()) {
                    out.set(t, p, Status::Unknown, f64::NAN);
                }
            }
        }
        out
    }

    /// The number of points of a frame.
    pub(crate) fn points(&self) -> usize {
        self.xyz.ncols() / 3
    }

    /// Standard deviation of a coordinate of each point (frames, J), cm; NaN where unknown.
    pub(crate) fn sd(&self) -> Array2<f64> {
        let shape = (self.xyz.nrows(), self.points());
        Array2::from_shape_fn(shape, |(t, p)| self.state(t, p).sd)
    }

    /// What became of a point.
    pub(crate) fn state(&self, frame: usize, point: usize) -> &PointState {
        &self.states[frame * self.points() + point]
    }

    /// Sets the status of a point that is not filled in time, and the standard deviation of its
    /// coordinates, cm.
    pub(crate) fn set(&mut self, frame: usize, point: usize, status: Status, sd: f64) {
        let at = frame * self.points() + point;
        self.states[at] = PointState {
            status,
            sd,
            method: None,
        };
    }

    /// Notes which of the points of each frame that were emptied were not filled.
    pub(crate) fn vacate(&mut self, emptied: &[Vec<usize>]) {
        for (t, points) in emptied.iter().enumerate() {
            for &p in points {
                if !point_at(self.xyz.view(), t, p).is_finite() {
                    self.set(t, p, Status::Unknown, f64::NAN);
                    self.vacated.push((t, p));
                }
            }
        }
    }

    /// The result for a take of which these are the rows without repeats; where a repeat has no
    /// value it gets that of the frame that it repeats. `captured` (frames, 3 J).
    pub(crate) fn repeated(
        self,
        repeated: &RepeatedFrames,
        captured: ArrayView2<'_, f64>,
    ) -> TakeResult {
        let (points, rows) = (self.points(), repeated.shown_rows());
        let mut out = TakeResult {
            xyz: self.xyz.select(Axis(0), &rows),
            states: (rows.iter())
                .flat_map(|k| &self.states[k * points..(k + 1) * points])
                .copied()
                .collect(),
            novelty: rows.iter().map(|k| self.novelty[*k]).collect(),
            vacated: Vec::new(),
            ..self
        };
        for (k, p) in &self.vacated {
            let frames = repeated.frames(&(*k..k + 1));
            out.vacated.extend(frames.map(|t| (t, *p)));
        }
        for (t, k) in repeated.shown.iter().enumerate() {
            for p in 0..points {
                let own = point_at(captured, t, p);
                let first = point_at(captured, repeated.kept[*k], p);
                let state = *out.state(t, p);
                if own.is_finite() && !(own.distance(first) <= REPEATED) {
                    // A value of its own.
                    (0..3).for_each(|axis| out.xyz[[t, 3 * p + axis]] = own[axis]);
                    out.set(t, p, Status::Observed, EXACT_VARIANCE.sqrt());
                } else if !own.is_finite() && first.is_finite() && state.status != Status::Unknown {
                    out.states[t * points + p] = PointState {
                        status: Status::Inferred,
                        method: Some(FillMethod::Interpolation),
                        ..state
                    };
                }
            }
        }
        out
    }

    /// Whether any point of a frame was filled or replaced.
    pub(crate) fn is_any_filled(&self, frame: usize) -> bool {
        let is_filled = |p: usize| {
            let status = self.state(frame, p).status;
            matches!(status, Status::Inferred | Status::Rejected)
        };
        (0..self.points()).any(is_filled)
    }
}

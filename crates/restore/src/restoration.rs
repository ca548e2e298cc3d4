//! The result of restoring a table: its values in the table's order of points, and what became of
//! each point.

use super::gap::{Gap, find_gaps};
use super::known_motion::BodyGap;
use super::take::{PointState, TakeResult};
use crate::Result;
use crate::io::Table;
use crate::label::unlabeled::labeled;
use crate::pose::zeros::Zeros;
use crate::pose::{FillMethod, Poses, Status, point_at};
use glam::DVec3;
use ndarray::{Array2, ArrayView2, s};
use serde::Serialize;
use std::ops::Range;

/// Numbers of frames and points by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct RestorationCounts {
    /// Frames.
    pub frames: usize,
    /// Frames with too little seen to restore them.
    pub too_little: usize,
    /// Frames whose restored pose has a novelty above 0.
    pub novel: usize,
    /// Takes of which the model knows no poses like most: smoothed without it, and filled with it
    /// as far as it fills simulated gaps.
    pub takes_unknown: usize,
    /// Jumps of a whole body, across which nothing was restored.
    pub cuts: usize,
    /// Missing points that were filled.
    pub filled: usize,
    /// Pairs of points, frame by frame, that were exchanged left and right, and put back.
    pub exchanged: usize,
    /// Outliers.
    pub rejected: usize,
    /// Outliers that were replaced by an estimate.
    pub replaced: usize,
    /// Points that stay missing.
    pub unfilled: usize,
    /// Sum over the frames of the standard deviation of the noise that was assumed, cm.
    #[serde(skip)]
    noise: f64,
    /// What the noise of a coordinate is at most in a take in which it cannot be told from motion,
    /// cm; 0 for none.
    #[serde(skip)]
    doubtful_noise: f64,
}

impl RestorationCounts {
    /// Adds other counts.
    #[doc(hidden)]
    pub fn add(&mut self, other: &RestorationCounts) {
        self.frames += other.frames;
        self.too_little += other.too_little;
        self.novel += other.novel;
        self.takes_unknown += other.takes_unknown;
        self.cuts += other.cuts;
        self.filled += other.filled;
        self.exchanged += other.exchanged;
        self.rejected += other.rejected;
        self.replaced += other.replaced;
        self.unfilled += other.unfilled;
        self.noise += other.noise;
        self.doubtful_noise = self.doubtful_noise.max(other.doubtful_noise);
    }

    /// What the noise of a coordinate is at most, cm, in a take in which it cannot be told from
    /// motion: cleaning leaves it, denoising may remove some motion too. `None` where there is no
    /// such take.
    pub fn doubtful_noise(&self) -> Option<f64> {
        (self.doubtful_noise > 0.0).then_some(self.doubtful_noise)
    }

    /// Standard deviation of the noise that was assumed, cm: the mean over the frames; 0 if none
    /// was.
    #[doc(hidden)]
    pub fn mean_noise(&self) -> f64 {
        self.noise / self.frames.max(1) as f64
    }
}

/// A gap of a restored table: a point that was missing for some frames on end.
///
/// ```
/// use posing_core::pose::{FillMethod, Poses};
/// use posing_io::Table;
/// use posing_restore::{Complete, Restorer};
///
/// let mut xyz = ndarray::Array2::from_shape_fn((60, 3), |(t, c)| (t + c) as f64);
/// xyz.slice_mut(ndarray::s![10..12, ..]).fill(f64::NAN);
/// let table = Table::from_poses(Poses { points: vec!["knee".into()], xyz, ..Poses::default() });
/// let options = Complete { fps: Some(100.0), ..Complete::default() };
/// let gaps = Restorer::without_model().complete(&table, &options)?.gaps();
/// assert_eq!((gaps.len(), gaps[0].frames.clone()), (1, 10..12));
/// assert_eq!(gaps[0].method, Some(FillMethod::Interpolation));
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RestoredGap {
    /// The point.
    pub point: usize,
    /// The frames, counted over the table.
    pub frames: Range<usize>,
    /// How most of its frames were filled; `None` if they were not.
    pub method: Option<FillMethod>,
    /// Standard deviation of a coordinate, cm: the root mean square over the filled frames; NaN
    /// where none was.
    pub sd: f64,
    /// The longest way from one frame to the next, the frames at both ends included, cm; NaN where
    /// none was filled.
    pub longest_step: f64,
}

/// What the columns of a table say of its points; of a point without them, that it is as captured
/// and nothing is known of its deviation. What is missing is unknown.
fn told_states(table: &Table, captured: &TakeResult) -> Vec<PointState> {
    let [statuses, methods] = ["status", "method"].map(|ending| table.columns.of_points(ending));
    let cell = |columns: &[Option<usize>], t: usize, p: usize| {
        let column = columns.get(p).copied().flatten()?;
        std::str::from_utf8(table.cells.get(t)?.get(column)?).ok()
    };
    let points = captured.points();
    let told = |(n, own): (usize, &PointState)| {
        let (t, p) = (n / points, n % points);
        if own.status == Status::Unknown {
            return *own;
        }
        let status = cell(&statuses, t, p).and_then(|name| Status::of_name(name.trim()));
        PointState {
            status: status.filter(|s| *s != Status::Unknown).unwrap_or_default(),
            sd: table.sd.as_ref().map_or(f64::NAN, |sd| sd[[t, p]]),
            method: cell(&methods, t, p).and_then(|name| FillMethod::of_name(name.trim())),
        }
    };
    captured.states.iter().enumerate().map(told).collect()
}

/// A restored table.
#[derive(Debug, Clone)]
#[must_use = "it holds the restored values; the table passed in is unchanged"]
pub struct Restoration<'t> {
    source: &'t Table,
    /// All its frames.
    frames: TakeResult,
    /// The gaps of a whole body, frames counted over the table.
    bodies: Vec<BodyGap>,
    counts: RestorationCounts,
    /// Positions at 0 0 0: nothing is estimated from them, and they stay.
    zeros: Zeros,
}

impl<'t> Restoration<'t> {
    /// A table that is left as it is, or of which no frame is restored yet.
    pub fn unchanged(source: &'t Table) -> Restoration<'t> {
        let mut frames = TakeResult::captured(source.poses.xyz.view());
        frames.states = told_states(source, &frames);
        Restoration {
            source,
            frames,
            bodies: Vec::new(),
            counts: RestorationCounts::default(),
            zeros: Zeros::of(source.poses.xyz.view()),
        }
    }

    /// A table whose points follow from something else that was restored, such as rotations: they
    /// are at `xyz` now (frames, 3 points; cm; NaN where still missing).
    #[doc(hidden)]
    pub fn followed(source: &'t Table, xyz: Array2<f64>) -> Restoration<'t> {
        let mut out = Restoration::unchanged(source);
        out.counts.frames = xyz.nrows();
        for t in 0..xyz.nrows() {
            for p in 0..out.frames.points() {
                let [was, now] = [&source.poses.xyz, &xyz].map(|xyz| point_at(xyz.view(), t, p));
                let status = match (was.is_finite(), now.is_finite()) {
                    (_, false) => Status::Unknown,
                    (false, true) => Status::Inferred,
                    (true, true) if was == now => Status::Observed,
                    (true, true) => Status::Changed,
                };
                out.frames.set(t, p, status, f64::NAN);
                out.counts.filled += usize::from(status == Status::Inferred);
                out.counts.unfilled += usize::from(status == Status::Unknown);
            }
        }
        out.frames.xyz = xyz;
        out
    }

    /// This result, in which motion filled gaps of a whole body; `sd` is the standard deviation of
    /// a coordinate (frames, points), cm, NaN where nothing is said.
    #[doc(hidden)]
    pub fn with_motion(mut self, bodies: Vec<BodyGap>, sd: ArrayView2<'_, f64>) -> Restoration<'t> {
        let points = self.frames.points();
        for body in bodies.iter().filter(|body| body.source.is_some()) {
            for (t, p) in body
                .frames
                .clone()
                .flat_map(|t| (0..points).map(move |p| (t, p)))
            {
                let state = &mut self.frames.states[t * points + p];
                if state.status == Status::Inferred {
                    state.method = Some(FillMethod::Motion);
                    state.sd = sd[[t, p]];
                }
            }
        }
        self.bodies = bodies;
        self
    }

    /// Counts the frames once, also where each of some people was restored by itself.
    pub(super) fn count_people(&mut self, people: usize) {
        self.counts.frames = self.source.poses.frames();
        self.counts.noise /= people.max(1) as f64;
    }

    /// Adds restored frames of some of the table's `points`, from frame `first` on. Where
    /// no value was found the table's stays.
    pub(super) fn add(&mut self, first: usize, restored: &TakeResult, points: &[usize]) {
        let count = restored.xyz.nrows();
        self.counts.add(&RestorationCounts {
            too_little: restored.too_little,
            takes_unknown: usize::from(restored.is_unknown),
            exchanged: restored.exchanged,
            novel: restored.novelty.iter().filter(|n| **n > 0.0).count(),
            noise: restored.noise * count as f64,
            doubtful_noise: restored.doubtful_noise.unwrap_or(0.0),
            ..RestorationCounts::default()
        });
        for (t, p) in &restored.vacated {
            let columns = 3 * points[*p]..3 * points[*p] + 3;
            self.frames
                .xyz
                .slice_mut(s![first + t, columns])
                .fill(f64::NAN);
        }
        (self.bodies).extend(restored.bodies.iter().map(|body| BodyGap {
            frames: first + body.frames.start..first + body.frames.end,
            ..body.clone()
        }));
        let out = &mut self.frames;
        out.novelty[first..first + count].copy_from_slice(&restored.novelty);
        for t in 0..count {
            for (p, in_table) in points.iter().enumerate() {
                let is_estimated = matches!(
                    restored.state(t, p).status,
                    Status::Inferred | Status::Unknown
                );
                if is_estimated && self.zeros.contains(first + t, *in_table) {
                    continue;
                }
                let at = (first + t) * out.points() + in_table;
                out.states[at] = restored.state(t, p).after(&out.states[at], restored.noise);
                let is_filled = (3 * p..3 * p + 3).all(|i| restored.xyz[[t, i]].is_finite());
                let mut is_moved = false;
                for axis in (0..3).filter(|_| is_filled) {
                    let value = restored.xyz[[t, 3 * p + axis]];
                    is_moved |= out.xyz[[first + t, 3 * in_table + axis]] != value;
                    out.xyz[[first + t, 3 * in_table + axis]] = value;
                }
                let status = restored.state(t, p).status;
                self.counts.filled += usize::from(status == Status::Inferred);
                self.counts.rejected += usize::from(status == Status::Rejected);
                self.counts.replaced += usize::from(status == Status::Rejected && is_moved);
                self.counts.unfilled += usize::from(status == Status::Unknown);
            }
        }
    }

    /// Tells positions that were measured, and taken out before, from those that were missing: they
    /// are outliers, and replaced where they are filled. `positions` are frames and points.
    #[doc(hidden)]
    pub fn reject(&mut self, positions: impl Iterator<Item = (usize, usize)>) {
        let points = self.frames.points();
        for (t, p) in positions {
            let status = &mut self.frames.states[t * points + p].status;
            if *status == Status::Inferred {
                *status = Status::Rejected;
                self.counts.filled -= 1;
                self.counts.rejected += 1;
                self.counts.replaced += 1;
            }
        }
    }

    pub(super) fn count_cuts(&mut self, cuts: usize) {
        self.counts.cuts += cuts;
    }

    /// A copy with filtered values ([`Poses::low_pass`]), and the number of pieces that are too
    /// short for that.
    ///
    /// # Errors
    /// Fails as [`Poses::low_pass`] does.
    #[doc(hidden)]
    pub fn low_passed(mut self, cutoff: f64, fps: Option<f64>) -> Result<(Restoration<'t>, usize)> {
        let source = &self.source.poses;
        self.zeros.set(&mut self.frames.xyz, f64::NAN);
        let mut poses = Poses {
            points: source.points.clone(),
            time: source.time.clone(),
            take: source.take.clone(),
            xyz: std::mem::take(&mut self.frames.xyz),
        };
        let short = poses.low_pass(cutoff, fps)?;
        self.frames.xyz = poses.xyz;
        self.zeros.set(&mut self.frames.xyz, 0.0);
        Ok((self, short))
    }

    /// The restored values (frames, 3 points), cm; NaN where still missing.
    pub fn xyz(&self) -> ArrayView2<'_, f64> {
        self.frames.xyz.view()
    }

    /// The table with the restored values; take, time and all other columns are carried along.
    pub fn table(&self) -> Table {
        let mut table = self.source.clone();
        table.poses.xyz.assign(&self.frames.xyz);
        table
    }

    /// Status and standard deviation of a point of the table. A point that the model does not know
    /// is observed, or unknown where missing.
    pub fn status(&self, frame: usize, point: usize) -> Status {
        self.frames.state(frame, point).status
    }

    /// Standard deviation of a coordinate of a point, cm; NaN where unknown.
    pub fn sd(&self, frame: usize, point: usize) -> f64 {
        self.frames.state(frame, point).sd
    }

    /// How a missing point was filled; `None` where it was not, or the frame was restored by
    /// itself.
    pub fn method(&self, frame: usize, point: usize) -> Option<FillMethod> {
        self.frames.state(frame, point).method
    }

    /// The gaps of a whole body that motion may fill, frames counted over the table.
    pub fn body_gaps(&self) -> &[BodyGap] {
        &self.bodies
    }

    /// The gaps of the labeled points of the table that was restored, in the order of their first
    /// frames.
    pub fn gaps(&self) -> Vec<RestoredGap> {
        let poses = &self.source.poses;
        let mut gaps = find_gaps(poses.xyz.view(), &poses.runs());
        let points = labeled(&poses.points);
        gaps.retain(|gap| points.binary_search(&gap.point).is_ok());
        gaps.sort_by_key(|g| (g.frames.start, g.point));
        gaps.iter().map(|gap| self.restored_gap(gap)).collect()
    }

    fn restored_gap(&self, gap: &Gap) -> RestoredGap {
        let point = gap.point;
        let at = |t: usize| {
            DVec3::from_array([0, 1, 2].map(|axis| self.frames.xyz[[t, 3 * point + axis]]))
        };
        let steps = (gap.before.unwrap_or(gap.frames.start)
            ..gap.after.map_or(gap.frames.end, |a| a + 1))
            .collect::<Vec<_>>();
        let longest = steps
            .windows(2)
            .map(|w| (at(w[1]) - at(w[0])).length())
            .fold(f64::NAN, f64::max);
        let variances = gap.frames.clone().map(|t| self.sd(t, point).powi(2));
        let known: Vec<f64> = variances.filter(|v| v.is_finite()).collect();
        let methods: Vec<FillMethod> = gap
            .frames
            .clone()
            .filter_map(|t| self.method(t, point))
            .collect();
        let count = |m: FillMethod| methods.iter().filter(|x| **x == m).count();
        RestoredGap {
            point,
            frames: gap.frames.clone(),
            method: methods.iter().copied().max_by_key(|m| count(*m)),
            sd: (known.iter().sum::<f64>() / known.len() as f64).sqrt(),
            longest_step: longest,
        }
    }

    /// The table that was restored.
    #[doc(hidden)]
    pub fn source(&self) -> &'t Table {
        self.source
    }

    /// Novelty of a frame's pose, nats: 0 for a pose like those of the training set; NaN where the
    /// model has no threshold or the frame is not restored.
    pub fn novelty(&self, frame: usize) -> f64 {
        self.frames.novelty[frame]
    }

    /// The number of missing points that were filled, over all frames; each has three coordinates.
    pub fn filled(&self) -> usize {
        self.counts.filled
    }

    /// The number of outliers.
    pub fn rejected(&self) -> usize {
        self.counts.rejected
    }

    /// Counts of a restoration.
    pub fn counts(&self) -> &RestorationCounts {
        &self.counts
    }
}

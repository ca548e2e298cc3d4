//! Gaps of a take filled: from the frames around them, else by the model.
//!
//! A gap is a point that is missing for some frames on end. Short gaps are filled before long ones,
//! whose neighbors they then are:
//!
//! 0. A point that rests on either side of a short gap, as a planted foot does, rests in it
//!    (`path`).
//!    Gaps of a whole body are filled from motion that is known (`body_motion`), else bridged
//!    point by point (`whole_body`).
//! 1. Gaps of about the same frames are one group (`filler`). The points that are seen all through
//!    it are its `predictors`; they also give the frame of reference (`local_poses`).
//! 2. `regression` learns the missing points from the predictors: from the take's own frames, from
//!    a model's training poses, and over time. `estimates` adds what is known at the ends, and
//!    interpolation.
//! 3. `weights` simulates gaps of the same length where the take is known, and mixes the estimates
//!    by their errors.
//! 4. Where nothing can be learned, `path` interpolates each point over time, if its path is smooth
//!    enough.
//! 5. What is left the model fills frame by frame (`model_fill`).
//! 6. `rigid_distances` holds what was filled to the distances that are rigid in this take, and
//!    `contacts` a foot where it stands.
//!
//! Any points will do; a body is known only by its pelvis, whose frame of reference a model's
//! training poses share, and by its feet. The constants of all steps stand in `tuning`.

mod body_motion;
mod conditional;
mod contacts;
mod ends;
mod estimates;
mod filler;
mod known_frames;
mod local_poses;
mod model_fill;
mod motion_limits;
mod path;
mod predictors;
mod regression;
mod rigid_distances;
mod tuning;
mod weights;
mod whole_body;

use super::adapted_prior::AdaptedPrior;
use super::known_motion::BodyGap;
use super::take::{PointState, Take, TakeResult};
use crate::numeric::statistics::mean_of_finite;
use crate::pose::{FillMethod, Status, ranges};
pub(crate) use contacts::hold as hold_feet;
use filler::GapFiller;
pub use local_poses::{LocalPoses, anchor as local_anchor};
use ndarray::{Array2, ArrayView2, Axis, s};
use std::ops::Range;
use tuning::noise::NOISE_SHARE;
pub(crate) use whole_body::bare_frames;

/// A point that is missing for some frames on end.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Gap {
    /// The point.
    pub point: usize,
    /// The frames in which it is missing.
    pub frames: Range<usize>,
    /// The frame before, where the point is seen.
    pub before: Option<usize>,
    /// The frame after, where the point is seen.
    pub after: Option<usize>,
}

impl Gap {
    /// Whether it lasts for more than so many seconds at `rate` frames a second; with no limit, no
    /// gap does.
    pub(crate) fn is_longer(&self, seconds: Option<f64>, rate: f64) -> bool {
        seconds.is_some_and(|most| self.frames.len() as f64 / rate > most * (1.0 + 1e-9))
    }

    /// Whether its point is among those of some frame in it; in others it may be missing.
    pub(crate) fn is_any_of(&self, points: &[Vec<usize>]) -> bool {
        (self.frames.clone()).any(|t| points[t].contains(&self.point))
    }
}

/// A filled gap.
#[derive(Debug, Clone)]
pub(crate) struct FilledGap {
    /// (frames, 3), cm.
    pub xyz: Array2<f64>,
    /// Variance of a coordinate in each frame, cm².
    pub variance: Vec<f64>,
    /// How it was filled.
    pub method: FillMethod,
    /// Frames, counted from its first, in which a foot is held where it stands.
    pub contacts: Vec<Range<usize>>,
}

impl FilledGap {
    /// How one of its frames was filled, counted from its first.
    fn method_in(&self, frame: usize) -> FillMethod {
        if self.contacts.iter().any(|c| c.contains(&frame)) {
            FillMethod::Contact
        } else {
            self.method
        }
    }

    /// This estimate of a gap with the weight `share`, and another one.
    fn mixed_with(mut self, other: &FilledGap, share: f64) -> FilledGap {
        let apart = (&self.xyz - &other.xyz).mapv(|v| v * v).sum_axis(Axis(1)) / 3.0;
        self.xyz *= share;
        self.xyz.scaled_add(1.0 - share, &other.xyz);
        for ((v, w), apart) in self.variance.iter_mut().zip(&other.variance).zip(apart) {
            *v = share * *v + (1.0 - share) * w + share * (1.0 - share) * apart;
        }
        FilledGap {
            method: if share >= 0.5 {
                self.method
            } else {
                other.method
            },
            ..self
        }
    }
}

/// The gaps of `seen` (frames, 3 J; NaN missing) within its `runs` of consecutive frames.
pub(crate) fn find_gaps(seen: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> Vec<Gap> {
    runs.iter().flat_map(|run| gaps_of(seen, run)).collect()
}

fn gaps_of(seen: ArrayView2<'_, f64>, run: &Range<usize>) -> Vec<Gap> {
    let mut gaps = Vec::new();
    for point in 0..seen.ncols() / 3 {
        let is_missing = |t: &usize| (3 * point..3 * point + 3).any(|i| seen[[*t, i]].is_nan());
        gaps.extend(
            ranges(run.clone().filter(is_missing))
                .into_iter()
                .map(|frames| Gap {
                    point,
                    before: (frames.start > run.start).then(|| frames.start - 1),
                    after: (frames.end < run.end).then_some(frames.end),
                    frames,
                }),
        );
    }
    gaps
}

/// Fills the gaps of a take: by the frames around them, else by the model. Where the take is unlike
/// what the model knows (not `is_known`) its poses have the weight that they earn in simulated
/// gaps, and no frame is filled by it alone. Gaps in which no body can be placed are filled up to
/// `longest` seconds; `None`: one. Those of a whole body are listed.
pub(crate) fn fill_gaps(
    adapted: Option<&AdaptedPrior<'_>>,
    is_known: bool,
    take: &Take<'_>,
    gaps: &[Gap],
    longest: Option<f64>,
    done: &(dyn Fn(usize) + Sync),
) -> (Vec<Option<FilledGap>>, Vec<BodyGap>) {
    let poses = adapted.and_then(AdaptedPrior::training_poses);
    let others = poses.as_ref().map(|p| p.view());
    let (moved, bodies) = body_motion::fill(take, gaps, longest);
    let bridged = whole_body::bridge(take, gaps, longest);
    let bridged: Vec<_> = (moved.into_iter().zip(bridged))
        .map(|(moved, bridged)| moved.or(bridged))
        .collect();
    let filler = GapFiller::new(take, gaps, others, !is_known);
    let (mut filled, implausible) = filler.fill(&bridged, done);
    if let Some(adapted) = adapted.filter(|_| is_known) {
        let seen = whole_body::with_bridged(take.xyz, gaps, &bridged);
        let take = take.with_xyz(seen.view());
        model_fill::fill(adapted, &take, gaps, &mut filled, implausible, done);
    }
    rigid_distances::hold(take, gaps, &mut filled);
    if let Some(sd) = take.sd {
        for (gap, filled) in gaps.iter().zip(&mut filled) {
            let noise = noise_beside(sd, gap);
            let variances = filled.iter_mut().flat_map(|f| &mut f.variance);
            variances.for_each(|v| *v += NOISE_SHARE * noise);
        }
    }
    (filled, bodies)
}

/// The variance of a coordinate of a gap's point where it is seen: at the gap's ends, else the mean
/// over the take; cm². What is learned from noisy frames is uncertain besides; simulated gaps,
/// which are judged by noisy frames, show a part of that.
fn noise_beside(sd: ArrayView2<'_, f64>, gap: &Gap) -> f64 {
    let mean = |frames: &mut dyn Iterator<Item = usize>| {
        mean_of_finite(frames.map(|t| sd[[t, gap.point]].powi(2)))
    };
    let ends = mean(&mut gap.before.into_iter().chain(gap.after));
    ends.or_else(|| mean(&mut (0..sd.nrows()))).unwrap_or(0.0)
}

/// Writes a filled gap into the result; coordinates of `xyz` that were measured of a missing point
/// stay. Outliers are rejected; where `outliers_only`, missing points stay missing.
pub(crate) fn put_filled(
    out: &mut TakeResult,
    xyz: ArrayView2<'_, f64>,
    gap: &Gap,
    filled: Option<&FilledGap>,
    outliers_only: bool,
) {
    let (p, points) = (gap.point, out.points());
    for (k, t) in gap.frames.clone().enumerate() {
        let is_measured = (3 * p..3 * p + 3).all(|i| xyz[[t, i]].is_finite());
        if outliers_only && !is_measured {
            continue;
        }
        let status = match (is_measured, filled) {
            (true, _) => Status::Rejected,
            (false, Some(_)) => Status::Inferred,
            (false, None) => Status::Unknown,
        };
        out.states[t * points + p] = PointState {
            status,
            sd: filled.map_or(f64::NAN, |f| f.variance[k].sqrt()),
            method: filled.map(|f| f.method_in(k)),
        };
        let Some(filled) = filled else { continue };
        for axis in 0..3 {
            if is_measured || xyz[[t, 3 * p + axis]].is_nan() {
                out.xyz[[t, 3 * p + axis]] = filled.xyz[[k, axis]];
            }
        }
    }
}

/// Leaves gaps empty. A frame of which nothing is left filled has no novelty.
pub(crate) fn empty_gaps<'a>(
    out: &mut TakeResult,
    xyz: ArrayView2<'_, f64>,
    gaps: impl Iterator<Item = &'a Gap>,
) {
    for gap in gaps {
        let columns = 3 * gap.point..3 * gap.point + 3;
        for t in gap.frames.clone() {
            let captured = xyz.slice(s![t, columns.clone()]);
            // What bore another's name was measured, and stays.
            let is_put_back = out.state(t, gap.point).status == Status::Changed;
            if is_put_back || captured.iter().all(|v| v.is_finite()) {
                continue;
            }
            out.xyz.slice_mut(s![t, columns.clone()]).assign(&captured);
            out.set(t, gap.point, Status::Unknown, f64::NAN);
        }
    }
    for t in 0..out.xyz.nrows() {
        if !out.is_any_filled(t) {
            out.novelty[t] = f64::NAN;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_found_with_their_ends() {
        let mut xyz = Array2::<f64>::zeros((6, 6));
        xyz[[0, 1]] = f64::NAN;
        xyz[[2, 4]] = f64::NAN;
        xyz[[3, 3]] = f64::NAN;
        xyz[[5, 5]] = f64::NAN;
        let gap = |point, frames: Range<usize>, before, after| Gap {
            point,
            frames,
            before,
            after,
        };
        assert_eq!(
            gaps_of(xyz.view(), &(0..6)),
            [
                gap(0, 0..1, None, Some(1)),
                gap(1, 2..4, Some(1), Some(4)),
                gap(1, 5..6, Some(4), None)
            ]
        );
        // The edge of a run is an end like that of the take.
        assert_eq!(gaps_of(xyz.view(), &(3..6))[0], gap(1, 3..4, None, Some(4)));
    }
}

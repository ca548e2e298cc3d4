//! Completing: missing points are filled, seen points stay.
//!
//! Each frame is an observation whose seen coordinates are exact and whose others have infinite
//! variance; the restored frame fills the missing points. In a take, outliers count as missing, the
//! model is adapted to the take's body, and the gaps are filled from the frames around them
//! (`gap`), else by the model frame by frame (`frame_fill`).

use super::frame_fill::FrameFill;
use super::frame_restorer::{FrameRestorer, RestoredFrame};
use super::gap::{FilledGap, Gap, GapAnswers, GapFiller, find_gaps};
use super::loaded_model::AdaptedModel;
use super::noise_estimation::{exact_noise, typical_noise};
use super::outliers::{find_outliers, remove};
use super::restored_frames::{BoundModel, Method, RestoredFrames, Take};
use crate::numeric::parallel;
use crate::pose::{Similarity, Status};
use crate::{Error, Result};
use ndarray::{ArrayView2, s};

/// Frames of one parallel task.
const CHUNK: usize = 8;

/// How to complete.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Complete {
    /// Longest gap to fill, in seconds; `None`: no limit. Needs a frame rate.
    pub max_gap: Option<f64>,
    /// Replaces outliers by their estimate too.
    pub overwrite_outliers: bool,
    /// Points that count as seen; all others count as missing. `None`: all points.
    pub observe: Option<Vec<String>>,
    /// Frames a second, for a table without times.
    pub fps: Option<f64>,
    /// Restores each frame by itself, without its neighbors in time.
    pub per_frame: bool,
}

impl Complete {
    /// Checks the options against the points of a table.
    ///
    /// # Errors
    /// [`Error::Usage`] if a point to observe is not among `points`.
    pub fn check(&self, points: &[String]) -> Result<()> {
        match self.observe.iter().flatten().find(|n| !points.contains(n)) {
            Some(name) => Err(Error::usage(format!(
                "observe {name}: the table has no point of this name"
            ))),
            None => Ok(()),
        }
    }
}

impl Method for Complete {
    fn frames(&self, bound: &BoundModel<'_>, table: ArrayView2<'_, f64>) -> RestoredFrames {
        let xyz = bound.gather(table);
        let estimates = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
            let estimate = |t: usize| {
                let y = xyz.row(t).to_vec();
                if bound.is_complete(&y) {
                    return (Estimate::NotNeeded, f64::NAN);
                }
                let adapted = bound.model.adapt(xyz.slice(s![t..t + 1, ..]), 0.0);
                let restorer = adapted.rigid_restorer();
                match restorer.restore(&y, &exact_noise(&y, &[])) {
                    Some(found) => {
                        let novelty = novelty(&restorer, &y, &found);
                        (Estimate::Found(found), novelty)
                    }
                    None => (Estimate::TooLittleSeen, f64::NAN),
                }
            };
            range.map(estimate).collect::<Vec<_>>()
        });
        let mut out = RestoredFrames::of(xyz);
        for (t, (estimate, novelty)) in estimates.into_iter().flatten().enumerate() {
            fill(bound, &mut out, t, &estimate);
            out.novelty[t] = novelty;
        }
        bound.scatter(table, &out)
    }

    fn take(
        &self,
        bound: Option<&BoundModel<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames {
        let own = bound.filter(|bound| !bound.is_mapped);
        let (outliers, mut adapted) = find_outliers(own, take, None);
        let mut captured = take.xyz.to_owned();
        remove(&mut captured, &outliers.points);
        let gaps = find_gaps(captured.view(), take.runs);
        let mut out = RestoredFrames::captured(take.xyz);
        let noise = typical_noise(captured.view(), take.runs);
        out.take_alone = !is_known(own, adapted.as_ref(), captured.view(), noise);
        if let Some(bound) = bound.filter(|bound| bound.is_mapped) {
            let seen = bound.gather(captured.view());
            adapted = Some(bound.model.adapt(seen.view(), noise));
        }
        let known = adapted.as_ref().filter(|_| !out.take_alone);
        let filled = fill_gaps(bound, known, take, captured.view(), &gaps, done);
        for (gap, filled) in gaps.iter().zip(&filled) {
            put(&mut out, take.xyz, gap, filled.as_ref(), false);
        }
        out.too_little = count_unknown(&out);
        if let Some((bound, adapted)) = bound.zip(adapted.as_ref()) {
            out.novelty = novelty_of_filled(bound, &adapted.rigid_restorer(), &out);
        }
        self.put_back(&mut out, take, &outliers.points, &gaps);
        out
    }
}

impl Complete {
    /// Puts back the outliers that are to stay, and empties gaps that are too long.
    fn put_back(
        &self,
        out: &mut RestoredFrames,
        take: &Take<'_>,
        outliers: &[Vec<usize>],
        gaps: &[Gap],
    ) {
        if !self.overwrite_outliers {
            for (t, points) in outliers.iter().enumerate() {
                for i in points.iter().flat_map(|p| 3 * p..3 * p + 3) {
                    out.xyz[[t, i]] = take.xyz[[t, i]];
                }
            }
        }
        if let Some(longest) = self.max_gap {
            let is_long = |g: &&Gap| g.frames.len() as f64 / take.rate > longest * (1.0 + 1e-9);
            empty_gaps(out, take.xyz, gaps.iter().filter(is_long));
        }
    }
}

/// Whether the model, if there is one, knows poses like those of the captured frames (frames, 3 J,
/// in the table's order) with `noise` (cm). If not, the take is restored alone.
pub fn is_known(
    bound: Option<&BoundModel<'_>>,
    adapted: Option<&AdaptedModel<'_>>,
    captured: ArrayView2<'_, f64>,
    noise: f64,
) -> bool {
    let both = bound.zip(adapted);
    both.is_none_or(|(bound, adapted)| adapted.knows(bound.gather(captured).view(), noise))
}

/// Fills the gaps of `captured` (frames, 3 J, in the table's order): by the frames around them,
/// else by the model.
pub fn fill_gaps(
    bound: Option<&BoundModel<'_>>,
    adapted: Option<&AdaptedModel<'_>>,
    take: &Take<'_>,
    captured: ArrayView2<'_, f64>,
    gaps: &[Gap],
    done: &(dyn Fn(usize) + Sync),
) -> Vec<Option<FilledGap>> {
    let both = bound.zip(adapted);
    // How the points of another skeleton go together, the take itself knows best.
    let own = both.filter(|(bound, _)| !bound.is_mapped);
    let poses = own.and_then(|(bound, adapted)| {
        Some(bound.scatter_rows(adapted.training_poses()?.view(), take.names.len()))
    });
    let filler = GapFiller {
        names: take.names,
        captured,
        runs: take.runs,
        rate: take.rate,
        others: poses.as_ref().map(|p| p.view()),
    };
    let mut answers = filler.fill(gaps, done);
    if let Some((bound, adapted)) = both {
        fill_by_model(bound, adapted, take, captured, gaps, &mut answers, done);
    }
    filler.hold_distances(gaps, &mut answers.filled);
    answers.filled
}

/// Fills the gaps that are left by the model, frame by frame; one whose answer was refused, by what
/// is surer of both.
fn fill_by_model(
    bound: &BoundModel<'_>,
    adapted: &AdaptedModel<'_>,
    take: &Take<'_>,
    captured: ArrayView2<'_, f64>,
    gaps: &[Gap],
    answers: &mut GapAnswers,
    done: &(dyn Fn(usize) + Sync),
) {
    let left: Vec<usize> = (0..gaps.len())
        .filter(|&k| answers.filled[k].is_none() && bound.in_model(gaps[k].point).is_some())
        .collect();
    let of_model = |&k: &usize| Gap {
        point: bound.in_model(gaps[k].point).unwrap_or_default(),
        ..gaps[k].clone()
    };
    let restorer = adapted.rigid_restorer();
    let seen = bound.gather(captured);
    let model = FrameFill {
        restorer: &restorer,
        seen: seen.view(),
        runs: take.runs,
        rate: take.rate,
    };
    let frames = model.fill(&left.iter().map(of_model).collect::<Vec<_>>(), done);
    let variance = |filled: &FilledGap| filled.variance.iter().sum::<f64>();
    for (k, by_model) in left.into_iter().zip(frames) {
        let both = by_model.into_iter().chain(answers.refused[k].take());
        answers.filled[k] = both.min_by(|a, b| variance(a).total_cmp(&variance(b)));
    }
}

/// Puts a filled gap in place; coordinates of `xyz` that were measured of a missing point stay.
/// Outliers are rejected; where `outliers_only`, missing points stay missing.
pub fn put(
    out: &mut RestoredFrames,
    xyz: ArrayView2<'_, f64>,
    gap: &Gap,
    filled: Option<&FilledGap>,
    outliers_only: bool,
) {
    let p = gap.point;
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
        let sd = filled.map_or(f64::NAN, |f| f.variance[k].sqrt());
        out.set(t, p, status, sd);
        let Some(filled) = filled else { continue };
        out.set_method(t, p, Some(filled.method));
        for axis in 0..3 {
            if is_measured || xyz[[t, 3 * p + axis]].is_nan() {
                out.xyz[[t, 3 * p + axis]] = filled.xyz[[k, axis]];
            }
        }
    }
}

/// The number of frames with a point that stays unknown.
fn count_unknown(out: &RestoredFrames) -> usize {
    let is_unknown = |t: usize| (0..out.points()).any(|p| out.of_point(t, p).0 == Status::Unknown);
    (0..out.xyz.nrows()).filter(|t| is_unknown(*t)).count()
}

/// The novelty of each frame in which something was filled, nats.
fn novelty_of_filled(
    bound: &BoundModel<'_>,
    restorer: &FrameRestorer<'_>,
    out: &RestoredFrames,
) -> Vec<f64> {
    let poses = bound.gather(out.xyz.view());
    parallel::map_chunks(poses.nrows(), CHUNK, |range| {
        let of = |t: usize| {
            let is_filled =
                |p: usize| matches!(out.of_point(t, p).0, Status::Inferred | Status::Rejected);
            let pose = poses.row(t).to_vec();
            let is_judged = (0..out.points()).any(is_filled) && pose.iter().all(|v| v.is_finite());
            match is_judged {
                true => restorer.novelty(&pose, &Similarity::IDENTITY),
                false => f64::NAN,
            }
        };
        range.map(of).collect::<Vec<_>>()
    })
    .concat()
}

/// The estimate of a frame.
enum Estimate {
    /// Nothing is missing.
    NotNeeded,
    TooLittleSeen,
    Found(RestoredFrame),
}

impl Estimate {
    fn found(&self) -> Option<&RestoredFrame> {
        match self {
            Estimate::Found(found) => Some(found),
            _ => None,
        }
    }
}

/// Novelty of a completed frame, nats. What the frame still lacks is taken from the estimate.
fn novelty(restorer: &FrameRestorer<'_>, frame: &[f64], found: &RestoredFrame) -> f64 {
    let all = frame.iter().zip(&found.mean);
    let pose: Vec<f64> = all
        .map(|(y, m)| if y.is_finite() { *y } else { *m })
        .collect();
    restorer.novelty(&pose, &found.placement)
}

/// Fills the missing points of a frame from its estimate, and sets their statuses.
fn fill(bound: &BoundModel<'_>, out: &mut RestoredFrames, t: usize, estimate: &Estimate) {
    let mut is_incomplete = false;
    for p in (0..out.points()).filter(|&p| bound.in_table(p).is_some()) {
        let missing: Vec<usize> = (3 * p..3 * p + 3)
            .filter(|&i| out.xyz[[t, i]].is_nan())
            .collect();
        if missing.is_empty() {
            continue;
        }
        // A model of another unit of length may overflow: what is not finite is no estimate.
        let is_finite = |f: &&RestoredFrame| f.mean[3 * p..3 * p + 3].iter().all(|v| v.is_finite());
        let Some(found) = estimate.found().filter(is_finite) else {
            is_incomplete = true;
            out.set(t, p, Status::Unknown, f64::NAN);
            continue;
        };
        out.set(t, p, Status::Inferred, found.sd[p]);
        missing
            .iter()
            .for_each(|&i| out.xyz[[t, i]] = found.mean[i]);
    }
    out.too_little += usize::from(is_incomplete && !matches!(estimate, Estimate::NotNeeded));
}

/// Leaves gaps empty. A frame of which nothing is left filled has no novelty.
pub fn empty_gaps<'a>(
    out: &mut RestoredFrames,
    xyz: ArrayView2<'_, f64>,
    gaps: impl Iterator<Item = &'a Gap>,
) {
    for gap in gaps {
        let columns = 3 * gap.point..3 * gap.point + 3;
        for t in gap.frames.clone() {
            let captured = xyz.slice(s![t, columns.clone()]);
            if captured.iter().all(|v| v.is_finite()) {
                continue;
            }
            out.xyz.slice_mut(s![t, columns.clone()]).assign(&captured);
            out.set(t, gap.point, Status::Unknown, f64::NAN);
            out.set_method(t, gap.point, None);
        }
    }
    for t in 0..out.xyz.nrows() {
        let is_filled =
            |p: usize| matches!(out.of_point(t, p).0, Status::Inferred | Status::Rejected);
        if !(0..out.points()).any(is_filled) {
            out.novelty[t] = f64::NAN;
        }
    }
}

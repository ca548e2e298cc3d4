//! The points and the poses that the points of a gap are learned from.

use super::known_frames::Known;
use super::local_poses::LocalPoses;
use super::regression::OtherPoses;
use super::tuning::predictors::*;
use crate::pose::Anchor;
use ndarray::{ArrayView2, s};
use std::ops::Range;

/// What the targets of a gap are learned from.
pub(crate) struct Predictors {
    /// The points.
    pub points: Vec<usize>,
    /// The frames in which all of them and the targets are known.
    pub frames: Vec<usize>,
    /// Whether others were left out, as the model does not know them.
    pub leave_out: bool,
}

/// The predictors of `targets` in the frames `gap`, and the frames `around` it in which all of
/// both are known, counted from the first around. `None` where either are too few. `others` are a
/// model's training poses (n, 3 J).
pub(crate) fn predictors(
    known: &Known,
    others: Option<ArrayView2<'_, f64>>,
    around: &Range<usize>,
    targets: &[usize],
    gap: &Range<usize>,
) -> Option<Predictors> {
    let frames = known.captured.all_known(targets, around);
    let count = frames.len();
    let of_model = |p: &usize| others.is_some_and(|o| o[[0, 3 * p]].is_finite());
    let is_of_model = targets.iter().all(of_model);
    let fewest = if is_of_model {
        FEWEST_WITH_OTHERS
    } else {
        FEWEST_FRAMES
    };
    if count < fewest {
        return None;
    }
    let lacking = |p: usize| count - known.frames.count(p, &frames);
    let mut candidates: Vec<(usize, usize)> = (0..known.frames.points())
        .filter(|p| known.frames.has_all(*p, gap.clone()) && !targets.contains(p))
        .map(|p| (lacking(p), p))
        .filter(|(lacks, _)| *lacks < count)
        .collect();
    candidates.sort_unstable();
    let mut points: Vec<usize> = candidates.into_iter().map(|c| c.1).collect();
    let mut leave_out = false;
    if is_of_model {
        // Points that the model does not know would leave its training poses out.
        let both: Vec<usize> = points.iter().copied().filter(|p| of_model(p)).collect();
        if 2 * both.len() >= points.len() {
            leave_out = both.len() < points.len();
            points = both;
        }
    }
    let mut complete = frames;
    let mut kept: Vec<usize> = Vec::new();
    for p in points {
        if known.frames.count(p, &complete) as f64 >= SHARE_COMPLETE * count as f64 {
            complete = known.frames.intersection(p, &complete);
            kept.push(p);
        }
    }
    if complete.len() < fewest {
        return None;
    }
    let complete: Vec<usize> = complete.frames().map(|t| t - around.start).collect();
    if kept.len() > MOST_PREDICTORS {
        let xyz = known.xyz.slice(s![around.clone(), ..]);
        kept = steadiest(xyz, &kept, targets, &complete);
    }
    kept.sort_unstable();
    Some(Predictors {
        points: kept,
        frames: complete,
        leave_out,
    })
}

/// The model's training poses in the frame of reference of the predictors; `None` without a
/// model, or where it does not know all points.
pub(crate) fn other_poses(
    others: Option<ArrayView2<'_, f64>>,
    anchor: &Anchor,
    predictors: &[usize],
    targets: &[usize],
) -> Option<OtherPoses> {
    let others = others.filter(|o| o.nrows() > 1)?;
    let mut points = predictors.iter().chain(targets);
    if !points.all(|p| others[[0, 3 * p]].is_finite()) {
        return None;
    }
    let poses = match anchor.root {
        Some(_) => LocalPoses::in_reference_frame(others, predictors, targets),
        None => {
            let step = others.nrows().div_ceil(MOST_PLACED) as isize;
            LocalPoses::new(anchor, others.slice(s![..;step, ..]), predictors, targets)
        }
    };
    Some(OtherPoses::new(poses))
}

/// The predictors whose distances to the targets vary least.
fn steadiest(
    known: ArrayView2<'_, f64>,
    predictors: &[usize],
    targets: &[usize],
    frames: &[usize],
) -> Vec<usize> {
    let step = frames.len().div_ceil(STEADY_FRAMES);
    let frames: Vec<usize> = frames.iter().copied().step_by(step).collect();
    let variance = |a: usize, b: usize| {
        let lengths = frames.iter().map(|&t| {
            let square =
                |axis: usize| (known[[t, 3 * a + axis]] - known[[t, 3 * b + axis]]).powi(2);
            (0..3).map(square).sum::<f64>().sqrt()
        });
        let (n, sum, squares) =
            lengths.fold((0.0, 0.0, 0.0), |(n, s, q), l| (n + 1.0, s + l, q + l * l));
        squares / n - (sum / n) * (sum / n)
    };
    let mut ranked: Vec<(f64, usize)> = (predictors.iter())
        .map(|&p| {
            let least = targets
                .iter()
                .map(|&q| variance(p, q))
                .fold(f64::INFINITY, f64::min);
            (least, p)
        })
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.truncate(MOST_PREDICTORS);
    ranked.into_iter().map(|r| r.1).collect()
}

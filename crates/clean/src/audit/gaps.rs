//! What is missing, and what only looks as if it were there.

use super::{Finding, FindingKind, Limits, Take, ranges};
use crate::pose::point_at;
use serde::Serialize;

/// What is missing in a take.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct GapSummary {
    /// The share of all points of all frames that are missing.
    pub missing: f64,
    /// By point with a gap: its name, its gaps, its missing frames, and the frames of its longest
    /// gap.
    pub by_point: Vec<PointGaps>,
}

/// The gaps of a point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PointGaps {
    /// The point's name.
    pub point: String,
    /// The number of its gaps.
    pub gaps: usize,
    /// The frames in which it is missing.
    pub frames: usize,
    /// The first frame of its longest gap, and the one after the last.
    pub longest: [usize; 2],
    /// The first frame of each gap, and the one after its last.
    pub ranges: Vec<[usize; 2]>,
}

impl GapSummary {
    pub(super) fn of(take: &Take<'_>) -> GapSummary {
        let frames = take.xyz.nrows();
        let mut by_point = Vec::new();
        for p in 0..take.points.len() {
            let missing = (0..frames).filter(|&t| !point_at(take.with_zeros, t, p).is_finite());
            let gaps = ranges(missing);
            let Some(longest) = gaps.iter().max_by_key(|g| g.len()) else {
                continue;
            };
            by_point.push(PointGaps {
                point: take.points[p].clone(),
                gaps: gaps.len(),
                frames: gaps.iter().map(|g| g.len()).sum(),
                longest: [longest.start, longest.end],
                ranges: gaps.iter().map(|g| [g.start, g.end]).collect(),
            });
        }
        let all = (frames * take.points.len()).max(1) as f64;
        GapSummary {
            missing: by_point.iter().map(|p| p.frames).sum::<usize>() as f64 / all,
            by_point,
        }
    }

    pub(super) fn findings(&self, take: &Take<'_>, limits: &Limits) -> Vec<Finding> {
        let frames = take.xyz.nrows();
        let mut out = Vec::new();
        for gaps in &self.by_point {
            let [start, end] = gaps.longest;
            let seconds = take.rate.map(|rate| (end - start) as f64 / rate);
            let share = gaps.frames as f64 / frames as f64;
            let finding = |kind, what| Finding {
                kind,
                points: vec![gaps.point.clone()],
                frames: Some(gaps.longest),
                what,
            };
            if gaps.frames == frames {
                let what = format!("{} is never seen", gaps.point);
                out.push(finding(FindingKind::Missing, what));
            } else if let Some(seconds) = seconds.filter(|s| *s > limits.gap) {
                let what = format!(
                    "{} is missing for {seconds:.2} s (limit {} s)",
                    gaps.point, limits.gap
                );
                out.push(finding(FindingKind::LongGap, what));
            } else if share > limits.missing {
                let what = format!(
                    "{} is missing in {:.0}% of the frames (limit {:.0}%)",
                    gaps.point,
                    100.0 * share,
                    100.0 * limits.missing
                );
                out.push(finding(FindingKind::Missing, what));
            }
        }
        out
    }
}

/// What to do where zeros are no positions.
const EMPTIED: &str =
    "if that means missing, make these cells empty (the option `zeros_are_missing`)";
/// So many points that are at the origin in every frame are none of a skeleton's root.
const MANY_AT_ORIGIN: usize = 5;

/// Points that are exactly at the origin: nothing that is measured is.
pub(super) fn zeros(take: &Take<'_>) -> Vec<Finding> {
    let frames = take.xyz.nrows();
    let (mut out, mut always) = (Vec::new(), Vec::new());
    for p in 0..take.points.len() {
        let is_zero = |t: &usize| point_at(take.with_zeros, *t, p) == glam::DVec3::ZERO;
        let zeros: Vec<usize> = (0..frames).filter(is_zero).collect();
        let others = (0..frames).any(|t| take.at(t, p).is_some_and(|at| at != glam::DVec3::ZERO));
        if zeros.is_empty() {
            continue;
        }
        if !others {
            always.push(p);
            continue;
        }
        let what = format!(
            "{} is exactly 0, 0, 0 in {} frames: {EMPTIED}",
            take.points[p],
            zeros.len()
        );
        let range = ranges(zeros.iter().copied())[0].clone();
        out.push(take.finding(FindingKind::Zeros, &[p], Some(range), what));
    }
    // A root that is at the origin all the time, and joints at its position, are there on purpose.
    if always.len() >= MANY_AT_ORIGIN && !take.are_joints {
        let what = format!(
            "{}, {} and {} more are exactly 0, 0, 0 in every frame: {EMPTIED}",
            take.points[always[0]],
            take.points[always[1]],
            always.len() - 2
        );
        out.push(take.finding(FindingKind::Zeros, &always, None, what));
    }
    out
}

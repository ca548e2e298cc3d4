//! How points move: too fast, off their paths, into each other's places, or not at all.

use super::other_speeds::OtherSpeeds;
use super::{Finding, FindingKind, Limits, Take, ranges};
use crate::label::out_and_back::stretches;
use crate::pose::stray::PointApart;
use crate::restore::outliers::spikes_of_take;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use posing_core::often;
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

/// The share of a point's steps that are not faster than its speed.
const FAST: f64 = 0.99;
/// Two points that are nearer than this to each other are not told apart, cm.
const TOLD_APART: f64 = 3.0;
/// A swap leaves each point this many times as near to the other's path as to its own.
const SWAPPED: f64 = 4.0;
/// Up to this number of points that move far, each is compared with all others.
const FEW: usize = 500;
/// A value that is held for so many frames, while the others move this fast in the median, cm/s,
/// was not measured.
const HELD_FRAMES: usize = 10;
const MOVING: f64 = 5.0;

/// Points that are faster than people.
pub(super) fn too_fast(take: &Take<'_>, limits: &Limits) -> Option<Finding> {
    let rate = take.rate?;
    let speed = |p: usize| {
        let steps = take.steps();
        let lengths = steps.filter_map(|t| Some((take.at(t + 1, p)? - take.at(t, p)?).length()));
        let mut lengths: Vec<f64> = lengths.collect();
        if lengths.is_empty() {
            return None;
        }
        let at = ((lengths.len() - 1) as f64 * FAST) as usize;
        let step = *lengths.select_nth_unstable_by(at, f64::total_cmp).1;
        Some((p, step * rate))
    };
    let speeds = (0..take.points.len()).filter_map(speed);
    let (p, fastest) = speeds.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (fastest > limits.speed).then(|| {
        let what = format!(
            "{} moves at {:.1} m/s (limit {:.1}): is the rate {:.2} frames per second, and is the \
             unit right?",
            take.points[p],
            fastest / 100.0,
            limits.speed / 100.0,
            rate
        );
        take.finding(FindingKind::Rate, &[p], None, what)
    })
}

/// Points that leave their path for some frames and come back.
pub(super) fn jumps(take: &Take<'_>, limits: &Limits) -> Vec<Finding> {
    let Some(rate) = take.rate else {
        return Vec::new();
    };
    let mut spikes = spikes_of_take(take.xyz, &take.runs, rate);
    let away = if take.are_joints {
        Vec::new()
    } else {
        stretches(take.xyz, &take.runs, rate)
    };
    let mut out = Vec::new();
    for stretch in away.iter().filter(|away| away.height > limits.jump) {
        let (p, frames) = (stretch.point, &stretch.frames);
        let what = format!(
            "{} stands off its place for {} from frame {} on, by {:.1} cm (limit {} cm)",
            take.points[p],
            number_of_frames(frames.len()),
            frames.start,
            stretch.height,
            limits.jump
        );
        out.push(take.finding(FindingKind::Jump, &[p], Some(frames.clone()), what));
        frames
            .clone()
            .for_each(|t| spikes[t].retain(|spike| *spike != p));
    }
    let mut frames = vec![Vec::new(); take.points.len()];
    for (t, points) in spikes.iter().enumerate() {
        points.iter().for_each(|p| frames[*p].push(t));
    }
    for (p, frames) in frames.into_iter().enumerate() {
        let far = ranges(frames)
            .into_iter()
            .filter_map(|range| Some((height(take, p, &range)?, range)))
            .filter(|(height, _)| *height > limits.jump);
        let found: Vec<_> = far.collect();
        let Some((height, worst)) = found.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else {
            continue;
        };
        let what = format!(
            "{} jumps off its path {}, by {height:.1} cm in frame {} (limit {} cm)",
            take.points[p],
            often(found.len()),
            worst.start,
            limits.jump
        );
        out.push(take.finding(FindingKind::Jump, &[p], Some(worst.clone()), what));
    }
    out
}

fn number_of_frames(count: usize) -> String {
    match count {
        1 => "a frame".to_string(),
        n => format!("{n} frames"),
    }
}

/// How far a point is at most from the line between the frames around a range, cm; `None` where one
/// of them is not there.
fn height(take: &Take<'_>, p: usize, range: &Range<usize>) -> Option<f64> {
    let before = take.at(range.start.checked_sub(1)?, p)?;
    let after = take.at((range.end < take.xyz.nrows()).then_some(range.end)?, p)?;
    let steps = (range.len() + 1) as f64;
    let off = |t: usize| {
        let line = before.lerp(after, (t + 1 - range.start) as f64 / steps);
        take.at(t, p).map(|at| (at - line).length())
    };
    range.clone().filter_map(off).max_by(f64::total_cmp)
}

/// Pairs of points that change places from one frame to the next: each goes on where the other was.
pub(super) fn swaps(take: &Take<'_>) -> Vec<Finding> {
    let mut pairs: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for t in take.steps() {
        // Only what moves far can have changed places.
        let step = |p: usize| Some((p, (take.at(t + 1, p)? - take.at(t, p)?).length()));
        let far: Vec<usize> = (0..take.points.len())
            .filter_map(step)
            .filter(|(_, length)| *length > TOLD_APART)
            .map(|(p, _)| p)
            .collect();
        for (a, b) in may_swap(take, t, &far) {
            if is_swap(take, t, a, b) {
                pairs.entry((a, b)).or_default().push(t + 1);
            }
        }
    }
    let finding = |((a, b), frames): ((usize, usize), Vec<usize>)| {
        let what = format!(
            "{} and {} change places {}, first in frame {}",
            take.points[a],
            take.points[b],
            often(frames.len()),
            frames[0]
        );
        take.finding(
            FindingKind::Swap,
            &[a, b],
            Some(frames[0]..frames[0] + 1),
            what,
        )
    };
    pairs.into_iter().map(finding).collect()
}

/// The pairs of `far` that may change places after frame `t`. Where a goes to b's position and b to
/// a's, what both miss is less than their own steps / [`SWAPPED`], and so than 2 / 3 of a's step.
fn may_swap(take: &Take<'_>, t: usize, far: &[usize]) -> Vec<(usize, usize)> {
    let positions = |p: usize| Some((take.at(t, p)?, take.at(t + 1, p)?));
    let steps: Vec<(DVec3, DVec3)> = far.iter().filter_map(|&p| positions(p)).collect();
    let square = |(now, next): &(DVec3, DVec3)| {
        let miss = 2.0 / 3.0 * (*next - *now).length();
        miss * miss * (1.0 + 1e-9)
    };
    let mut out = Vec::new();
    if far.len() <= FEW {
        for (i, step) in steps.iter().enumerate() {
            let most = square(step);
            let misses = |other: &(DVec3, DVec3)| {
                step.1.distance_squared(other.0) + step.0.distance_squared(other.1)
            };
            let later = (i + 1..steps.len()).filter(|&k| misses(&steps[k]) <= most);
            out.extend(later.map(|k| (far[i], far[k])));
        }
        return out;
    }
    let both = |a: DVec3, b: DVec3| [a.x, a.y, a.z, b.x, b.y, b.z];
    let ends: Vec<[f64; 6]> = steps.iter().map(|(now, next)| both(*next, *now)).collect();
    let tree: ImmutableKdTree<f64, 6> = ImmutableKdTree::new_from_slice(&ends);
    for (i, step) in steps.iter().enumerate() {
        let near = tree.within_unsorted::<SquaredEuclidean>(&both(step.0, step.1), square(step));
        let later = near.iter().map(|n| n.item as usize).filter(|&k| k > i);
        out.extend(later.map(|k| (far[i], far[k])));
    }
    out
}

fn is_swap(take: &Take<'_>, t: usize, a: usize, b: usize) -> bool {
    let positions = || {
        let now = (take.at(t, a)?, take.at(t, b)?);
        let next = (take.at(t + 1, a)?, take.at(t + 1, b)?);
        Some((now, next))
    };
    let Some(((a0, b0), (a1, b1))) = positions() else {
        return false;
    };
    let own = (a1 - a0).length() + (b1 - b0).length();
    let crossed = (b1 - a0).length() + (a1 - b0).length();
    SWAPPED * crossed < own
}

/// Points with the very same position for many frames while others move; those that stand apart are
/// no value that was held.
pub(super) fn held(take: &Take<'_>, apart: &[PointApart]) -> Vec<Finding> {
    let Some(rate) = take.rate else {
        return Vec::new();
    };
    let mut out = Vec::new();
    let others = OtherSpeeds::of(take);
    let apart: HashSet<usize> = apart.iter().map(|a| a.point).collect();
    for p in (0..take.points.len()).filter(|p| !apart.contains(p)) {
        let is_same = |t: &usize| {
            let at = take.at(*t, p);
            at.is_some() && at == take.at(*t + 1, p) && at != Some(glam::DVec3::ZERO)
        };
        let same = ranges(take.steps().filter(is_same));
        let long = same.into_iter().filter(|r| r.len() >= HELD_FRAMES);
        let held = long.filter(|r| others.median(r.start..r.end + 1, p, rate) > MOVING);
        let held: Vec<_> = held.map(|r| r.start..r.end + 1).collect();
        let Some(longest) = held.iter().max_by_key(|r| r.len()) else {
            continue;
        };
        let what = format!(
            "{} is at the very same place for {} frames while others move: its last value was \
             held, make these cells empty",
            take.points[p],
            longest.len()
        );
        out.push(take.finding(FindingKind::Held, &[p], Some(longest.clone()), what));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel::rng;
    use ndarray::Array2;
    use rand::Rng;

    #[test]
    fn all_pairs_that_swap_are_among_those_that_may() {
        let points = 2 * FEW;
        let mut rng = rng(1, 0);
        let mut xyz = Array2::from_shape_fn((2, 3 * points), |_| rng.random_range(-50.0..50.0));
        for p in 0..points {
            let goes_on = p % 3 != 0;
            for axis in 0..3 {
                // Most go on together; others change places, nearly, or go anywhere.
                let other = if p % 2 == 0 {
                    p + 3
                } else {
                    p.saturating_sub(3)
                } % points;
                let from = if goes_on { p } else { other };
                let off = if goes_on {
                    5.0
                } else {
                    rng.random_range(-3.0..3.0)
                };
                xyz[[1, 3 * p + axis]] = xyz[[0, 3 * from + axis]] + off;
            }
        }
        let names = vec![String::new(); points];
        let take = Take {
            points: &names,
            xyz: xyz.view(),
            with_zeros: xyz.view(),
            time: None,
            runs: std::iter::once(0..2).collect(),
            rate: None,
            are_joints: false,
        };
        let all: Vec<usize> = (0..points).collect();
        let is_swap = |pair: &(usize, usize)| is_swap(&take, 0, pair.0, pair.1);
        let few = may_swap(&take, 0, &all);
        let mut found: Vec<_> = few.iter().copied().filter(is_swap).collect();
        found.sort_unstable();
        let pairs = all
            .iter()
            .flat_map(|&a| (a + 1..points).map(move |b| (a, b)));
        let want: Vec<_> = pairs.filter(is_swap).collect();
        assert!(
            want.len() > 50 && few.len() < 10 * points,
            "{} {}",
            want.len(),
            few.len()
        );
        assert_eq!(found, want);
    }
}

//! Feet held where they stand.

use super::bands::low_passed;
use super::put;
use super::tuning::*;
use crate::pose::foot_contacts::{fade, speed};
use crate::pose::{point_at, ranges};
use glam::{DMat3, DVec3};
use ndarray::Array2;
use std::ops::Range;

/// Holds a point of a foot in a stretch of frames at the middle of each stance; the frames of
/// these. `radius` is how far noise takes it from there along each of the `axes`, cm.
pub(super) fn hold(
    xyz: &mut Array2<f64>,
    point: usize,
    frames: Range<usize>,
    rate: f64,
    axes: DMat3,
    radius: DVec3,
) -> Vec<Range<usize>> {
    let track: Vec<DVec3> = frames
        .clone()
        .map(|t| point_at(xyz.view(), t, point))
        .collect();
    let share = |at: &DVec3| (axes.transpose() * *at) / radius;
    let shares: Vec<DVec3> = track.iter().map(share).collect();
    let stances = stances(&shares, rate, radius.element_product().cbrt());
    let mut offsets = vec![DVec3::ZERO; track.len()];
    for stance in &stances {
        let middle = middle(&track[stance.clone()]);
        for t in stance.clone() {
            offsets[t] = HELD * (middle - track[t]);
        }
    }
    let longest = (FADE * rate).round() as usize;
    fade(&stances, longest, &mut offsets, &mut vec![0.0; track.len()]);
    let start = frames.start;
    for ((t, at), by) in frames.zip(track).zip(offsets) {
        put(xyz, t, point, at + by);
    }
    let told = stances.into_iter().map(|s| start + s.start..start + s.end);
    told.collect()
}

/// The frames in which a point stands: it is slow, and stays near its middle; `shares` are its
/// positions as a share of how far noise goes, which is `mean` cm on the whole. So it may be faster
/// along the axis where noise is.
fn stances(shares: &[DVec3], rate: f64, mean: f64) -> Vec<Range<usize>> {
    let slow = low_passed(shares.to_vec(), STANCE_CUTOFF, rate);
    let is_slow = |t: &usize| mean * speed(&slow, *t, rate) < STANCE_SPEED;
    let is_one = |range: &Range<usize>| {
        let all = &shares[range.clone()];
        let middle = middle(all);
        all.iter().all(|at| at.distance_squared(middle) <= 1.0)
    };
    let mut open = ranges((0..shares.len()).filter(is_slow));
    let mut found = Vec::new();
    while let Some(range) = open.pop() {
        if is_one(&range) {
            found.push(range);
        } else {
            let at = range.start + best_split(&shares[range.clone()]);
            open.extend([range.start..at, at..range.end]);
        }
    }
    let fewest = (STANCE_SECONDS * rate).round() as usize;
    found.retain(|range| range.len() >= fewest.max(2));
    found.sort_by_key(|range| range.start);
    let mut out: Vec<Range<usize>> = Vec::new();
    for range in found {
        // Noise alone made it fast between them.
        let whole = out.last().map(|last| last.start..range.end);
        let near = |last: &&mut Range<usize>| range.start - last.end <= fewest;
        match out.last_mut().filter(near).zip(whole.filter(is_one)) {
            Some((last, whole)) => *last = whole,
            None => out.push(range),
        }
    }
    out
}

/// Where two or more points on end are parted so that both parts are nearest to their middles.
fn best_split(all: &[DVec3]) -> usize {
    let total: DVec3 = all.iter().sum();
    let mut before = DVec3::ZERO;
    // What the squares of the parts' sums over their numbers are more than that of all.
    let gain = |n: usize| {
        before += all[n - 1];
        let (first, last) = (n as f64, (all.len() - n) as f64);
        before.length_squared() / first + (total - before).length_squared() / last
    };
    let gains: Vec<f64> = (1..all.len()).map(gain).collect();
    let best = (0..gains.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b]));
    1 + best.unwrap_or(0)
}

fn middle(all: &[DVec3]) -> DVec3 {
    all.iter().sum::<DVec3>() / all.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a second at each of three places, 12 cm and then `step` cm on; along z noise comes and
    /// goes by 4 cm in half a second, by 50 cm/s at its fastest.
    fn track(step: f64) -> Vec<DVec3> {
        let at = |t: usize| {
            let noise = 4.0 * (t as f64 * std::f64::consts::TAU / 15.0).sin();
            DVec3::new([0.0, 12.0, 12.0 + step][t / 15], 0.0, noise)
        };
        (0..45).map(at).collect()
    }

    fn found(step: f64) -> Vec<Range<usize>> {
        let radius = DVec3::new(2.0, 2.0, 12.0);
        let shares: Vec<DVec3> = track(step).iter().map(|at| *at / radius).collect();
        stances(&shares, 30.0, radius.element_product().cbrt())
    }

    #[test]
    fn noise_along_the_line_of_sight_parts_no_stance() {
        let whole = found(0.0);
        assert!(whole.len() == 2 && whole[1].len() >= 25, "{whole:?}");
    }

    #[test]
    fn a_step_parts_stances() {
        let parted = found(12.0);
        assert!(parted.len() == 3, "{parted:?}");
        assert!(parted[0].end <= 15 && parted[1].start >= 15, "{parted:?}");
        assert!(parted[1].end <= 30 && parted[2].start >= 30, "{parted:?}");
    }
}

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
    let stances = stances(&track, rate, |by| (axes.transpose() * by) / radius);
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

/// The frames in which a point stands: it is slow, and stays near its middle; `far` is a way as a
/// share of how far noise goes.
fn stances(track: &[DVec3], rate: f64, far: impl Fn(DVec3) -> DVec3) -> Vec<Range<usize>> {
    let slow = low_passed(track.to_vec(), STANCE_CUTOFF, rate);
    let is_slow = |t: &usize| speed(&slow, *t, rate) < STANCE_SPEED;
    let shares: Vec<DVec3> = track.iter().map(|at| far(*at)).collect();
    let mut open = ranges((0..track.len()).filter(is_slow));
    let mut out = Vec::new();
    while let Some(range) = open.pop() {
        let all = &shares[range.clone()];
        let middle = middle(all);
        if all.iter().all(|at| at.distance_squared(middle) <= 1.0) {
            out.push(range);
        } else {
            let at = range.start + best_split(all);
            open.extend([range.start..at, at..range.end]);
        }
    }
    let fewest = (STANCE_SECONDS * rate).round() as usize;
    out.retain(|range| range.len() >= fewest.max(2));
    out.sort_by_key(|range| range.start);
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

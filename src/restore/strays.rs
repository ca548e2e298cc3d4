//! Points that leave their path for some frames: no part of a body jumps away and back. That needs no model and no body.
//!
//! 1. Of two frames, a before and b after, a point that moves steadily is on the line between them. It is off that line by
//!    A h² a b / 2 at most, h seconds a frame, if it is accelerated by no more than A, and by the noise. A point that agrees
//!    with too few of its neighbours in time is a stray.
//! 2. Of the others, a point is on the cubic through its two neighbours on either side but for S h⁴ a b c d / 24, if the
//!    fourth derivative of its path is no more than S. The one that is worst off of those near it is a stray, until none is.

use crate::par;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// No part of a body is accelerated by more, cm/s²: as a heel that strikes the ground is.
const MOST: f64 = 2e4;
/// Nor is the fourth derivative of its path larger, cm/s⁴.
const MOST_BENT: f64 = 4e8;
/// A point that is off its path by less is none, cm.
const LEAST: f64 = 1.5;
/// So many standard deviations of noise are allowed for.
const SURE: f64 = 5.0;
/// Neighbours on each side, and how far off they may be, seconds; but at least as many frames.
const NEIGHBOURS: usize = 3;
const REACH: f64 = 0.05;
/// A point agrees with one in so many pairs of neighbours, or is a stray.
const AGREE: usize = 3;
/// One stray is told from another that is this many frames off.
const APART: usize = 3;
/// The first time strays are among the neighbours too; then they are left out, as far as they were found.
const TIMES: usize = 3;

/// The strays of each frame of a take (frames, 3 J; cm, NaN missing): `runs` are the stretches of frames that follow one
/// another, `rate` frames a second, `noise` the standard deviation of a coordinate of each point (J), cm.
pub fn strays(
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
    noise: &[f64],
) -> Vec<Vec<usize>> {
    let reach = ((REACH * rate) as usize).max(NEIGHBOURS);
    let of_points = par::map_chunks(noise.len(), 1, |points| {
        let p = points.start;
        let at = |t: usize| DVec3::new(xyz[[t, 3 * p]], xyz[[t, 3 * p + 1]], xyz[[t, 3 * p + 2]]);
        let mut found = Vec::new();
        for run in runs {
            let path = Path {
                places: run.clone().map(at).collect(),
                step: 1.0 / rate,
                reach,
                noise: noise[p],
            };
            let strays = path.strays();
            found.extend(
                run.clone()
                    .zip(strays)
                    .filter_map(|(t, is)| is.then_some(t)),
            );
        }
        found
    });
    let mut out = vec![Vec::new(); xyz.nrows()];
    for (p, frames) in of_points.into_iter().enumerate() {
        frames.into_iter().for_each(|t| out[t].push(p));
    }
    out
}

/// A point over the frames of a run.
struct Path {
    /// NaN where it is missing.
    places: Vec<DVec3>,
    /// Seconds a frame.
    step: f64,
    /// Frames.
    reach: usize,
    noise: f64,
}

impl Path {
    fn strays(&self) -> Vec<bool> {
        let mut strays = vec![false; self.places.len()];
        for _ in 0..TIMES {
            strays = (0..strays.len())
                .map(|t| self.is_stray(t, &strays))
                .collect();
        }
        while self.add_worst(&mut strays) {}
        strays
    }

    /// Adds the places that are worst off of those near them, by the cubics through their neighbours; whether there are any.
    fn add_worst(&self, strays: &mut [bool]) -> bool {
        let off: Vec<f64> = (0..strays.len())
            .map(|t| self.off_cubic(t, strays))
            .collect();
        let mut some = false;
        for (t, own) in off.iter().enumerate().filter(|(_, off)| **off > 1.0) {
            let near = t.saturating_sub(APART)..(t + APART + 1).min(off.len());
            let is_worst = near
                .into_iter()
                .all(|i| off[i] < *own || (off[i] == *own && i >= t));
            strays[t] |= is_worst;
            some |= is_worst;
        }
        some
    }

    /// How far a place is off the cubic through its neighbours, of what may be; 0 where it has too few, or is a stray.
    fn off_cubic(&self, t: usize, strays: &[bool]) -> f64 {
        let counts = |i: &usize| self.places[*i].is_finite() && !strays[*i];
        if !counts(&t) {
            return 0.0;
        }
        let from = t.saturating_sub(self.reach);
        let to = (t + self.reach + 1).min(self.places.len());
        let mut before = (from..t).rev().filter(counts);
        let mut after = (t + 1..to).filter(counts);
        let [Some(a), Some(b), Some(c), Some(d)] =
            [before.next(), before.next(), after.next(), after.next()]
        else {
            return 0.0;
        };
        let near = [a, b, c, d];
        let x = near.map(|i| i as f64 - t as f64);
        let (mut expected, mut square) = (DVec3::ZERO, 1.0);
        for i in 0..4 {
            let share: f64 = (0..4)
                .filter(|j| *j != i)
                .map(|j| x[j] / (x[j] - x[i]))
                .product();
            expected += share * self.places[near[i]];
            square += share * share;
        }
        let bent = MOST_BENT * self.step.powi(4) * x.iter().product::<f64>() / 24.0;
        let most = LEAST + bent + SURE * self.noise * square.sqrt();
        (self.places[t] - expected).length() / most
    }

    /// Whether a place agrees with too few of its neighbours that are no strays.
    fn is_stray(&self, t: usize, strays: &[bool]) -> bool {
        if !self.places[t].is_finite() {
            return false;
        }
        let counts = |i: &usize| self.places[*i].is_finite() && !strays[*i];
        let from = t.saturating_sub(self.reach);
        let to = (t + self.reach + 1).min(self.places.len());
        let (mut all, mut agree) = (0, 0);
        for before in (from..t).rev().filter(counts).take(NEIGHBOURS) {
            for after in (t + 1..to).filter(counts).take(NEIGHBOURS) {
                all += 1;
                agree += usize::from(self.agrees(t, before, after));
            }
        }
        // At an end, and beside gaps, nothing tells.
        all > 1 && AGREE * agree < all
    }

    fn agrees(&self, t: usize, before: usize, after: usize) -> bool {
        let (a, b) = ((t - before) as f64, (after - t) as f64);
        let share = a / (a + b);
        let expected = self.places[before].lerp(self.places[after], share);
        let noise = self.noise * (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt();
        let bent = MOST * self.step * self.step * a * b / 2.0;
        (self.places[t] - expected).length() <= LEAST + bent + SURE * noise
    }
}

//! Spikes: points that leave their path for some frames. No part of a body jumps away and back, so
//! no model is needed.
//!
//! 1. Between two frames, a before and b after, a point moves on a straight line, but for A h² a b
//!    / 2 if its acceleration is at most A (h seconds per frame), and for the noise. A point that
//!    agrees with too few pairs of its neighbors in time is a spike.
//! 2. The remaining points are on the cubic through two neighbors on either side, but for S h⁴ a b
//!    c d / 24 if the fourth derivative of the path is at most S. The point with the largest
//!    deviation nearby is a spike, until none is left.
//! 3. Spikes after which the path does not continue as before are none: the point jumped and stays
//!    where it is.

use super::tuning::trajectory::*;
use crate::noise_estimation;
use crate::numeric::parallel;
use crate::numeric::statistics::median;
use crate::pose::ranges;
use crate::pose_model::PoseModel;
use crate::take::{Take, without};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};
use std::ops::{Deref, Range};

/// The points that leave their path for some frames, frame by frame, in a take (frames, 3 J; cm,
/// NaN missing). `runs` are ranges of consecutive frames, `rate` is in frames a second. No model is
/// needed.
pub fn spikes_of_take(
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
) -> Vec<Vec<usize>> {
    let take = Take {
        names: &[],
        xyz,
        runs,
        rate,
        sd: None,
        motion: Default::default(),
    };
    spikes_by_time(&take, None)
}

/// The spikes of each frame of a take; `noise` is the standard deviation of a coordinate, cm, if
/// known.
pub(crate) fn spikes_by_time(take: &Take<'_>, noise: Option<f64>) -> Vec<Vec<usize>> {
    spikes(take, &noise_estimation::most_by_point(None, take, noise))
}

/// The spikes of each frame of a take in the order of a model's points, the frames without them,
/// and the noise of most points there, cm. Spikes inflate the noise estimate, which hides others.
pub(crate) fn spikes_in_rounds(
    model: &PoseModel,
    take: &Take<'_>,
    noise: Option<f64>,
) -> (Vec<Vec<usize>>, Array2<f64>, f64) {
    let noise_of = |xyz: ArrayView2<'_, f64>| {
        noise_estimation::most_by_point(Some((model, xyz)), &take.with_xyz(xyz), noise)
    };
    let mut all: Vec<Vec<usize>> = vec![Vec::new(); take.xyz.nrows()];
    let mut clean = take.xyz.to_owned();
    let mut by_point = noise_of(take.xyz);
    for _ in 0..NOISE_ROUNDS {
        let before = all.clone();
        for (all, found) in all.iter_mut().zip(spikes(take, &by_point)) {
            // With a smaller noise a path may no longer be one: what was found stays.
            all.extend(found);
            all.sort_unstable();
            all.dedup();
        }
        if all == before {
            break;
        }
        clean = without(take.xyz, &all);
        by_point = noise_of(clean.view());
    }
    // The median: the noise of a single point may be meaningless.
    (all, clean, median(by_point).unwrap_or(0.0))
}

/// The spikes of each frame of a take; `noise` (J) is the standard deviation of a coordinate of
/// each point, cm.
fn spikes(take: &Take<'_>, noise: &[f64]) -> Vec<Vec<usize>> {
    let (xyz, rate) = (take.xyz, take.rate);
    let reach = ((REACH * rate) as usize).max(NEIGHBORS);
    let of_points = parallel::map_chunks(noise.len(), 1, |points| {
        let p = points.start;
        let at = |t: usize| DVec3::new(xyz[[t, 3 * p]], xyz[[t, 3 * p + 1]], xyz[[t, 3 * p + 2]]);
        let mut found = Vec::new();
        for run in take.runs {
            let path = Path {
                positions: run.clone().map(at).collect(),
                step: 1.0 / rate,
                reach,
                noise: noise[p],
            };
            let spikes = path.spikes();
            found.extend(
                run.clone()
                    .zip(spikes)
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

/// The nearest frames on one side, on the stack: there are many.
#[derive(Default)]
struct Near {
    frames: [usize; NEIGHBORS],
    count: usize,
}

impl Near {
    fn of(frames: impl Iterator<Item = usize>) -> Near {
        let mut near = Near::default();
        for (to, frame) in near.frames.iter_mut().zip(frames) {
            *to = frame;
            near.count += 1;
        }
        near
    }
}

impl Deref for Near {
    type Target = [usize];

    fn deref(&self) -> &[usize] {
        &self.frames[..self.count]
    }
}

/// Pairs of frames, each with each.
fn pairs(frames: &[usize]) -> impl Iterator<Item = (usize, usize)> {
    let each = frames.iter().enumerate();
    each.flat_map(|(k, a)| frames[k + 1..].iter().map(move |b| (*a, *b)))
}

/// The positions of a point over a run.
struct Path {
    /// NaN where missing.
    positions: Vec<DVec3>,
    /// Seconds a frame.
    step: f64,
    /// Frames.
    reach: usize,
    noise: f64,
}

impl Path {
    fn spikes(&self) -> Vec<bool> {
        let none = vec![false; self.positions.len()];
        // Far from spikes nothing is another than without any.
        let alone = (0..none.len()).map(|t| self.is_spike(t, &none));
        let alone: Vec<bool> = alone.collect();
        let mut spikes = alone.clone();
        for _ in 1..TIMES {
            let is_near = |t: usize| {
                let to = (t + self.reach + 1).min(spikes.len());
                spikes[t.saturating_sub(self.reach)..to].contains(&true)
            };
            let is_spike = |t: usize| {
                if is_near(t) {
                    self.is_spike(t, &spikes)
                } else {
                    alone[t]
                }
            };
            spikes = (0..alone.len()).map(is_spike).collect();
        }
        for _ in 0..ROUNDS {
            if !self.add_worst(&mut spikes) {
                break;
            }
        }
        self.release(&mut spikes);
        let count = |some: &[bool]| some.iter().filter(|s| **s).count();
        let seen: Vec<bool> = self.positions.iter().map(|p| p.is_finite()).collect();
        if 2 * count(&spikes) > count(&seen) {
            // There is no path: the noise is larger than stated.
            spikes.fill(false);
        }
        spikes
    }

    /// Where a path jumps and stays, the frames on either side of the jump disagree with their
    /// neighbors: they are no spikes.
    fn release(&self, spikes: &mut [bool]) {
        for found in ranges((0..spikes.len()).filter(|t| spikes[*t])) {
            if self.jumps(found.start, found.end, spikes) {
                spikes[found].fill(false);
            }
        }
    }

    /// Whether neither side of some spikes leads to the other; one frame of either side may be off.
    fn jumps(&self, first: usize, end: usize, spikes: &[bool]) -> bool {
        let before = &self.neighbors(first, spikes)[0];
        let after = &self.neighbors(end - 1, spikes)[1];
        let leads = |from: &[usize], to: &[usize]| {
            pairs(from).any(|(a, b)| to.iter().any(|t| self.is_on_line(*t, (a, b), MOST_LONG)))
        };
        !before.is_empty() && !after.is_empty() && !leads(before, after) && !leads(after, before)
    }

    /// Adds the largest deviations from the cubics through their neighbors; returns whether there
    /// are any.
    fn add_worst(&self, spikes: &mut [bool]) -> bool {
        let off: Vec<f64> = (0..spikes.len())
            .map(|t| self.off_cubic(t, spikes))
            .collect();
        let mut some = false;
        for (t, own) in off.iter().enumerate().filter(|(_, off)| **off > 1.0) {
            let near = t.saturating_sub(APART)..(t + APART + 1).min(off.len());
            let is_worst = near
                .into_iter()
                .all(|i| off[i] < *own || (off[i] == *own && i >= t));
            spikes[t] |= is_worst;
            some |= is_worst;
        }
        some
    }

    /// Deviation from the cubic through the neighbors, relative to the largest allowed; 0 for
    /// spikes and where neighbors lack.
    fn off_cubic(&self, t: usize, spikes: &[bool]) -> f64 {
        if !self.positions[t].is_finite() || spikes[t] {
            return 0.0;
        }
        let [before, after] = self.neighbors(t, spikes);
        let ([a, b, ..], [c, d, ..]) = (&before[..], &after[..]) else {
            return 0.0;
        };
        let near = [*a, *b, *c, *d];
        let x = near.map(|i| i as f64 - t as f64);
        let (mut expected, mut square) = (DVec3::ZERO, 1.0);
        for i in 0..4 {
            let others = (0..4).filter(|j| *j != i);
            let share: f64 = others.map(|j| x[j] / (x[j] - x[i])).product();
            expected += share * self.positions[near[i]];
            square += share * share;
        }
        let bent = MOST_BENT * self.step.powi(4) * x.iter().product::<f64>() / 24.0;
        let most = LEAST + bent + SURE * self.noise * square.sqrt();
        (self.positions[t] - expected).length() / most
    }

    /// Whether a position agrees with too few pairs of its neighbors.
    fn is_spike(&self, t: usize, spikes: &[bool]) -> bool {
        if !self.positions[t].is_finite() {
            return false;
        }
        let [before, after] = self.neighbors(t, spikes);
        let seen = self.neighbors(t, &[]);
        match [seen[0].len(), seen[1].len()] {
            [0, _] => return self.is_loose(t, &after),
            [_, 0] => return self.is_loose(t, &before),
            [1, _] => return self.is_loose_beside(t, seen[0][0], &after, spikes),
            [_, 1] => return self.is_loose_beside(t, seen[1][0], &before, spikes),
            _ => {}
        }
        let both = before
            .iter()
            .flat_map(|a| after.iter().map(move |b| (*a, *b)));
        let agree = both.filter(|(a, b)| self.agrees(t, *a, *b)).count();
        let all = before.len() * after.len();
        all > 1 && AGREE * agree < all
    }

    /// Whether the end of a run agrees with no pair of its neighbors, which agree with each other.
    fn is_loose(&self, t: usize, near: &[usize]) -> bool {
        let [a, b, c] = *near else { return false };
        self.agrees(b, a, c) && pairs(near).all(|(i, j)| !self.agrees(t, i, j))
    }

    /// `is_loose` for the frame beside the end of a run. The end itself may be off: it has to be a
    /// known spike, or to agree with the others.
    fn is_loose_beside(&self, t: usize, end: usize, near: &[usize], spikes: &[bool]) -> bool {
        let is_known = || spikes[end] || pairs(near).any(|(i, j)| self.agrees(end, i, j));
        self.is_loose(t, near) && is_known()
    }

    /// The nearest frames before and after `t` that are seen and not in `spikes`, the nearest
    /// first.
    fn neighbors(&self, t: usize, spikes: &[bool]) -> [Near; 2] {
        let is_spike = |i: usize| spikes.get(i).is_some_and(|is| *is);
        let counts = |i: &usize| self.positions[*i].is_finite() && !is_spike(*i);
        let from = t.saturating_sub(self.reach);
        let to = (t + self.reach + 1).min(self.positions.len());
        [
            Near::of((from..t).rev().filter(counts)),
            Near::of((t + 1..to).filter(counts)),
        ]
    }

    /// Whether a position is on the line through two others, within the largest acceleration.
    fn agrees(&self, t: usize, i: usize, j: usize) -> bool {
        self.is_on_line(t, (i, j), MOST)
    }

    /// `agrees`, within the acceleration `most`.
    fn is_on_line(&self, t: usize, (i, j): (usize, usize), most: f64) -> bool {
        let [a, b] = [i, j].map(|i| i as f64 - t as f64);
        let share = a / (a - b);
        let expected = self.positions[i].lerp(self.positions[j], share);
        let noise = self.noise * (1.0 + share * share + (1.0 - share) * (1.0 - share)).sqrt();
        let bent = most * self.step * self.step * (a * b).abs() / 2.0;
        (self.positions[t] - expected).length() <= LEAST + bent + SURE * noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use rand::Rng;

    const RATE: f64 = 120.0;

    /// A point that swings, and one that strikes: from 4 m/s to rest within three frames.
    fn motion(frames: usize) -> Array2<f64> {
        Array2::from_shape_fn((frames, 6), |(t, c)| {
            let at = t as f64 / RATE;
            match c {
                0..3 => 30.0 * (5.0 * at + c as f64).sin(),
                3 => {
                    let late = (at - 0.4).clamp(0.0, 0.025);
                    400.0 * (at.min(0.425) - 0.5 * late * late / 0.025)
                }
                _ => 0.0,
            }
        })
    }

    fn found_in(runs: &[Range<usize>], xyz: &Array2<f64>, noise: f64) -> Vec<(usize, usize)> {
        let take = Take {
            names: &[],
            xyz: xyz.view(),
            runs,
            rate: RATE,
            sd: None,
            motion: Default::default(),
        };
        let spikes = spikes(&take, &[noise; 2]);
        let each = spikes.into_iter().enumerate();
        each.flat_map(|(t, points)| points.into_iter().map(move |p| (t, p)))
            .collect()
    }

    fn found(xyz: &Array2<f64>, noise: f64) -> Vec<(usize, usize)> {
        found_in(&[0..xyz.nrows(), 0..0], xyz, noise)
    }

    #[test]
    fn what_moves_is_no_stray_and_neither_is_noise() {
        let mut xyz = motion(100);
        assert_eq!(found(&xyz, 0.0), []);
        let mut generator = parallel::rng(1, 0);
        xyz.mapv_inplace(|v| v + generator.random_range(-1.0..1.0));
        assert_eq!(found(&xyz, 0.6), []);
    }

    #[test]
    fn points_that_jump_away_and_back_are_found_however_far() {
        let mut generator = parallel::rng(2, 0);
        for far in [10.0, 30.0, 1e3, 1e9] {
            let mut xyz = motion(1000);
            let hit: Vec<usize> = (0..1000).filter(|_| generator.random_bool(0.2)).collect();
            for &t in &hit {
                (0..3).for_each(|c| xyz[[t, c]] += far * generator.random_range(-1.0..1.0));
            }
            let noise_variance = found(&xyz, 0.0);
            let right = noise_variance
                .iter()
                .filter(|(t, p)| *p == 0 && hit.contains(t))
                .count();
            // Some are hardly moved, and the neighbors of some are spikes too.
            assert!(
                right * 10 >= hit.len() * 9,
                "{far}: {right} of {}",
                hit.len()
            );
            assert!(
                (noise_variance.len() - right) * 5 <= right,
                "{far}: {right} of {}",
                noise_variance.len()
            );
        }
    }

    #[test]
    fn a_stretch_one_of_whose_ends_is_off_loses_no_other_frame() {
        for (gap, off) in [
            (0..0, 0),
            (0..0, 1),
            (0..0, 98),
            (0..0, 99),
            (30..50, 50),
            (30..50, 51),
            (30..50, 28),
            (30..50, 29),
        ] {
            let mut xyz = motion(100);
            xyz.slice_mut(ndarray::s![gap, ..3]).fill(f64::NAN);
            xyz[[off, 1]] += 20.0;
            assert_eq!(found(&xyz, 0.0), [(off, 0)]);
        }
    }

    #[test]
    fn where_the_first_few_frames_are_off_no_other_is_lost() {
        for (count, far) in [(2, 20.0), (3, 30.0), (3, 50.0), (4, 30.0)] {
            let mut xyz = motion(100);
            (0..count).for_each(|t| xyz[[t, 1]] += far);
            let noise_variance = found(&xyz, 0.0);
            assert!(
                noise_variance.iter().all(|(t, _)| *t < count),
                "{count}: {noise_variance:?}"
            );
        }
    }

    #[test]
    fn noise_of_more_than_was_told_makes_no_strays_of_all() {
        let mut generator = parallel::rng(3, 0);
        let mut xyz = motion(400);
        xyz.mapv_inplace(|v| v + generator.random_range(-20.0..20.0));
        assert_eq!(found(&xyz, 0.1), []);
    }

    #[test]
    fn one_that_stays_away_is_none_and_gaps_and_ends_of_runs_tell_nothing() {
        let mut xyz = motion(100);
        for t in 30..70 {
            xyz[[t, 1]] += 50.0;
        }
        let noise_variance = found(&xyz, 0.0);
        assert!(
            noise_variance
                .iter()
                .all(|(t, p)| *p == 0 && (26..75).contains(t)),
            "{noise_variance:?}"
        );
        assert!(noise_variance.len() < 8, "{noise_variance:?}");
        // Two takes need not join.
        let mut two = motion(100);
        for t in 50..100 {
            two[[t, 1]] += 50.0;
        }
        assert_eq!(found_in(&[0..50, 50..100], &two, 0.0), []);
        let mut missing = motion(100);
        for t in (0..100).filter(|t| t % 3 > 0) {
            missing.row_mut(t).fill(f64::NAN);
        }
        assert_eq!(found(&missing, 0.0), []);
        assert_eq!(found_in(&[0..1, 1..2], &motion(2), 0.0), []);
    }
}

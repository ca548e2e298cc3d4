//! Stretches of a track that stand away from their point: it jumps off, stays there for up to half
//! a second, and jumps back, as where a marker's name went to a reflection.
//!
//! A jump is a step that differs far more from those nearby than they do among themselves. Between
//! two of them the track is away where it goes on from one side to the other as the point moves,
//! and where its distances to the points that are steadiest beside it would be likelier on the
//! straight way across.
//!
//! Found without the cuts of `fragments`, which part from their track what stays away for
//! five frames and longer: with these as jumps, 12 of 16 such stretches of markers were found
//! instead of all, and twice as many true positions rejected.

use super::fragments::seen_ranges;
use super::marker_distances::{Distance, log_likelihood};
use super::tuning::out_and_back::*;
use crate::numeric::parallel;
use crate::numeric::statistics::{median_of, quantile};
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// A stretch of a track away from its point.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The point.
    pub point: usize,
    /// The frames in which the track is away from it.
    pub frames: Range<usize>,
    /// How far it is away at most, cm.
    pub height: f64,
}

/// The stretches of the tracks of `xyz` (frames, 3 J; cm, NaN missing) away from their points.
/// `runs` are ranges of consecutive frames, `rate` is in frames a second.
pub fn stretches(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>], rate: f64) -> Vec<Stretch> {
    let longest = ((LONGEST * rate) as usize).max(1);
    let found = parallel::map_chunks(xyz.ncols() / 3, 16, |points| {
        let of_point = |point: usize| {
            let track = Track { xyz, point };
            let all = seen_ranges(xyz, point, runs);
            let candidates = all.iter().flat_map(|seen| track.candidates(seen, longest));
            let candidates: Vec<Stretch> = candidates.collect();
            if candidates.is_empty() {
                candidates
            } else {
                track.denied(candidates)
            }
        };
        points.flat_map(of_point).collect::<Vec<_>>()
    });
    found.into_iter().flatten().collect()
}

/// One track of a take.
struct Track<'a> {
    xyz: ArrayView2<'a, f64>,
    point: usize,
}

impl Track<'_> {
    fn at(&self, t: usize) -> DVec3 {
        point_at(self.xyz, t, self.point)
    }

    /// Stretches of some frames in which the track is seen that lie between two jumps.
    fn candidates(&self, seen: &Range<usize>, longest: usize) -> Vec<Stretch> {
        let steps: Vec<DVec3> = (seen.start + 1..seen.end)
            .map(|t| self.at(t) - self.at(t - 1))
            .collect();
        if (0..steps.len()).all(|k| farthest_off(&steps, k) <= LEAST) {
            return Vec::new();
        }
        let off: Vec<f64> = (0..steps.len())
            .map(|k| steps[k].distance(usual_step(&steps, k)))
            .collect();
        // The first frame of the take, those after jumps, and the end.
        let mut bounds = vec![(seen.start, 0.0)];
        for (k, own) in off.iter().enumerate().filter(|(_, off)| **off > LEAST) {
            let others = nearby(k, off.len()).map(|i| off[i]).collect();
            let usual = quantile(others, USUAL).unwrap_or(f64::INFINITY);
            if *own > UNUSUAL * usual {
                bounds.push((seen.start + 1 + k, usual_step(&steps, k).length() + usual));
            }
        }
        bounds.push((seen.end, 0.0));
        let is_away = |w: &&[(usize, f64)]| {
            let [before, (from, usual), (to, usual_after), after] = **w else {
                return false;
            };
            let beside = (from - before.0) + (after.0 - to);
            let first = (from - seen.start).saturating_sub(2 * NEARBY);
            let around = &off[first..(to - seen.start + 2 * NEARBY).min(off.len())];
            let jump = |t: usize| off[t - seen.start - 1];
            let large = 0.5 * jump(from).min(jump(to));
            let jumps = around.iter().filter(|off| **off > large).count();
            // A path that jumps all the time says nothing.
            let is_path = jumps <= 2 + around.len() / JUMPY;
            // The point itself moves meanwhile, and the track may move with it.
            let farthest = LEAST + UNUSUAL * usual.max(usual_after) * (to - from + 1) as f64;
            let across = self.at(to) - self.at(from - 1);
            let along = across - (self.at(to - 1) - self.at(from));
            is_path
                && to - from <= longest
                && 2 * (to - from) <= beside
                && across.length().min(along.length()) <= farthest
        };
        let all = bounds.windows(4).filter(is_away).map(|w| w[1].0..w[2].0);
        let all = all.map(|frames| Stretch {
            point: self.point,
            height: self.height(&frames),
            frames,
        });
        all.filter(|stretch| stretch.height >= LEAST).collect()
    }

    /// How far the track is at most from the line between the frames beside a stretch, cm.
    fn height(&self, frames: &Range<usize>) -> f64 {
        let off = |t: usize| self.at(t).distance(self.on_line(frames, t));
        frames.clone().map(off).fold(0.0, f64::max)
    }

    /// The position in frame `t` on the line between the frames beside a stretch.
    fn on_line(&self, frames: &Range<usize>, t: usize) -> DVec3 {
        let share = (t + 1 - frames.start) as f64 / (frames.len() + 1) as f64;
        (self.at(frames.start - 1)).lerp(self.at(frames.end), share)
    }

    /// The stretches in which the distances to the steadiest points beside the track are far less
    /// likely than those of a line across would be, or, if they are rigid, than those to any point.
    fn denied(&self, candidates: Vec<Stretch>) -> Vec<Stretch> {
        let steadiest = self.steadiest(candidates[0].frames.start - 1);
        let is_rigid = steadiest
            .iter()
            .all(|(_, distance)| distance.spread <= RIGID);
        let is_denied = |stretch: &Stretch| {
            let step = stretch.frames.len().div_ceil(MOST_FRAMES);
            let frames = stretch.frames.clone().step_by(step);
            let both = frames.flat_map(|t| {
                let positions = [self.at(t), self.on_line(&stretch.frames, t)];
                steadiest.iter().map(move |(other, distance)| {
                    let other = point_at(self.xyz, t, *other);
                    positions.map(|at| log_likelihood(at.distance(other), distance))
                })
            });
            let known = both.filter(|[own, _]| own.is_finite());
            let (own, line) = known.fold((0.0, 0.0), |sum, v| (sum.0 + v[0], sum.1 + v[1]));
            line - own > EVIDENCE || is_rigid && own < 0.0
        };
        candidates.into_iter().filter(is_denied).collect()
    }

    /// The points whose distances to the track's are steadiest, of those that are near it in a
    /// frame.
    fn steadiest(&self, frame: usize) -> Vec<(usize, Distance)> {
        let here = self.at(frame);
        let mut near: Vec<(f64, usize)> = (0..self.xyz.ncols() / 3)
            .filter(|other| *other != self.point)
            .map(|other| (point_at(self.xyz, frame, other).distance(here), other))
            .filter(|(distance, _)| distance.is_finite())
            .collect();
        if near.len() > OTHERS {
            near.select_nth_unstable_by(OTHERS, |a, b| a.0.total_cmp(&b.0));
            near.truncate(OTHERS);
        }
        let measured = near.into_iter().filter_map(|(_, other)| {
            let distance = Distance::measure(self.xyz, [self.point, other])?;
            (distance.frames >= FEWEST_FRAMES).then_some((other, distance))
        });
        let mut measured: Vec<(usize, Distance)> = measured.collect();
        measured.sort_by(|a, b| a.1.looseness().total_cmp(&b.1.looseness()));
        measured.truncate(STEADIEST);
        measured
    }
}

/// The steps near step `k`, itself aside.
fn nearby(k: usize, steps: usize) -> impl Iterator<Item = usize> {
    (k.saturating_sub(NEARBY)..(k + NEARBY + 1).min(steps)).filter(move |i| *i != k)
}

/// How far a step is at most from the usual one, which lies between those nearby: far less work.
fn farthest_off(steps: &[DVec3], k: usize) -> f64 {
    let off = |i: usize| (steps[i] - steps[k]).abs();
    (nearby(k, steps.len()).map(off))
        .fold(DVec3::ZERO, DVec3::max)
        .length()
}

/// The median of the steps near step `k` along each axis.
fn usual_step(steps: &[DVec3], k: usize) -> DVec3 {
    // On the stack: there are many.
    let along = |axis: usize| {
        let (mut others, mut count) = ([0.0; 2 * NEARBY], 0);
        for (other, i) in others.iter_mut().zip(nearby(k, steps.len())) {
            *other = steps[i][axis];
            count += 1;
        }
        median_of(&mut others[..count]).unwrap_or(0.0)
    };
    DVec3::from_array([0, 1, 2].map(along))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// Five points of a body that swings; the last swings about it besides.
    fn swing() -> Array2<f64> {
        Array2::from_shape_fn((400, 15), |(t, c)| {
            let (p, axis, t) = ((c / 3) as f64, (c % 3) as f64, t as f64);
            let own = if c >= 12 {
                20.0 * (t / 9.0 + axis).sin()
            } else {
                0.0
            };
            60.0 * (t / 40.0 + axis).sin() + 10.0 * (p * (1.0 + axis)).cos() + own
        })
    }

    #[test]
    fn a_track_that_goes_off_and_comes_back_is_found() {
        let truth = swing();
        let all = 0..400;
        let runs = std::slice::from_ref(&all);
        assert_eq!(stretches(truth.view(), runs, 120.0), []);
        for length in [1, 2, 6, 12, 30] {
            let mut xyz = truth.clone();
            let mut off = xyz.slice_mut(ndarray::s![150..150 + length, 3..6]);
            off += &ndarray::arr1(&[12.0, -8.0, 15.0]);
            let found = stretches(xyz.view(), runs, 120.0);
            assert_eq!(found.len(), 1, "{length}: {found:?}");
            assert_eq!(
                (found[0].point, &found[0].frames),
                (1, &(150..150 + length))
            );
            assert!((found[0].height - 20.8).abs() <= 1.0);
        }
    }

    #[test]
    fn one_that_stays_away_or_moves_fast_is_not() {
        let mut xyz = swing();
        let all = 0..400;
        xyz.slice_mut(ndarray::s![150..300, 3..6])
            .mapv_inplace(|v| v + 15.0);
        assert_eq!(stretches(xyz.view(), std::slice::from_ref(&all), 120.0), []);
        // A whole body that is elsewhere keeps its distances.
        let mut xyz = swing();
        xyz.slice_mut(ndarray::s![150..160, ..])
            .mapv_inplace(|v| v + 30.0);
        assert_eq!(stretches(xyz.view(), std::slice::from_ref(&all), 120.0), []);
    }
}

//! The floor under stances, and what levels a take on it.
//!
//! A point p of a foot that stands at (x, z) at the time t is at
//!
//! y = a_p + b x + c z + d(t),
//!
//! with b, c the slope and d, which begins with 0, a line or a chain of lines: slow sinking. Each
//! point has its own a_p, so neither ankles nor a foot that is captured higher than the other tell
//! a slope. The fit is by iteratively reweighted least squares under Tukey's weights, whose width
//! falls from far to near (graduated non-convexity, Blake and Zisserman 1987): where feet rest
//! above the floor does not count. Slope and drift are there if they take more from the truncated
//! sum of squares than parameters of noise would. Stances are looked at in pieces, so steps of
//! stairs, level each, are no slow drift.

use super::stance::Sample;
use super::tuning::*;
use crate::numeric::small_linalg::{backward, factorize, forward};
use crate::numeric::statistics::median;
use crate::pose::rotation::shortest_arc;
use glam::{DMat3, DVec3};
use std::ops::Range;

/// What is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Model {
    /// Pieces of the drift; none: the floor stays.
    pieces: usize,
    /// Directions along which the floor slopes: that along which stances lie farther apart, then
    /// the one across.
    slopes: usize,
}

impl Model {
    /// A level floor that stays.
    const STILL: Model = Model {
        pieces: 0,
        slopes: 0,
    };
}

/// What stances say of a floor.
#[derive(Debug, Clone)]
pub(super) struct Floor {
    /// The heights of the points that stand, over the pivot at the first frame; NaN: unknown.
    pub heights: Vec<f64>,
    /// How much it rises by a cm along x and z.
    pub slope: [f64; 2],
    /// How much higher it is at equal times than at the first frame; one value: it stays.
    drift: Vec<f64>,
    /// The point (x, z) of `heights`.
    pivot: [f64; 2],
    /// Seconds of the take.
    seconds: f64,
    /// The shares of the time of stances in which a point is on it, and in which all are below.
    shares: [f64; 2],
}

/// The part of each knot in the drift at a time: two neighbors share it.
fn hats(time: f64, seconds: f64, pieces: usize) -> [(usize, f64); 2] {
    let at = (time / seconds.max(1e-9) * pieces as f64).clamp(0.0, pieces as f64);
    let before = (at.floor() as usize).min(pieces.saturating_sub(1));
    let share = at - before as f64;
    [(before, 1.0 - share), (before + 1, share)]
}

impl Floor {
    /// The floor of samples of `tracks` points in a take of `seconds`, around `pivot`; `unit`
    /// counts as a centimeter.
    pub(super) fn find(
        samples: &[Sample],
        tracks: usize,
        seconds: f64,
        pivot: [f64; 2],
        unit: f64,
    ) -> Floor {
        let fit = Fit {
            samples,
            tracks,
            seconds,
            pivot,
            unit,
            axes: axes(samples, tracks),
        };
        let curved = ((seconds / KNOT).round() as usize).max(1);
        let mut models = vec![];
        for slopes in 0..=2 {
            models.extend([0, 1].map(|pieces| Model { pieces, slopes }));
            if curved > 1 {
                let pieces = curved;
                models.push(Model { pieces, slopes });
            }
        }
        let fitted: Vec<Floor> = models.iter().map(|model| fit.floor(*model)).collect();
        let noise = fitted.iter().map(|floor| fit.noise(floor));
        let noise = noise.fold(f64::INFINITY, f64::min);
        let cost = |(model, floor): (&Model, &Floor)| {
            let [slopes, pieces] = [model.slopes, model.pieces].map(|n| n as f64);
            fit.truncated(floor, noise) + PENALTY[0] * slopes + PENALTY[1] * pieces
        };
        let costs: Vec<f64> = models.iter().zip(&fitted).map(cost).collect();
        let mut order: Vec<usize> = (0..models.len()).collect();
        order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]));
        let can_be = |n: &usize| fit.can_be(models[*n], &fitted[*n]);
        let possible: Vec<usize> = order.into_iter().filter(can_be).collect();
        let is_sure = |n: &&usize| fit.is_sure(models[**n], &fitted[**n]);
        let sure = possible.iter().find(is_sure).map_or(0, |n| *n);
        // Stances that are too few to be sure of a slope may be on one all the same.
        let shares = possible.iter().map(|n| fitted[*n].shares);
        let shares = shares.max_by(|a, b| a[0].total_cmp(&b[0]));
        Floor {
            shares: shares.unwrap_or([0.0; 2]),
            ..fitted[sure].clone()
        }
    }

    /// The slope, degrees.
    pub(super) fn degrees(&self) -> f64 {
        self.slope[0].hypot(self.slope[1]).atan().to_degrees()
    }

    /// The direction that is up on it.
    pub(super) fn normal(&self) -> DVec3 {
        DVec3::new(-self.slope[0], 1.0, -self.slope[1]).normalize()
    }

    /// How far apart the heights of the drift are.
    fn sinks_by(&self) -> f64 {
        let ends = |f: fn(f64, f64) -> f64| self.drift.iter().copied().fold(0.0, f);
        ends(f64::max) - ends(f64::min)
    }

    /// How much it sinks from the first to the last frame.
    pub(super) fn sunk(&self) -> f64 {
        0.0 - self.drift.last().copied().unwrap_or(0.0)
    }

    /// How much higher it is at a time than at the first frame.
    pub(super) fn drift(&self, time: f64) -> f64 {
        let pieces = self.drift.len() - 1;
        if pieces == 0 {
            return 0.0;
        }
        let parts = hats(time, self.seconds, pieces);
        parts
            .iter()
            .map(|(knot, part)| part * self.drift[*knot])
            .sum()
    }

    /// The height of a point's floor where a sample is.
    fn height(&self, sample: &Sample) -> f64 {
        let [x, z] = [sample.at.x - self.pivot[0], sample.at.z - self.pivot[1]];
        let flat = self.heights[sample.track] + self.drift(sample.time);
        flat + self.slope[0] * x + self.slope[1] * z
    }

    /// Whether it neither slopes nor moves.
    pub(super) fn is_level(&self) -> bool {
        self.slope == [0.0; 2] && self.drift.len() == 1
    }

    /// Whether most stances are on it, and hardly any below.
    pub(super) fn is_one(&self) -> bool {
        self.shares[0] >= MOST && self.shares[1] < LOWER
    }

    /// The height of the lowest points that stand: the mean of those within a centimeter.
    pub(super) fn lowest(&self, unit: f64) -> f64 {
        let known = self.heights.iter().copied().filter(|h| h.is_finite());
        let low = known.clone().fold(f64::INFINITY, f64::min);
        let near: Vec<f64> = known.filter(|h| *h <= low + unit).collect();
        near.iter().sum::<f64>() / near.len() as f64
    }

    /// What carries a take of `rate` frames a second onto a level floor on which the lowest points
    /// stand at `target`.
    pub(super) fn level(self, lowest: f64, target: f64, rate: f64) -> Level {
        let [x, z] = self.pivot;
        Level {
            turn: shortest_arc(self.normal(), DVec3::Y).unwrap_or(DMat3::IDENTITY),
            from: DVec3::new(x, lowest, z),
            to: DVec3::new(x, target, z),
            floor: self,
            rate,
        }
    }
}

/// A rigid motion onto a level floor, another in each frame where the floor drifts.
#[derive(Debug, Clone)]
pub(super) struct Level {
    /// What turns all directions.
    pub turn: DMat3,
    /// The floor as it was.
    pub floor: Floor,
    from: DVec3,
    to: DVec3,
    /// Frames per second.
    pub rate: f64,
}

impl Level {
    /// Where a point of a frame comes.
    pub(super) fn place(&self, frame: usize, point: DVec3) -> DVec3 {
        if self.is_still() {
            return point;
        }
        let drift = self.floor.drift(frame as f64 / self.rate);
        self.turn * (point - self.from - drift * DVec3::Y) + self.to
    }

    /// The positions of a point, where they come.
    pub(super) fn places(&self, points: &[DVec3]) -> Vec<DVec3> {
        let place = |(t, p): (usize, &DVec3)| self.place(t, *p);
        points.iter().enumerate().map(place).collect()
    }

    /// How high a point of a foot stands then.
    pub(super) fn height(&self, track: usize) -> f64 {
        self.floor.heights[track] - self.from.y + self.to.y
    }

    /// Whether it moves nothing.
    pub(super) fn is_still(&self) -> bool {
        self.from == self.to && self.floor.is_level()
    }
}

/// The samples of a take.
struct Fit<'a> {
    samples: &'a [Sample],
    tracks: usize,
    seconds: f64,
    pivot: [f64; 2],
    unit: f64,
    /// The directions of slopes.
    axes: [[f64; 2]; 2],
}

/// The direction (x, z) along which the stances of each point lie farthest apart, and that across.
fn axes(samples: &[Sample], tracks: usize) -> [[f64; 2]; 2] {
    let (mut xx, mut xz, mut zz) = (0.0, 0.0, 0.0);
    for track in 0..tracks {
        let own = || samples.iter().filter(|s| s.track == track);
        let all: f64 = own().map(|s| s.weight).sum();
        let mean = own().map(|s| s.weight * s.at).sum::<DVec3>() / all;
        for s in own() {
            let d = s.at - mean;
            xx += s.weight * d.x * d.x;
            xz += s.weight * d.x * d.z;
            zz += s.weight * d.z * d.z;
        }
    }
    let (sin, cos) = (f64::atan2(2.0 * xz, xx - zz) / 2.0).sin_cos();
    [[cos, sin], [-sin, cos]]
}

impl Fit<'_> {
    /// The floor of a model.
    fn floor(&self, model: Model) -> Floor {
        let mut floor = self.without(model, 0..0);
        floor.shares = self.shares(&floor);
        floor
    }

    /// The floor of a model, without the samples of a part of the take.
    fn without(&self, model: Model, part: Range<usize>) -> Floor {
        let own = |(n, s): (usize, &Sample)| if part.contains(&n) { 0.0 } else { s.weight };
        let own: Vec<f64> = self.samples.iter().enumerate().map(own).collect();
        let mut floor = self.weighted(model, &own);
        for width in WIDTHS {
            for _ in 0..FITS {
                let weight = |(sample, own): (&Sample, &f64)| {
                    let share = (sample.at.y - floor.height(sample)) / (width * self.unit);
                    own * (1.0 - share * share).max(0.0).powi(2)
                };
                let weights: Vec<f64> = self.samples.iter().zip(&own).map(weight).collect();
                floor = self.weighted(model, &weights);
            }
        }
        floor
    }

    /// Whether slope and drift change heights at all, and are no steeper than floors are.
    fn can_be(&self, model: Model, floor: &Floor) -> bool {
        let least = EFFECT * self.unit;
        let is_slope = (LEVEL..=STEEPEST).contains(&floor.degrees()) && self.rise(floor) >= least;
        (model.slopes == 0 || is_slope) && (model.pieces == 0 || floor.sinks_by() >= least)
    }

    /// Whether slope and drift are larger than their standard errors by far: by the jackknife over
    /// parts of the take, as the errors of a stance are one error.
    fn is_sure(&self, model: Model, floor: &Floor) -> bool {
        if model == Model::STILL {
            return true;
        }
        let count = self.samples.len();
        let parts = (0..PARTS).map(|n| n * count / PARTS..(n + 1) * count / PARTS);
        let others: Vec<Vec<f64>> = parts
            .map(|part| self.parameters(model, &self.without(model, part)))
            .collect();
        let own = self.parameters(model, floor);
        let error = |k: usize| {
            let far = others
                .iter()
                .map(|other| (other[k] - own[k]).powi(2))
                .sum::<f64>();
            (far * (PARTS - 1) as f64 / PARTS as f64).sqrt()
        };
        let sizes: Vec<f64> = (0..own.len())
            .map(|k| own[k].abs() / error(k).max(1e-12))
            .collect();
        let (slopes, knots) = sizes.split_at(model.slopes);
        slopes.iter().all(|size| *size >= SURE)
            && (knots.is_empty() || knots.iter().any(|size| *size >= SURE))
    }

    /// The slopes along the axes, then the knots of the drift.
    fn parameters(&self, model: Model, floor: &Floor) -> Vec<f64> {
        let [x, z] = floor.slope;
        let along = self
            .axes
            .iter()
            .take(model.slopes)
            .map(|axis| axis[0] * x + axis[1] * z);
        along.chain(floor.drift[1..].iter().copied()).collect()
    }

    /// The shares of the time of stances in which a point is on a floor, and in which those that
    /// stand are below it.
    fn shares(&self, floor: &Floor) -> [f64; 2] {
        let slot = |s: &Sample| (s.time / PIECE) as usize;
        let near = ON_FLOOR * self.unit;
        let mut slots = vec![[false; 3]; self.samples.iter().map(slot).max().map_or(0, |n| n + 1)];
        for s in self.samples {
            let residual = s.at.y - floor.height(s);
            let found = [true, residual.abs() <= near, residual < -near];
            let slot = &mut slots[slot(s)];
            (0..3).for_each(|n| slot[n] |= found[n]);
        }
        let count = |is: &dyn Fn(&[bool; 3]) -> bool| slots.iter().filter(|s| is(s)).count() as f64;
        let [all, on] = [0, 1].map(|n| count(&|slot| slot[n]));
        let below = count(&|slot| slot[2] && !slot[1]);
        [on / all.max(1.0), below / all.max(1.0)]
    }

    /// The floor of a model by weighted least squares, with what is expected of slope and drift.
    fn weighted(&self, model: Model, weights: &[f64]) -> Floor {
        let (k, pieces) = (self.tracks, model.pieces);
        let n = k + pieces + model.slopes;
        let (mut a, mut b) = (vec![0.0; n * n], vec![0.0; n]);
        let mut row = Vec::new();
        for (sample, weight) in self.samples.iter().zip(weights) {
            row.clear();
            row.push((sample.track, 1.0));
            if pieces > 0 {
                let parts = hats(sample.time, self.seconds, pieces);
                let knots = parts.iter().filter(|(knot, _)| *knot > 0);
                row.extend(knots.map(|(knot, part)| (k + knot - 1, *part)));
            }
            let [x, z] = [sample.at.x - self.pivot[0], sample.at.z - self.pivot[1]];
            let along = self.axes.iter().take(model.slopes).enumerate();
            row.extend(along.map(|(i, axis)| (k + pieces + i, axis[0] * x + axis[1] * z)));
            for (i, x) in &row {
                b[*i] += weight * x * sample.at.y;
                row.iter().for_each(|(j, y)| a[i * n + j] += weight * x * y);
            }
        }
        let noise = NOISE[0] * self.unit;
        for i in 0..n {
            let expected = match i {
                _ if i < k => 1e6 * self.unit,
                _ if i < k + pieces => EXPECTED[1] * self.unit,
                _ => EXPECTED[0],
            };
            a[i * n + i] += (noise / expected).powi(2);
        }
        factorize(&mut a, n);
        forward(&a, n, &mut b);
        backward(&a, n, &mut b);
        let is_seen = |track: &usize| {
            let own = self.samples.iter().zip(weights);
            own.filter(|(s, _)| s.track == *track)
                .map(|(_, w)| w)
                .sum::<f64>()
                > 0.0
        };
        Floor {
            heights: (0..k)
                .map(|p| if is_seen(&p) { b[p] } else { f64::NAN })
                .collect(),
            slope: [0, 1].map(|c| {
                let along = self.axes.iter().zip(&b[k + pieces..]);
                along.map(|(axis, slope)| axis[c] * slope).sum()
            }),
            drift: [&[0.0], &b[k..k + pieces]].concat(),
            pivot: self.pivot,
            seconds: self.seconds,
            shares: [0.0; 2],
        }
    }

    /// The standard deviation of what stands on a floor.
    fn noise(&self, floor: &Floor) -> f64 {
        let residuals = self
            .samples
            .iter()
            .map(|s| (s.at.y - floor.height(s)).abs());
        let near = residuals.filter(|r| *r <= ON_FLOOR * self.unit).collect();
        let deviation = 1.4826 * median(near).unwrap_or(f64::INFINITY);
        deviation.clamp(NOISE[0] * self.unit, NOISE[1] * self.unit)
    }

    /// The truncated sum of squares, in variances of a stance of a foot.
    fn truncated(&self, floor: &Floor, noise: f64) -> f64 {
        let square = |s: &Sample| {
            let residual = (s.at.y - floor.height(s)) / noise;
            // NaN: of a track that is nowhere on the floor.
            s.weight * residual.powi(2).min(TRUNCATED.powi(2))
        };
        // All points of a foot stand and err together.
        let feet = 2.0 / self.tracks.max(2) as f64;
        feet * self.samples.iter().map(square).sum::<f64>()
    }

    /// How far apart the heights of a slope are at the samples.
    fn rise(&self, floor: &Floor) -> f64 {
        let rise = |s: &Sample| floor.slope[0] * s.at.x + floor.slope[1] * s.at.z;
        crate::numeric::statistics::span(self.samples.iter().map(rise))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Two points of each of two feet that walk around a ring of 4 m: steps of half a second on a
    /// floor whose height at (x, z, seconds) is `height`, seen with errors of `noise` a step.
    fn walk(
        seconds: f64,
        noise: f64,
        seed: u64,
        height: impl Fn(f64, f64, f64) -> f64,
    ) -> Vec<Sample> {
        let mut rng = rng(seed, 0);
        let mut samples = Vec::new();
        for step in 0..(2.0 * seconds) as usize {
            let start = step as f64 / 2.0;
            let (sin, cos) = (start * 0.6).sin_cos();
            let error: f64 = StandardNormal.sample(&mut rng);
            for piece in 0..4 {
                let time = start + 0.125 * (piece as f64 + 0.5);
                for point in 0..2 {
                    let far = 200.0 + 5.0 * point as f64 + 18.0 * (step % 2) as f64;
                    let (x, z) = (far * cos, far * sin);
                    let y = height(x, z, time) + [2.0, 1.0][point] + noise * error;
                    samples.push(Sample {
                        track: 2 * (step % 2) + point,
                        time,
                        at: DVec3::new(x, y, z),
                        weight: 0.25,
                        seconds: 0.125,
                    });
                }
            }
        }
        samples
    }

    fn find(samples: &[Sample], seconds: f64) -> Floor {
        Floor::find(samples, 4, seconds, [0.0; 2], 1.0)
    }

    #[test]
    fn a_floor_that_slopes_and_sinks_is_found() {
        let samples = walk(8.0, 0.3, 1, |x, z, t| 5.0 + 0.05 * x - 0.03 * z - 2.0 * t);
        let floor = find(&samples, 8.0);
        assert!((floor.slope[0] - 0.05).abs() <= 0.003, "{:?}", floor.slope);
        assert!((floor.slope[1] + 0.03).abs() <= 0.003, "{:?}", floor.slope);
        assert!((floor.sunk() - 16.0).abs() <= 1.0, "{}", floor.sunk());
        assert!((floor.lowest(1.5) - 6.5).abs() <= 0.6 && floor.is_one());
        // Where it is carried, points stand level.
        let target = floor.lowest(0.5);
        let level = floor.level(target, 0.0, 8.0);
        for s in &samples {
            let place = level.place((s.time * 8.0).round() as usize, s.at);
            assert!((place.y - [1.0, 0.0][s.track % 2]).abs() <= 1.5, "{place}");
        }
    }

    #[test]
    fn noise_is_neither_slope_nor_drift() {
        for seed in 0..20 {
            let floor = find(&walk(6.0, 0.4, seed, |_, _, _| 1.0), 6.0);
            assert!(floor.is_level() && floor.is_one(), "{seed}: {floor:?}");
        }
    }

    #[test]
    fn drift_that_turns_back_is_followed() {
        let sinking = |t: f64| 6.0 * (t / 40.0 * std::f64::consts::PI).sin();
        let floor = find(&walk(40.0, 0.2, 3, |_, _, t| -sinking(t)), 40.0);
        for t in [5.0, 20.0, 35.0] {
            assert!(
                (floor.drift(t) + sinking(t)).abs() <= 1.0,
                "{t}: {}",
                floor.drift(t)
            );
        }
    }

    #[test]
    fn stairs_and_boxes_are_no_slope_and_no_drift() {
        // Up a straight staircase: 18 cm every half second, level while a foot stands.
        let mut stairs = walk(8.0, 0.0, 1, |_, _, t| 18.0 * (2.0 * t).floor());
        for s in &mut stairs {
            s.at.x = 28.0 * (2.0 * s.time).floor();
            s.at.z = 9.0 * (s.track / 2) as f64;
        }
        let floor = find(&stairs, 8.0);
        assert!(floor.is_level() && !floor.is_one(), "{floor:?}");
        // At times on a box: the floor is the lower, if most of the time is spent there.
        let on_box = |edge: f64| {
            let height = move |x: f64| if x > edge { 40.0 } else { 0.0 };
            find(&walk(8.0, 0.1, 1, |x, _, _| height(x)), 8.0)
        };
        assert!(on_box(100.0).is_level() && on_box(100.0).is_one());
        assert!((on_box(100.0).lowest(0.5) - 1.0).abs() <= 0.2);
        assert!(on_box(-100.0).is_level() && !on_box(-100.0).is_one());
    }

    #[test]
    fn feet_that_rest_above_the_floor_do_not_count() {
        let mut samples = walk(8.0, 0.1, 2, |_, _, _| 0.0);
        let lifted: Vec<Sample> = samples.iter().take(30).copied().collect();
        samples.extend(lifted.into_iter().map(|mut s| {
            s.at.y += 35.0;
            s
        }));
        samples.sort_by(|a, b| a.time.total_cmp(&b.time));
        let floor = find(&samples, 8.0);
        assert!(floor.is_level() && floor.is_one());
        assert!((floor.lowest(0.5) - 1.0).abs() <= 0.2);
    }

    #[test]
    fn few_samples_are_no_fault() {
        for count in [0, 1, 2] {
            let floor = find(&walk(1.0, 0.0, 1, |_, _, _| 3.0)[..count], 1.0);
            assert!(floor.is_level() && floor.is_one() == (count > 0));
        }
    }
}

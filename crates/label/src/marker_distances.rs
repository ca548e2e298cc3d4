//! The distances between points of a take: how long they are, and how steady.

use super::tuning::marker_distances::*;
use crate::numeric::parallel;
use crate::numeric::statistics::{at_ranks, median};
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// The distance of two points over a take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// The median, cm.
    pub median: f64,
    /// Standard deviation by the 10th and 90th percentiles, cm.
    pub spread: f64,
    /// Standard deviation by the 5th and 95th percentiles, cm: larger where a tenth of the lengths
    /// differ.
    pub tails: f64,
    /// In how many frames it was measured.
    pub frames: usize,
}

impl Distance {
    /// The distance of two points of `xyz` (frames, 3 J; cm, NaN missing). `None` where they are
    /// never seen together.
    pub fn measure(xyz: ArrayView2<'_, f64>, points: [usize; 2]) -> Option<Distance> {
        Distance::within(xyz, points, std::slice::from_ref(&(0..xyz.nrows())))
    }

    /// The distance of two points in some frames.
    pub(crate) fn within(
        xyz: ArrayView2<'_, f64>,
        [a, b]: [usize; 2],
        frames: &[Range<usize>],
    ) -> Option<Distance> {
        let count: usize = frames.iter().map(ExactSizeIterator::len).sum();
        let step = count.div_ceil(MOST_FRAMES).max(1);
        let all = frames.iter().flat_map(|r| r.clone().step_by(step));
        let lengths = all.map(|t| point_at(xyz, t, a).distance(point_at(xyz, t, b)));
        Distance::of(lengths.filter(|l| l.is_finite()).collect())
    }

    /// How little it says, cm: its spread, and a little for its length.
    pub(crate) fn looseness(&self) -> f64 {
        self.spread + LOOSER * self.median
    }

    /// The distance whose measured lengths, cm, these are; `None` of none.
    pub fn of(mut lengths: Vec<f64>) -> Option<Distance> {
        let last = lengths.len().checked_sub(1)?;
        let ranks = [0.95, 0.9, 0.5, 0.1, 0.05].map(|share| (share * last as f64).round() as usize);
        let [most, high, median, low, least] = at_ranks(&mut lengths, ranks);
        Some(Distance {
            median,
            // Of a Gaussian these are 2.56 standard deviations apart.
            spread: (high - low) / 2.563,
            tails: (most - least) / 3.29,
            frames: lengths.len(),
        })
    }
}

/// The distances of all pairs of points of a take.
pub(crate) struct Distances {
    /// Distances to later points, by point.
    rows: Vec<Vec<Option<Distance>>>,
}

impl Distances {
    /// Measures those of the points of `xyz` (frames, 3 J; cm, NaN missing).
    pub(crate) fn measure(xyz: ArrayView2<'_, f64>) -> Distances {
        let points = xyz.ncols() / 3;
        let step = xyz.nrows().div_ceil(MOST_FRAMES).max(1);
        let track = |point: usize| -> Vec<DVec3> {
            let frames = (0..xyz.nrows()).step_by(step);
            frames.map(|t| point_at(xyz, t, point)).collect()
        };
        let tracks: Vec<Vec<DVec3>> = (0..points).map(track).collect();
        let row = |range: Range<usize>| {
            let own = &tracks[range.start];
            let of = |other: &Vec<DVec3>| {
                let lengths = own.iter().zip(other).map(|(a, b)| a.distance(*b));
                let known = Distance::of(lengths.filter(|l| l.is_finite()).collect());
                known.filter(|d| d.frames >= FEWEST_FRAMES)
            };
            tracks[range.start + 1..].iter().map(of).collect::<Vec<_>>()
        };
        Distances {
            rows: parallel::map_chunks(points, 1, row),
        }
    }

    pub(crate) fn points(&self) -> usize {
        self.rows.len()
    }

    /// The distance of two points; `None` where it is known in too few frames, or they are one.
    pub(crate) fn between(&self, a: usize, b: usize) -> Option<Distance> {
        let (first, last) = (a.min(b), a.max(b));
        *self.rows[first].get(last.checked_sub(first + 1)?)?
    }

    /// How far apart the steady distances are from those of others, cm, in the median, or a body
    /// of half a meter by the ratio of sizes; `None` where both know few.
    pub(crate) fn off(&self, others: impl Fn(usize, usize) -> Option<Distance>) -> Option<f64> {
        let steady = |a: usize, b: usize| {
            let both = [self.between(a, b)?, others(a, b)?];
            let is_rigid = both
                .iter()
                .all(|d| d.spread < RIGID && d.median < RIGID_NEAR);
            is_rigid.then(|| both.map(|d| d.median))
        };
        let pairs = (0..self.points()).flat_map(|a| (0..a).map(move |b| (a, b)));
        let both: Vec<[f64; 2]> = pairs.filter_map(|(a, b)| steady(a, b)).collect();
        if both.len() < FEWEST_RIGID {
            return None;
        }
        let off = median(both.iter().map(|[a, b]| (a - b).abs()).collect())?;
        // A whole body that is a little larger has short distances that hardly differ.
        let long = both.iter().filter(|[a, _]| *a >= RIGID_LONG);
        let ratio = median(long.map(|[a, b]| (a / b).ln()).collect()).unwrap_or(0.0);
        Some(off.max(BODY * ratio.abs()))
    }

    /// The other points and their distances, the most rigid first.
    pub(crate) fn most_rigid(&self, point: usize) -> Vec<(usize, Distance)> {
        let others = 0..self.points();
        let known = others.filter_map(|other| Some((other, self.between(point, other)?)));
        let mut all: Vec<(usize, Distance)> = known.collect();
        all.sort_by(|a, b| a.1.looseness().total_cmp(&b.1.looseness()));
        all
    }
}

/// How much likelier a length is as that of a distance than as that to any point, nats; both may be
/// wrong now and then.
pub(crate) fn log_likelihood(length: f64, distance: &Distance) -> f64 {
    let sd = distance.spread.max(LEAST_SPREAD);
    let z = (length - distance.median) / sd;
    let density = (-0.5 * z * z).exp() / (sd * (2.0 * std::f64::consts::PI).sqrt());
    ((1.0 - ANY) * density * ANYWHERE + ANY).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn a_distance_is_measured_though_a_tenth_is_off() {
        let xyz = Array2::from_shape_fn((200, 6), |(t, c)| match c {
            3 if t % 12 == 0 => 90.0,
            3 => 10.0 + 0.1 * (t as f64).sin(),
            5 if t < 20 => f64::NAN,
            _ => 0.0,
        });
        let found = Distance::measure(xyz.view(), [0, 1]).unwrap();
        assert_eq!(found.frames, 180);
        assert!(
            (found.median - 10.0).abs() <= 0.03 && found.spread <= 0.1,
            "{found:?}"
        );
        assert_eq!(
            Distance::measure(xyz.slice(ndarray::s![..20, ..]), [0, 1]),
            None
        );
    }
}

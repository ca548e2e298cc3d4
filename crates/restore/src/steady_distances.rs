//! Filled gaps whose point is much farther from others than they ever are, or much nearer.
//!
//! The distances of markers on one limb change by some centimeters of skin, too much for a fill to
//! be held to them. One that breaks them by more is off by as much at least.

use super::gap::Gap;
use super::take::TakeResult;
use super::tuning::clean::*;
use crate::pose::{Status, point_at};
use ndarray::ArrayView2;

/// The distances of one point of a take that hardly change.
#[derive(Clone)]
pub(crate) struct SteadyDistances {
    /// Other points, and the shortest and longest distance to each, cm.
    ranges: Vec<(usize, [f64; 2])>,
}

impl SteadyDistances {
    /// Measures them over the frames of `seen` (frames, 3 J; cm, NaN missing) that have the point.
    pub(crate) fn measure(seen: ArrayView2<'_, f64>, point: usize) -> SteadyDistances {
        let step = seen.nrows().div_ceil(STEADY_FRAMES).max(1);
        let range = |other: usize| {
            let frames = (0..seen.nrows()).step_by(step);
            let all = frames.map(|t| point_at(seen, t, point).distance(point_at(seen, t, other)));
            let (mut range, mut count) = ([f64::INFINITY, 0.0], 0);
            for distance in all.filter(|d| d.is_finite()) {
                range = [range[0].min(distance), range[1].max(distance)];
                count += 1;
            }
            (count >= FEWEST_STEADY && range[1] - range[0] <= STEADY).then_some((other, range))
        };
        let others = (0..seen.ncols() / 3).filter(|other| *other != point);
        SteadyDistances {
            ranges: others.filter_map(range).collect(),
        }
    }

    /// By how much the positions that fill a gap of the point break them at most, cm.
    pub(crate) fn broken_by(&self, gap: &Gap, filled: &TakeResult) -> f64 {
        let positions = filled.xyz.view();
        let at = |t: usize| {
            let own = point_at(positions, t, gap.point);
            let is_seen = move |other: usize| filled.state(t, other).status == Status::Observed;
            let seen = self.ranges.iter().filter(move |(other, _)| is_seen(*other));
            seen.map(move |(other, [least, most])| {
                let distance = own.distance(point_at(positions, t, *other));
                (least - distance).max(distance - most)
            })
        };
        gap.frames.clone().flat_map(at).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn a_fill_that_breaks_a_steady_distance_tells_by_how_much() {
        // Markers of one limb 20 to 22 cm apart, and one that goes away.
        let seen = Array2::from_shape_fn((200, 9), |(t, c)| match c {
            0 => 10.0 * (t as f64 / 9.0).sin(),
            3 => 10.0 * (t as f64 / 9.0).sin() + 21.0 + (t as f64).sin(),
            6 => t as f64,
            _ => 0.0,
        });
        let gap = Gap {
            point: 0,
            frames: 90..110,
            before: Some(89),
            after: Some(110),
        };
        let of = |off: f64| {
            let mut out = TakeResult::of(seen.clone());
            for t in gap.frames.clone() {
                out.set(t, 0, Status::Inferred, 2.0);
            }
            out.xyz[[100, 0]] -= off;
            SteadyDistances::measure(seen.view(), 0).broken_by(&gap, &out)
        };
        assert_eq!(of(0.0), 0.0);
        assert!((6.0..8.5).contains(&of(8.0)), "{}", of(8.0));
    }
}

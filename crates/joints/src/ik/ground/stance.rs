//! Where points of feet stand: pieces in which they are slow.

use super::tuning::*;
use crate::numeric::statistics::median;
use crate::pose::ranges;
use glam::DVec3;
use std::ops::Range;

/// The frames of [`WINDOW`].
pub(super) fn reach(rate: f64) -> usize {
    ((WINDOW * rate).round() as usize).max(1)
}

/// The speed of a point (frames; NaN missing) over [`WINDOW`] before and after a frame, cm/s; NaN
/// where it is missing.
pub(super) fn speed(points: &[DVec3], frame: usize, rate: f64) -> f64 {
    let reach = reach(rate);
    let (before, after) = (
        frame.saturating_sub(reach),
        (frame + reach).min(points.len() - 1),
    );
    points[after].distance(points[before]) * rate / (after - before) as f64
}

/// The frames in which a point is slower than `fastest`, cm/s, and `stands` says so, for as long as
/// a stance is at least; `unit` counts as a centimeter.
pub(super) fn stances(
    points: &[DVec3],
    [rate, unit]: [f64; 2],
    fastest: f64,
    stands: impl Fn(usize) -> bool,
) -> Vec<Range<usize>> {
    if points.len() < 2 {
        return Vec::new();
    }
    let is_slow = |t: &usize| stands(*t) && speed(points, *t, rate) < fastest * unit;
    let mut found = ranges((0..points.len()).filter(is_slow));
    found.retain(|range| range.len() as f64 >= LEAST * rate - 1e-6);
    found
}

/// Where a point is in a piece of a stance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Which of the points of feet.
    pub track: usize,
    /// Seconds from the first frame.
    pub time: f64,
    /// The median of each coordinate.
    pub at: DVec3,
    /// How much it counts; all samples of a stance of less than a second count 1 together.
    pub weight: f64,
    /// How long it lasts, seconds.
    pub seconds: f64,
}

/// The samples of a stance of a point.
pub(super) fn samples(
    track: usize,
    points: &[DVec3],
    stance: &Range<usize>,
    rate: f64,
) -> Vec<Sample> {
    let count = ((stance.len() as f64 / (PIECE * rate)).round() as usize).clamp(1, stance.len());
    let whole = stance.len() as f64 / rate;
    let one = |n: usize| {
        let edge = |n: usize| stance.start + n * stance.len() / count;
        let piece = edge(n)..edge(n + 1);
        let axis = |c: usize| median(points[piece.clone()].iter().map(|p| p[c]).collect());
        let seconds = piece.len() as f64 / rate;
        Some(Sample {
            track,
            time: (piece.start + piece.end - 1) as f64 / 2.0 / rate,
            at: DVec3::new(axis(0)?, axis(1)?, axis(2)?),
            weight: seconds / whole.min(COUNTS),
            seconds,
        })
    };
    (0..count).filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point that stands, moves by a meter in half a second, and stands, at a rate.
    fn track(rate: f64) -> Vec<DVec3> {
        let at = |t: usize| {
            let share = ((t as f64 / rate - 1.0) / 0.5).clamp(0.0, 1.0);
            DVec3::new(0.0, 2.0, 100.0 * share)
        };
        (0..(2.5 * rate) as usize).map(at).collect()
    }

    #[test]
    fn stances_are_those_of_any_rate() {
        for rate in [30.0, 120.0, 250.0] {
            let found = stances(&track(rate), [rate, 1.0], 30.0, |_| true);
            let seconds = |t: usize| t as f64 / rate;
            assert_eq!(found.len(), 2, "{rate}");
            assert!(
                (seconds(found[0].end) - 1.0).abs() <= 0.06,
                "{rate}: {found:?}"
            );
            assert!(
                (seconds(found[1].start) - 1.5).abs() <= 0.06,
                "{rate}: {found:?}"
            );
        }
        assert!(stances(&track(100.0), [100.0, 1.0], 30.0, |_| false).is_empty());
        for few in [&[][..], &[DVec3::ZERO], &[DVec3::NAN; 50]] {
            assert!(stances(few, [100.0, 1.0], 30.0, |_| true).is_empty());
        }
    }

    #[test]
    fn a_long_stance_counts_by_its_seconds() {
        let points = vec![DVec3::ONE; 600];
        let total = |stance: Range<usize>| -> f64 {
            let all = samples(0, &points, &stance, 100.0);
            all.iter().map(|s| s.weight).sum()
        };
        assert!((total(0..40) - 1.0).abs() <= 1e-9);
        assert!((total(0..600) - 6.0).abs() <= 1e-9);
        assert_eq!(samples(3, &points, &(7..8), 100.0)[0].time, 0.07);
    }
}

//! Cycles: from a foot's strike to its next, as 101 points.

use crate::axes::wrapped;
use crate::events::{Event, EventKind};
use crate::side::Side;
use glam::{DVec2, DVec3};
use serde::Serialize;

/// The points of a cycle: 0 to 100 percent.
pub const POINTS: usize = 101;
/// A longer one has a strike missing, seconds.
const LONGEST: f64 = 2.5;
/// Angles beyond it may go around at 180 degrees, where their mean is not that of their numbers.
const NEAR_BORDER: f64 = 150.0;

/// A cycle of a side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cycle {
    /// Whose.
    pub side: Side,
    /// Counted from 1 in time, a side.
    pub cycle: usize,
    /// The strike that begins it, seconds.
    pub start_s: f64,
    /// The strike that ends it.
    pub end_s: f64,
}

/// The cycles of both sides within a trial, whose frames are from `first` to `last` seconds.
pub(crate) fn cycles(events: &[Event], first: f64, last: f64) -> Vec<Cycle> {
    let of = |side: Side| {
        let strikes = events
            .iter()
            .filter(|e| e.side == side && e.kind == EventKind::FootStrike);
        let strikes: Vec<f64> = strikes.map(|e| e.time_s).collect();
        let is_inside = |t: f64| (first - 1e-6..=last + 1e-6).contains(&t);
        let pairs: Vec<[f64; 2]> = strikes.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        let whole = pairs
            .into_iter()
            .filter(move |[a, b]| b - a <= LONGEST && is_inside(*a) && is_inside(*b));
        whole.enumerate().map(move |(i, [start_s, end_s])| Cycle {
            side,
            cycle: i + 1,
            start_s,
            end_s,
        })
    };
    Side::BOTH.into_iter().flat_map(of).collect()
}

/// A curve between two times, which are in frames, as [`POINTS`] on lines between the frames;
/// empty (NaN) beside an empty value. Angles go around in the shorter way.
pub fn resampled(curve: &[DVec3], from: f64, to: f64, is_angle: bool) -> Vec<DVec3> {
    let at = |i: usize| {
        let t = from + (to - from) * i as f64 / (POINTS - 1) as f64;
        at_time(curve, t, is_angle)
    };
    (0..POINTS).map(at).collect()
}

/// A curve at a time in frames; NaN outside.
pub(crate) fn at_time(curve: &[DVec3], t: f64, is_angle: bool) -> DVec3 {
    let frame = (t + 1e-6).floor();
    let part = (t - frame).max(0.0);
    let value = |t: f64| {
        let t = Some(t).filter(|t| *t >= 0.0);
        t.and_then(|t| curve.get(t as usize))
            .copied()
            .unwrap_or(DVec3::NAN)
    };
    let (now, next) = (value(frame), value(frame + 1.0));
    if part < 1e-6 {
        now
    } else if is_angle {
        mapped(now + part * mapped(next - now, wrapped), wrapped)
    } else {
        now.lerp(next, part)
    }
}

/// The mean of cycles and their standard deviation (n - 1; NaN of one), each over those that have a
/// value there. Angles that come near 180 degrees in a cycle are averaged around it.
pub fn mean_and_sd(cycles: &[Vec<DVec3>], is_angle: bool) -> [Vec<DVec3>; 2] {
    let goes_around = [0, 1, 2].map(|axis| {
        let mut all = cycles.iter().flatten();
        is_angle && all.any(|v| v[axis].abs() > NEAR_BORDER)
    });
    let at = |i: usize| {
        let column = |axis: usize| {
            let values: Vec<f64> = cycles
                .iter()
                .map(|c| c[i][axis])
                .filter(|v| v.is_finite())
                .collect();
            statistics(&values, goes_around[axis])
        };
        [0, 1, 2].map(column)
    };
    let all: Vec<[[f64; 2]; 3]> = (0..POINTS).map(at).collect();
    [0, 1].map(|k| {
        all.iter()
            .map(|point| DVec3::from_array(point.map(|v| v[k])))
            .collect()
    })
}

/// Mean and standard deviation of values; those that go around are taken around the direction of
/// their mean.
fn statistics(values: &[f64], goes_around: bool) -> [f64; 2] {
    if values.is_empty() {
        return [f64::NAN; 2];
    }
    let turned = |v: f64| DVec2::from_angle(v.to_radians());
    let center = values
        .iter()
        .map(|v| turned(*v))
        .sum::<DVec2>()
        .to_angle()
        .to_degrees();
    let (center, apart): (f64, &dyn Fn(f64) -> f64) = if goes_around {
        (center, &|v| wrapped(v - center))
    } else {
        (0.0, &|v| v)
    };
    let count = values.len() as f64;
    let mean = values.iter().map(|v| apart(*v)).sum::<f64>() / count;
    let spread: f64 = values.iter().map(|v| (apart(*v) - mean).powi(2)).sum();
    let sd = (spread / (count - 1.0)).sqrt();
    let mean = if goes_around {
        wrapped(center + mean)
    } else {
        mean
    };
    [mean, if count > 1.0 { sd } else { f64::NAN }]
}

fn mapped(v: DVec3, f: impl Fn(f64) -> f64) -> DVec3 {
    DVec3::new(f(v.x), f(v.y), f(v.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_read_on_lines_and_angles_go_around() {
        let curve = [170.0, -170.0, f64::NAN, 4.0].map(DVec3::splat);
        let read = |t: f64, is_angle: bool| at_time(&curve, t, is_angle).x;
        assert!((read(0.5, false) - 0.0).abs() < 1e-9 && (read(0.75, true) + 175.0).abs() < 1e-9);
        assert!(read(1.5, true).is_nan() && read(3.0, true) == 4.0 && read(3.1, true).is_nan());
        let cycles = [179.0, -179.0].map(|v| vec![DVec3::splat(v); POINTS]);
        let [mean, sd] = mean_and_sd(&cycles, true);
        assert!((mean[5].x + 180.0).abs() < 1e-9 && (sd[5].x - 2f64.sqrt()).abs() < 1e-9);
        let [_, sd] = mean_and_sd(&cycles[..1], true);
        assert!(sd[0].x.is_nan());
    }
}

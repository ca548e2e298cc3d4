//! Spatio-temporal values of a cycle, as Vicon's ANALYSIS has them, and how alike both sides are.

use crate::axes::wrapped;
use crate::cycles::{Cycle, at_time};
use crate::events::{Event, EventKind};
use crate::markers::Markers;
use crate::side::Side;
use glam::DVec3;
use std::collections::BTreeMap;

/// The values of a cycle by name: `stride_time_s`, `cadence_steps_per_min`, `stride_length_m`,
/// `walking_speed_m_per_s`, `step_time_s`, `step_length_m`, `step_width_m`, `foot_off_percent`,
/// `opposite_foot_off_percent`, `opposite_foot_strike_percent`, `single_support_s` and
/// `double_support_s`. One whose event or marker is missing is not there.
pub type CycleValues = BTreeMap<&'static str, f64>;

/// The values of a cycle. Lengths are between the TOE markers. `rate` and `first` are the frames a
/// second and the time of the first.
pub(crate) fn values(
    cycle: &Cycle,
    events: &[Event],
    markers: &Markers,
    rate: f64,
    first: f64,
) -> CycleValues {
    let (start, end, side) = (cycle.start_s, cycle.end_s, cycle.side);
    let time = end - start;
    let next = |side: Side, kind: EventKind| {
        let mut own = events.iter().filter(|e| e.side == side && e.kind == kind);
        own.find(|e| start < e.time_s && e.time_s < end)
            .map(|e| e.time_s)
    };
    let toe = |side: Side, at: f64| {
        let track = markers
            .get(&format!("{}TOE", side.letter()))
            .unwrap_or_default();
        at_time(track, (at - first) * rate, false).with_z(0.0) / 1000.0
    };
    let off = next(side, EventKind::FootOff);
    let opposite_off = next(side.other(), EventKind::FootOff);
    let opposite_strike = next(side.other(), EventKind::FootStrike);
    let stride = toe(side, end) - toe(side, start);
    let length = stride.length();
    let along = stride / length;
    let percent = |t: f64| 100.0 * (t - start) / time;
    let opposite = opposite_strike.map(|t| toe(side.other(), t));
    let across = DVec3::Z.cross(along);
    let all = [
        ("stride_time_s", Some(time)),
        ("cadence_steps_per_min", Some(120.0 / time)),
        ("stride_length_m", Some(length)),
        ("walking_speed_m_per_s", Some(length / time)),
        ("step_time_s", opposite_strike.map(|t| end - t)),
        (
            "step_length_m",
            opposite.map(|p| (toe(side, end) - p).dot(along)),
        ),
        (
            "step_width_m",
            opposite.map(|p| (p - toe(side, start)).dot(across).abs()),
        ),
        ("foot_off_percent", off.map(percent)),
        ("opposite_foot_off_percent", opposite_off.map(percent)),
        ("opposite_foot_strike_percent", opposite_strike.map(percent)),
        (
            "single_support_s",
            opposite_off.zip(opposite_strike).map(|(a, b)| b - a),
        ),
        (
            "double_support_s",
            opposite_off
                .zip(off.zip(opposite_strike))
                .map(|(a, (c, b))| (a - start) + (c - b)),
        ),
    ];
    let known = all
        .into_iter()
        .filter_map(|(name, value)| Some((name, value?)));
    known.filter(|(_, value)| value.is_finite()).collect()
}

/// How far both sides' values are apart, in percent of their mean size; 0 is alike.
pub fn symmetry(left: f64, right: f64) -> f64 {
    100.0 * (left - right).abs() / (0.5 * (left.abs() + right.abs()))
}

/// The ranges of an angle's x, y and z within a cycle, degrees, each on from the value before, so
/// that 180 and -180 are one; NaN where it is empty at a point.
pub fn range(cycle: &[DVec3]) -> DVec3 {
    let Some(&first) = cycle.first() else {
        return DVec3::NAN;
    };
    let (mut at, mut most, mut least) = (first, first, first);
    for pair in cycle.windows(2) {
        let step = pair[1] - pair[0];
        at += DVec3::from_array(step.to_array().map(wrapped));
        (most, least) = (most.max(at), least.min(at));
    }
    // The minimum and the maximum of a missing value are those of the others.
    if at.is_nan() {
        DVec3::NAN
    } else {
        most - least
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::EventSource;

    #[test]
    fn values_are_those_by_hand() {
        let line = |y: f64, from: f64| -> Vec<DVec3> {
            (0..=120)
                .map(|t| DVec3::new(from + 10.0 * f64::from(t), y, 30.0))
                .collect()
        };
        let tracks = [("LTOE", line(100.0, 0.0)), ("RTOE", line(-50.0, 40.0))];
        let markers = Markers::new(tracks).unwrap();
        let event = |side, kind, time| Event::new(time, side, kind, EventSource::Plate, 2.0);
        let events = [
            event(Side::Right, EventKind::FootOff, 1.2),
            event(Side::Right, EventKind::FootStrike, 1.6),
            event(Side::Left, EventKind::FootOff, 1.7),
        ];
        let cycle = Cycle {
            side: Side::Left,
            cycle: 1,
            start_s: 1.0,
            end_s: 2.1,
        };
        let values = values(&cycle, &events, &markers, 100.0, 1.0);
        let near = |name: &str, right: f64| {
            assert!(
                (values[name] - right).abs() < 1e-9,
                "{name} {}",
                values[name]
            );
        };
        near("stride_length_m", 1.1);
        near("walking_speed_m_per_s", 1.0);
        near("step_length_m", 1.1 - 0.64);
        near("step_width_m", 0.15);
        near("single_support_s", 0.4);
        near("double_support_s", 0.3);
        near("foot_off_percent", 100.0 * 0.7 / 1.1);
        assert_eq!(symmetry(1.0, 3.0), 100.0);
        assert!(range(&[DVec3::ONE, DVec3::NAN]).is_nan());
        assert_eq!(range(&[DVec3::ONE, -DVec3::ONE]), DVec3::splat(2.0));
        let around = [179.0, -179.0, 178.0].map(DVec3::splat);
        assert_eq!(range(&around), DVec3::splat(3.0));
    }
}

//! The size of the body, and the axis that it stands along.

use super::{Finding, FindingKind, Limits, Take, median};

/// Fewer points are no body.
const FEWEST_POINTS: usize = 8;
/// How many times as long as upwards a body is along another axis, in the median, that stands along that one.
const LONGER: f64 = 1.5;

/// The extents of the points of a frame along each axis, in the median, cm; `None` for too few points.
pub(super) fn size(take: &Take<'_>) -> Option<[f64; 3]> {
    let extent = |t: usize, axis: usize| {
        let values = take.xyz.row(t).into_iter().skip(axis).step_by(3);
        let seen = values.filter(|v| v.is_finite());
        let (count, low, high) = seen.fold((0, f64::MAX, f64::MIN), |(n, l, h), v| {
            (n + 1, v.min(l), v.max(h))
        });
        (count >= FEWEST_POINTS).then_some(high - low)
    };
    let axis = |c: usize| median((0..take.xyz.nrows()).filter_map(|t| extent(t, c)).collect());
    Some([axis(0)?, axis(1)?, axis(2)?])
}

/// A body that no person has.
pub(super) fn wrong_unit(size: Option<[f64; 3]>, limits: &Limits) -> Option<Finding> {
    let longest = size?.into_iter().fold(0.0, f64::max);
    let [low, high] = limits.size;
    let is_wrong = !(low..=high).contains(&longest);
    is_wrong.then(|| Finding {
        kind: FindingKind::Unit,
        points: Vec::new(),
        frames: None,
        what: format!(
            "the body measures {longest:.1} cm (people: {low:.0} to {high:.0}): give the unit of the file with --units"
        ),
    })
}

/// A body that is longest along another axis than y all the time.
pub(super) fn wrong_axis(size: Option<[f64; 3]>) -> Option<Finding> {
    let [x, y, z] = size?;
    let (axis, longest) = if x > z { ("x", x) } else { ("z", z) };
    (longest > LONGER * y).then(|| Finding {
        kind: FindingKind::UpAxis,
        points: Vec::new(),
        frames: None,
        what: format!(
            "the body measures {y:.0} cm along y and {longest:.0} cm along {axis}: it lies, or {axis} is up (--up {axis})"
        ),
    })
}

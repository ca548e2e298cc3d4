//! The size of the body, and the axis that it stands along.

use super::{Finding, FindingKind, Limits, Take};
use crate::numeric::statistics::{median, span};
use crate::pose::stray::PointApart;

/// Fewer points are no body.
const FEWEST_POINTS: usize = 8;
/// How many times as long as upwards a body is along another axis, in the median, that stands along
/// that one.
const LONGER: f64 = 1.5;

/// The extents of the points of a frame along each axis, in the median, without those that stand
/// apart, cm; `None` for too few points.
pub(super) fn size(take: &Take<'_>, apart: &[PointApart]) -> Option<[f64; 3]> {
    let mut of_body = vec![true; take.points.len()];
    apart.iter().for_each(|a| of_body[a.point] = false);
    let extent = |t: usize, axis: usize| {
        let values = take.xyz.row(t).into_iter().skip(axis).step_by(3);
        let seen = values.zip(&of_body).filter(|(v, of)| **of && v.is_finite());
        let seen = seen.map(|(v, _)| *v);
        let (count, low, high) = seen.fold((0, f64::MAX, f64::MIN), |(n, l, h), v| {
            (n + 1, l.min(v), h.max(v))
        });
        (count >= FEWEST_POINTS).then_some(high - low)
    };
    let axis = |c: usize| median((0..take.xyz.nrows()).filter_map(|t| extent(t, c)).collect());
    Some([axis(0)?, axis(1)?, axis(2)?])
}

/// Points that stand far off all others, farther than any body is long.
pub(super) fn stray(take: &Take<'_>, apart: &[PointApart]) -> Vec<Finding> {
    let finding = |a: &PointApart| {
        let remedy = if moves(take, a.point) {
            "it is far from all other points"
        } else {
            "it is of no body; make its cells empty, or leave it out (trim, the option \
             `points`)"
        };
        let what = format!(
            "{} stands {:.1} m from the middle of all points: {remedy}",
            take.points[a.point],
            a.distance / 100.0
        );
        take.finding(FindingKind::Stray, &[a.point], None, what)
    };
    apart.iter().filter(|a| a.is_stray).map(finding).collect()
}

/// Whether a point moves by more than 10 cm along an axis.
fn moves(take: &Take<'_>, point: usize) -> bool {
    (0..3).any(|c| {
        let column = take.xyz.column(3 * point + c);
        span(column.iter().copied().filter(|v| v.is_finite())) > 10.0
    })
}

/// Whether the points are as high as a person, and farther apart than one: several people, or
/// props.
fn are_several([x, y, z]: [f64; 3], limits: &Limits) -> bool {
    let [low, high] = limits.size;
    (low..=high).contains(&y) && x.max(z) > high
}

/// A body that no person has.
pub(super) fn wrong_unit(size: Option<[f64; 3]>, limits: &Limits) -> Option<Finding> {
    let size = size?;
    let longest = size.into_iter().fold(0.0, f64::max);
    let [low, high] = limits.size;
    let is_wrong = !(low..=high).contains(&longest) && !are_several(size, limits);
    is_wrong.then(|| Finding {
        kind: FindingKind::Unit,
        points: Vec::new(),
        frames: None,
        what: format!(
            "the body measures {longest:.1} cm (people: {low:.0} to {high:.0}): give the unit of \
             the file with the option `units`"
        ),
    })
}

/// A body that is longest along another axis than y all the time.
pub(super) fn wrong_axis(size: Option<[f64; 3]>, limits: &Limits) -> Option<Finding> {
    let [x, y, z] = size?;
    let (axis, longest) = if x > z { ("x", x) } else { ("z", z) };
    let is_wrong = longest > LONGER * y && !are_several([x, y, z], limits);
    is_wrong.then(|| Finding {
        kind: FindingKind::UpAxis,
        points: Vec::new(),
        frames: None,
        what: format!(
            "the body measures {y:.0} cm along y and {longest:.0} cm along {axis}: it lies, or \
             {axis} is up (the option `up {axis}`)"
        ),
    })
}

//! The axes of segments, as models draw them: an origin and three ends at right angles, and what is
//! fixed to them.

use super::{EXACT, FEWEST_FRAMES, MOVES, Tracks};
use glam::DVec3;
use std::ops::RangeInclusive;

/// A take is one of joints where so large a share of its points is rigid to another.
const JOINTS: f64 = 0.9;
/// An end is no nearer to its origin, cm.
const NEAREST: f64 = 0.5;
/// Frames in which axes are looked for.
const TRIED: usize = 3;
/// More axes a point are those of a grid, which is no body.
const MOST_AXES: usize = 20;

/// An origin and three ends at right angles.
type Axes = [usize; 4];

/// The ends of axes, origins that are named after them, and what is fixed to them. A marker may be
/// the origin, stand on an axis, as that of a knee does beside its joint center, or be the first
/// of some points at one position.
pub(super) fn computed(tracks: Tracks<'_>) -> Vec<usize> {
    let moves = |p: &usize| tracks.extent(*p, |_| true).max_element() >= MOVES;
    let moving: Vec<usize> = (0..tracks.points()).filter(moves).collect();
    if are_joints(tracks, &moving) {
        return Vec::new();
    }
    let named = named(tracks);
    let mut is_computed = vec![false; tracks.points()];
    named.iter().flatten().for_each(|p| is_computed[*p] = true);
    let mut found = found(tracks, &moving);
    found.retain(|axes| !axes.iter().all(|p| is_computed[*p]));
    let all: Vec<Axes> = named.into_iter().chain(found.iter().copied()).collect();
    if all.is_empty() {
        return Vec::new();
    }
    let are_one = |p: usize, q: &usize| is_steady(tracks, p, *q, 0.0..=EXACT);
    let is_copy: Vec<bool> = (0..tracks.points())
        .map(|p| moving.contains(&p) && (0..p).any(|q| are_one(p, &q)))
        .collect();
    let has_copy = |p: usize| (p + 1..tracks.points()).any(|q| are_one(p, &q));
    let is_original = |p: usize| !is_copy[p] && has_copy(p);
    for axes @ [origin, ends @ ..] in &found {
        let is_drawn = |end: usize| is_of_ends(tracks, end, ends) || is_as_long(tracks, axes, end);
        for end in ends.iter().filter(|end| is_drawn(**end)) {
            is_computed[*end] |= !is_original(*end);
        }
        let is_named = is_of_ends(tracks, *origin, ends) || is_joint_center(tracks, *origin);
        is_computed[*origin] |= is_named;
    }
    for p in moving {
        let is_of = |axes: &Axes| is_fixed(tracks, axes, p);
        is_computed[p] |= is_copy[p] || !is_original(p) && all.iter().any(is_of);
    }
    let is_one = |p: &usize| is_computed[*p] || is_number(tracks, *p);
    (0..tracks.points()).filter(is_one).collect()
}

/// Whether some points are joints of a skeleton: nearly each keeps its distance to another.
fn are_joints(tracks: Tracks<'_>, moving: &[usize]) -> bool {
    let is_rigid = |p: &&usize| {
        let mut others = moving.iter().filter(|q| *q != *p);
        others.any(|q| is_steady(tracks, **p, *q, NEAREST..=f64::INFINITY))
    };
    let rigid = moving.iter().filter(is_rigid).count();
    rigid > 0 && rigid as f64 >= JOINTS * moving.len() as f64
}

/// Whether the distance of two points is the same in all frames to the last digit, and `within`
/// some range (cm).
fn is_steady(tracks: Tracks<'_>, p: usize, q: usize, within: RangeInclusive<f64>) -> bool {
    let (mut low, mut high, mut count) = (f64::INFINITY, 0_f64, 0);
    let [p_seen, q_seen] = [p, q].map(|point| &tracks.spans[point]);
    for t in p_seen.start.max(q_seen.start)..p_seen.end.min(q_seen.end) {
        let apart = (tracks.at(t, p) - tracks.at(t, q)).length();
        if !apart.is_finite() {
            continue;
        }
        count += 1;
        (low, high) = (low.min(apart), high.max(apart));
        if high - low > EXACT || !within.contains(&apart) {
            return false;
        }
    }
    count >= FEWEST_FRAMES
}

/// Axes by the names that Vicon's models give them: HEDO, HEDA, HEDL, HEDP.
fn named(tracks: Tracks<'_>) -> Vec<Axes> {
    let index = |name: String| tracks.names.iter().position(|n| *n == name);
    let of_origin = |name: &String| {
        let stem = name.strip_suffix('O')?;
        let [a, l, p] = ['A', 'L', 'P'].map(|end| index(format!("{stem}{end}")));
        let axes = [index(name.clone())?, a?, l?, p?];
        are_axes(tracks, &axes).then_some(axes)
    };
    tracks.names.iter().filter_map(of_origin).collect()
}

/// Axes by their right angles.
fn found(tracks: Tracks<'_>, moving: &[usize]) -> Vec<Axes> {
    let mut out: Vec<Axes> = Vec::new();
    for n in 0..TRIED {
        let t = (2 * n + 1) * tracks.frames() / (2 * TRIED);
        for origin in moving {
            let off = |p: &usize| (*p, tracks.at(t, *p) - tracks.at(t, *origin));
            let offs: Vec<(usize, DVec3)> = moving.iter().map(off).collect();
            for (i, (a, off)) in offs.iter().enumerate() {
                let next = offs[i + 1..].iter().filter(|b| are_square(*off, b.1));
                let next: Vec<&(usize, DVec3)> = next.collect();
                for (j, (b, off)) in next.iter().enumerate() {
                    let third = next[j + 1..].iter().filter(|c| are_square(*off, c.1));
                    let axes = third.map(|c| [*origin, *a, *b, c.0]);
                    out.extend(axes.filter(|axes| are_axes(tracks, axes)));
                    if out.len() > MOST_AXES * moving.len() {
                        return Vec::new();
                    }
                }
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Whether three ends are at right angles about an origin in all frames in which they are seen.
fn are_axes(tracks: Tracks<'_>, [o, ends @ ..]: &Axes) -> bool {
    let is_seen = |t: &usize| {
        ends.iter()
            .chain([o])
            .all(|p| tracks.at(*t, *p).is_finite())
    };
    let mut count = 0;
    for t in (0..tracks.frames()).filter(is_seen) {
        count += 1;
        let mut pairs = [[0, 1], [0, 2], [1, 2]].into_iter();
        if !pairs.all(|[a, b]| is_square(tracks, t, [*o, ends[a], ends[b]])) {
            return false;
        }
    }
    count >= FEWEST_FRAMES
}

/// Whether the axis to an end is as long as another in all frames, to the last digit.
fn is_as_long(tracks: Tracks<'_>, [o, ends @ ..]: &Axes, end: usize) -> bool {
    let length = |t: usize, p: usize| (tracks.at(t, p) - tracks.at(t, *o)).length();
    let is_other = |t: usize, p: usize| (length(t, p) - length(t, end)).abs() > EXACT;
    let mut others = ends.iter().filter(|p| **p != end);
    others.any(|p| !(0..tracks.frames()).any(|t| is_other(t, *p)))
}

/// Whether a point is fixed to axes, to the last digit: off them, or a joint center by its name.
fn is_fixed(tracks: Tracks<'_>, axes: &Axes, point: usize) -> bool {
    let steady = |q: &usize| is_steady(tracks, point, *q, NEAREST..=f64::INFINITY);
    let is_free = || is_joint_center(tracks, point) || !is_on_axis(tracks, axes, point);
    !axes.contains(&point) && axes.iter().all(steady) && is_free()
}

/// Whether a point stands on an axis: at right angles to the two others.
fn is_on_axis(tracks: Tracks<'_>, [o, ends @ ..]: &Axes, point: usize) -> bool {
    let is_seen = |t: &usize| {
        ends.iter()
            .chain([o, &point])
            .all(|p| tracks.at(*t, *p).is_finite())
    };
    let Some(t) = (0..tracks.frames()).find(is_seen) else {
        return false;
    };
    let square = ends
        .iter()
        .filter(|end| is_square(tracks, t, [*o, point, **end]));
    square.count() >= 2
}

/// Whether two ends are at a right angle about an origin in a frame, to the last digit.
fn is_square(tracks: Tracks<'_>, t: usize, [o, a, b]: [usize; 3]) -> bool {
    are_square(
        tracks.at(t, a) - tracks.at(t, o),
        tracks.at(t, b) - tracks.at(t, o),
    )
}

/// Whether two axes are at a right angle, to the last digit.
fn are_square(a: DVec3, b: DVec3) -> bool {
    // Few pairs need their lengths; NaN is no right angle.
    let off = a.dot(b).abs();
    off <= EXACT * (a.abs().element_sum() + b.abs().element_sum()) && {
        let (long, wide) = (a.length(), b.length());
        long >= NEAREST && wide >= NEAREST && off <= EXACT * (long + wide)
    }
}

/// Whether a point is called as three ends but for the last letter: LFOF0 of LFOF1, LFOF2, LFOF3.
fn is_of_ends(tracks: Tracks<'_>, point: usize, ends: &[usize; 3]) -> bool {
    let stem = |p: usize| {
        let name = tracks.own_name(p);
        let end = name.char_indices().next_back().map_or(0, |(at, _)| at);
        name[..end].to_string()
    };
    let own = stem(point);
    own.len() > 1 && ends.iter().all(|end| stem(*end) == own)
}

/// Whether a point is a number that a model wrote as one: two coordinates are always 0.
fn is_number(tracks: Tracks<'_>, point: usize) -> bool {
    let is_zero = |c: &usize| {
        tracks
            .xyz
            .column(3 * point + c)
            .iter()
            .all(|v| *v == 0.0 || v.is_nan())
    };
    (0..3).filter(is_zero).count() == 2
}

/// Whether a point is called a joint center: LHJC, or left_knee_joint_center.
fn is_joint_center(tracks: Tracks<'_>, point: usize) -> bool {
    let name = tracks.own_name(point);
    name.ends_with("jc") || name.contains("joint")
}

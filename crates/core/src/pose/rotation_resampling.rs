//! Motion in rotations at other times: each joint's rotation as a rotation, its position and its
//! single angles as numbers.
//!
//! A rotation is a unit quaternion q(t), of whose two signs each frame has the one nearer to the
//! frame before; its four numbers are filtered and interpolated (cubic splines), and what comes out
//! is divided by its length. That is the shortest way from frame to frame, at whatever place the
//! angles of the file wrap. Angles are then chosen near those of the frame before. It fails where a
//! joint turns by more than half a turn from frame to frame: nobody can tell which way.

use super::joint_angles::JointChannels;
use super::rotation::{Axis, decompose, nearest_equivalent_angle, three_axes};
use crate::numeric::anti_alias::AntiAlias;
use crate::numeric::butterworth::LowPass;
use crate::numeric::cubic_spline::CubicSpline;
use glam::{DMat3, DQuat};
use ndarray::{Array2, ArrayView2};
use std::f64::consts::PI;
use std::ops::Range;

/// So many equal frames on end were held.
const HELD: usize = 4;
/// Times that differ by less, in frames, are equal.
const EQUAL: f64 = 1e-6;

/// The frames of a result, by where they are among those of a take.
#[derive(Debug, Clone, PartialEq)]
pub struct Retiming {
    /// Where each frame of the result is, counted in frames from the first of the take; ascending.
    /// Before the first and after the last frame these are held.
    pub at: Vec<f64>,
    /// Filters that run first.
    pub low_pass: Option<LowPass>,
    /// The filter for a lower rate.
    pub anti_alias: Option<AntiAlias>,
}

impl Retiming {
    /// Frames of the take `step` apart, from its first on to its last, of so many; filtered where
    /// they are fewer.
    pub fn even(frames: usize, step: f64) -> Retiming {
        let count = ((frames.saturating_sub(1)) as f64 / step + EQUAL).floor() as usize + 1;
        Retiming {
            at: (0..count.min(count * frames))
                .map(|k| k as f64 * step)
                .collect(),
            low_pass: None,
            anti_alias: AntiAlias::new(1.0 / step),
        }
    }

    /// Whether the result is the take itself, of so many frames.
    pub fn is_identity(&self, frames: usize) -> bool {
        let is_own = |(k, at): (usize, &f64)| (at - k as f64).abs() <= EQUAL;
        self.low_pass.is_none()
            && self.anti_alias.is_none()
            && self.at.len() == frames
            && self.at.iter().enumerate().all(is_own)
    }
}

/// Values of channels (frames, channels; radians and centimeters, NaN is missing) at other times.
/// A frame of the result that lies between two frames has what both have, joint by joint: nothing
/// is interpolated across what is missing. What was held for four frames or more stays held.
///
/// ```
/// use ndarray::array;
/// use posing_core::pose::rotation::Axis;
/// use posing_core::pose::{JointChannels, Retiming, resampled_motion};
///
/// let neck = JointChannels {
///     joint: "neck".into(),
///     angles: vec![(0, Axis::Z)],
///     positions: Vec::new(),
/// };
/// // From 3 to -3 radians it is not far.
/// let motion = array![[3.0], [-3.0]];
/// let twice = resampled_motion(motion.view(), &[neck], &Retiming::even(2, 0.5));
/// assert!((twice[[1, 0]] - std::f64::consts::PI).abs() < 1e-9);
/// ```
pub fn resampled_motion(
    motion: ArrayView2<'_, f64>,
    joints: &[JointChannels],
    timing: &Retiming,
) -> Array2<f64> {
    let mut out = Array2::from_elem((timing.at.len(), motion.ncols()), f64::NAN);
    if motion.nrows() == 0 {
        return out;
    }
    let mut is_angle = vec![false; motion.ncols()];
    let mut is_done = vec![false; motion.ncols()];
    for joint in joints {
        joint.angles.iter().for_each(|(c, _)| is_angle[*c] = true);
        if let Some(axes) = three_axes(joint.angles.iter().map(|a| a.1)) {
            let columns = [0, 1, 2].map(|i| joint.angles[i].0);
            columns.iter().for_each(|c| is_done[*c] = true);
            resample_rotation(motion, columns, axes, timing, &mut out);
        }
    }
    for c in (0..motion.ncols()).filter(|c| !is_done[*c]) {
        let mut values = motion.column(c).to_vec();
        if is_angle[c] {
            unwrap(&mut values);
        }
        let seen: Vec<bool> = values.iter().map(|v| v.is_finite()).collect();
        let new = resampled(&[values], &seen, timing);
        new.into_iter()
            .enumerate()
            .for_each(|(k, value)| out[[k, c]] = value[0]);
    }
    out
}

/// Carries the rotation of three channels over.
fn resample_rotation(
    motion: ArrayView2<'_, f64>,
    columns: [usize; 3],
    axes: [Axis; 3],
    timing: &Retiming,
    out: &mut Array2<f64>,
) {
    let angles = |t: usize| columns.map(|c| motion[[t, c]]);
    let seen: Vec<bool> = (0..motion.nrows())
        .map(|t| angles(t).iter().all(|v| v.is_finite()))
        .collect();
    let mut quaternions = [0; 4].map(|_| vec![f64::NAN; seen.len()]);
    let mut before = DQuat::IDENTITY;
    for t in (0..seen.len()).filter(|t| seen[*t]) {
        let q = quaternion(axes, angles(t));
        before = if q.dot(before) < 0.0 { -q } else { q };
        let numbers = before.to_array();
        (0..4).for_each(|i| quaternions[i][t] = numbers[i]);
    }
    let mut near: Option<[f64; 3]> = None;
    let new = resampled(&quaternions, &seen, timing);
    for (k, q) in new.iter().enumerate().filter(|(_, q)| q[0].is_finite()) {
        let q = DQuat::from_slice(q).normalize();
        let own = timing.at[k].clamp(0.0, (seen.len() - 1) as f64).round() as usize;
        let start = angles(own).map(|v| if v.is_finite() { v } else { 0.0 });
        let angles = decompose(&DMat3::from_quat(q), axes, near.unwrap_or(start));
        (0..3).for_each(|i| out[[k, columns[i]]] = angles[i]);
        near = Some(angles);
    }
}

/// The angles of a motion (frames, channels; radians), each on the branch that is nearest to the
/// frame before, where it jumps by more than half a turn: the rotations stay. All other values stay
/// to the last bit.
pub fn without_jumps(motion: ArrayView2<'_, f64>, joints: &[JointChannels]) -> Array2<f64> {
    let mut out = motion.to_owned();
    for joint in joints.iter().filter(|joint| !joint.angles.is_empty()) {
        let columns: Vec<usize> = joint.angles.iter().map(|a| a.0).collect();
        let axes = three_axes(joint.angles.iter().map(|a| a.1));
        let mut before: Option<Vec<f64>> = None;
        for mut row in out.rows_mut() {
            let mut own: Vec<f64> = columns.iter().map(|c| row[*c]).collect();
            if !own.iter().all(|v| v.is_finite()) {
                continue;
            }
            let jumps = |(a, b): (&f64, &f64)| (a - b).abs() > PI;
            if let Some(near) = before.filter(|near| own.iter().zip(near).any(jumps)) {
                own = match axes {
                    Some(axes) => {
                        let q = quaternion(axes, [own[0], own[1], own[2]]);
                        let near = [near[0], near[1], near[2]];
                        decompose(&DMat3::from_quat(q), axes, near).to_vec()
                    }
                    None => (own.iter().zip(&near))
                        .map(|(angle, near)| nearest_equivalent_angle(*angle, *near))
                        .collect(),
                };
                columns.iter().zip(&own).for_each(|(c, v)| row[*c] = *v);
            }
            before = Some(own);
        }
    }
    out
}

/// The rotation that three angles about three axes make.
fn quaternion(axes: [Axis; 3], angles: [f64; 3]) -> DQuat {
    let turn = |i: usize| DQuat::from_axis_angle(axes[i].unit(), angles[i]);
    turn(0) * turn(1) * turn(2)
}

/// Adds whole turns so that no angle is further than half a turn from the one before.
fn unwrap(angles: &mut [f64]) {
    let mut before = f64::NAN;
    for angle in angles.iter_mut().filter(|v| v.is_finite()) {
        if before.is_finite() {
            *angle = nearest_equivalent_angle(*angle, before);
        }
        before = *angle;
    }
}

/// Numbers that are seen together, at other times: for each, one of each of `columns`.
fn resampled(columns: &[Vec<f64>], seen: &[bool], timing: &Retiming) -> Vec<Vec<f64>> {
    let mut out = vec![vec![f64::NAN; columns.len()]; timing.at.len()];
    let last = (seen.len() - 1) as f64;
    let at: Vec<f64> = timing.at.iter().map(|at| at.clamp(0.0, last)).collect();
    let held = held_runs(columns, seen);
    for run in runs(seen) {
        let first = at.partition_point(|at| *at < run.start as f64 - EQUAL);
        let end = at.partition_point(|at| *at <= (run.end - 1) as f64 + EQUAL);
        let x: Vec<f64> = run.clone().map(|t| t as f64).collect();
        for (i, column) in columns.iter().enumerate() {
            let mut y = column[run.clone()].to_vec();
            timing
                .low_pass
                .iter()
                .for_each(|filter| filter.apply(&mut y));
            timing
                .anti_alias
                .iter()
                .for_each(|filter| filter.apply(&mut y));
            let spline = CubicSpline::new(x.clone(), y);
            for k in first..end {
                out[k][i] = spline.value(at[k]);
            }
        }
    }
    for run in held {
        let first = at.partition_point(|at| *at < run.start as f64 - EQUAL);
        let end = at.partition_point(|at| *at <= (run.end - 1) as f64 + EQUAL);
        for row in out[first..end].iter_mut() {
            (row.iter_mut().zip(columns)).for_each(|(value, column)| *value = column[run.start]);
        }
    }
    out
}

/// The runs of frames on end that are seen.
fn runs(seen: &[bool]) -> Vec<Range<usize>> {
    let parts = seen.chunk_by(|a, b| a == b);
    let mut at = 0;
    let ranges = parts.map(|part| {
        at += part.len();
        (at - part.len()..at, part[0])
    });
    ranges
        .filter(|(_, seen)| *seen)
        .map(|(range, _)| range)
        .collect()
}

/// The runs of at least [`HELD`] equal frames.
fn held_runs(columns: &[Vec<f64>], seen: &[bool]) -> Vec<Range<usize>> {
    let is_equal = |t: usize| {
        seen[t - 1] && seen[t] && columns.iter().all(|c| c[t].to_bits() == c[t - 1].to_bits())
    };
    let mut out = Vec::new();
    let mut start = 0;
    for t in 1..=seen.len() {
        if t < seen.len() && is_equal(t) {
            continue;
        }
        if seen[start] && t - start >= HELD {
            out.push(start..t);
        }
        start = t;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::{angle_between, compose, from_rotation_vector};
    use glam::DVec3;
    use std::f64::consts::TAU;

    const ORDER: [Axis; 3] = [Axis::Z, Axis::X, Axis::Y];

    /// A joint of six channels: position, then angles.
    fn joint() -> Vec<JointChannels> {
        vec![JointChannels {
            joint: "hips".into(),
            angles: (3..6).zip(ORDER).collect(),
            positions: (0..3).zip([Axis::X, Axis::Y, Axis::Z]).collect(),
        }]
    }

    /// Three turns in three seconds while it sways.
    fn turn(s: f64) -> DMat3 {
        DMat3::from_rotation_y(TAU * s)
            * from_rotation_vector(DVec3::new((2.0 * s).sin(), 0.1, 0.7))
    }

    fn place(s: f64) -> [f64; 3] {
        [
            80.0 * s,
            90.0 + 4.0 * (5.0 * s).sin(),
            30.0 * (3.0 * s).cos(),
        ]
    }

    /// The motion at `rate` frames a second, with angles wrapped at half a turn.
    fn motion(rate: f64) -> Array2<f64> {
        let frames = (3.0 * rate) as usize + 1;
        let mut out = Array2::zeros((frames, 6));
        for t in 0..frames {
            let s = t as f64 / rate;
            let angles = decompose(&turn(s), ORDER, [0.0; 3]);
            let all = place(s).into_iter().chain(angles);
            all.enumerate().for_each(|(c, v)| out[[t, c]] = v);
        }
        out
    }

    fn rotation(row: &[f64]) -> DMat3 {
        let reversed = [ORDER[2], ORDER[1], ORDER[0]];
        compose(&reversed, &[row[5], row[4], row[3]])
    }

    #[test]
    fn a_turning_body_keeps_its_course_at_any_rate() {
        for (from, to, bound) in [
            (120.0, 30.0, 2e-4),
            (29.97, 30.0, 5e-3),
            (30.0, 100.0, 5e-3),
        ] {
            let own = motion(from);
            let new = resampled_motion(
                own.view(),
                &joint(),
                &Retiming::even(own.nrows(), from / to),
            );
            assert_eq!(
                new.nrows(),
                ((own.nrows() - 1) as f64 / from * to + 1e-6) as usize + 1
            );
            for (k, row) in new.rows().into_iter().enumerate() {
                let s = k as f64 / to;
                let bound = if (0.4..2.5).contains(&s) {
                    bound
                } else {
                    20.0 * bound
                };
                let error = angle_between(&rotation(&row.to_vec()), &turn(s));
                assert!(error < bound, "{from} {to} {k}: {error}");
                let off = (0..3)
                    .map(|c| (row[c] - place(s)[c]).abs())
                    .fold(0.0, f64::max);
                assert!(off < 20.0 * bound, "{from} {to} {k}: {off} cm");
                let step = |c: usize| (row[c] - new[[k.max(1) - 1, c]]).abs();
                assert!((3..6).all(|c| step(c) < PI), "{k}");
            }
        }
    }

    #[test]
    fn a_tremor_does_not_turn_into_slow_movement() {
        let mut own = motion(120.0);
        let clean = resampled_motion(own.view(), &joint(), &Retiming::even(own.nrows(), 4.0));
        for t in 0..own.nrows() {
            let shake = (TAU * 27.0 * t as f64 / 120.0).sin();
            own[[t, 1]] += shake;
            own[[t, 5]] += 0.03 * shake;
        }
        let new = resampled_motion(own.view(), &joint(), &Retiming::even(own.nrows(), 4.0));
        for k in 12..new.nrows() - 12 {
            assert!((new[[k, 1]] - clean[[k, 1]]).abs() < 0.01, "{k}");
            let [a, b] = [&new, &clean].map(|m| rotation(&m.row(k).to_vec()));
            assert!(angle_between(&a, &b) < 2e-3, "{k}");
        }
    }

    #[test]
    fn missing_and_held_values_stay_so() {
        let mut own = motion(120.0);
        own[[100, 4]] = f64::NAN;
        own[[200, 0]] = f64::NAN;
        let still = own.slice(ndarray::s![250, ..]).to_owned();
        (251..300).for_each(|t| own.row_mut(t).assign(&still));
        let new = resampled_motion(own.view(), &joint(), &Retiming::even(own.nrows(), 2.5));
        for (k, row) in new.rows().into_iter().enumerate() {
            let (below, above) = ((2.5 * k as f64).floor(), (2.5 * k as f64).ceil());
            let lacks = |t: f64| below == t || above == t;
            assert!((3..6).all(|c| row[c].is_nan() == lacks(100.0)), "{k}");
            assert_eq!(row[0].is_nan(), lacks(200.0));
            assert!(row[1].is_finite() && row[2].is_finite());
            if below >= 250.0 && above < 300.0 {
                assert_eq!(row[0], still[0]);
                let [a, b] = [&row.to_vec(), &still.to_vec()].map(|row| rotation(row));
                assert!(angle_between(&a, &b) < 1e-9);
            }
        }
    }

    #[test]
    fn a_take_at_its_own_times_is_the_take() {
        let own = motion(30.0);
        let timing = Retiming::even(own.nrows(), 1.0);
        assert!(timing.is_identity(own.nrows()) && !timing.is_identity(own.nrows() + 1));
        let new = resampled_motion(own.view(), &joint(), &timing);
        for (a, b) in new.rows().into_iter().zip(own.rows()) {
            let [a, b] = [a, b].map(|row| rotation(&row.to_vec()));
            assert!(angle_between(&a, &b) < 1e-7);
        }
        let none = resampled_motion(own.slice(ndarray::s![..0, ..]), &joint(), &timing);
        assert!(none.iter().all(|v| v.is_nan()));
        let one = resampled_motion(
            own.slice(ndarray::s![..1, ..]),
            &joint(),
            &Retiming::even(1, 4.0),
        );
        assert!(one.nrows() == 1 && (one[[0, 0]] - own[[0, 0]]).abs() < 1e-12);
    }

    #[test]
    fn wrapped_angles_go_on_and_all_others_stay() {
        let own = motion(120.0);
        let new = without_jumps(own.view(), &joint());
        let mut changed = 0;
        for (t, row) in new.rows().into_iter().enumerate() {
            let [a, b] = [row, own.row(t)].map(|row| rotation(&row.to_vec()));
            assert!(angle_between(&a, &b) < 1e-9, "{t}");
            let step = |c: usize| (row[c] - new[[t.max(1) - 1, c]]).abs();
            assert!((3..6).all(|c| step(c) < PI), "{t}");
            changed += (0..6)
                .filter(|c| row[*c].to_bits() != own[[t, *c]].to_bits())
                .count();
        }
        assert!(changed > 100);
        let again = without_jumps(new.view(), &joint());
        assert_eq!(again, new);
    }

    #[test]
    fn infinite_values_are_missing() {
        let mut own = motion(30.0);
        own[[7, 3]] = f64::INFINITY;
        let new = resampled_motion(own.view(), &joint(), &Retiming::even(own.nrows(), 0.5));
        assert!((13..=15).all(|k| new[[k, 3]].is_nan() && new[[k, 5]].is_nan()));
        assert!(new[[12, 3]].is_finite() && new[[16, 3]].is_finite());
    }
}

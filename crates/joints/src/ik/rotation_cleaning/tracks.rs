//! The tracks of a file's channels: rotations of ball joints, angles of hinges, positions; and the
//! way back to its own angles.

use super::movement::{Movable, gaps, straight};
use super::tuning::*;
use crate::pose::JointChannels;
use crate::pose::rotation::{Axis, cross_matrix, decompose, nearest_equivalent_angle, three_axes};
use glam::{DMat3, DQuat, DVec3};
use ndarray::{Array2, ArrayView2};

/// What moves in a file: some of its channels over time.
pub(super) struct Track<M> {
    /// The joint's index.
    pub joint: usize,
    /// Channels among those of a frame, with their axes: of a ball joint three, in the order of
    /// their product, of a hinge one, of a position one to three.
    pub channels: Vec<(usize, Axis)>,
    /// By frame; missing ones on the straight way.
    pub values: Vec<M>,
    /// Whether each frame has it.
    pub seen: Vec<bool>,
    /// Frames whose value is no longer the file's.
    pub is_new: Vec<bool>,
}

impl<M: Movable> Track<M> {
    /// `None` for one that no frame has.
    fn new(
        (joint, channels): (usize, Vec<(usize, Axis)>),
        motion: ArrayView2<'_, f64>,
        value: impl Fn(&[(usize, Axis)], usize) -> M,
    ) -> Option<Track<M>> {
        let is_seen = |t: usize| channels.iter().all(|(c, _)| motion[[t, *c]].is_finite());
        let seen: Vec<bool> = (0..motion.nrows()).map(is_seen).collect();
        if !seen.contains(&true) {
            return None;
        }
        let values = (0..motion.nrows()).map(|t| value(&channels, t)).collect();
        let mut track = Track {
            is_new: vec![false; seen.len()],
            joint,
            channels,
            values,
            seen,
        };
        for gap in gaps(&track.seen) {
            // Not from frames inside the gap, which have no value yet.
            let path = straight(&track.values, &gap);
            track.values[gap].copy_from_slice(&path);
        }
        Some(track)
    }
}

/// The rotations and the positions of joints.
pub(super) fn tracks(
    joints: &[JointChannels],
    motion: ArrayView2<'_, f64>,
) -> (Vec<Track<DQuat>>, Vec<Track<DVec3>>) {
    let (mut rotations, mut positions) = (Vec::new(), Vec::new());
    for (j, joint) in joints.iter().enumerate() {
        let parts = if three_axes(joint.angles.iter().map(|a| a.1)).is_some() {
            vec![joint.angles.clone()]
        } else {
            joint.angles.iter().map(|a| vec![*a]).collect()
        };
        rotations.extend(parts.into_iter().filter_map(|channels| {
            let rotation = |channels: &[(usize, Axis)], t: usize| match channels {
                [(c, _)] => DQuat::from_rotation_x(motion[[t, *c]]),
                _ => (channels.iter()).fold(DQuat::IDENTITY, |q, (c, axis)| {
                    q * DQuat::from_axis_angle(axis.unit(), motion[[t, *c]])
                }),
            };
            let mut track = Track::new((j, channels), motion, rotation)?;
            make_continuous(&mut track.values);
            Some(track)
        }));
        let position = |channels: &[(usize, Axis)], t: usize| {
            let along = channels
                .iter()
                .map(|(c, axis)| axis.unit() * motion[[t, *c]]);
            along.sum::<DVec3>()
        };
        let channels = joint.positions.clone();
        positions.extend(
            Some((j, channels))
                .filter(|c| !c.1.is_empty())
                .and_then(|c| Track::new(c, motion, position)),
        );
    }
    (rotations, positions)
}

/// Gives each quaternion the sign that is nearer to the one before.
fn make_continuous(rotations: &mut [DQuat]) {
    for t in 1..rotations.len() {
        if rotations[t].dot(rotations[t - 1]) < 0.0 {
            rotations[t] = -rotations[t];
        }
    }
}

impl Track<DQuat> {
    /// The free axes: 1 or 3.
    pub(super) fn freedoms(&self) -> usize {
        self.channels.len()
    }

    /// The quaternions as rows.
    pub(super) fn rows(&self) -> Vec<[f64; 4]> {
        self.values.iter().map(|q| q.to_array()).collect()
    }

    /// Writes the new rotations as angles, on the file's branch where they moved little, else on
    /// that of the frame before, or after where none before is known. Of a frame of which some
    /// angles are known, the others change.
    pub(super) fn write(&self, motion: &mut Array2<f64>) {
        let is_whole = |t: &usize| {
            self.channels
                .iter()
                .all(|(c, _)| motion[[*t, *c]].is_finite())
        };
        let frames = 0..self.values.len();
        let first = frames.clone().find(is_whole).unwrap_or(0);
        let forth = (first..frames.end).map(|t| (t, t.checked_sub(1)));
        let all = forth.chain((0..first).rev().map(|t| (t, Some(t + 1))));
        for (t, beside) in all.filter(|(t, _)| self.is_new[*t]) {
            let own: Vec<f64> = self.channels.iter().map(|(c, _)| motion[[t, *c]]).collect();
            let before: Vec<f64> = (self.channels.iter())
                .map(|(c, _)| beside.map_or(f64::NAN, |t| motion[[t, *c]]))
                .collect();
            let is_near = |angles: &[f64]| {
                let was = rotation_of(&self.channels, angles);
                was.step_to(self.values[t]).length() < UNCHANGED
            };
            let is_whole = own.iter().all(|v| v.is_finite());
            let near = if is_whole && is_near(&own) {
                &own
            } else {
                &before
            };
            let near: Vec<f64> = near
                .iter()
                .map(|v| if v.is_finite() { *v } else { 0.0 })
                .collect();
            let angles = match (&self.channels[..], &near[..]) {
                ([a, b, c], [x, y, z]) => {
                    let known = [0, 1, 2]
                        .map(|i| own[i])
                        .map(|v| (!is_whole && v.is_finite()).then_some(v));
                    let axes = [a.1, b.1, c.1];
                    angles(&DMat3::from_quat(self.values[t]), axes, [*x, *y, *z], known).to_vec()
                }
                _ => {
                    let turn = self.values[t].to_scaled_axis().x;
                    vec![nearest_equivalent_angle(turn, near[0])]
                }
            };
            for ((c, _), angle) in self.channels.iter().zip(angles) {
                motion[[t, *c]] = angle;
            }
        }
    }
}

impl Track<DVec3> {
    /// The positions as rows.
    pub(super) fn rows(&self) -> Vec<[f64; 4]> {
        self.values.iter().map(|p| [p.x, p.y, p.z, 0.0]).collect()
    }

    /// Writes the new positions; coordinates that are known stay where others of the frame are
    /// missing.
    pub(super) fn write(&self, motion: &mut Array2<f64>) {
        for t in (0..self.values.len()).filter(|t| self.is_new[*t]) {
            for (c, axis) in &self.channels {
                if self.seen[t] || motion[[t, *c]].is_nan() {
                    motion[[t, *c]] = self.values[t][axis.index()];
                }
            }
        }
    }
}

/// The rotation of a ball joint, or of a hinge about x.
fn rotation_of(channels: &[(usize, Axis)], angles: &[f64]) -> DQuat {
    match (channels, angles) {
        ([_], [angle]) => DQuat::from_rotation_x(*angle),
        _ => (channels.iter().zip(angles)).fold(DQuat::IDENTITY, |q, ((_, axis), angle)| {
            q * DQuat::from_axis_angle(axis.unit(), *angle)
        }),
    }
}

/// The angles of a rotation about `axes` in turn, on the branch that is nearest to `near`, the
/// `known` ones kept; at the pole the first stays as in `near`.
fn angles(r: &DMat3, axes: [Axis; 3], near: [f64; 3], known: [Option<f64>; 3]) -> [f64; 3] {
    let all = decompose(r, axes, near);
    let is_any_known = known.iter().any(|k| k.is_some());
    match (is_any_known, all[1].cos().abs() < AT_POLE) {
        (true, _) => with_known(r, axes, all, known),
        (false, true) => with_known(r, axes, all, [Some(near[0]), None, None]),
        _ => all,
    }
}

/// Rounds in which the open angles are improved one by one.
const ROUNDS: usize = 20;

/// The angles nearest to a rotation of which some are known, from `start`.
fn with_known(r: &DMat3, axes: [Axis; 3], start: [f64; 3], known: [Option<f64>; 3]) -> [f64; 3] {
    let mut out = [0, 1, 2].map(|i| known[i].unwrap_or(start[i]));
    for _ in 0..ROUNDS {
        for i in (0..3).filter(|i| known[*i].is_none()) {
            let product = |part: std::ops::Range<usize>| {
                part.fold(DMat3::IDENTITY, |m, k| m * axes[k].rotation(out[k]))
            };
            // The trace of r' A R(θ) B is that of R(θ) M: a sine and a cosine of θ.
            let m = product(i + 1..3) * r.transpose() * product(0..i);
            let axis = axes[i].unit();
            let turned = cross_matrix(axis) * m;
            let sine = turned.x_axis.x + turned.y_axis.y + turned.z_axis.z;
            let cosine = m.x_axis.x + m.y_axis.y + m.z_axis.z - axis.dot(m * axis);
            if sine.hypot(cosine) > 1e-9 {
                out[i] = nearest_equivalent_angle(sine.atan2(cosine), start[i]);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::angle_between;
    use std::f64::consts::PI;

    fn product(axes: [Axis; 3], angles: [f64; 3]) -> DMat3 {
        axes[0].rotation(angles[0]) * axes[1].rotation(angles[1]) * axes[2].rotation(angles[2])
    }

    const ZXY: [Axis; 3] = [Axis::Z, Axis::X, Axis::Y];

    #[test]
    fn known_angles_stay_and_the_others_come_back() {
        let truth = [0.7, -0.4, 2.1];
        let r = product(ZXY, truth);
        for known in [
            [true, false, false],
            [false, true, false],
            [true, false, true],
        ] {
            let known = [0, 1, 2].map(|i| known[i].then_some(truth[i]));
            let found = angles(&r, ZXY, [0.5, -0.2, 2.0], known);
            assert!(
                (0..3).all(|i| (found[i] - truth[i]).abs() < 1e-3),
                "{found:?}"
            );
        }
    }

    #[test]
    fn at_the_pole_the_first_angle_stays_and_the_rotation_too() {
        for b in [PI / 2.0, -PI / 2.0, PI / 2.0 - 1e-4] {
            let r = product(ZXY, [1.0, b, 0.3]);
            let found = angles(&r, ZXY, [0.2, b, 0.9], [None; 3]);
            assert_eq!(found[0], 0.2);
            assert!(angle_between(&r, &product(ZXY, found)) < 2e-4, "{found:?}");
        }
    }

    #[test]
    fn branches_of_the_file_are_kept() {
        let joints = [JointChannels {
            joint: "a".into(),
            angles: vec![(0, Axis::Z), (1, Axis::X), (2, Axis::Y)],
            positions: Vec::new(),
        }];
        let row = |t: usize| {
            // Past a whole turn, and on the other branch.
            let (a, b, c) = (6.5 + 0.01 * t as f64, 2.0, -0.3);
            [a, b, c]
        };
        let truth = Array2::from_shape_fn((30, 3), |(t, c)| row(t)[c]);
        let mut gappy = truth.clone();
        gappy.slice_mut(ndarray::s![10..14, ..]).fill(f64::NAN);
        let (mut rotations, positions) = tracks(&joints, gappy.view());
        assert!(positions.is_empty() && rotations[0].seen.iter().filter(|s| !**s).count() == 4);
        rotations[0].is_new.fill(true);
        let mut written = gappy.clone();
        rotations[0].write(&mut written);
        assert!((&written - &truth).iter().all(|d| d.abs() < 1e-9));
        // At the start, on that of the frames after.
        gappy.slice_mut(ndarray::s![..3, ..]).fill(f64::NAN);
        let (mut rotations, _) = tracks(&joints, gappy.view());
        rotations[0].is_new.fill(true);
        rotations[0].write(&mut gappy);
        assert!((&gappy - &truth).iter().all(|d| d.abs() < 0.05));
        // A joint that is never there is no track.
        assert!(
            tracks(&joints, Array2::from_elem((3, 3), f64::NAN).view())
                .0
                .is_empty()
        );
        assert!(tracks(&joints, Array2::zeros((0, 3)).view()).0.is_empty());
    }
}

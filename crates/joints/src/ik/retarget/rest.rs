//! The pose in which two skeletons are compared: that of zero rotations where it is a standing
//! body, else the most upright frame of the motion. (The rotations of some exporters are those of
//! the bones' own axes: at zero, spine and legs lie on one line.) Where nobody stands in a frame
//! either, that of zero rotations stands in, which may turn limbs wrongly: [`Rest::Assumed`].

use super::hierarchy::{Hierarchy, Pose};
use super::segments::BodyJoints;
use super::tuning::rest::*;
use crate::pose::rotation::frame_along;
use glam::{DMat3, DVec3};
use ndarray::ArrayView2;

/// The pose in which a skeleton is compared with another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rest {
    /// That of zero rotations: of a standing body, or of both skeletons alike.
    Zero,
    /// A frame of the file, from 0: at zero rotations nobody stands.
    Frame(usize),
    /// That of zero rotations, though nobody stands in it, nor in a frame.
    Assumed,
}

/// A pose to compare with.
pub(super) struct RestPose {
    pub pose: Pose,
    /// Which axis of the world points up along the trunk; `None`: the body leans, or this is no
    /// pose of a body.
    pub up: Option<DVec3>,
    pub kind: Rest,
}

impl RestPose {
    /// That of zero rotations.
    pub(super) fn zero(tree: &Hierarchy, body: &BodyJoints) -> RestPose {
        let pose = tree.zero();
        let trunk = trunk(body, &pose);
        let axis =
            DVec3::AXES[trunk.abs().max_position()] * trunk[trunk.abs().max_position()].signum();
        let is_upright = is_standing(body, &pose) && trunk.dot(axis) > UPRIGHT;
        RestPose {
            pose,
            up: is_upright.then_some(axis),
            kind: Rest::Zero,
        }
    }

    /// That of zero rotations if it is a standing body, else the most upright frame.
    pub(super) fn of(tree: &Hierarchy, body: &BodyJoints, motion: ArrayView2<f64>) -> RestPose {
        let zero = RestPose::zero(tree, body);
        if is_standing(body, &zero.pose) {
            return zero;
        }
        let assumed = RestPose {
            kind: Rest::Assumed,
            ..zero
        };
        let (mut best, mut pose) = ((f64::NEG_INFINITY, assumed), Pose::default());
        for frame in (0..motion.nrows()).step_by(motion.nrows().div_ceil(FRAMES).max(1)) {
            let values = motion.row(frame);
            if values.iter().any(|v| !v.is_finite()) {
                continue;
            }
            tree.pose(values, &mut pose);
            let score = uprightness(body, &pose);
            if score > best.0 && is_standing(body, &pose) {
                let rest = RestPose {
                    pose: pose.clone(),
                    up: None,
                    kind: Rest::Frame(frame),
                };
                best = (score, rest);
            }
        }
        best.1
    }
}

/// The direction from the hips to the shoulders, or to the head.
fn trunk(body: &BodyJoints, pose: &Pose) -> DVec3 {
    let [hips, top] = [middle(pose, &hips(body)), top(body, pose)];
    (top - hips).normalize_or(DVec3::Y)
}

pub(super) fn hips(body: &BodyJoints) -> [usize; 2] {
    [body.legs[0].joints[0], body.legs[1].joints[0]]
}

pub(super) fn top(body: &BodyJoints, pose: &Pose) -> DVec3 {
    match (&body.arms, body.head) {
        (Some(arms), _) => middle(pose, &[arms[0].joints[0], arms[1].joints[0]]),
        (None, Some(head)) => pose.positions[head],
        (None, None) => middle(pose, &hips(body)) + DVec3::Y,
    }
}

pub(super) fn middle(pose: &Pose, [a, b]: &[usize; 2]) -> DVec3 {
    (pose.positions[*a] + pose.positions[*b]) / 2.0
}

/// Whether a pose is that of somebody who stands, in whatever direction.
fn is_standing(body: &BodyJoints, pose: &Pose) -> bool {
    let trunk = trunk(body, pose);
    let opposes = |[from, to]: [usize; 2]| {
        let bone = (pose.positions[to] - pose.positions[from]).normalize_or_zero();
        bone.dot(trunk) < OPPOSITE
    };
    let [left, right] = hips(body).map(|hip| pose.positions[hip]);
    let line = (left - right).normalize_or_zero();
    line != DVec3::ZERO
        && line.dot(trunk).abs() < ACROSS
        && (body.legs.iter()).all(|leg| opposes([leg.joints[0], leg.joints[2]]))
}

/// How upright a pose is: the larger, the more.
fn uprightness(body: &BodyJoints, pose: &Pose) -> f64 {
    let bones = body.legs.iter().flat_map(|leg| leg.joints.windows(2));
    let down =
        bones.map(|two| (pose.positions[two[1]] - pose.positions[two[0]]).normalize_or_zero());
    trunk(body, pose).y - down.map(|d| d.y).sum::<f64>()
}

/// What carries the rest pose of a rig to that of a source: for pelvis and legs by the line of the
/// hips, for chest and arms by that of the shoulders.
pub(super) fn between(
    [source, rig]: [&RestPose; 2],
    [of_source, of_rig]: [&BodyJoints; 2],
) -> [DMat3; 2] {
    // A rest pose that leans is compared by the trunk, and then so is the other.
    let is_upright = source.up.is_some() && rig.up.is_some();
    let frames = |rest: &RestPose, body: &BodyJoints| {
        let up = rest.up.filter(|_| is_upright);
        let up = up.unwrap_or_else(|| trunk(body, &rest.pose));
        let line =
            |[left, right]: [usize; 2]| rest.pose.positions[left] - rest.pose.positions[right];
        let hips = line(hips(body));
        let shoulders = body.arms.as_ref();
        let shoulders = shoulders.map(|arms| line([arms[0].joints[0], arms[1].joints[0]]));
        [frame(hips, up), frame(shoulders.unwrap_or(hips), up)]
    };
    let ([hips, shoulders], [rig_hips, rig_shoulders]) =
        (frames(source, of_source), frames(rig, of_rig));
    let has_both = of_source.arms.is_some() && of_rig.arms.is_some();
    let lower = hips * rig_hips.transpose();
    [
        lower,
        if has_both {
            shoulders * rig_shoulders.transpose()
        } else {
            lower
        },
    ]
}

/// The axes of a body: x along a line from right to left, y up across it, z forward; any where a
/// pose that is no body has none.
fn frame(line: DVec3, up: DVec3) -> DMat3 {
    let x = line.normalize_or(up.any_orthonormal_vector());
    let frame = frame_along(x, up).or_else(|| frame_along(x, x.any_orthonormal_vector()));
    frame.unwrap_or(DMat3::IDENTITY)
}

/// Whether two hierarchies have the same joints in the same directions, if of other lengths: then
/// their rotations mean the same, whatever their zero pose is.
pub(super) fn is_same_convention(a: &Hierarchy, b: &Hierarchy) -> bool {
    let is_alike = |(p, q): (&DVec3, &DVec3)| {
        let longest = p.length().max(q.length());
        longest == 0.0 || p.dot(*q) >= SAME * p.length() * q.length()
    };
    a.names == b.names
        && a.parents == b.parents
        && a.offsets.iter().zip(&b.offsets).skip(1).all(is_alike)
}

//! Rotations of the joints, fitted to their coordinates: the features of orientation-based
//! distances (Chen et al., section 5.3).
//!
//! Each joint with children has axes: y along the trunk, x from right to left, in the T-pose those
//! of the body. At the hip and the neck, which have three children, x is the direction between the
//! two at the sides and y the part of the third one's direction that is perpendicular to it. At any
//! other joint the axes are those of the parent, turned by the smallest rotation that carries
//! the bone's direction in the T-pose to its present one: points alone do not show the twist about
//! a bone.
//!
//! A rotation is described by the nine entries of its matrix relative to the parent's, over √2.
//! Distances between descriptions are then 2 sin(θ/2) for two rotations θ apart: the straight line
//! between their quaternions, doubled, which is θ where it is small.

use super::body_frame::BodyFramePoses;
use super::gpd::stencil;
use super::joint_map::{JOINTS, PARENTS, joint};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;

/// The joints that have children.
pub(super) const ROTATED: [usize; 11] = [
    joint::HIP,
    joint::CHEST,
    joint::NECK,
    joint::LSHOULDER,
    joint::LELBOW,
    joint::RSHOULDER,
    joint::RELBOW,
    joint::LHIP,
    joint::LKNEE,
    joint::RHIP,
    joint::RKNEE,
];

/// Numbers a frame: a matrix for each of [`ROTATED`], and the hip's height.
pub(super) const STATIC: usize = 9 * ROTATED.len() + 1;

/// The names of the features: `R(LElbow)_xy` the entry of row x and column y; the same with `v`
/// before the axes for its velocity.
pub(super) fn names() -> Vec<String> {
    let mut names = Vec::with_capacity(2 * STATIC);
    for order in ["", "v"] {
        for j in ROTATED {
            for row in ["x", "y", "z"] {
                names.extend(
                    ["x", "y", "z"].map(|column| format!("R({})_{order}{row}{column}", JOINTS[j])),
                );
            }
        }
        names.push(format!("J_c(Hip)_{order}y"));
    }
    names
}

/// Appends the features of frame `t`: rotations and the hip's height, body heights, then their
/// velocities (a second; NaN without a rate).
pub(super) fn describe_frame(poses: &BodyFramePoses, t: usize, out: &mut Vec<f32>) {
    let at = |t: usize| {
        let mut values = [0.0; STATIC];
        for (part, rotation) in values.chunks_exact_mut(9).zip(rotations(&poses.frame(t))) {
            part.copy_from_slice(&(rotation * FRAC_1_SQRT_2).transpose().to_cols_array());
        }
        values[STATIC - 1] = poses.hip_height[t];
        values
    };
    out.extend(at(t).map(|v| v as f32));
    let Some(rate) = poses.rate else {
        out.extend([f32::NAN; STATIC]);
        return;
    };
    let mut velocity = [0.0; STATIC];
    for (frame, weight) in stencil(t, &poses.run_of(t), 1) {
        let values = at(frame);
        (velocity.iter_mut().zip(values)).for_each(|(sum, v)| *sum += v * weight * rate);
    }
    out.extend(velocity.map(|v| v as f32));
}

/// The rotation of each of [`ROTATED`] relative to its parent.
fn rotations(joints: &[DVec3; 16]) -> [DMat3; ROTATED.len()] {
    let mut world = [DMat3::IDENTITY; 16];
    ROTATED.map(|j| {
        let parent = match j {
            joint::HIP => DMat3::IDENTITY,
            _ => world[PARENTS[j]],
        };
        world[j] = match j {
            joint::HIP => axes(
                joints[joint::LHIP] - joints[joint::RHIP],
                joints[joint::CHEST] - joints[joint::HIP],
            ),
            joint::NECK => axes(
                joints[joint::LSHOULDER] - joints[joint::RSHOULDER],
                joints[joint::HEAD] - joints[joint::NECK],
            ),
            _ => {
                let child = child_of(j);
                smallest(parent * rest_direction(j), joints[child] - joints[j]) * parent
            }
        };
        parent.transpose() * world[j]
    })
}

/// The only child of a joint other than hip and neck.
fn child_of(j: usize) -> usize {
    (1..16).find(|c| PARENTS[*c] == j).unwrap_or(j)
}

/// The direction of a joint's bone in the T-pose.
fn rest_direction(j: usize) -> DVec3 {
    match j {
        joint::LSHOULDER | joint::LELBOW => DVec3::X,
        joint::RSHOULDER | joint::RELBOW => -DVec3::X,
        joint::LHIP | joint::LKNEE | joint::RHIP | joint::RKNEE => -DVec3::Y,
        _ => DVec3::Y,
    }
}

/// Axes with x along `across`, and `up` in the half-plane of x and y; those of the body where they
/// are not determined, NaN for NaN.
fn axes(across: DVec3, up: DVec3) -> DMat3 {
    let z = across.cross(up);
    if across.is_nan() || up.is_nan() {
        return DMat3::from_cols(DVec3::NAN, DVec3::NAN, DVec3::NAN);
    }
    match (across.try_normalize(), z.try_normalize()) {
        (Some(x), Some(z)) => DMat3::from_cols(x, z.cross(x), z),
        _ => DMat3::IDENTITY,
    }
}

/// The smallest rotation that carries the unit vector `from` to the direction of `to`; none where
/// that has no length.
fn smallest(from: DVec3, to: DVec3) -> DMat3 {
    if from.is_nan() || to.is_nan() {
        return DMat3::from_cols(DVec3::NAN, DVec3::NAN, DVec3::NAN);
    }
    match to.try_normalize() {
        Some(to) => DMat3::from_quat(DQuat::from_rotation_arc(from, to)),
        None => DMat3::IDENTITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::{own_names, standing, take_of};

    #[test]
    fn the_t_pose_has_no_rotations() {
        for rotation in rotations(&standing()) {
            assert!((rotation - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-12));
        }
    }

    #[test]
    fn a_bent_elbow_turns_only_the_elbow_by_its_angle() {
        let mut bent = standing();
        let angle: f64 = 0.8;
        bent[joint::LHAND] = bent[joint::LELBOW] + 25.0 * DVec3::new(angle.cos(), 0.0, angle.sin());
        let take = take_of(&[standing(), bent]);
        let poses = BodyFramePoses::new(&take, None, &own_names()).unwrap();
        let (mut a, mut b) = (Vec::new(), Vec::new());
        describe_frame(&poses, 0, &mut a);
        describe_frame(&poses, 1, &mut b);
        let names = names();
        let square: f64 = (0..STATIC).map(|k| f64::from(a[k] - b[k]).powi(2)).sum();
        assert!((square.sqrt() - 2.0 * (angle / 2.0).sin()).abs() < 1e-6);
        for k in 0..STATIC {
            assert!((a[k] - b[k]).abs() < 1e-6 || names[k].starts_with("R(LElbow)"));
        }
        assert!(a[STATIC..].iter().all(|v| v.is_nan()));
    }
}

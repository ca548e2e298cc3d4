//! Any skeleton as a BVH hierarchy: the bone convention that Blender, MotionBuilder and retargeters expect.
//!
//! JOINT NAME stands at the start of bone NAME and turns it; what hangs on the bone stands at its end; the last bone
//! ends in an End Site. Bones that start together become joints with one OFFSET, each turning its own bone. A bone of
//! an ASF turns by `L = C M C⁻¹` in the rest pose's axes, `G = G_parent L`, so the joint's rotation is L, the OFFSETs
//! are the ASF's and the poses are equal.

use super::Joint;
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{Axis, decompose};
use crate::pose::{Channel, Skeleton};
use glam::{DMat3, DVec3};

/// Turns postures of a skeleton into frames of a BVH file.
pub struct Converter<'a> {
    skeleton: &'a Skeleton,
    order: [Axis; 3],
    /// Carries our axes (y up) to the file's.
    turn: DMat3,
    joints: Vec<Joint>,
    /// The bone of each joint: depth first, as files have them.
    bones: Vec<usize>,
    /// Each joint's angles in the frame before.
    near: Vec<[f64; 3]>,
}

impl<'a> Converter<'a> {
    /// `order` is that of the rotation channels, the last turning first; `turn` carries our axes to the file's.
    pub fn new(skeleton: &'a Skeleton, order: [Axis; 3], turn: DMat3) -> Converter<'a> {
        let all = skeleton.bones();
        let mut children = vec![Vec::new(); all.len()];
        for (i, bone) in all.iter().enumerate() {
            if let Some(p) = bone.parent {
                children[p].push(i);
            }
        }
        let (mut bones, mut place) = (Vec::with_capacity(all.len()), vec![0; all.len()]);
        let mut stack = vec![0];
        while let Some(bone) = stack.pop() {
            place[bone] = bones.len();
            bones.push(bone);
            stack.extend(children[bone].iter().rev());
        }
        let joints = bones.iter().map(|&i| {
            let bone = &all[i];
            let slides = |i: usize| {
                all[i]
                    .dofs
                    .iter()
                    .any(|d| matches!(d.channel, Channel::Translate(_)))
            };
            let grows = |i: usize| all[i].dofs.iter().any(|d| d.channel == Channel::Length);
            let free = bone.parent.is_none_or(|p| slides(i) || grows(p));
            let positions = [Axis::X, Axis::Y, Axis::Z].map(Channel::Translate);
            let mut channels = if free { positions.to_vec() } else { Vec::new() };
            channels.extend(order.map(Channel::Rotate));
            Joint {
                name: bone.name.clone(),
                parent: bone.parent.map(|p| place[p]),
                offset: bone.parent.map_or(DVec3::ZERO, |p| turn * all[p].offset),
                channels,
                ends: match children[i].is_empty() {
                    true => vec![turn * bone.offset],
                    false => Vec::new(),
                },
            }
        });
        Converter {
            skeleton,
            order,
            turn,
            joints: joints.collect(),
            near: vec![[0.0; 3]; bones.len()],
            bones,
        }
    }

    /// The file's joints.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Appends the channels of the next frame, centimetres and radians. Angles follow those of the frame before.
    pub fn frame(&mut self, posture: &Posture, out: &mut Vec<f64>) {
        let back = self.turn.transpose();
        for ((joint, &bone), near) in self.joints.iter().zip(&self.bones).zip(&mut self.near) {
            let (before, from) = match self.skeleton.bones()[bone].parent {
                Some(p) => (posture.rotations[p], posture.starts[p]),
                None => (DMat3::IDENTITY, DVec3::ZERO),
            };
            if joint.channels.len() > 3 {
                let step = before.transpose() * (posture.starts[bone] - from);
                out.extend((self.turn * step).to_array());
            }
            let own = self.turn * before.transpose() * posture.rotations[bone] * back;
            *near = decompose(&own, self.order, *near);
            out.extend(*near);
        }
    }
}

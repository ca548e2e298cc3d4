//! The joints of a BVH file in their rotations: in their parent's frame, in the world, and where
//! they stand.

use crate::io::Bvh;
use crate::io::bvh::Joint;
use crate::pose::Channel;
use glam::{DMat3, DVec3};
use ndarray::{ArrayView1, s};

/// A hierarchy, y up, centimeters.
pub(in crate::ik) struct Hierarchy {
    pub names: Vec<String>,
    pub parents: Vec<Option<usize>>,
    /// By joint, from its parent in the parent's frame; the mean where position channels move it.
    pub offsets: Vec<DVec3>,
    /// By joint, its End Sites.
    pub tips: Vec<Vec<DVec3>>,
    joints: Vec<Joint>,
    /// By joint, its first channel.
    first: Vec<usize>,
    turn: DMat3,
}

/// The rotations and positions of all joints in one frame.
#[derive(Debug, Clone, Default)]
pub(in crate::ik) struct Pose {
    pub rotations: Vec<DMat3>,
    pub positions: Vec<DVec3>,
}

impl Hierarchy {
    /// That of a file; `turn` carries its axes to ours.
    pub(in crate::ik) fn new(bvh: &Bvh, turn: DMat3) -> Hierarchy {
        let mut next = 0;
        let first = bvh.joints.iter().map(|joint| {
            let at = next;
            next += joint.channels.len();
            at
        });
        Hierarchy {
            first: first.collect(),
            names: bvh.joints.iter().map(|j| j.name.clone()).collect(),
            parents: bvh.joints.iter().map(|j| j.parent).collect(),
            offsets: bvh.mean_bones().iter().map(|j| turn * j.offset).collect(),
            tips: (bvh.joints.iter())
                .map(|j| j.ends.iter().map(|e| turn * e.offset).collect())
                .collect(),
            joints: bvh.joints.clone(),
            turn,
        }
    }

    /// The number of joints.
    pub(in crate::ik) fn len(&self) -> usize {
        self.names.len()
    }

    /// The channels of a joint, in the file's order, and the first one's index in a frame.
    pub(in crate::ik) fn channels(&self, joint: usize) -> (&[Channel], usize) {
        (&self.joints[joint].channels, self.first[joint])
    }

    /// The joints that hang on a joint.
    pub(in crate::ik) fn children(&self, joint: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(move |&j| self.parents[j] == Some(joint))
    }

    /// A joint and all above it, upwards.
    pub(in crate::ik) fn upwards(&self, joint: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(joint), |&j| self.parents[j])
    }

    /// Whether a joint is `above` or hangs below it.
    pub(in crate::ik) fn is_below(&self, joint: usize, above: usize) -> bool {
        self.upwards(joint).any(|j| j == above)
    }

    /// The lowest joint that two hang on, which may be one of them.
    pub(in crate::ik) fn common(&self, a: usize, b: usize) -> usize {
        let mut above = self.upwards(a);
        above.find(|&j| self.is_below(b, j)).unwrap_or(0)
    }

    /// The joints from one, or from the first that both hang on, down to another: the first is not
    /// among them.
    pub(in crate::ik) fn path(&self, from: usize, to: usize) -> Vec<usize> {
        let top = self.common(from, to);
        let mut path: Vec<usize> = self.upwards(to).take_while(|&j| j != top).collect();
        path.reverse();
        path
    }

    /// The pose in which nothing is turned, the first joint at the origin.
    pub(in crate::ik) fn zero(&self) -> Pose {
        let mut pose = Pose {
            rotations: vec![DMat3::IDENTITY; self.len()],
            positions: Vec::with_capacity(self.len()),
        };
        for (parent, offset) in self.parents.iter().zip(&self.offsets) {
            let position = parent.map_or(DVec3::ZERO, |p| pose.positions[p] + *offset);
            pose.positions.push(position);
        }
        pose
    }

    /// The pose of a frame. What is missing (nan) is not turned, and stands at its offset.
    pub(in crate::ik) fn pose(&self, frame: ArrayView1<'_, f64>, pose: &mut Pose) {
        pose.rotations.clear();
        pose.positions.clear();
        for (j, joint) in self.joints.iter().enumerate() {
            let values = frame.slice(s![self.first[j]..]);
            let (mut local, mut position) =
                (DMat3::IDENTITY, self.turn.transpose() * self.offsets[j]);
            for (channel, &value) in joint.channels.iter().zip(&values) {
                match channel {
                    _ if !value.is_finite() => {}
                    Channel::Rotate(axis) => local *= axis.rotation(value),
                    Channel::Translate(axis) => position[axis.index()] = value,
                    Channel::Length => {}
                }
            }
            let local = self.turn * local * self.turn.transpose();
            let position = self.turn * position;
            let (rotation, position) = match joint.parent {
                Some(p) => (
                    pose.rotations[p] * local,
                    pose.positions[p] + pose.rotations[p] * position,
                ),
                None => (local, position),
            };
            pose.rotations.push(rotation);
            pose.positions.push(position);
        }
    }

    /// What each joint lacks in a frame.
    pub(in crate::ik) fn missing(&self, frame: ArrayView1<'_, f64>) -> Vec<Missing> {
        let of = |(joint, &first): (&Joint, &usize)| {
            let values = frame.slice(s![first..]);
            let lacks = |is_angle: bool| {
                let channels = joint.channels.iter().zip(&values);
                let mut values = channels.filter(|(c, _)| c.is_angle() == is_angle);
                values.any(|(_, v)| !v.is_finite())
            };
            Missing {
                rotation: lacks(true),
                position: lacks(false),
            }
        };
        self.joints.iter().zip(&self.first).map(of).collect()
    }

    /// Whether where a joint stands is missing.
    pub(in crate::ik) fn lacks_position(&self, joint: usize, missing: &[Missing]) -> bool {
        let mut above = self.upwards(joint).skip(1);
        missing[joint].position || above.any(|j| missing[j].position || missing[j].rotation)
    }
}

/// What a joint lacks in a frame.
#[derive(Debug, Clone, Copy)]
pub(in crate::ik) struct Missing {
    pub rotation: bool,
    pub position: bool,
}

//! Builds the bones of a BVH hierarchy, joint after joint.

use super::Joint;
use crate::pose::{Bone, Channel, Dof};
use glam::{DMat3, DVec3};
use std::collections::HashMap;

/// How a position channel moves its joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Moving {
    /// Not at all: the joint stays at its OFFSET.
    No,
    /// From the joint above, as the file's numbers count.
    FromOrigin,
    /// From the OFFSET, where a solver that knows no better leaves it.
    FromOffset,
}

/// The bones of a hierarchy so far, and what they move by.
#[derive(Default)]
pub(super) struct SkeletonBuilder {
    /// Carries the file's axes to ours (y up).
    turn: DMat3,
    pub bones: Vec<Bone>,
    /// Values of the skeleton so far.
    values: usize,
    /// By joint: the bone that turns with it.
    turning: Vec<usize>,
    /// By position on a bone: the bone that ends there.
    bone_at: HashMap<(usize, [u64; 3]), usize>,
    /// By joint: what stands on it.
    carried: Vec<Carried>,
    /// The skeleton's value of each channel of a frame; `None` for one that does not move here.
    pub channels: Vec<Option<usize>>,
    /// What is added to the value of each channel.
    pub still: Vec<f64>,
    /// The joints, and the bones that end where they start.
    pub origins: Vec<(String, usize)>,
    /// The End Sites, and the bones that end there.
    pub end_sites: Vec<(String, usize)>,
}

/// What stands on a joint.
#[derive(Clone, Default)]
struct Carried {
    /// The first and second bone that ends where something does.
    on: Vec<usize>,
    /// The sum of all OFFSETs, and their number.
    sum: DVec3,
    count: f64,
}

impl Carried {
    fn push(&mut self, bone: usize, offset: DVec3) {
        if !self.on.contains(&bone) && self.on.len() < 2 {
            self.on.push(bone);
        }
        self.sum += offset;
        self.count += 1.0;
    }
}

impl SkeletonBuilder {
    /// No bones; `turn` carries the file's axes to ours (y up).
    pub(super) fn new(turn: DMat3) -> SkeletonBuilder {
        SkeletonBuilder {
            turn,
            ..SkeletonBuilder::default()
        }
    }

    /// Appends the next joint, whose position channels (its number and theirs) move as `moving`
    /// says.
    pub(super) fn push_joint(&mut self, joint: &Joint, moving: impl Fn(usize, usize) -> Moving) {
        let own = self.turning.len();
        let kind = |(c, channel): (usize, &Channel)| {
            if channel.is_angle() {
                Moving::FromOrigin
            } else {
                moving(own, c)
            }
        };
        let kinds = joint.channels.iter().enumerate().map(kind);
        let channels: Vec<(Channel, Moving)> = joint.channels.iter().copied().zip(kinds).collect();
        let start = self.push_start(joint, &channels);
        self.turning.push(self.bones.len());
        self.carried.push(Carried::default());
        self.origins.push((joint.name.clone(), self.bones.len()));
        let free = channels.iter().filter(|(_, kind)| *kind != Moving::No);
        let mut dofs: Vec<Dof> = free.map(|(channel, _)| Dof::free(*channel)).collect();
        // The last named turns first, and a skeleton's first.
        dofs.reverse();
        let mut value = self.values + dofs.len();
        for (channel, kind) in channels {
            self.channels.push((kind != Moving::No).then(|| {
                value -= 1;
                value
            }));
            self.still.push(match channel {
                Channel::Translate(axis) if kind != Moving::FromOrigin => {
                    joint.offset[axis.index()]
                }
                _ => 0.0,
            });
        }
        self.push(start, DVec3::ZERO, self.turn, dofs);
    }

    /// The bone that ends where a joint starts, which is made where there is none.
    fn push_start(&mut self, joint: &Joint, channels: &[(Channel, Moving)]) -> Option<usize> {
        let is_slide = |(c, kind): &(Channel, Moving)| !c.is_angle() && *kind != Moving::No;
        let slides = channels.iter().any(is_slide);
        // A position channel takes the place of its component.
        let mut fixed = joint.offset;
        for (channel, kind) in channels {
            if let (Channel::Translate(axis), Moving::FromOrigin) = (channel, kind) {
                fixed[axis.index()] = 0.0;
            }
        }
        let Some(parent) = joint.parent else {
            return (fixed != DVec3::ZERO).then(|| self.fixed(None, fixed));
        };
        let above = self.turning[parent];
        let bone = if slides {
            self.fixed(Some(above), fixed)
        } else {
            self.bone_to(above, fixed)
        };
        // What slides stands where its own bone, the next, does.
        let stands = if slides { self.bones.len() } else { bone };
        self.carried[parent].push(stands, joint.offset);
        Some(bone)
    }

    /// Appends the End Sites of the last joint.
    pub(super) fn push_end_sites(&mut self, joint: &Joint) {
        let own = self.turning.len() - 1;
        for (n, end) in joint.ends.iter().map(|e| e.offset).enumerate() {
            let bone = self.bone_to(self.turning[own], end);
            self.carried[own].push(bone, end);
            let suffix = match n {
                0 => String::new(),
                n => format!("_{}", n + 1),
            };
            let name = format!("{}_end{suffix}", joint.name);
            self.end_sites.push((name, bone));
        }
    }

    /// The bone that ends where the bone of each joint does; it is made where there is none.
    pub(super) fn ends(&mut self, joints: &[Joint]) -> Vec<(String, usize)> {
        let mut ends = Vec::with_capacity(joints.len());
        for (i, joint) in joints.iter().enumerate() {
            let Carried { on, sum, count } = self.carried[i].clone();
            let bone = match on[..] {
                _ if i == 0 => self.turning[0],
                [] => self.turning[i],
                [one] => one,
                _ => self.fixed(Some(self.turning[i]), sum / count),
            };
            ends.push((joint.name.clone(), bone));
        }
        ends
    }

    /// The bone that ends at a position on another, which is made where there is none.
    fn bone_to(&mut self, on: usize, offset: DVec3) -> usize {
        let key = (on, bits(offset));
        if let Some(&bone) = self.bone_at.get(&key) {
            return bone;
        }
        let bone = self.fixed(Some(on), offset);
        self.bone_at.insert(key, bone);
        bone
    }

    /// A bone that does not move.
    fn fixed(&mut self, parent: Option<usize>, offset: DVec3) -> usize {
        self.push(parent, self.turn * offset, DMat3::IDENTITY, Vec::new());
        self.bones.len() - 1
    }

    fn push(&mut self, parent: Option<usize>, offset: DVec3, axis: DMat3, dofs: Vec<Dof>) {
        self.values += dofs.len();
        self.bones.push(Bone {
            // A name of its own; the points' names are kept beside.
            name: self.bones.len().to_string(),
            parent,
            offset,
            axis,
            dofs,
        });
    }
}

/// A position as a key: equal text reads to equal bits; 0 and -0 are one position.
fn bits(v: DVec3) -> [u64; 3] {
    v.to_array().map(|c| (c + 0.0).to_bits())
}

//! Skeletons: bones in a tree, each with the degrees of freedom its file gives it.

use super::rotation::{Axis, nearest_equivalent_angle, three_axes};
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// The motion of a bone that one value of a frame gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Channel {
    /// Moves the bone along an axis of its own frame, in centimeters.
    Translate(Axis),
    /// Turns the bone about an axis of its own frame, in radians.
    Rotate(Axis),
    /// Lengthens the bone, in centimeters.
    Length,
}

impl Channel {
    /// `tx ty tz rx ry rz l` in either case.
    #[doc(hidden)]
    pub fn parse(text: &str) -> Option<Channel> {
        let mut letters = text.chars();
        let (kind, axis) = (letters.next()?, letters.next());
        match (kind.to_ascii_lowercase(), axis, letters.next()) {
            ('t', Some(a), None) => Axis::parse(a).map(Channel::Translate),
            ('r', Some(a), None) => Axis::parse(a).map(Channel::Rotate),
            ('l', None, None) => Some(Channel::Length),
            _ => None,
        }
    }
    /// Whether the channel is an angle.
    #[doc(hidden)]
    pub fn is_angle(self) -> bool {
        matches!(self, Channel::Rotate(_))
    }
}

/// One degree of freedom.
#[derive(Debug, Clone, PartialEq)]
pub struct Dof {
    /// The motion that the value gives.
    pub channel: Channel,
    /// The range it may have (radians or centimeters), where the file gives one.
    pub limits: Option<(f64, f64)>,
    /// Offset added to the file's value (the root's own position and orientation; else 0).
    pub offset: f64,
}

impl Dof {
    /// A degree of freedom without limits and offset.
    #[doc(hidden)]
    pub fn free(channel: Channel) -> Dof {
        Dof {
            channel,
            limits: None,
            offset: 0.0,
        }
    }
}

/// A bone: from its parent's end to its own. The joint of the same name is that end.
#[derive(Debug, Clone, PartialEq)]
pub struct Bone {
    /// Its name.
    pub name: String,
    /// The index of the bone it starts from; `None` for the root alone.
    pub parent: Option<usize>,
    /// Vector from the bone's start to its end in the rest pose, global axes, centimeters. Zero
    /// for the root.
    pub offset: DVec3,
    /// The axes of its own frame `C` in global coordinates; its motion is `L = C M C⁻¹`.
    pub axis: DMat3,
    /// Its degrees of freedom in the file's order: the first named turns first.
    pub dofs: Vec<Dof>,
}

impl Bone {
    /// The axes of its angles if it is a ball joint, the first turning first; `None` where it has
    /// other angles than three about different axes.
    #[doc(hidden)]
    pub fn ball_axes(&self) -> Option<[Axis; 3]> {
        three_axes(self.dofs.iter().filter_map(|dof| match dof.channel {
            Channel::Rotate(axis) => Some(axis),
            _ => None,
        }))
    }
}

/// Bones in an order in which a parent precedes its children; the first is the root.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    bones: Vec<Bone>,
    first_dof: Vec<usize>,
    dof_count: usize,
    rest: Vec<RestFrame>,
}

/// The parts of a bone's transform that are the same in every posture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RestFrame {
    /// `C⁻¹`.
    pub inverse_axis: DMat3,
    /// `L` of a bone without degrees of freedom.
    pub fixed_rotation: DMat3,
    /// Where it points, of unit length; zero for the root.
    pub direction: DVec3,
    /// Whether a degree of freedom moves its start.
    pub translates: bool,
}

impl RestFrame {
    fn of(bone: &Bone) -> RestFrame {
        let inverse_axis = bone.axis.transpose();
        let slide = |d: &Dof| matches!(d.channel, Channel::Translate(_));
        RestFrame {
            inverse_axis,
            fixed_rotation: bone.axis * DMat3::IDENTITY * inverse_axis,
            direction: bone.offset.try_normalize().unwrap_or(DVec3::ZERO),
            translates: bone.dofs.iter().any(slide),
        }
    }
}

impl Skeleton {
    /// Checks that the first bone is the only root, that each parent comes before its children and
    /// that no name stands twice.
    ///
    /// # Errors
    /// [`Error::Usage`]: the bones are no such tree.
    pub fn new(bones: Vec<Bone>) -> Result<Skeleton> {
        let fail = |what: String| Err(Error::usage(format!("not a skeleton: {what}")));
        for (i, bone) in bones.iter().enumerate() {
            match bone.parent {
                None if i > 0 => return fail(format!("a second root, {}", bone.name)),
                Some(p) if p >= i => return fail(format!("{} comes before its parent", bone.name)),
                _ => {}
            }
            if bones[..i].iter().any(|b| b.name == bone.name) {
                return fail(format!("two bones are named {}", bone.name));
            }
        }
        if bones.first().is_none_or(|b| b.parent.is_some()) {
            return fail("it has no root".into());
        }
        let mut first_dof = Vec::with_capacity(bones.len());
        let mut dof_count = 0;
        for bone in &bones {
            first_dof.push(dof_count);
            dof_count += bone.dofs.len();
        }
        Ok(Skeleton {
            rest: bones.iter().map(RestFrame::of).collect(),
            bones,
            first_dof,
            dof_count,
        })
    }

    /// The bones, parents first.
    pub fn bones(&self) -> &[Bone] {
        &self.bones
    }
    /// The fixed parts of the transforms, one for each bone.
    pub(super) fn rest(&self) -> &[RestFrame] {
        &self.rest
    }
    /// Whether each bone is an ancestor of a joint of `joints`, or that joint itself.
    #[doc(hidden)]
    pub fn ancestors(&self, joints: &[usize]) -> Vec<bool> {
        let mut above = vec![false; self.bones.len()];
        for &joint in joints {
            above[joint] = true;
        }
        for i in (0..above.len()).rev() {
            if let Some(parent) = self.bones[i].parent {
                above[parent] |= above[i];
            }
        }
        above
    }
    /// How many values a frame has.
    pub fn dof_count(&self) -> usize {
        self.dof_count
    }
    /// Where the values of a bone stand in a frame.
    pub fn dofs_of(&self, bone: usize) -> std::ops::Range<usize> {
        self.first_dof[bone]..self.first_dof[bone] + self.bones[bone].dofs.len()
    }

    /// For each of some bones, the one of them that is nearest above it.
    #[doc(hidden)]
    pub fn nearest_above(&self, bones: &[usize]) -> Vec<Option<usize>> {
        let parent = |bone: &usize| self.bones()[*bone].parent;
        let above = |bone: &usize| std::iter::successors(parent(bone), |b| parent(b));
        let nearest = |bone: &usize| above(bone).find_map(|b| bones.iter().position(|&o| o == b));
        bones.iter().map(nearest).collect()
    }

    /// The bone of a name.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.bones.iter().position(|b| b.name == name)
    }
    /// The limits of every value, infinite where there are none.
    pub fn limits(&self) -> Vec<(f64, f64)> {
        let open = (f64::NEG_INFINITY, f64::INFINITY);
        self.bones
            .iter()
            .flat_map(|b| &b.dofs)
            .map(|d| d.limits.unwrap_or(open))
            .collect()
    }
    /// Values of the same posture as `q`, with whole turns added so that each angle is as close to
    /// that of `near` as it gets.
    #[doc(hidden)]
    pub fn nearest_equivalent(&self, q: &[f64], near: &[f64]) -> Vec<f64> {
        let dofs = self.bones.iter().flat_map(|b| &b.dofs);
        (q.iter().zip(near).zip(dofs))
            .map(|((&q, &near), dof)| {
                if dof.channel.is_angle() {
                    nearest_equivalent_angle(q, near)
                } else {
                    q
                }
            })
            .collect()
    }
}

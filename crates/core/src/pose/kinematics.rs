//! Forward kinematics: positions of the joints by the values of a frame, and their derivatives.
//!
//! Letters: `q` the values of a frame (radians and centimeters, [`Skeleton::dof_count`] of them);
//! `C` a bone's own axes; `M = R_n … R_1` its rotations, the first named turning first; `L = C M
//! C⁻¹`; `G` the bone's global rotation, `G = G_parent L`; a bone ends at `start + G (offset)`,
//! where its children start.

use super::skeleton::{Channel, Skeleton};
use glam::{DMat3, DVec3};

/// A skeleton in one posture.
#[derive(Debug, Clone, Default)]
pub struct Posture {
    /// The global rotation of each bone.
    pub rotations: Vec<DMat3>,
    /// Where each bone starts, centimeters.
    pub starts: Vec<DVec3>,
    /// Where each bone ends: its joint, centimeters.
    pub ends: Vec<DVec3>,
}

/// Where a take's poses stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Space {
    /// Where they were captured.
    World,
    /// The root at the origin, the global rotation kept.
    Root,
    /// The root at the origin and no global rotation: Lai et al.'s training poses.
    Body,
}

/// How a bone stands on the one above: its rotation in the axes of the rest pose, how far it slides
/// in its own axes, and by how much it is longer, cm.
struct Local {
    rotation: DMat3,
    shift: DVec3,
    longer: f64,
}

impl Posture {
    fn clear(&mut self) {
        self.rotations.clear();
        self.starts.clear();
        self.ends.clear();
    }
}

impl Skeleton {
    /// Sets the root's values so that the posture stands in `space`.
    #[doc(hidden)]
    pub fn move_root_to(&self, q: &mut [f64], space: Space) {
        for (dof, value) in self.bones()[0].dofs.iter().zip(q) {
            if space == Space::Body || (space == Space::Root && !dof.channel.is_angle()) {
                *value = -dof.offset;
            }
        }
    }

    /// The posture for the values `q`. (The root's joint is where it starts.)
    ///
    /// ```
    /// use glam::{DMat3, DVec3};
    /// use posing_core::pose::{Bone, Channel, Dof, Skeleton, rotation::Axis};
    ///
    /// let bone = |name: &str, parent, offset, channel| {
    ///     let dof = Dof { channel, limits: None, offset: 0.0 };
    ///     Bone { name: name.into(), parent, offset, axis: DMat3::IDENTITY, dofs: vec![dof] }
    /// };
    /// let root = bone("root", None, DVec3::ZERO, Channel::Translate(Axis::Y));
    /// let arm = bone("arm", Some(0), DVec3::new(30.0, 0.0, 0.0), Channel::Rotate(Axis::Z));
    /// let skeleton = Skeleton::new(vec![root, arm])?;
    /// // The root 100 cm up; the arm, along x at rest, turned upwards by 90 degrees.
    /// let posture = skeleton.posture(&[100.0, 90_f64.to_radians()]);
    /// assert!((posture.ends[1] - DVec3::new(0.0, 130.0, 0.0)).length() < 1e-9);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    pub fn posture(&self, q: &[f64]) -> Posture {
        let mut out = Posture::default();
        self.posture_into(q, &mut out);
        out
    }

    /// [`Skeleton::posture`] into an old posture, without allocating.
    #[doc(hidden)]
    pub fn posture_into(&self, q: &[f64], out: &mut Posture) {
        self.posture_where(|_| true, q, out);
    }

    /// [`Skeleton::posture_into`] for the bones that are `wanted`, which must want their parents,
    /// too (see [`Skeleton::ancestors`]); the others stand at the origin.
    #[doc(hidden)]
    pub fn posture_of_bones(&self, wanted: &[bool], q: &[f64], out: &mut Posture) {
        self.posture_where(|i| wanted[i], q, out);
    }

    fn posture_where(&self, wanted: impl Fn(usize) -> bool, q: &[f64], out: &mut Posture) {
        out.clear();
        for i in 0..self.bones().len() {
            if wanted(i) {
                let local = self.local(i, &q[self.dofs_of(i)]);
                self.push_bone(i, &local, out);
                continue;
            }
            out.rotations.push(DMat3::IDENTITY);
            out.starts.push(DVec3::ZERO);
            out.ends.push(DVec3::ZERO);
        }
    }

    /// The posture of the values `q`, where the rotation against the bone above is another for
    /// those bones that `rotation` gives one for.
    #[doc(hidden)]
    pub fn posture_with(
        &self,
        rotation: impl Fn(usize) -> Option<DMat3>,
        q: &[f64],
        out: &mut Posture,
    ) {
        out.clear();
        for i in 0..self.bones().len() {
            let own = &q[self.dofs_of(i)];
            let local = match rotation(i) {
                None => self.local(i, own),
                Some(rotation) => Local {
                    rotation,
                    ..self.slides(i, own)
                },
            };
            self.push_bone(i, &local, out);
        }
    }

    /// How bone `i` stands on the one above for its own values.
    #[inline]
    fn local(&self, i: usize, own: &[f64]) -> Local {
        let (bone, rest) = (&self.bones()[i], &self.rest()[i]);
        let mut turn = DMat3::IDENTITY;
        for (dof, &value) in bone.dofs.iter().zip(own) {
            if let Channel::Rotate(axis) = dof.channel {
                turn = axis.rotation(value + dof.offset) * turn;
            }
        }
        let rotation = if bone.dofs.is_empty() {
            rest.fixed_rotation
        } else {
            bone.axis * turn * rest.inverse_axis
        };
        Local {
            rotation,
            ..self.slides(i, own)
        }
    }

    /// The rotation of bone `i` against the one above, in the axes of the rest pose, for its own
    /// values.
    #[doc(hidden)]
    pub fn local_rotation(&self, i: usize, own: &[f64]) -> DMat3 {
        self.local(i, own).rotation
    }

    /// The part of [`Skeleton::local`] that does not turn.
    #[inline]
    fn slides(&self, i: usize, own: &[f64]) -> Local {
        let (mut shift, mut longer) = (DVec3::ZERO, 0.0);
        for (dof, &value) in self.bones()[i].dofs.iter().zip(own) {
            match dof.channel {
                Channel::Rotate(_) => {}
                Channel::Translate(axis) => shift += axis.unit() * (value + dof.offset),
                Channel::Length => longer += value + dof.offset,
            }
        }
        Local {
            rotation: DMat3::IDENTITY,
            shift,
            longer,
        }
    }

    /// Appends bone `i`, after all before it.
    #[inline]
    fn push_bone(&self, i: usize, local: &Local, out: &mut Posture) {
        let (bone, rest) = (&self.bones()[i], &self.rest()[i]);
        let (before, mut start) = match bone.parent {
            Some(p) => (out.rotations[p], out.ends[p]),
            None => (DMat3::IDENTITY, DVec3::ZERO),
        };
        if rest.translates {
            start += before * (bone.axis * local.shift);
        }
        let rotation = before * local.rotation;
        out.rotations.push(rotation);
        out.starts.push(start);
        let along = bone.offset + rest.direction * local.longer;
        // A bone without length ends where it starts, even if its rotation is missing.
        out.ends.push(if along == DVec3::ZERO {
            start
        } else {
            start + rotation * along
        });
    }

    /// How each value moves what it moves, at the posture of the values `q`.
    #[doc(hidden)]
    pub fn dof_motions(&self, q: &[f64], posture: &Posture, out: &mut Vec<DofMotion>) {
        out.clear();
        (0..self.bones().len()).for_each(|i| self.push_dof_motions(i, q, posture, out));
    }

    /// Appends how each value of bone `i` moves what it moves.
    #[doc(hidden)]
    pub fn push_dof_motions(
        &self,
        i: usize,
        q: &[f64],
        posture: &Posture,
        out: &mut Vec<DofMotion>,
    ) {
        let bone = &self.bones()[i];
        let before = (bone.parent).map_or(DMat3::IDENTITY, |p| posture.rotations[p]);
        let own = &q[self.dofs_of(i)];
        for (n, dof) in bone.dofs.iter().enumerate() {
            // The rotations named after this one still turn its axis.
            let mut later = DMat3::IDENTITY;
            for (d, &value) in bone.dofs[n + 1..].iter().zip(&own[n + 1..]) {
                if let Channel::Rotate(axis) = d.channel {
                    later = axis.rotation(value + d.offset) * later;
                }
            }
            out.push(match dof.channel {
                Channel::Rotate(axis) => DofMotion::Turn {
                    axis: before * (bone.axis * (later * axis.unit())),
                    about: posture.starts[i],
                },
                Channel::Translate(axis) => DofMotion::Slide(before * (bone.axis * axis.unit())),
                Channel::Length => {
                    DofMotion::Slide(posture.rotations[i] * self.rest()[i].direction)
                }
            });
        }
    }
}

/// How a value moves the ends of its own bone and of those below it.
#[derive(Debug, Clone, Copy)]
#[doc(hidden)]
pub enum DofMotion {
    /// A turn about an axis of unit length through a point, radians.
    Turn {
        /// The axis.
        axis: DVec3,
        /// A point on it, centimeters.
        about: DVec3,
    },
    /// A shift, centimeters a centimeter.
    Slide(DVec3),
}

impl DofMotion {
    /// The derivative by the value of the position of a point that is at `position`: a column of
    /// the Jacobian.
    pub fn derivative(&self, position: DVec3) -> DVec3 {
        match *self {
            DofMotion::Turn { axis, about } => axis.cross(position - about),
            DofMotion::Slide(along) => along,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::rotation::{Axis, compose, parse_order};
    use super::super::skeleton::{Bone, Dof};
    use super::*;

    fn dof(channel: &str, offset: f64) -> Dof {
        Dof {
            offset,
            ..Dof::free(Channel::parse(channel).unwrap())
        }
    }

    pub(crate) fn arm() -> Skeleton {
        let order = parse_order("XYZ").unwrap();
        Skeleton::new(vec![
            Bone {
                name: "root".into(),
                parent: None,
                offset: DVec3::ZERO,
                axis: DMat3::IDENTITY,
                dofs: ["tx", "ty", "tz", "rx", "ry", "rz"]
                    .map(|c| dof(c, 0.1))
                    .to_vec(),
            },
            Bone {
                name: "upper".into(),
                parent: Some(0),
                offset: DVec3::new(10.0, 1.0, 0.0),
                axis: compose(&order, &[0.2, -0.4, 0.9]),
                dofs: vec![
                    dof("rz", 0.0),
                    dof("rx", 0.0),
                    dof("tx", 0.0),
                    dof("l", 0.0),
                ],
            },
            Bone {
                name: "lower".into(),
                parent: Some(1),
                offset: DVec3::new(0.0, 8.0, 0.0),
                axis: compose(&order, &[-1.2, 0.4, 0.3]),
                dofs: vec![dof("ry", 0.0)],
            },
            Bone {
                name: "other".into(),
                parent: Some(0),
                offset: DVec3::new(0.0, -3.0, 0.0),
                axis: DMat3::IDENTITY,
                dofs: vec![],
            },
        ])
        .unwrap()
    }

    #[test]
    fn motions_are_the_derivatives() {
        let s = arm();
        let q: Vec<f64> = (0..s.dof_count())
            .map(|i| 0.3 * (i as f64 * 1.7).sin())
            .collect();
        let (posture, mut motions) = (s.posture(&q), Vec::new());
        s.dof_motions(&q, &posture, &mut motions);
        let h = 1e-6;
        for d in 0..s.dof_count() {
            let moved = |by: f64| {
                let mut q = q.clone();
                q[d] += by;
                s.posture(&q).ends
            };
            let (plus, minus) = (moved(h), moved(-h));
            let bone = (0..4).find(|&b| s.dofs_of(b).contains(&d)).unwrap();
            let hangs_below = |&j: &usize| {
                let mut up = std::iter::successors(Some(j), |&j| s.bones()[j].parent);
                up.any(|j| j == bone)
            };
            for joint in (0..4).filter(hangs_below) {
                let want = (plus[joint] - minus[joint]) / (2.0 * h);
                let got = motions[d].derivative(posture.ends[joint]);
                assert!((got - want).length() <= 1e-7, "{d} {joint}: {got} {want}");
            }
        }
    }

    #[test]
    fn a_partial_posture_equals_that_part_of_the_full_one() {
        let s = arm();
        let q: Vec<f64> = (0..s.dof_count()).map(|i| 0.2 * i as f64 - 0.7).collect();
        let whole = s.posture(&q);
        for joint in 0..4 {
            let wanted = s.ancestors(&[joint]);
            assert_eq!(wanted.iter().filter(|w| **w).count(), [1, 2, 3, 2][joint]);
            let mut part = Posture::default();
            s.posture_of_bones(&wanted, &q, &mut part);
            assert_eq!(part.ends[joint], whole.ends[joint]);
        }
    }

    #[test]
    fn a_bones_rotation_turns_the_bone_itself() {
        let s = arm();
        let mut q = vec![0.0; s.dof_count()];
        let rest = s.posture(&q).ends;
        q[s.dofs_of(2).start] = 0.5;
        let turned = s.posture(&q).ends;
        assert!((turned[1] - rest[1]).length() <= 1e-12);
        assert!((turned[2] - rest[2]).length() > 1.0);
        assert!((Axis::Y.unit() - DVec3::Y).length() <= 0.0);
    }
}

//! Any skeleton as a BVH hierarchy: the bone convention that Blender, MotionBuilder and retargeters
//! expect.
//!
//! JOINT NAME stands at the start of bone NAME and turns it; what hangs on the bone stands at its
//! end; the last bone ends in an End Site. Bones that start together become joints with one OFFSET,
//! each turning its own bone. A bone of an ASF turns by `L = C M C⁻¹` in the rest pose's axes, `G =
//! G_parent L`, so the joint's rotation is L, the OFFSETs are the ASF's and the poses are equal.

use super::{Bvh, EndSite, Joint};
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{Axis, decompose};
use crate::pose::{Channel, Skeleton};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};

/// Turns postures of a skeleton into frames of a BVH file.
pub struct BvhExporter<'a> {
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

impl<'a> BvhExporter<'a> {
    /// `order` is that of the rotation channels, the last turning first; `turn` carries our axes to
    /// the file's.
    pub(crate) fn new(skeleton: &'a Skeleton, order: [Axis; 3], turn: DMat3) -> BvhExporter<'a> {
        let all = skeleton.bones();
        let mut children = vec![Vec::new(); all.len()];
        for (i, bone) in all.iter().enumerate() {
            if let Some(p) = bone.parent {
                children[p].push(i);
            }
        }
        let (mut bones, mut index) = (Vec::with_capacity(all.len()), vec![0; all.len()]);
        let mut stack = vec![0];
        while let Some(bone) = stack.pop() {
            index[bone] = bones.len();
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
                parent: bone.parent.map(|p| index[p]),
                offset: bone.parent.map_or(DVec3::ZERO, |p| turn * all[p].offset),
                channels,
                ends: if children[i].is_empty() {
                    vec![EndSite {
                        offset: turn * bone.offset,
                        after: 0,
                    }]
                } else {
                    Vec::new()
                },
            }
        });
        BvhExporter {
            skeleton,
            order,
            turn,
            joints: joints.collect(),
            near: vec![[0.0; 3]; bones.len()],
            bones,
        }
    }

    /// Appends the channels of the next frame, centimeters and radians. Angles follow those of the
    /// frame before.
    pub(crate) fn frame(&mut self, posture: &Posture, out: &mut Vec<f64>) {
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

impl Bvh {
    /// The motion of `skeleton` with the given `values` (frames, degrees of freedom; radians and
    /// centimeters). `order` is that of the rotation channels, the last turning first; `turn`
    /// carries our axes (y up) to the file's.
    ///
    /// # Errors
    /// [`Error::Usage`]: not as many values a frame as the skeleton has degrees of freedom.
    #[doc(hidden)]
    pub fn from_values(
        skeleton: &Skeleton,
        values: ArrayView2<'_, f64>,
        order: [Axis; 3],
        turn: DMat3,
        frame_time: f64,
    ) -> Result<Bvh> {
        if values.ncols() != skeleton.dof_count() {
            return Err(Error::usage(format!(
                "{} values a frame for {} degrees of freedom",
                values.ncols(),
                skeleton.dof_count()
            )));
        }
        let mut exporter = BvhExporter::new(skeleton, order, turn);
        let (mut posture, mut motion) = (Posture::default(), Vec::new());
        for q in values.rows() {
            skeleton.posture_into(&q.to_vec(), &mut posture);
            exporter.frame(&posture, &mut motion);
        }
        let joints = exporter.joints;
        let shape = (values.nrows(), Bvh::channels(&joints));
        let motion = Array2::from_shape_vec(shape, motion);
        Ok(Bvh {
            joints,
            frame_time,
            motion: motion.map_err(|e| Error::usage(e.to_string()))?,
            notes: Vec::new(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BvhPoints, BvhSkeleton};
    use super::*;
    use crate::pose::rotation::parse_order;
    use crate::pose::{Bone, Dof};

    #[test]
    fn an_exported_skeleton_has_the_same_poses_in_every_order_and_axis() {
        let bone = |name: &str, parent, offset: [f64; 3], dofs: &[&str]| Bone {
            name: name.into(),
            parent,
            offset: DVec3::from_array(offset),
            axis: DMat3::from_rotation_z(offset[0]) * DMat3::from_rotation_x(0.4),
            dofs: dofs
                .iter()
                .map(|c| Dof::free(crate::pose::Channel::parse(c).unwrap()))
                .collect(),
        };
        let s = Skeleton::new(vec![
            bone(
                "root",
                None,
                [0., 0., 0.],
                &["tx", "ty", "tz", "rx", "ry", "rz"],
            ),
            bone("hip", Some(0), [1., -2., 0.], &[]),
            bone("spine", Some(0), [0., 5., 0.], &["rx", "ry", "rz"]),
            // What hangs on a bone that grows gets position channels, and so does one that slides.
            bone("leg", Some(1), [0., -9., 1.], &["rx", "l"]),
            bone("foot", Some(3), [0., -1., 3.], &["ry"]),
            bone("pack", Some(2), [0., -1., -2.], &["tx", "rz"]),
            bone("head", Some(2), [0., 3., 0.], &["rz"]),
        ])
        .unwrap();
        for order in ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"] {
            for turn in [
                DMat3::IDENTITY,
                DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2),
            ] {
                let mut converter = BvhExporter::new(&s, parse_order(order).unwrap(), turn);
                let rig = BvhSkeleton::new(&converter.joints, turn.transpose(), true).unwrap();
                let mut q = vec![0.0; rig.skeleton.dof_count()];
                for round in 0..5 {
                    let values: Vec<f64> = (0..s.dof_count())
                        .map(|i| ((i + 1 + 9 * round) as f64).sin())
                        .collect();
                    let want = s.posture(&values);
                    let mut frame = Vec::new();
                    converter.frame(&want, &mut frame);
                    rig.values(&frame, &mut q);
                    let got = rig.skeleton.posture(&q);
                    for (name, bone) in rig.points(BvhPoints::Ends) {
                        let end = want.ends[s.find(name).unwrap()];
                        let fits = (got.ends[*bone] - end).length() <= 1e-9;
                        // Its children start apart: the mean is not the bone's end.
                        assert!(fits || name == "spine", "{order} {name}");
                    }
                }
            }
        }
    }
}

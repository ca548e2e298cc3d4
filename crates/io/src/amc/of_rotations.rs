//! The values of an Acclaim skeleton for rotations of its bones that come from elsewhere.
//!
//! A bone takes of its rotation the angles that it has; the others, which it loses, turn before
//! them, that about the limb itself first. Of a limb with one angle, such as a shank, the bone
//! above turns about itself so that the limb can have its direction. Bones below make good what is
//! lost.

use super::{Amc, Asf};
use crate::bvh::Bvh;
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{Axis, decompose, rotation_zyx};
use crate::pose::{Bone, Channel};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// The bend of a limb, as the sine of its angle, below which its plane counts for little.
const STRAIGHT: f64 = 0.05;

impl Asf {
    /// The skeleton in its rest pose as a hierarchy of BVH, with joint NAME at the start of bone
    /// NAME, in centimeters.
    ///
    /// # Errors
    /// None for a skeleton that was read.
    pub fn to_bvh(&self) -> Result<Bvh> {
        let rest = Array2::zeros((1, self.skeleton.dof_count()));
        let order = [Axis::Z, Axis::Y, Axis::X];
        Bvh::from_values(&self.skeleton, rest.view(), order, DMat3::IDENTITY, 1.0)
    }

    /// The take of a motion of the hierarchy of [`Asf::to_bvh`], frames counted from 1; how far the
    /// ends of its bones are from those of the motion, in cm: on average and at most.
    ///
    /// # Errors
    /// [`Error::Unfit`]: the motion is of another hierarchy, or values of it are missing.
    pub fn take_of(&self, bvh: &Bvh) -> Result<(Amc<'_>, [f64; 2])> {
        let (skeleton, bones) = (&self.skeleton, self.skeleton.bones());
        let mut columns = vec![0; bones.len()];
        let mut end = 0;
        for joint in &bvh.joints {
            end += joint.channels.len();
            let bone = bones.iter().position(|bone| bone.name == joint.name);
            columns[bone.ok_or_else(|| Error::unfit("has other bones"))?] = end - 3;
        }
        let mut values = Array2::zeros((bvh.motion.nrows(), skeleton.dof_count()));
        let (mut near, mut far) = (vec![[0.0; 3]; bones.len()], [0.0, 0.0_f64]);
        let [mut goal, mut posture] = [Posture::default(), Posture::default()];
        for (row, mut out) in bvh.motion.rows().into_iter().zip(values.rows_mut()) {
            if !row.iter().all(|v| v.is_finite()) {
                let what = "misses values, which an AMC file cannot hold; fill them with clean";
                return Err(Error::unfit(what));
            }
            let mut q = vec![0.0; skeleton.dof_count()];
            let at = bones[0].axis.transpose() * DVec3::new(row[0], row[1], row[2]);
            for (value, dof) in q[skeleton.dofs_of(0)].iter_mut().zip(&bones[0].dofs) {
                if let Channel::Translate(axis) = dof.channel {
                    *value = at[axis.index()] - dof.offset;
                }
            }
            let local = |c: usize| rotation_zyx(DVec3::new(row[c + 2], row[c + 1], row[c]));
            skeleton.posture_with(|bone| Some(local(columns[bone])), &q, &mut goal);
            self.turn(&goal, &mut near, &mut q);
            skeleton.posture_into(&q, &mut posture);
            for (a, b) in posture.ends.iter().zip(&goal.ends) {
                far = [far[0] + a.distance(*b), far[1].max(a.distance(*b))];
            }
            out.assign(&ndarray::ArrayView1::from(&q));
        }
        far[0] /= (values.nrows() * bones.len()).max(1) as f64;
        Ok((Amc::from_values(self, 1, values.view()), far))
    }

    /// Gives `q` the angles that come near to a posture. `near`: each bone's in the frame before.
    fn turn(&self, goal: &Posture, near: &mut [[f64; 3]], q: &mut [f64]) {
        let bones = self.skeleton.bones();
        let mut rotations: Vec<DMat3> = Vec::with_capacity(bones.len());
        for (i, bone) in bones.iter().enumerate() {
            let before = bone.parent.map_or(DMat3::IDENTITY, |p| rotations[p]);
            let mut wanted = goal.rotations[i];
            if let (Some(_), Some(hinge)) = (bone.ball_axes(), hinge_after(bones, i)) {
                let limb = goal.rotations[hinge] * bones[hinge].offset;
                wanted *= plane_turn(bone, &bones[hinge], wanted.transpose() * limb);
            }
            let own = bone.axis.transpose() * before.transpose() * wanted * bone.axis;
            let order = order_of(bone);
            near[i] = decompose(&own, order, near[i]);
            let range = self.skeleton.dofs_of(i);
            for (value, dof) in q[range.clone()].iter_mut().zip(&bone.dofs) {
                if let Channel::Rotate(axis) = dof.channel {
                    let at = order.iter().position(|of| *of == axis).unwrap_or(0);
                    *value = near[i][at] - dof.offset;
                }
            }
            rotations.push(before * self.skeleton.local_rotation(i, &q[range]));
        }
    }
}

/// The axes of a bone's turns, the last turning first: those that it has, and before them the
/// others, that along the limb first of all.
fn order_of(bone: &Bone) -> [Axis; 3] {
    let along = bone.axis.transpose() * bone.offset;
    let mut axes = [Axis::X, Axis::Y, Axis::Z];
    let own = |axis: &Axis| {
        bone.dofs
            .iter()
            .position(|d| d.channel == Channel::Rotate(*axis))
    };
    axes.sort_by(|a, b| match (own(a), own(b)) {
        (None, None) => along[a.index()].abs().total_cmp(&along[b.index()].abs()),
        (a, b) => b.cmp(&a),
    });
    axes
}

/// The only bone on bone `i`, if it has one angle.
fn hinge_after(bones: &[Bone], i: usize) -> Option<usize> {
    let mut below = (0..bones.len()).filter(|b| bones[*b].parent == Some(i));
    let one = below.next().filter(|b| bones[*b].dofs.len() == 1)?;
    below.next().is_none().then_some(one)
}

/// The turn of a bone about itself after which its hinge can point its limb to `limb`, in the
/// bone's axes; less of it the straighter the limb is.
fn plane_turn(bone: &Bone, hinge: &Bone, limb: DVec3) -> DMat3 {
    let along = bone.offset.normalize_or_zero();
    let axis = hinge.axis * order_of(hinge)[0].unit();
    // The hinge's axis turned by t has to have the same share of the limb as at rest.
    let share = axis.dot(along) * along.dot(limb);
    let (a, b) = (axis.dot(limb) - share, along.cross(axis).dot(limb));
    let (reach, wanted) = (a.hypot(b), axis.dot(hinge.offset) - share);
    if !(reach > 1e-9) || (a - wanted).abs() <= 1e-9 {
        return DMat3::IDENTITY;
    }
    let half = (wanted / reach).clamp(-1.0, 1.0).acos();
    let way = |half: f64| (b.atan2(a) + half).sin().atan2((b.atan2(a) + half).cos());
    let [one, other] = [way(-half), way(half)];
    let least = if one.abs() <= other.abs() { one } else { other };
    let bend = (reach / limb.length() / STRAIGHT).powi(2);
    DMat3::from_axis_angle(along, least * bend / (1.0 + bend))
}

#[cfg(test)]
mod tests;

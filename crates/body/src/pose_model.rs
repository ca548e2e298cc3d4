//! How flesh follows the joints: the matrix Q of each triangle, from the rotations at the joints
//! nearest to it.
//!
//! The twist of a joint is the rotation vector of R_aᵀ R_b, of its two parts. Each of the nine
//! numbers of Q_k is an affine function of the twists of the joints nearest to the TRIANGLE, or of
//! the entries of their R_aᵀ R_b, learned by least squares from decomposed poses. (Anguelov et al.
//! take the twists of the two joints nearest to the triangle's part, which errs three times as
//! much.)

use super::template::Template;
use crate::Result;
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel;
use crate::pose::rotation::{
    cross_matrix, from_rotation_vector, rotation_vector, rotation_vector_jacobian,
};
use glam::{DMat3, DVec3};
use ndarray::{Array2, s};
use std::collections::BTreeMap;

/// The joints that a triangle follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Follows {
    /// The joints nearest to the triangle: this many.
    OfTriangle(usize),
    /// The joints nearest to the middle of the triangle's part (Anguelov et al.'s two).
    OfPart(usize),
}

impl Default for Follows {
    fn default() -> Self {
        Follows::OfTriangle(4)
    }
}

/// What of a joint the triangles follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointInputs {
    /// The three components of its twist.
    Twist,
    /// The nine entries of its rotation, less those of no rotation, by columns: they tell a bend
    /// from its square, and need more poses.
    Rotation,
}

names!(JointInputs {
    Twist = "twist",
    Rotation = "rotation",
});

impl JointInputs {
    /// The share of the mean diagonal that is added to the normal matrix.
    fn ridge(self) -> f64 {
        match self {
            JointInputs::Twist => 1e-4,
            JointInputs::Rotation => 0.1,
        }
    }

    /// How many numbers a joint has.
    pub(crate) fn width(self) -> usize {
        match self {
            JointInputs::Twist => 3,
            JointInputs::Rotation => 9,
        }
    }

    /// The numbers of a joint.
    pub(crate) fn of(self, twist: DVec3) -> Vec<f64> {
        match self {
            JointInputs::Twist => twist.to_array().to_vec(),
            JointInputs::Rotation => {
                let rotation = from_rotation_vector(twist) - DMat3::IDENTITY;
                rotation.to_cols_array().to_vec()
            }
        }
    }

    /// How each number changes with the components of the twist.
    pub(crate) fn slopes(self, twist: DVec3) -> Vec<DVec3> {
        match self {
            JointInputs::Twist => vec![DVec3::X, DVec3::Y, DVec3::Z],
            JointInputs::Rotation => {
                // A turn by d in the rotation's own frame changes the twist by J d.
                let turn = rotation_vector_jacobian(twist).inverse();
                let rotation = from_rotation_vector(twist);
                let by = [0, 1, 2].map(|c| (rotation * cross_matrix(turn.col(c))).to_cols_array());
                (0..9)
                    .map(|e| DVec3::new(by[0][e], by[1][e], by[2][e]))
                    .collect()
            }
        }
    }
}

/// Predicts the Q of all triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseModel {
    /// The joints that each triangle follows (P, J), of [`Template::joints`].
    pub joints: Vec<Vec<usize>>,
    /// What of a joint they follow: n numbers.
    pub inputs: JointInputs,
    /// (P, 9 (n J + 1)): for each number of Q, by columns, a factor for each number of each joint,
    /// then the constant.
    pub coefficients: Array2<f32>,
}

/// The twist of each joint, of its two parts.
pub(crate) fn twists(joints: &[[usize; 2]], rotations: &[DMat3]) -> Vec<DVec3> {
    let twist = |[a, b]: &[usize; 2]| rotation_vector(&(rotations[*a].transpose() * rotations[*b]));
    joints.iter().map(twist).collect()
}

impl PoseModel {
    /// Learns from poses: the rotations of the parts, and the Q of the triangles, of each.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: there is no pose.
    pub fn learn(
        template: &Template,
        poses: &[(Vec<DMat3>, Vec<DMat3>)],
        follows: Follows,
        inputs: JointInputs,
    ) -> Result<PoseModel> {
        if poses.is_empty() {
            return Err("a pose model is learned from one pose or more; none is given".into());
        }
        let joints = followed_joints(template, follows);
        let of_pose = |r: &[DMat3]| -> Vec<Vec<f64>> {
            let twists = twists(&template.joint_parts(), r).into_iter();
            twists.map(|twist| inputs.of(twist)).collect()
        };
        let numbers: Vec<Vec<Vec<f64>>> = poses.iter().map(|(r, _)| of_pose(r)).collect();
        let mut groups: BTreeMap<&[usize], Vec<usize>> = BTreeMap::new();
        for (k, joints) in joints.iter().enumerate() {
            groups.entry(joints).or_default().push(k);
        }
        let groups: Vec<(&[usize], Vec<usize>)> = groups.into_iter().collect();
        let width = inputs.width() * joints[0].len() + 1;
        let mut coefficients = Array2::zeros((template.faces.len(), 9 * width));
        let learned = parallel::map_chunks(groups.len(), 1, |range| {
            groups[range]
                .iter()
                .map(|(joints, faces)| learn_group(joints, faces, &numbers, poses, inputs.ridge()))
                .collect::<Vec<_>>()
        });
        for ((_, faces), learned) in groups.iter().zip(learned.into_iter().flatten()) {
            // (width, 9 faces).
            let learned = learned.ok_or("the rotations of the poses are not finite")?;
            for (f, face) in faces.iter().enumerate() {
                for entry in 0..9 {
                    let column = learned.slice(s![.., 9 * f + entry]).mapv(|v| v as f32);
                    let to = s![*face, entry * width..(entry + 1) * width];
                    coefficients.slice_mut(to).assign(&column);
                }
            }
        }
        Ok(PoseModel {
            joints,
            inputs,
            coefficients,
        })
    }

    /// What Q of triangle `k` is multiplied by each of its inputs: the numbers of its joints, then
    /// 1.
    pub(crate) fn terms(&self, k: usize) -> impl Iterator<Item = DMat3> + '_ {
        let width = self.coefficients.ncols() / 9;
        let term = move |t: usize| {
            let entry = |e: usize| f64::from(self.coefficients[[k, e * width + t]]);
            DMat3::from_cols_array(&std::array::from_fn(entry))
        };
        (0..width).map(term)
    }

    /// The Q of each triangle for rotations of the parts.
    pub fn deformations(&self, template: &Template, rotations: &[DMat3]) -> Vec<DMat3> {
        let twists = twists(&template.joint_parts(), rotations).into_iter();
        let numbers: Vec<Vec<f64>> = twists.map(|twist| self.inputs.of(twist)).collect();
        let (width, own) = (self.coefficients.ncols() / 9, self.inputs.width());
        let parts = parallel::map_chunks(self.joints.len(), 1024, |range| {
            let mut out = Vec::with_capacity(range.len());
            let mut inputs = vec![1.0; width];
            for k in range {
                for (to, joint) in inputs.chunks_exact_mut(own).zip(&self.joints[k]) {
                    to.copy_from_slice(&numbers[*joint]);
                }
                let row = self.coefficients.row(k);
                let row = row.as_slice().unwrap_or(&[]);
                let mut q = [0.0; 9];
                for (q, factors) in q.iter_mut().zip(row.chunks_exact(width)) {
                    *q = factors
                        .iter()
                        .zip(&inputs)
                        .map(|(f, x)| f64::from(*f) * x)
                        .sum();
                }
                out.push(DMat3::from_cols_array(&q));
            }
            out
        });
        parts.concat()
    }
}

fn followed_joints(template: &Template, follows: Follows) -> Vec<Vec<usize>> {
    let middle = |vertices: &mut dyn Iterator<Item = &usize>| {
        let (sum, n) = vertices.fold((DVec3::ZERO, 0.0), |(sum, n), v| {
            (sum + template.vertices[*v], n + 1.0)
        });
        sum / n
    };
    match follows {
        Follows::OfTriangle(count) => (template.faces.iter())
            .map(|f| nearest_joints(template, middle(&mut f.iter()), count))
            .collect(),
        Follows::OfPart(count) => {
            let of_part = |part: usize| {
                let mut corners = (template.faces.iter().zip(&template.face_parts))
                    .filter(|(_, p)| **p == part)
                    .flat_map(|(f, _)| f);
                nearest_joints(template, middle(&mut corners), count)
            };
            let of_parts: Vec<Vec<usize>> = (0..template.parts()).map(of_part).collect();
            let of_face = |p: &usize| of_parts[*p].clone();
            template.face_parts.iter().map(of_face).collect()
        }
    }
}

fn nearest_joints(template: &Template, middle: DVec3, count: usize) -> Vec<usize> {
    let distance = |j: &usize| (template.joints[*j].at - middle).length();
    let mut joints: Vec<usize> = (0..template.joints.len()).collect();
    joints.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    joints.truncate(count);
    joints.sort_unstable();
    joints
}

/// The factors of the triangles that follow one set of joints (width, 9 triangles).
fn learn_group(
    joints: &[usize],
    faces: &[usize],
    numbers: &[Vec<Vec<f64>>],
    poses: &[(Vec<DMat3>, Vec<DMat3>)],
    ridge: f64,
) -> Option<Array2<f64>> {
    let own = numbers[0].first().map_or(0, Vec::len);
    let width = own * joints.len() + 1;
    let inputs = Array2::from_shape_fn((poses.len(), width), |(i, c)| {
        if c + 1 == width {
            1.0
        } else {
            numbers[i][joints[c / own]][c % own]
        }
    });
    let outputs = Array2::from_shape_fn((poses.len(), 9 * faces.len()), |(i, c)| {
        poses[i].1[faces[c / 9]].to_cols_array()[c % 9]
    });
    let mut normal = inputs.t().dot(&inputs);
    let ridge = ridge * normal.diag().sum() / width as f64;
    // The constant is not drawn to 0: it is Q without a bend.
    let mut drawn = normal.diag_mut();
    drawn.slice_mut(s![..width - 1]).mapv_inplace(|v| v + ridge);
    Cholesky::new(normal)?.solve(&inputs.t().dot(&outputs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_agree_with_differences() {
        for inputs in [JointInputs::Twist, JointInputs::Rotation] {
            for twist in [
                DVec3::ZERO,
                DVec3::new(0.3, -1.1, 0.7),
                DVec3::new(0.0, 2.9, 0.4),
            ] {
                let slopes = inputs.slopes(twist);
                for axis in 0..3 {
                    let at = |h: f64| inputs.of(twist + DVec3::AXES[axis] * h);
                    let (up, down) = (at(1e-6), at(-1e-6));
                    for (e, slope) in slopes.iter().enumerate() {
                        let by = (up[e] - down[e]) / 2e-6;
                        assert!((by - slope[axis]).abs() < 1e-6, "{inputs:?} {e}: {by}");
                    }
                }
            }
        }
    }
}

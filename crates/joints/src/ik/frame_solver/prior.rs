//! The prior over the rotations of a frame, as the columns of its states have it.

use super::state::{Column, FrameState, FrameStates};
use crate::ik::tuning::frame_solver::{ANGLE_ROUNDS, SLIDE_SD};
use crate::numeric::linalg;
use crate::pose::Skeleton;
use crate::pose::kinematics::{DofMotion, Posture};
use crate::pose::rotation::rotation_vector;
use crate::prior::rotations::JointPrior;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// What is most probable in a frame, and how sure that is.
pub(super) struct FramePrior {
    /// The bones with a prior, their first column and number of columns: the first of all.
    pub bones: Vec<(usize, usize, usize)>,
    /// Means of the bones with a prior: M, or the angles.
    pub mean: FrameState,
    /// Λ, (columns with a prior, the same), by rows.
    pub precision: Vec<f64>,
    /// One over the variance of the other columns; 0 of the root's.
    pub held: Vec<f64>,
}

impl FramePrior {
    /// The prior of the bones that move one of the joints, which turn about the `root`; `states`
    /// get the columns that are solved for.
    ///
    /// # Errors
    /// [`Error::Usage`]: the covariance of the prior is singular.
    pub(super) fn new(
        prior: &JointPrior,
        root: usize,
        joints: &[usize],
        states: &mut FrameStates<'_>,
    ) -> Result<FramePrior> {
        let moves_a_joint = moving_bones(states.skeleton, joints);
        let with_prior: Vec<usize> = (0..prior.bones.len())
            .filter(|n| moves_a_joint[prior.bones[*n]])
            .collect();
        let mut out = FramePrior {
            bones: Vec::new(),
            mean: mean_state(states, prior, &with_prior),
            precision: Vec::new(),
            held: Vec::new(),
        };
        for &n in &with_prior {
            let (bone, first) = (prior.bones[n], states.columns.len());
            states.push_turns(bone);
            let count = states.columns.len() - first;
            out.bones.push((bone, first, count));
        }
        out.precision = out.precision_of(prior, &with_prior, states)?;
        states.push_turns(root);
        out.held = vec![0.0; states.columns.len()];
        out.push_slides(root, &moves_a_joint, states);
        Ok(out)
    }

    /// Λ: the inverse of the covariance of the columns. The angles of a bone that has fewer than
    /// three are those whose turns are nearest to a rotation vector.
    fn precision_of(
        &self,
        prior: &JointPrior,
        of: &[usize],
        states: &FrameStates<'_>,
    ) -> Result<Vec<f64>> {
        let size = states.columns.len();
        let mut to_columns: Array2<f64> = Array2::zeros((size, 3 * prior.bones.len()));
        for (&n, &(bone, first, count)) in of.iter().zip(&self.bones) {
            let rows: Vec<DVec3> = if states.is_ball[bone] {
                vec![DVec3::X, DVec3::Y, DVec3::Z]
            } else {
                pseudo_inverse(&turn_axes(states.skeleton, bone, &self.mean.values))
            };
            for (i, j) in (0..count).flat_map(|i| (0..3).map(move |j| (i, j))) {
                to_columns[[first + i, 3 * n + j]] = rows[i][j];
            }
        }
        let covariance = to_columns.dot(&prior.covariance).dot(&to_columns.t());
        let singular = || Error::usage("the covariance of the prior of rotations is singular");
        if size == 0 {
            return Ok(Vec::new());
        }
        let factor = linalg::Cholesky::new(covariance).ok_or_else(singular)?;
        let inverse = factor.solve(&Array2::eye(size)).ok_or_else(singular)?;
        let symmetric = Array2::from_shape_fn((size, size), |(i, j)| {
            (inverse[[i, j]] + inverse[[j, i]]) / 2.0
        });
        Ok(symmetric.into_iter().collect())
    }

    /// Appends the columns of what slides: free where they move the whole body, at the root or
    /// nearest above it, else held to their rest. Those farther above stay at rest.
    fn push_slides(&mut self, root: usize, moves_a_joint: &[bool], states: &mut FrameStates<'_>) {
        let bones = states.skeleton.bones();
        let slides = |b: usize| bones[b].dofs.iter().any(|d| !d.channel.is_angle());
        let body = states.above(root).into_iter().find(|&b| slides(b));
        for bone in 0..bones.len() {
            let is_below = bone != root && states.above(bone).contains(&root);
            if Some(bone) != body && !(moves_a_joint[bone] && is_below) {
                continue;
            }
            for (n, dof) in bones[bone].dofs.iter().enumerate() {
                if !dof.channel.is_angle() {
                    states.columns.push(Column::Dof(bone, n));
                    let held = if Some(bone) == body {
                        0.0
                    } else {
                        SLIDE_SD.powi(-2)
                    };
                    self.held.push(held);
                }
            }
        }
    }

    /// r.
    pub(super) fn set_deviations(
        &self,
        states: &FrameStates<'_>,
        state: &FrameState,
        out: &mut Vec<f64>,
    ) {
        out.clear();
        for &(bone, first, count) in &self.bones {
            if states.is_ball[bone] {
                let off = state.rotations[bone] * self.mean.rotations[bone].transpose();
                out.extend(rotation_vector(&off).to_array());
                continue;
            }
            for column in &states.columns[first..first + count] {
                out.push(states.slide(*column, state) - states.slide(*column, &self.mean));
            }
        }
    }
}

/// Whether each bone moves one of the joints by turning.
fn moving_bones(skeleton: &Skeleton, joints: &[usize]) -> Vec<bool> {
    let bones = skeleton.bones();
    let turned = |&joint: &usize| {
        let is_short = bones[joint].offset == DVec3::ZERO;
        if is_short {
            bones[joint].parent
        } else {
            Some(joint)
        }
    };
    let turned: Vec<usize> = joints.iter().filter_map(turned).collect();
    skeleton.ancestors(&turned)
}

/// The state in which the bones with a prior, by their number there, are at its mean, the others at
/// rest.
fn mean_state(states: &FrameStates<'_>, prior: &JointPrior, with_prior: &[usize]) -> FrameState {
    let skeleton = states.skeleton;
    let dofs = skeleton.bones().iter().flat_map(|b| &b.dofs);
    let mut state = states.state_of(&dofs.map(|d| -d.offset).collect::<Vec<f64>>());
    for &n in with_prior {
        let (bone, mean) = (prior.bones[n], &prior.means[n]);
        if states.is_ball[bone] {
            state.rotations[bone] = *mean;
            continue;
        }
        // The angles whose rotation is nearest to the mean: Gauss's and Newton's steps.
        let values = &mut state.values;
        for _ in 0..ANGLE_ROUNDS {
            let own = skeleton.local_rotation(bone, &values[skeleton.dofs_of(bone)]);
            let off = rotation_vector(&(*mean * own.transpose()));
            let rows = pseudo_inverse(&turn_axes(skeleton, bone, values));
            let angles = angle_values(skeleton, bone);
            angles
                .zip(rows)
                .for_each(|(i, row)| values[i] += row.dot(off));
        }
    }
    state
}

/// The values of a bone that are angles.
fn angle_values(skeleton: &Skeleton, bone: usize) -> impl Iterator<Item = usize> {
    let first = skeleton.dofs_of(bone).start;
    let dofs = skeleton.bones()[bone].dofs.iter().enumerate();
    dofs.filter(|(_, d)| d.channel.is_angle())
        .map(move |(n, _)| first + n)
}

/// The axes about which a bone's angles turn it, in the axes of the rest pose.
fn turn_axes(skeleton: &Skeleton, bone: usize, values: &[f64]) -> Vec<DVec3> {
    let still = Posture {
        rotations: vec![DMat3::IDENTITY; skeleton.bones().len()],
        starts: vec![DVec3::ZERO; skeleton.bones().len()],
        ends: Vec::new(),
    };
    let mut motions = Vec::new();
    skeleton.push_dof_motions(bone, values, &still, &mut motions);
    let turn = |motion: DofMotion| match motion {
        DofMotion::Turn { axis, .. } => Some(axis),
        DofMotion::Slide(_) => None,
    };
    motions.into_iter().filter_map(turn).collect()
}

/// The rows of the pseudo-inverse of the matrix whose columns these are.
fn pseudo_inverse(columns: &[DVec3]) -> Vec<DVec3> {
    // (BᵀB)⁻¹ Bᵀ by Gram-Schmidt: each row is orthogonal to the other columns.
    let row = |n: usize| {
        let mut own = columns[n];
        let mut others: Vec<DVec3> = Vec::new();
        for (m, &other) in columns.iter().enumerate() {
            if m != n {
                let rest = others.iter().fold(other, |v, u| v - *u * v.dot(*u));
                others.extend(rest.try_normalize().filter(|_| rest.length() > 1e-9));
            }
        }
        own = others.iter().fold(own, |v, u| v - *u * v.dot(*u));
        let square = own.length_squared();
        if square > 1e-12 {
            own / square
        } else {
            DVec3::ZERO
        }
    };
    (0..columns.len()).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_the_pseudo_inverse_pick_their_column() {
        let columns = [
            DVec3::new(1.0, 0.2, 0.0),
            DVec3::new(0.5, 2.0, 0.3),
            DVec3::Z,
        ];
        for some in 1..=3 {
            let rows = pseudo_inverse(&columns[..some]);
            for (i, row) in rows.iter().enumerate() {
                for (j, column) in columns[..some].iter().enumerate() {
                    assert!((row.dot(*column) - f64::from(u8::from(i == j))).abs() <= 1e-12);
                }
            }
        }
        assert_eq!(pseudo_inverse(&[DVec3::ZERO]), [DVec3::ZERO]);
    }
}

//! Where the search for the rotations of a frame begins that knows nothing of others.

use super::equations::FrameEquations;
use super::state::{Column, FrameState};
use crate::ik::tuning::frame_solver::START_SD;
use crate::pose::kinematics::{DofMotion, Posture};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::prior::rotations::JointPrior;
use glam::{DMat3, DVec3};

/// The start of frames.
pub(super) struct FrameStart {
    /// The weight of each joint: the less the prior lets it move against the root, the more.
    weights: Vec<f64>,
}

impl FrameStart {
    /// Weighs the joints by how far the prior lets them move against the root.
    pub(super) fn new(equations: &FrameEquations<'_>, prior: &JointPrior) -> FrameStart {
        let states = &equations.states;
        let mut posture = Posture::default();
        states.posture(&equations.prior.mean, &mut posture);
        let weight = |&joint: &usize| {
            let mut variance = START_SD * START_SD;
            for bone in states.above(joint) {
                if let Some(n) = prior.bones.iter().position(|b| *b == bone) {
                    let trace: f64 = (0..3)
                        .map(|c| prior.covariance[[3 * n + c, 3 * n + c]])
                        .sum();
                    let lever = (posture.ends[joint] - posture.starts[bone]).length_squared();
                    variance += lever * trace / 3.0;
                }
            }
            1.0 / variance
        };
        FrameStart {
            weights: equations.joints.iter().map(weight).collect(),
        }
    }

    /// The start of a frame that knows nothing of others: rotations at their means, the body where
    /// its points are, above all those that hardly move against the root.
    pub(super) fn of(
        &self,
        equations: &FrameEquations<'_>,
        root: usize,
        targets: &[f64],
    ) -> FrameState {
        let FrameEquations {
            states,
            prior,
            joints,
            ..
        } = equations;
        let mut state = prior.mean.clone();
        let mut posture = Posture::default();
        states.posture(&state, &mut posture);
        let pairs = (joints
            .iter()
            .zip(targets.chunks_exact(3))
            .zip(&self.weights))
        .filter(|((_, y), _)| y.iter().all(|v| v.is_finite()))
        .map(|((&joint, y), weight)| (posture.ends[joint], DVec3::from_slice(y), *weight));
        let pairs: Vec<(DVec3, DVec3, f64)> = pairs.collect();
        let Some(fit) = fit_similarity(pairs.iter().copied(), TransformKind::Rigid) else {
            return state;
        };
        let above = states.skeleton.bones()[root].parent;
        let above = above.map_or(DMat3::IDENTITY, |b| posture.rotations[b]);
        if fit.determined && states.is_ball[root] {
            let turned = above.transpose() * fit.similarity.rotation * above;
            state.rotations[root] = turned * state.rotations[root];
        }
        // Then the middle of the points on the middle of their joints, by what slides at the root.
        states.posture(&state, &mut posture);
        let weights: f64 = pairs.iter().map(|p| p.2).sum();
        let seen = joints.iter().zip(targets.chunks_exact(3));
        let seen = seen.filter(|(_, y)| y.iter().all(|v| v.is_finite()));
        let off = seen
            .zip(&pairs)
            .map(|((&joint, _), (_, y, w))| (*y - posture.ends[joint]) * *w);
        let off = off.sum::<DVec3>() / weights;
        let mut motions = Vec::new();
        for (column, held) in states.columns.iter().zip(&prior.held) {
            let &Column::Dof(bone, n) = column else {
                continue;
            };
            if *held > 0.0 || states.skeleton.bones()[bone].dofs[n].channel.is_angle() {
                continue;
            }
            motions.clear();
            states
                .skeleton
                .push_dof_motions(bone, &state.values, &posture, &mut motions);
            if let DofMotion::Slide(along) = motions[n] {
                state.values[states.skeleton.dofs_of(bone).start + n] += along.dot(off);
            }
        }
        state
    }
}

//! What of a frame is solved for: rotations of bones with three angles, single values of others.

use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use crate::pose::rotation::{from_rotation_vector, rotation_vector};
use glam::{DMat3, DVec3};

/// A frame's rotations.
#[derive(Debug, Clone)]
pub(crate) struct FrameState {
    /// The rotation of each bone with three angles against the bone above, in the axes of the rest
    /// pose; of others nothing is read.
    pub rotations: Vec<DMat3>,
    /// The skeleton's values; the angles of bones with three are not read.
    pub values: Vec<f64>,
}

/// A value that is solved for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Column {
    /// A turn about an axis of the bone above.
    Turn(usize, usize),
    /// The bone's n-th degree of freedom.
    Dof(usize, usize),
}

/// The states of frames of one skeleton, and their columns.
pub(crate) struct FrameStates<'a> {
    pub(super) skeleton: &'a Skeleton,
    /// Whether each bone is a rotation matrix.
    pub(super) is_ball: Vec<bool>,
    /// Whether each value is an angle of a bone that is none.
    is_angle: Vec<bool>,
    pub(super) columns: Vec<Column>,
}

impl<'a> FrameStates<'a> {
    /// Those of a skeleton, without columns.
    pub(super) fn new(skeleton: &'a Skeleton) -> FrameStates<'a> {
        let bones = skeleton.bones().iter();
        let is_ball: Vec<bool> = bones.map(|bone| bone.ball_axes().is_some()).collect();
        let bones = skeleton.bones().iter().zip(&is_ball);
        let is_angle = bones
            .flat_map(|(bone, ball)| bone.dofs.iter().map(move |d| d.channel.is_angle() && !ball));
        FrameStates {
            skeleton,
            is_angle: is_angle.collect(),
            is_ball,
            columns: Vec::new(),
        }
    }

    /// Appends the columns of a bone's turns.
    pub(super) fn push_turns(&mut self, bone: usize) {
        if self.is_ball[bone] {
            self.columns
                .extend([0, 1, 2].map(|axis| Column::Turn(bone, axis)));
            return;
        }
        let dofs = self.skeleton.bones()[bone].dofs.iter().enumerate();
        let angles = dofs.filter(|(_, d)| d.channel.is_angle());
        self.columns
            .extend(angles.map(|(n, _)| Column::Dof(bone, n)));
    }

    /// The columns that move the end of a bone.
    pub(super) fn moving(&self, bone: usize) -> Vec<usize> {
        let above = self.above(bone);
        let moves = |c: &usize| above.contains(&self.columns[*c].bone());
        (0..self.columns.len()).filter(moves).collect()
    }

    /// A bone and those above it.
    pub(super) fn above(&self, bone: usize) -> Vec<usize> {
        let bones = self.skeleton.bones();
        std::iter::successors(Some(bone), |&b| bones[b].parent).collect()
    }

    /// Where the joints stand.
    pub(crate) fn posture(&self, state: &FrameState, out: &mut Posture) {
        let rotation = |b: usize| self.is_ball[b].then(|| state.rotations[b]);
        self.skeleton.posture_with(rotation, &state.values, out);
    }

    /// The state that has some values of the skeleton.
    pub(crate) fn state_of(&self, values: &[f64]) -> FrameState {
        let own = |b: usize| {
            let dofs = self.skeleton.dofs_of(b);
            self.skeleton.local_rotation(b, &values[dofs])
        };
        FrameState {
            rotations: (0..self.is_ball.len()).map(own).collect(),
            values: values.to_vec(),
        }
    }

    /// Whether each value of a state is an angle that is read there.
    pub(crate) fn angle_values(&self) -> &[bool] {
        &self.is_angle
    }

    /// Gives a bone the rotation at a share of the way from one state to another.
    pub(crate) fn set_between(
        &self,
        bone: usize,
        (from, to): (&FrameState, &FrameState),
        share: f64,
        state: &mut FrameState,
    ) {
        let (a, b) = (from.rotations[bone], to.rotations[bone]);
        let turn = rotation_vector(&(b * a.transpose())) * share;
        state.rotations[bone] = from_rotation_vector(turn) * a;
        for i in self.skeleton.dofs_of(bone).filter(|i| self.is_angle[*i]) {
            state.values[i] = from.values[i] + share * (to.values[i] - from.values[i]);
        }
    }

    /// The state at a share of the way from one to another.
    pub(crate) fn between(&self, from: &FrameState, to: &FrameState, share: f64) -> FrameState {
        let rotations = from.rotations.iter().zip(&to.rotations).zip(&self.is_ball);
        let rotations = rotations.map(|((a, b), is_ball)| {
            if *is_ball {
                from_rotation_vector(rotation_vector(&(*b * a.transpose())) * share) * *a
            } else {
                *a
            }
        });
        let values = from.values.iter().zip(&to.values);
        FrameState {
            rotations: rotations.collect(),
            values: values.map(|(a, b)| a + share * (b - a)).collect(),
        }
    }

    /// How far a value that slides is from its rest.
    pub(super) fn slide(&self, column: Column, state: &FrameState) -> f64 {
        match column {
            Column::Dof(bone, n) => state.values[self.skeleton.dofs_of(bone).start + n],
            Column::Turn(..) => 0.0,
        }
    }

    /// The state after a step, none of whose turns is over a radian: beyond that the linear model
    /// says nothing.
    pub(super) fn applied(&self, state: &FrameState, step: impl Fn(usize) -> f64) -> FrameState {
        let n = self.columns.len();
        let is_turn = |c: &usize| match self.columns[*c] {
            Column::Turn(..) => true,
            Column::Dof(bone, n) => self.skeleton.bones()[bone].dofs[n].channel.is_angle(),
        };
        let largest = (0..n)
            .filter(is_turn)
            .fold(0.0, |z: f64, c| z.max(step(c).abs()));
        let scale = 1.0 / largest.max(1.0);
        let mut next = state.clone();
        let mut c = 0;
        while c < n {
            match self.columns[c] {
                Column::Turn(bone, _) => {
                    let turn = DVec3::new(step(c), step(c + 1), step(c + 2)) * scale;
                    next.rotations[bone] = from_rotation_vector(turn) * next.rotations[bone];
                    c += 3;
                }
                Column::Dof(bone, k) => {
                    next.values[self.skeleton.dofs_of(bone).start + k] += scale * step(c);
                    c += 1;
                }
            }
        }
        next
    }
}

impl Column {
    pub(super) fn bone(self) -> usize {
        match self {
            Column::Turn(bone, _) | Column::Dof(bone, _) => bone,
        }
    }
}

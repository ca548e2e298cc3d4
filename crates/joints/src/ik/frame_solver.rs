//! The rotations of one frame that are most probable given its points: the prior over rotations
//! settles what the points leave open.
//!
//! Minimizes `E = Σ wₜ |fₜ − yₜ|² + rᵀ Λ r`: f the joints' places and y the points (centimeters,
//! those that are seen), w one over the variance of a coordinate; r how far the rotations are from
//! the means of the prior, Λ its precision. A bone with three angles is a rotation matrix L, which
//! a step turns by `L ← exp(d) L` in the axes of the bone above, and `r = log(L Mᵀ)`; a bone with
//! fewer keeps its angles θ, and `r = θ − θ₀`. The root has no prior.
//!
//! A step is Levenberg's and Marquardt's, `(JᵀWJ + Λ + λ D) δ = −gradient / 2`, with the exact
//! gradient and, for the prior, d r / d d ≈ I in the matrix alone. E is not convex: the solution
//! is a minimum near the start.

use super::tuning::frame_solver::*;
use super::tuning::sequence::LEAST_SD;
use crate::numeric::levenberg_marquardt::Damping;
use crate::numeric::linalg;
use crate::numeric::small_linalg::{add, backward, dot, factorize, forward};
use crate::pose::Skeleton;
use crate::pose::kinematics::{DofMotion, Posture};
use crate::pose::rotation::{from_rotation_vector, rotation_vector, rotation_vector_jacobian};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::prior::rotations::JointPrior;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// The weight of a point that says no deviation, 1/cm².
const MEASURED: f64 = 1.0 / (LEAST_SD * LEAST_SD);

const SCHEDULE: Damping = Damping {
    start: FAR_DAMPING,
    accepted: |damping, _| damping * RELAX,
    rejected: |damping| damping * RAISE,
    most: MOST_DAMPING,
};

/// A frame's rotations.
#[derive(Debug, Clone)]
pub(crate) struct FrameState {
    /// The rotation of each bone with three angles against the bone above, in the axes of the rest
    /// pose; of others nothing is read.
    pub rotations: Vec<DMat3>,
    /// The skeleton's values; the angles of bones with three are not read.
    pub values: Vec<f64>,
}

/// Where the search for a frame's rotations begins.
#[derive(Debug)]
pub(crate) enum Start {
    /// Anywhere.
    Far(FrameState),
    /// At rotations that are hardly other.
    Near(FrameState),
}

/// A solution of a frame.
#[derive(Debug, Clone)]
pub(crate) struct FrameFit {
    pub state: FrameState,
    /// E.
    pub energy: f64,
    pub converged: bool,
}

/// The normal equations of a frame at a state, half the gradient on their right.
#[derive(Debug)]
pub(crate) struct Linearized {
    pub energy: f64,
    /// (columns, columns).
    pub normal: Array2<f64>,
    pub gradient: Vec<f64>,
    /// The weight that each point has there, 1/cm².
    pub weights: Vec<f64>,
    /// How far each joint is from its point, cm; NaN where that is missing.
    pub off: Vec<DVec3>,
    /// By joint, the columns that move it, and how.
    pub derivatives: Vec<Vec<(usize, DVec3)>>,
    pub posture: Posture,
}

/// A value that is solved for.
#[derive(Debug, Clone, Copy)]
enum Column {
    /// A turn about an axis of the bone above.
    Turn(usize, usize),
    /// The bone's n-th degree of freedom.
    Dof(usize, usize),
}

/// Solves frames of one skeleton and one set of points.
pub(crate) struct FrameSolver<'a> {
    skeleton: &'a Skeleton,
    joints: &'a [usize],
    /// Whether each bone is a rotation matrix.
    is_ball: Vec<bool>,
    /// Whether each value is an angle of a bone that is none.
    is_angle: Vec<bool>,
    columns: Vec<Column>,
    /// The columns that move each joint.
    moving: Vec<Vec<usize>>,
    /// The bones with a prior, their first column and number of columns: the first of all.
    with_prior: Vec<(usize, usize, usize)>,
    /// Means of the bones with a prior: M, or the angles.
    mean: FrameState,
    /// Λ, (columns with a prior, the same), by rows.
    precision: Vec<f64>,
    /// One over the variance of the other columns; 0 of the root's.
    held: Vec<f64>,
    /// The weight of each joint at the start: the less the prior lets it move against the root, the
    /// more.
    start_weights: Vec<f64>,
    /// c²; infinite where no point is an outlier.
    outlier: f64,
}

impl<'a> FrameSolver<'a> {
    /// `joints[t]` is the bone whose end is point t, `root` the bone at which the body turns; bones
    /// that move no joint stay at rest.
    ///
    /// # Errors
    /// [`Error::Usage`]: the covariance of the prior is singular.
    pub(crate) fn new(
        skeleton: &'a Skeleton,
        joints: &'a [usize],
        root: usize,
        prior: &JointPrior,
    ) -> Result<FrameSolver<'a>> {
        let bones = skeleton.bones().iter();
        let is_ball: Vec<bool> = bones.map(|bone| bone.ball_axes().is_some()).collect();
        let moves_a_joint = moving_bones(skeleton, joints);
        let with_prior: Vec<usize> = (0..prior.bones.len())
            .filter(|n| moves_a_joint[prior.bones[*n]])
            .collect();
        let mean = mean_state(skeleton, &is_ball, prior, &with_prior);
        let bones = skeleton.bones().iter().zip(&is_ball);
        let is_angle = bones
            .flat_map(|(bone, ball)| bone.dofs.iter().map(move |d| d.channel.is_angle() && !ball));
        let is_angle = is_angle.collect();
        let mut solver = FrameSolver {
            skeleton,
            joints,
            is_ball,
            is_angle,
            columns: Vec::new(),
            moving: Vec::new(),
            with_prior: Vec::new(),
            mean,
            precision: Vec::new(),
            held: Vec::new(),
            start_weights: Vec::new(),
            outlier: f64::INFINITY,
        };
        for &n in &with_prior {
            let (bone, first) = (prior.bones[n], solver.columns.len());
            solver.push_turns(bone);
            solver
                .with_prior
                .push((bone, first, solver.columns.len() - first));
        }
        solver.held = vec![0.0; solver.columns.len()];
        solver.precision = solver.precision_of(prior, &with_prior)?;
        solver.push_turns(root);
        solver.held.resize(solver.columns.len(), 0.0);
        solver.push_slides(root, &moves_a_joint);
        solver.set_moving();
        solver.set_start_weights(prior);
        Ok(solver)
    }

    /// Lets points be far off: outliers count little.
    pub(crate) fn with_outliers(mut self) -> FrameSolver<'a> {
        self.outlier = OUTLIER * OUTLIER;
        self
    }

    /// What a point that is off by so many squared deviations costs.
    fn cost(&self, square: f64) -> f64 {
        if self.outlier.is_finite() {
            self.outlier * (square / self.outlier).ln_1p()
        } else {
            square
        }
    }

    /// The share of its weight that such a point has.
    fn share(&self, square: f64) -> f64 {
        1.0 / (1.0 + square / self.outlier)
    }

    /// Appends the columns of a bone's turns.
    fn push_turns(&mut self, bone: usize) {
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

    /// Appends the columns of what slides: free where they move the whole body, at the root or
    /// nearest above it, else held to their rest. Those farther above stay at rest.
    fn push_slides(&mut self, root: usize, moves_a_joint: &[bool]) {
        let bones = self.skeleton.bones();
        let slides = |b: usize| bones[b].dofs.iter().any(|d| !d.channel.is_angle());
        let mut up = std::iter::successors(Some(root), |&b| bones[b].parent);
        let body = up.find(|&b| slides(b));
        let is_below = |b: usize| {
            std::iter::successors(bones[b].parent, |&b| bones[b].parent).any(|b| b == root)
        };
        for bone in 0..bones.len() {
            if Some(bone) != body && !(moves_a_joint[bone] && is_below(bone)) {
                continue;
            }
            for (n, dof) in bones[bone].dofs.iter().enumerate() {
                if !dof.channel.is_angle() {
                    self.columns.push(Column::Dof(bone, n));
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

    /// Finds which columns move each joint.
    fn set_moving(&mut self) {
        let bones = self.skeleton.bones();
        for &joint in self.joints {
            let above: Vec<usize> =
                std::iter::successors(Some(joint), |&b| bones[b].parent).collect();
            let moves = |c: &usize| above.contains(&self.columns[*c].bone());
            self.moving
                .push((0..self.columns.len()).filter(moves).collect());
        }
    }

    /// Weighs the joints by how far the prior lets them move against the root.
    fn set_start_weights(&mut self, prior: &JointPrior) {
        let mut posture = Posture::default();
        self.posture(&self.mean, &mut posture);
        let bones = self.skeleton.bones();
        for &joint in self.joints {
            let mut above = std::iter::successors(Some(joint), |&b| bones[b].parent);
            let mut variance = START_SD * START_SD;
            for bone in above.by_ref() {
                if let Some(n) = prior.bones.iter().position(|b| *b == bone) {
                    let trace: f64 = (0..3)
                        .map(|c| prior.covariance[[3 * n + c, 3 * n + c]])
                        .sum();
                    let lever = (posture.ends[joint] - posture.starts[bone]).length_squared();
                    variance += lever * trace / 3.0;
                }
            }
            self.start_weights.push(1.0 / variance);
        }
    }

    /// Λ: the inverse of the covariance of the columns. The angles of a bone that has fewer than
    /// three are those whose turns are nearest to a rotation vector.
    fn precision_of(&self, prior: &JointPrior, of: &[usize]) -> Result<Vec<f64>> {
        let size = self.columns.len();
        let mut to_columns: Array2<f64> = Array2::zeros((size, 3 * prior.bones.len()));
        for (&n, &(bone, first, count)) in of.iter().zip(&self.with_prior) {
            let rows: Vec<DVec3> = if self.is_ball[bone] {
                vec![DVec3::X, DVec3::Y, DVec3::Z]
            } else {
                pseudo_inverse(&turn_axes(self.skeleton, bone, &self.mean.values))
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

    /// The start of a frame that knows nothing of others: rotations at their means, the body where
    /// its points are, above all those that hardly move against the root.
    pub(crate) fn start(&self, root: usize, targets: &[f64]) -> FrameState {
        let mut state = self.mean.clone();
        let mut posture = Posture::default();
        self.posture(&state, &mut posture);
        let pairs = (self
            .joints
            .iter()
            .zip(targets.chunks_exact(3))
            .zip(&self.start_weights))
        .filter(|((_, y), _)| y.iter().all(|v| v.is_finite()))
        .map(|((&joint, y), weight)| (posture.ends[joint], DVec3::from_slice(y), *weight));
        let pairs: Vec<(DVec3, DVec3, f64)> = pairs.collect();
        let Some(fit) = fit_similarity(pairs.iter().copied(), TransformKind::Rigid) else {
            return state;
        };
        let above = self.skeleton.bones()[root].parent;
        let above = above.map_or(DMat3::IDENTITY, |b| posture.rotations[b]);
        if fit.determined && self.is_ball[root] {
            let turned = above.transpose() * fit.similarity.rotation * above;
            state.rotations[root] = turned * state.rotations[root];
        }
        // Then the middle of the points on the middle of their joints, by what slides at the root.
        self.posture(&state, &mut posture);
        let weights: f64 = pairs.iter().map(|p| p.2).sum();
        let seen = self.joints.iter().zip(targets.chunks_exact(3));
        let seen = seen.filter(|(_, y)| y.iter().all(|v| v.is_finite()));
        let off = seen
            .zip(&pairs)
            .map(|((&joint, _), (_, y, w))| (*y - posture.ends[joint]) * *w);
        let off = off.sum::<DVec3>() / weights;
        let mut motions = Vec::new();
        for (column, held) in self.columns.iter().zip(&self.held) {
            let &Column::Dof(bone, n) = column else {
                continue;
            };
            if *held > 0.0 || self.skeleton.bones()[bone].dofs[n].channel.is_angle() {
                continue;
            }
            motions.clear();
            self.skeleton
                .push_dof_motions(bone, &state.values, &posture, &mut motions);
            if let DofMotion::Slide(along) = motions[n] {
                state.values[self.skeleton.dofs_of(bone).start + n] += along.dot(off);
            }
        }
        state
    }

    /// Where the joints stand.
    pub(crate) fn posture(&self, state: &FrameState, out: &mut Posture) {
        let rotation = |b: usize| self.is_ball[b].then(|| state.rotations[b]);
        self.skeleton.posture_with(rotation, &state.values, out);
    }

    /// Improves a frame from a start: `targets` (3 a joint; NaN is missing), `weights` one a joint,
    /// 1/cm².
    pub(crate) fn solve(
        &self,
        targets: &[f64],
        weights: &[f64],
        start: Start,
        scratch: &mut Scratch,
    ) -> FrameFit {
        self.descend(targets, weights, start, (STEPS, TOLERANCE), scratch)
    }

    /// Improves a frame by at most so many steps.
    pub(crate) fn improve(
        &self,
        targets: &[f64],
        weights: &[f64],
        state: FrameState,
        steps: usize,
        scratch: &mut Scratch,
    ) -> FrameFit {
        let most = (steps, (0.0, 0.0));
        self.descend(targets, weights, Start::Far(state), most, scratch)
    }

    /// Puts the joints at the measured points, off which the prior pulls them by some hundredths of
    /// a centimeter, by last steps in which these weigh more by far.
    pub(crate) fn finish(
        &self,
        targets: &[f64],
        weights: &[f64],
        fit: FrameFit,
        scratch: &mut Scratch,
    ) -> FrameFit {
        if weights.iter().all(|w| *w < MEASURED) {
            return fit;
        }
        let heavier = |w: &f64| if *w >= MEASURED { w * SURE } else { *w };
        let heavier: Vec<f64> = weights.iter().map(heavier).collect();
        let end = (LAST_STEPS, LAST_TOLERANCE);
        let last = self.descend(targets, &heavier, Start::Near(fit.state), end, scratch);
        FrameFit {
            state: last.state,
            ..fit
        }
    }

    /// [`FrameSolver::solve`] by at most so many steps that lower E by more than a tolerance.
    fn descend(
        &self,
        targets: &[f64],
        weights: &[f64],
        start: Start,
        (steps, tolerance): (usize, (f64, f64)),
        scratch: &mut Scratch,
    ) -> FrameFit {
        let (start, damping) = match start {
            Start::Far(state) => (state, FAR_DAMPING),
            Start::Near(state) => (state, NEAR_DAMPING),
        };
        let energy = self.energy(&start, targets, weights, scratch);
        let attempt = |at: &(f64, FrameState), damping: f64, fresh: bool| {
            if fresh {
                self.set_equations(&at.1, targets, weights, scratch);
            }
            let next = self.step(&at.1, damping, scratch);
            let energy = self.energy(&next, targets, weights, scratch);
            Some((energy, (energy, next)))
        };
        let (first, most) = ((energy, (energy, start)), (steps, 2 * steps));
        let schedule = Damping {
            start: damping,
            ..SCHEDULE
        };
        let ((energy, state), converged) = schedule.minimize(most, tolerance, first, attempt);
        FrameFit {
            state,
            energy,
            converged,
        }
    }

    /// The normal equations of a frame at a state.
    pub(crate) fn linearized(
        &self,
        state: &FrameState,
        targets: &[f64],
        weights: &[f64],
        scratch: &mut Scratch,
    ) -> Linearized {
        let energy = self.energy(state, targets, weights, scratch);
        self.set_equations(state, targets, weights, scratch);
        let n = self.columns.len();
        let at = |t: usize| scratch.posture.ends[self.joints[t]];
        let off = targets.chunks_exact(3).enumerate();
        let off: Vec<DVec3> = off.map(|(t, y)| at(t) - DVec3::from_slice(y)).collect();
        let shares = off.iter().zip(weights);
        Linearized {
            energy,
            normal: Array2::from_shape_fn((n, n), |(i, j)| scratch.normal[i.max(j) * n + i.min(j)]),
            gradient: scratch.gradient.clone(),
            weights: shares
                .map(|(off, w)| w * self.share(w * off.length_squared()))
                .collect(),
            derivatives: (self.moving.iter().enumerate())
                .map(|(t, moving)| {
                    let of = |&c: &usize| (c, scratch.motions[c].derivative(at(t)));
                    moving.iter().map(of).collect()
                })
                .collect(),
            posture: scratch.posture.clone(),
            off,
        }
    }

    /// How far each value that is solved for moves the end of a bone.
    pub(crate) fn derivatives(
        &self,
        bone: usize,
        at: &Linearized,
        scratch: &Scratch,
    ) -> Vec<DVec3> {
        let bones = self.skeleton.bones();
        let above: Vec<usize> = std::iter::successors(Some(bone), |&b| bones[b].parent).collect();
        let place = at.posture.ends[bone];
        let of = |(c, column): (usize, &Column)| {
            if above.contains(&column.bone()) {
                scratch.motions[c].derivative(place)
            } else {
                DVec3::ZERO
            }
        };
        self.columns.iter().enumerate().map(of).collect()
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

    /// The state after a step that a linearization gives.
    pub(crate) fn after(&self, state: &FrameState, step: &[f64]) -> FrameState {
        self.applied(state, |c| step[c])
    }

    /// Whether each value of a state is an angle that is read there.
    pub(crate) fn angle_values(&self) -> &[bool] {
        &self.is_angle
    }

    /// The bones with a prior, and of each the points by which its rotation is seen.
    pub(crate) fn seen_by(&self) -> impl Iterator<Item = (usize, Vec<usize>)> + '_ {
        let bones = self.skeleton.bones();
        let has_lever = move |t: &usize, bone: usize| {
            self.joints[*t] != bone || bones[bone].offset != DVec3::ZERO
        };
        self.with_prior.iter().map(move |&(bone, first, _)| {
            let moves = |t: &usize| self.moving[*t].contains(&first) && has_lever(t, bone);
            (bone, (0..self.joints.len()).filter(moves).collect())
        })
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

    fn energy(
        &self,
        state: &FrameState,
        targets: &[f64],
        weights: &[f64],
        scratch: &mut Scratch,
    ) -> f64 {
        self.posture(state, &mut scratch.posture);
        let mut sum = 0.0;
        for ((&joint, y), w) in self.joints.iter().zip(targets.chunks_exact(3)).zip(weights) {
            let off = (scratch.posture.ends[joint] - DVec3::from_slice(y)).length_squared();
            if off.is_finite() {
                sum += self.cost(w * off);
            }
        }
        self.set_deviations(state, &mut scratch.deviations);
        let n = scratch.deviations.len();
        for (i, r) in scratch.deviations.iter().enumerate() {
            sum += r * dot(&self.precision[i * n..][..n], &scratch.deviations);
        }
        let held = self.columns.iter().zip(&self.held);
        let held = held.filter(|(_, held)| **held > 0.0);
        sum + held
            .map(|(c, held)| held * self.slide(*c, state).powi(2))
            .sum::<f64>()
    }

    /// How far a value that slides is from its rest.
    fn slide(&self, column: Column, state: &FrameState) -> f64 {
        match column {
            Column::Dof(bone, n) => state.values[self.skeleton.dofs_of(bone).start + n],
            Column::Turn(..) => 0.0,
        }
    }

    /// r.
    fn set_deviations(&self, state: &FrameState, out: &mut Vec<f64>) {
        out.clear();
        for &(bone, first, count) in &self.with_prior {
            if self.is_ball[bone] {
                let off = state.rotations[bone] * self.mean.rotations[bone].transpose();
                out.extend(rotation_vector(&off).to_array());
                continue;
            }
            for column in &self.columns[first..first + count] {
                out.push(self.slide(*column, state) - self.slide(*column, &self.mean));
            }
        }
    }

    /// Sets the normal equations (lower triangle) and half the gradient at the state whose energy
    /// was asked for last.
    fn set_equations(
        &self,
        state: &FrameState,
        targets: &[f64],
        weights: &[f64],
        scratch: &mut Scratch,
    ) {
        let n = self.columns.len();
        self.set_motions(state, scratch);
        let Scratch {
            posture,
            motions,
            derivatives,
            normal,
            gradient,
            deviations,
            ..
        } = scratch;
        normal.clear();
        normal.resize(n * n, 0.0);
        gradient.clear();
        gradient.resize(n, 0.0);
        for (t, y) in targets.chunks_exact(3).enumerate() {
            let end = posture.ends[self.joints[t]];
            let off = end - DVec3::from_slice(y);
            if !off.is_finite() {
                continue;
            }
            let weight = weights[t] * self.share(weights[t] * off.length_squared());
            let moving = &self.moving[t];
            derivatives.clear();
            derivatives.extend(moving.iter().map(|&c| motions[c].derivative(end)));
            for (m, (&a, v)) in moving.iter().zip(derivatives.iter()).enumerate() {
                let weighted = *v * weight;
                gradient[a] += weighted.dot(off);
                let row = &mut normal[a * n..][..=a];
                for (&b, other) in moving[..=m].iter().zip(derivatives.iter()) {
                    row[b] += weighted.dot(*other);
                }
            }
        }
        let known = deviations.len();
        for i in 0..known {
            add(
                &mut normal[i * n..][..=i],
                1.0,
                &self.precision[i * known..][..=i],
            );
        }
        let pull = |i: usize| dot(&self.precision[i * known..][..known], deviations);
        for &(bone, first, count) in &self.with_prior {
            if self.is_ball[bone] {
                let r = DVec3::from_slice(&deviations[first..first + 3]);
                // log(exp(d) exp(r)) ≈ r + J(−r) d, and its transpose carries the gradient.
                let carried = rotation_vector_jacobian(r)
                    * DVec3::from_array([0, 1, 2].map(|c| pull(first + c)));
                (0..3).for_each(|c| gradient[first + c] += carried[c]);
            } else {
                (first..first + count).for_each(|c| gradient[c] += pull(c));
            }
        }
        for (c, (column, held)) in self.columns.iter().zip(&self.held).enumerate() {
            normal[c * n + c] += held;
            gradient[c] += held
                * if *held > 0.0 {
                    self.slide(*column, state)
                } else {
                    0.0
                };
        }
    }

    /// How each column moves the joints below it.
    fn set_motions(&self, state: &FrameState, scratch: &mut Scratch) {
        let Scratch {
            posture,
            motions,
            dof_motions,
            ..
        } = scratch;
        motions.clear();
        let mut last = None;
        for column in &self.columns {
            motions.push(match *column {
                Column::Turn(bone, axis) => {
                    let above = self.skeleton.bones()[bone].parent;
                    let above = above.map_or(DMat3::IDENTITY, |b| posture.rotations[b]);
                    DofMotion::Turn {
                        axis: above.col(axis),
                        about: posture.starts[bone],
                    }
                }
                Column::Dof(bone, n) => {
                    if last != Some(bone) {
                        dof_motions.clear();
                        let values = &state.values;
                        self.skeleton
                            .push_dof_motions(bone, values, posture, dof_motions);
                        last = Some(bone);
                    }
                    dof_motions[n]
                }
            });
        }
    }

    /// The state after a damped step.
    fn step(&self, state: &FrameState, damping: f64, scratch: &mut Scratch) -> FrameState {
        let n = self.columns.len();
        scratch.factor.clone_from(&scratch.normal);
        scratch.step.clone_from(&scratch.gradient);
        for c in 0..n {
            scratch.factor[c * n + c] += damping * (scratch.normal[c * n + c] + LEAST_PRECISION);
        }
        factorize(&mut scratch.factor, n);
        forward(&scratch.factor, n, &mut scratch.step);
        backward(&scratch.factor, n, &mut scratch.step);
        self.applied(state, |c| -scratch.step[c])
    }

    /// The state after a step, none of whose turns is over a radian: beyond that the linear model
    /// says nothing.
    fn applied(&self, state: &FrameState, step: impl Fn(usize) -> f64) -> FrameState {
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
    fn bone(self) -> usize {
        match self {
            Column::Turn(bone, _) | Column::Dof(bone, _) => bone,
        }
    }
}

/// Memory that frames are solved in.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    posture: Posture,
    motions: Vec<DofMotion>,
    dof_motions: Vec<DofMotion>,
    derivatives: Vec<DVec3>,
    deviations: Vec<f64>,
    normal: Vec<f64>,
    gradient: Vec<f64>,
    factor: Vec<f64>,
    step: Vec<f64>,
}

/// Whether each bone moves one of the joints by turning.
fn moving_bones(skeleton: &Skeleton, joints: &[usize]) -> Vec<bool> {
    let bones = skeleton.bones();
    let mut moving = vec![false; bones.len()];
    for &joint in joints {
        let first = if bones[joint].offset == DVec3::ZERO {
            bones[joint].parent
        } else {
            Some(joint)
        };
        std::iter::successors(first, |&b| bones[b].parent).for_each(|b| moving[b] = true);
    }
    moving
}

/// The state in which the bones with a prior, by their number there, are at its mean, the others at
/// rest.
fn mean_state(
    skeleton: &Skeleton,
    is_ball: &[bool],
    prior: &JointPrior,
    with_prior: &[usize],
) -> FrameState {
    let dofs = skeleton.bones().iter().flat_map(|b| &b.dofs);
    let mut values: Vec<f64> = dofs.map(|d| -d.offset).collect();
    let own = |values: &[f64], b: usize| skeleton.local_rotation(b, &values[skeleton.dofs_of(b)]);
    let mut rotations: Vec<DMat3> = (0..is_ball.len()).map(|b| own(&values, b)).collect();
    for &n in with_prior {
        let (bone, mean) = (prior.bones[n], &prior.means[n]);
        if is_ball[bone] {
            rotations[bone] = *mean;
            continue;
        }
        // The angles whose rotation is nearest to the mean: Gauss's and Newton's steps.
        for _ in 0..ANGLE_ROUNDS {
            let off = rotation_vector(&(*mean * own(&values, bone).transpose()));
            let rows = pseudo_inverse(&turn_axes(skeleton, bone, &values));
            let angles = angle_values(skeleton, bone);
            angles
                .zip(rows)
                .for_each(|(i, row)| values[i] += row.dot(off));
        }
    }
    FrameState { rotations, values }
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
    use crate::pose::rotation::Axis;
    use crate::pose::{Bone, Channel, Dof};
    use crate::prior::rotations::RotationPrior;

    const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    fn bone(name: &str, parent: Option<usize>, offset: [f64; 3], dofs: Vec<Channel>) -> Bone {
        Bone {
            name: name.into(),
            parent,
            offset: DVec3::from_array(offset),
            axis: DMat3::from_rotation_x(0.3) * DMat3::from_rotation_z(0.1 * offset[0]),
            dofs: dofs.into_iter().map(Dof::free).collect(),
        }
    }

    /// A trunk with two arms and a hinge: ball joints, one that slides, angles of one and of two.
    fn body() -> Skeleton {
        let ball = || ALL.map(Channel::Rotate).to_vec();
        let root = [ALL.map(Channel::Translate).to_vec(), ball()].concat();
        let two = vec![Channel::Rotate(Axis::Z), Channel::Rotate(Axis::X)];
        let slides = [vec![Channel::Translate(Axis::Y)], ball()].concat();
        Skeleton::new(vec![
            bone("root", None, [0., 0., 0.], root),
            bone("trunk", Some(0), [0., 30., 1.], ball()),
            bone("left", Some(1), [20., 2., 0.], ball()),
            bone("right", Some(1), [-20., 3., 0.], slides),
            bone(
                "hand",
                Some(2),
                [9., 0., 4.],
                vec![Channel::Rotate(Axis::Y)],
            ),
            bone("leg", Some(0), [5., -40., 3.], two),
            bone("tail", Some(0), [0., 0., -9.], ball()),
        ])
        .unwrap()
    }

    const JOINTS: [usize; 6] = [0, 1, 2, 3, 4, 5];

    fn targets(s: &Skeleton, of: impl Fn(usize) -> f64) -> Vec<f64> {
        let q: Vec<f64> = (0..s.dof_count()).map(of).collect();
        let ends = s.posture(&q).ends;
        JOINTS.iter().flat_map(|&j| ends[j].to_array()).collect()
    }

    fn with_solver(work: impl Fn(&FrameSolver<'_>, &Skeleton)) {
        let s = body();
        let prior = JointPrior::new(&RotationPrior::builtin().unwrap(), &s, 0, &[]);
        let joints = JOINTS.to_vec();
        work(&FrameSolver::new(&s, &joints, 0, &prior).unwrap(), &s);
    }

    #[test]
    fn the_gradient_is_that_of_the_differences() {
        with_solver(|solver, s| {
            let y = targets(s, |i| 0.4 * (i as f64 * 1.3).sin());
            let weights = vec![0.7; JOINTS.len()];
            let mut scratch = Scratch::default();
            let mut state = solver.start(0, &y);
            // Away from the start, so that the prior pulls too.
            let fit = solver.solve(&y, &weights, Start::Far(state), &mut scratch);
            state = fit.state;
            for (n, r) in state.rotations.iter_mut().enumerate() {
                *r = from_rotation_vector(DVec3::new(0.3, -0.2, 0.1 * n as f64)) * *r;
            }
            state.values.iter_mut().for_each(|v| *v += 0.1);
            solver.energy(&state, &y, &weights, &mut scratch);
            solver.set_equations(&state, &y, &weights, &mut scratch);
            let gradient = scratch.gradient.clone();
            let h = 1e-6;
            for (c, column) in solver.columns.iter().enumerate() {
                let mut at = |by: f64| {
                    let mut moved = state.clone();
                    match *column {
                        Column::Turn(bone, axis) => {
                            let turn = from_rotation_vector(DVec3::AXES[axis] * by);
                            moved.rotations[bone] = turn * moved.rotations[bone];
                        }
                        Column::Dof(bone, n) => moved.values[s.dofs_of(bone).start + n] += by,
                    }
                    solver.energy(&moved, &y, &weights, &mut scratch)
                };
                let want = (at(h) - at(-h)) / (4.0 * h);
                let scale = 1.0 + want.abs();
                assert!(
                    (gradient[c] - want).abs() <= 1e-5 * scale,
                    "{c}: {} {want}",
                    gradient[c]
                );
            }
        });
    }

    #[test]
    fn sure_points_are_reached_and_others_left_to_the_prior() {
        with_solver(|solver, s| {
            let y = targets(s, |i| 0.4 * (i as f64 * 1.3).sin());
            let mut scratch = Scratch::default();
            let sure = vec![400.0; JOINTS.len()];
            let fit = solver.solve(&y, &sure, Start::Far(solver.start(0, &y)), &mut scratch);
            assert!(fit.converged, "{}", fit.energy);
            let fit = solver.finish(&y, &sure, fit, &mut scratch);
            let mut posture = Posture::default();
            solver.posture(&fit.state, &mut posture);
            for (&joint, y) in JOINTS.iter().zip(y.chunks_exact(3)) {
                let off = (posture.ends[joint] - DVec3::from_slice(y)).length();
                assert!(off <= 0.1, "{joint}: {off}");
            }
            // What moves no point stays at rest.
            assert!(fit.state.rotations[6].abs_diff_eq(DMat3::IDENTITY, 1e-12));
            // Points that say nothing leave the mean, which is the rest pose here.
            let unsure = vec![1e-12; JOINTS.len()];
            let fit = solver.solve(&y, &unsure, Start::Far(solver.start(0, &y)), &mut scratch);
            assert!(fit.state.rotations[1].abs_diff_eq(DMat3::IDENTITY, 1e-3));
            let missing = vec![f64::NAN; y.len()];
            let fit = solver.solve(
                &missing,
                &sure,
                Start::Far(solver.start(0, &missing)),
                &mut scratch,
            );
            assert!(fit.energy == 0.0);
        });
    }

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

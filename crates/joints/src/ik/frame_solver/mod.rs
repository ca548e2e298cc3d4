//! The rotations of one frame that are most probable given its points: the prior over rotations
//! settles what the points leave open.
//!
//! Minimizes `E = Σ wₜ |fₜ − yₜ|² + rᵀ Λ r`: f the joints' positions and y the points (centimeters,
//! those that are seen), w one over the variance of a coordinate; r how far the rotations are from
//! the means of the prior, Λ its precision. A bone with three angles is a rotation matrix L, which
//! a step turns by `L ← exp(d) L` in the axes of the bone above, and `r = log(L Mᵀ)`; a bone with
//! fewer keeps its angles θ, and `r = θ − θ₀`. The root has no prior.
//!
//! A step is Levenberg's and Marquardt's, `(JᵀWJ + Λ + λ D) δ = −gradient / 2`, with the exact
//! gradient and, for the prior, d r / d d ≈ I in the matrix alone. E is not convex: the solution
//! is a minimum near the start.

mod equations;
mod prior;
mod start;
mod state;

pub(crate) use equations::{Linearized, Scratch};
pub(crate) use state::FrameState;

use self::equations::FrameEquations;
use self::prior::FramePrior;
use self::start::FrameStart;
use self::state::FrameStates;
use super::tuning::frame_solver::*;
use super::tuning::sequence::LEAST_SD;
use crate::Result;
use crate::numeric::levenberg_marquardt::Damping;
use crate::pose::Skeleton;
use crate::prior::rotations::JointPrior;

/// The weight of a point that says no deviation, 1/cm².
const MEASURED: f64 = 1.0 / (LEAST_SD * LEAST_SD);

const SCHEDULE: Damping = Damping {
    start: FAR_DAMPING,
    accepted: |damping, _| damping * RELAX,
    rejected: |damping| damping * RAISE,
    most: MOST_DAMPING,
};

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

/// Solves frames of one skeleton and one set of points.
pub(crate) struct FrameSolver<'a> {
    pub(crate) equations: FrameEquations<'a>,
    start: FrameStart,
}

impl<'a> FrameSolver<'a> {
    /// `joints[t]` is the bone whose end is point t, `root` the bone at which the body turns; bones
    /// that move no joint stay at rest.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): the covariance of the prior is singular.
    pub(crate) fn new(
        skeleton: &'a Skeleton,
        joints: &'a [usize],
        root: usize,
        prior: &JointPrior,
    ) -> Result<FrameSolver<'a>> {
        let mut states = FrameStates::new(skeleton);
        let own = FramePrior::new(prior, root, joints, &mut states)?;
        let equations = FrameEquations {
            moving: joints.iter().map(|joint| states.moving(*joint)).collect(),
            states,
            prior: own,
            joints,
            outlier: f64::INFINITY,
        };
        Ok(FrameSolver {
            start: FrameStart::new(&equations, prior),
            equations,
        })
    }

    /// Lets points be far off: outliers count little.
    pub(crate) fn with_outliers(mut self) -> FrameSolver<'a> {
        self.equations.outlier = OUTLIER * OUTLIER;
        self
    }

    /// The start of a frame that knows nothing of others: rotations at their means, the body where
    /// its points are, above all those that hardly move against the root.
    pub(crate) fn start(&self, root: usize, targets: &[f64]) -> FrameState {
        self.start.of(&self.equations, root, targets)
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

    /// Improves a frame by at most so many steps; one that lowers E by less than a share of it is
    /// the last.
    pub(crate) fn improve(
        &self,
        targets: &[f64],
        weights: &[f64],
        state: FrameState,
        (steps, share): (usize, f64),
        scratch: &mut Scratch,
    ) -> FrameFit {
        let most = (steps, (0.0, share));
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
        let equations = &self.equations;
        let (start, damping) = match start {
            Start::Far(state) => (state, FAR_DAMPING),
            Start::Near(state) => (state, NEAR_DAMPING),
        };
        let energy = equations.energy(&start, targets, weights, scratch);
        let (absolute, relative) = tolerance;
        let mut is_settled = false;
        let attempt = |at: &(f64, FrameState), damping: f64, fresh: bool| {
            if is_settled {
                return Some((at.0, at.clone()));
            }
            if fresh {
                equations.set_equations(&at.1, targets, weights, scratch);
            }
            let (next, expected) = equations.step(&at.1, damping, scratch);
            let energy = equations.energy(&next, targets, weights, scratch);
            // Where a step that helps lowers E as it should, the next one would hardly.
            let gain = at.0 - energy;
            let most = absolute + relative * energy;
            is_settled = absolute > 0.0 && gain > 0.0 && (gain - expected).abs() <= most;
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

    /// The state after a step that a linearization gives.
    pub(crate) fn after(&self, state: &FrameState, step: &[f64]) -> FrameState {
        self.equations.states.applied(state, |c| step[c])
    }
}

#[cfg(test)]
mod tests {
    use super::state::Column;
    use super::*;
    use crate::pose::kinematics::Posture;
    use crate::pose::rotation::{Axis, from_rotation_vector};
    use crate::pose::{Bone, Channel, Dof};
    use crate::prior::rotations::RotationPrior;
    use glam::{DMat3, DVec3};

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
            let equations = &solver.equations;
            let mut scratch = Scratch::default();
            let mut state = solver.start(0, &y);
            // Away from the start, so that the prior pulls too.
            let fit = solver.solve(&y, &weights, Start::Far(state), &mut scratch);
            state = fit.state;
            for (n, r) in state.rotations.iter_mut().enumerate() {
                *r = from_rotation_vector(DVec3::new(0.3, -0.2, 0.1 * n as f64)) * *r;
            }
            state.values.iter_mut().for_each(|v| *v += 0.1);
            equations.energy(&state, &y, &weights, &mut scratch);
            equations.set_equations(&state, &y, &weights, &mut scratch);
            let gradient = scratch.gradient.clone();
            let h = 1e-6;
            for (c, column) in equations.states.columns.iter().enumerate() {
                let mut at = |by: f64| {
                    let mut moved = state.clone();
                    match *column {
                        Column::Turn(bone, axis) => {
                            let turn = from_rotation_vector(DVec3::AXES[axis] * by);
                            moved.rotations[bone] = turn * moved.rotations[bone];
                        }
                        Column::Dof(bone, n) => moved.values[s.dofs_of(bone).start + n] += by,
                    }
                    equations.energy(&moved, &y, &weights, &mut scratch)
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
            solver.equations.states.posture(&fit.state, &mut posture);
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
}

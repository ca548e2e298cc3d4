//! The bones of a person and the positions of the markers, fitted with the poses of some frames.
//!
//! ```text
//! (κ/F) Σ_f [Σ ρ(|y − x|²/σ²) + rᵀ Λ r] + (s − s₀)ᵀ P (s − s₀)
//! ```
//!
//! over the poses of F frames and the numbers s of bones and markers, of which P is the precision:
//! the frames count as κ independent ones. A step is Gauss's and Newton's; each frame's pose is
//! eliminated, so that only s remains (Schur's complement), and is damped.

use super::body::{Body, Part};
use super::tuning::*;
use crate::ik::frame_solver::{FrameSolver, FrameState, Linearized, Scratch, Start};
use crate::numeric::linalg::{Cholesky, gram};
use crate::numeric::parallel::map_chunks;
use crate::pose::Skeleton;
use crate::prior::rotations::JointPrior;
use crate::{Error, Result};
use glam::DMat3;
use ndarray::{Array1, Array2, Axis, concatenate};
use std::f64::consts::PI;

/// What is known of a person once the frames are fitted.
pub(super) struct Calibration {
    /// The numbers of bones and markers.
    pub numbers: Vec<f64>,
    /// One over their covariance.
    pub precision: Array2<f64>,
}

/// Frames and the body that is fitted to them.
pub(super) struct Calibrator<'a> {
    pub body: &'a Body,
    pub prior: &'a JointPrior,
    /// The markers of each frame (3 a marker; NaN is missing), cm.
    pub frames: &'a [Vec<f64>],
}

/// The equations of a frame's pose, by their Cholesky factor L, and what they have to do with the
/// numbers.
struct Pose {
    factor: Cholesky,
    /// L⁻¹ B and L⁻¹ g.
    coupling: Array2<f64>,
    gradient: Array2<f64>,
}

/// What is left of the equations for the numbers once the poses are eliminated.
struct Reduced {
    precision: Array2<f64>,
    rest: Array1<f64>,
    poses: Vec<Pose>,
}

/// A state of the fit.
#[derive(Clone)]
struct State {
    numbers: Vec<f64>,
    poses: Vec<FrameState>,
}

impl Calibrator<'_> {
    /// Fits them.
    ///
    /// # Errors
    /// [`Error::Usage`]: the equations cannot be solved.
    pub(super) fn calibrate(&self) -> Result<Calibration> {
        let singular = || Error::usage("bones and markers cannot be fitted: singular equations");
        let skeleton = self.body.skeleton(&self.body.mean)?;
        let joints = self.body.marker_bones();
        let of_mean = frame_solver(&skeleton, &joints, self.prior)?;
        let mut state = self.start()?;
        let mut linear = self.linearized(&state)?;
        let mut cost = self.cost(&state, &linear);
        let (mut damping, mut taken) = (DAMPING, 0);
        let mut reduced = self.reduced(&state, &linear).ok_or_else(singular)?;
        loop {
            let next = self.step(&of_mean, &state, &reduced, damping);
            let gains_little = |gain: f64| damping <= DAMPING && gain <= TOLERANCE * cost;
            let is_last = next.as_ref().is_some_and(|n| gains_little(n.1));
            if is_last || taken == STEPS || damping > MOST_DAMPING {
                return Ok(Calibration {
                    numbers: state.numbers,
                    precision: reduced.precision,
                });
            }
            let reached = match next {
                Some((next, _)) => {
                    let there = self.linearized(&next)?;
                    Some((self.cost(&next, &there), next, there))
                }
                None => None,
            };
            match reached {
                Some(reached) if reached.0 < cost => {
                    (cost, state, linear) = reached;
                    reduced = self.reduced(&state, &linear).ok_or_else(singular)?;
                    damping *= RELAX;
                    taken += 1;
                }
                _ => damping *= RAISE,
            }
        }
    }

    /// The most probable body, and the poses that it has then.
    fn start(&self) -> Result<State> {
        let numbers = self.body.mean.clone();
        let poses = self.with_solver(&numbers, |solver, n, scratch| {
            let frame = &self.frames[n];
            let weights = self.body.weights();
            let start = solver.start(0, frame);
            let mut solve = |start| solver.solve(frame, &weights, Start::Far(start), scratch);
            let fit = solve(start.clone());
            let seen = frame.iter().filter(|v| v.is_finite()).count() / 3;
            if fit.energy < FITS * seen as f64 {
                return fit.state;
            }
            // Two wrong names at the pelvis turn it about.
            let mut about = start;
            about.rotations[0] = DMat3::from_rotation_y(PI) * about.rotations[0];
            let about = solve(about);
            if about.energy < fit.energy {
                about.state
            } else {
                fit.state
            }
        })?;
        Ok(State { numbers, poses })
    }

    /// Does something with the solver of a body for each frame, by its number.
    fn with_solver<T: Send>(
        &self,
        numbers: &[f64],
        of: impl Fn(&FrameSolver<'_>, usize, &mut Scratch) -> T + Sync,
    ) -> Result<Vec<T>> {
        let skeleton = self.body.skeleton(numbers)?;
        let joints = self.body.marker_bones();
        let solver = frame_solver(&skeleton, &joints, self.prior)?;
        let all = map_chunks(self.frames.len(), 1, |range| {
            of(&solver, range.start, &mut Scratch::default())
        });
        Ok(all)
    }

    fn linearized(&self, state: &State) -> Result<Vec<Linearized>> {
        let weights = self.body.weights();
        self.with_solver(&state.numbers, |solver, n, scratch| {
            solver
                .equations
                .linearized(&state.poses[n], &self.frames[n], &weights, scratch)
        })
    }

    /// The share that a frame counts.
    fn share(&self) -> f64 {
        INDEPENDENT / self.frames.len() as f64
    }

    fn cost(&self, state: &State, linear: &[Linearized]) -> f64 {
        let frames: f64 = linear.iter().map(|l| l.energy).sum();
        let off = self.off(state);
        self.share() * frames + off.dot(&self.body.precision.dot(&off))
    }

    /// How far the numbers are from the most probable ones.
    fn off(&self, state: &State) -> Array1<f64> {
        let both = state.numbers.iter().zip(&self.body.mean);
        both.map(|(own, mean)| own - mean).collect()
    }

    /// The equations of the numbers; `None` where those of a frame are singular.
    fn reduced(&self, state: &State, linear: &[Linearized]) -> Option<Reduced> {
        let pose = |linear: &Linearized| {
            let (factor, coupling) = coupled(self.body, linear)?;
            let gradient = Array1::from_vec(linear.gradient.clone()).insert_axis(Axis(1));
            let gradient = factor.half_solve(&gradient)?;
            Some(Pose {
                factor,
                coupling,
                gradient,
            })
        };
        let poses = map_chunks(linear.len(), 1, |range| pose(&linear[range.start]));
        let poses: Vec<Pose> = poses.into_iter().collect::<Option<_>>()?;
        // One product for all frames: couplings on top of each other.
        let stacked = |columns: usize, of: fn(&Pose) -> &Array2<f64>| {
            let none = Array2::zeros((0, columns));
            let all = std::iter::once(none.view()).chain(poses.iter().map(|p| of(p).view()));
            concatenate(Axis(0), &all.collect::<Vec<_>>()).ok()
        };
        let coupling = stacked(self.body.mean.len(), |p| &p.coupling)?;
        let gradient = stacked(1, |p| &p.gradient)?;
        let (own, rest) = self.of_numbers(linear);
        let lost = coupling.t().dot(&gradient.column(0));
        Some(Reduced {
            precision: &self.body.precision + (own - gram(coupling.view())) * self.share(),
            rest: self.body.precision.dot(&self.off(state)) + (rest - lost) * self.share(),
            poses,
        })
    }

    /// The equations of the numbers, as if the poses were known, without what is known of people.
    fn of_numbers(&self, linear: &[Linearized]) -> (Array2<f64>, Array1<f64>) {
        let count = self.body.mean.len();
        let (mut own, mut rest) = (Array2::zeros((count, count)), Array1::zeros(count));
        for linear in linear {
            for (m, off) in linear.off.iter().enumerate().filter(|(_, o)| o.is_finite()) {
                let parts = self.body.moved_marker(m, &linear.posture.rotations);
                for (Part { first, turn }, c) in
                    parts.iter().flat_map(|p| [0, 1, 2].map(|c| (p, c)))
                {
                    let by = turn.col(c) * linear.weights[m];
                    rest[first + c] += by.dot(*off);
                    for other in &parts {
                        for d in 0..3 {
                            own[[first + c, other.first + d]] += by.dot(other.turn.col(d));
                        }
                    }
                }
            }
        }
        (own, rest)
    }

    /// The state after a damped step, with the solver of any body of these bones, and by how much
    /// the cost is less there as far as the undamped equations tell; `None` where they are
    /// singular.
    fn step(
        &self,
        solver: &FrameSolver<'_>,
        state: &State,
        reduced: &Reduced,
        damping: f64,
    ) -> Option<(State, f64)> {
        let Reduced {
            precision,
            rest,
            poses,
        } = reduced;
        let mut damped = precision.clone();
        damped.diag_mut().mapv_inplace(|v| v * (1.0 + damping));
        let step = -Cholesky::new(damped)?.solve(&rest.clone().insert_axis(Axis(1)))?;
        let of_poses: f64 = poses
            .iter()
            .map(|p| p.gradient.iter().map(|v| v * v).sum::<f64>())
            .sum();
        let gain = self.share() * of_poses - rest.dot(&step.column(0));
        let numbers = state.numbers.iter().zip(step.column(0));
        let numbers: Vec<f64> = numbers.map(|(s, d)| s + d).collect();
        let poses = poses.iter().zip(&state.poses).map(|(own, pose)| {
            let right = &own.gradient + &own.coupling.dot(&step);
            let turn = -own.factor.half_solve_transposed(&right)?;
            Some(solver.after(pose, &turn.column(0).to_vec()))
        });
        let poses = poses.collect::<Option<_>>()?;
        Some((State { numbers, poses }, gain))
    }
}

/// The Cholesky factor L of a frame's own equations and L⁻¹ B: what the pose has to do with the
/// numbers of the body. `None` where the equations are singular.
pub(super) fn coupled(body: &Body, linear: &Linearized) -> Option<(Cholesky, Array2<f64>)> {
    let n = linear.gradient.len();
    let mut coupling: Array2<f64> = Array2::zeros((n, body.mean.len()));
    for (m, _) in linear
        .off
        .iter()
        .enumerate()
        .filter(|(_, off)| off.is_finite())
    {
        for Part { first, turn } in body.moved_marker(m, &linear.posture.rotations) {
            for c in 0..3 {
                let by = turn.col(c) * linear.weights[m];
                for (column, moved) in &linear.derivatives[m] {
                    coupling[[*column, first + c]] += by.dot(*moved);
                }
            }
        }
    }
    let mut normal = linear.normal.clone();
    for i in 0..n {
        normal[[i, i]] += LEAST_PRECISION;
    }
    let factor = Cholesky::new(normal)?;
    let coupling = factor.half_solve(&coupling)?;
    Some((factor, coupling))
}

/// Damps what neither markers nor the prior move.
const LEAST_PRECISION: f64 = 1e-6;

/// The solver of the frames of a body with markers, any of which may be wrong.
pub(super) fn frame_solver<'s>(
    skeleton: &'s Skeleton,
    joints: &'s [usize],
    prior: &JointPrior,
) -> Result<FrameSolver<'s>> {
    Ok(FrameSolver::new(skeleton, joints, 0, prior)?.with_outliers())
}

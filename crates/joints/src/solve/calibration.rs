//! The bones of a person and the positions of the markers, fitted with the poses of some frames.
//!
//! ```text
//! (κ/F) Σ_f [Σ ρ(|y − x|²/σ²) + rᵀ Λ r] + (s − s₀)ᵀ P (s − s₀)
//! ```
//!
//! over the poses of F frames and the numbers s of bones and markers, of which P is the precision:
//! the frames count as κ independent ones. A step is Gauss's and Newton's, damped; each frame's
//! pose is eliminated, so that only s remains (Schur's complement).

use super::body::{Body, Part};
use super::tuning::*;
use crate::ik::frame_solver::{FrameSolver, FrameState, Linearized, Scratch, Start};
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel::map_chunks;
use crate::pose::Skeleton;
use crate::prior::rotations::JointPrior;
use crate::{Error, Result};
use glam::DMat3;
use ndarray::{Array1, Array2, Axis};
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

/// The equations of a frame: its pose's own, by their Cholesky factor L, and what they have to do
/// with the numbers.
struct Reduced {
    factor: Cholesky,
    /// L⁻¹ B and L⁻¹ g.
    coupling: Array2<f64>,
    gradient: Array2<f64>,
    /// What is left for the numbers.
    precision: Array2<f64>,
    rest: Array1<f64>,
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
        let mut state = self.start()?;
        let mut linear = self.linearized(&state)?;
        let mut cost = self.cost(&state, &linear);
        let (mut damping, mut taken) = (DAMPING, 0);
        while taken < STEPS && damping <= MOST_DAMPING {
            let Some(next) = self.step(&state, &linear, damping) else {
                damping *= RAISE;
                continue;
            };
            let there = self.linearized(&next)?;
            let reached = self.cost(&next, &there);
            if reached >= cost || reached.is_nan() {
                damping *= RAISE;
                continue;
            }
            let gain = cost - reached;
            (cost, state, linear) = (reached, next, there);
            damping *= RELAX;
            taken += 1;
            if gain <= TOLERANCE * cost {
                break;
            }
        }
        let (precision, _, _) = self.reduced(&state, &linear, 0.0).ok_or_else(singular)?;
        Ok(Calibration {
            numbers: state.numbers,
            precision,
        })
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

    /// The equations of the numbers once the poses are eliminated, their right side, and those of
    /// the frames; `None` where one is singular.
    fn reduced(
        &self,
        state: &State,
        linear: &[Linearized],
        damping: f64,
    ) -> Option<(Array2<f64>, Array1<f64>, Vec<Reduced>)> {
        let frames = map_chunks(linear.len(), 1, |range| {
            self.reduced_frame(&linear[range.start], damping)
        });
        let frames: Vec<Reduced> = frames.into_iter().collect::<Option<_>>()?;
        let mut precision = self.body.precision.clone();
        let mut rest = self.body.precision.dot(&self.off(state));
        for frame in &frames {
            precision.scaled_add(self.share(), &frame.precision);
            rest.scaled_add(self.share(), &frame.rest);
        }
        Some((precision, rest, frames))
    }

    fn reduced_frame(&self, linear: &Linearized, damping: f64) -> Option<Reduced> {
        let count = self.body.mean.len();
        let mut own: Array2<f64> = Array2::zeros((count, count));
        let mut rest: Array1<f64> = Array1::zeros(count);
        for (m, off) in linear.off.iter().enumerate() {
            if !off.is_finite() {
                continue;
            }
            let parts = self.body.moved_marker(m, &linear.posture.rotations);
            for Part { first, turn } in &parts {
                for c in 0..3 {
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
        let (factor, coupling) = coupled(self.body, linear, damping)?;
        let gradient = Array1::from_vec(linear.gradient.clone()).insert_axis(Axis(1));
        let gradient = factor.half_solve(&gradient)?;
        let lost = coupling.t().dot(&gradient);
        Some(Reduced {
            precision: own - coupling.t().dot(&coupling),
            rest: rest - lost.column(0),
            factor,
            coupling,
            gradient,
        })
    }

    /// The state after a damped step; `None` where the equations are singular.
    fn step(&self, state: &State, linear: &[Linearized], damping: f64) -> Option<State> {
        let (mut precision, rest, frames) = self.reduced(state, linear, damping)?;
        for i in 0..rest.len() {
            precision[[i, i]] *= 1.0 + damping;
        }
        let step = -Cholesky::new(precision)?.solve(&rest.insert_axis(Axis(1)))?;
        let numbers = state.numbers.iter().zip(step.column(0));
        let numbers: Vec<f64> = numbers.map(|(s, d)| s + d).collect();
        let skeleton = self.body.skeleton(&state.numbers).ok()?;
        let joints = self.body.marker_bones();
        let solver = frame_solver(&skeleton, &joints, self.prior).ok()?;
        let poses = frames.iter().zip(&state.poses).map(|(frame, pose)| {
            let right = &frame.gradient + &frame.coupling.dot(&step);
            let turn = -frame.factor.half_solve_transposed(&right)?;
            Some(solver.after(pose, &turn.column(0).to_vec()))
        });
        Some(State {
            numbers,
            poses: poses.collect::<Option<_>>()?,
        })
    }
}

/// The Cholesky factor L of a frame's own equations, damped, and L⁻¹ B: what the pose has to do
/// with the numbers of the body. `None` where the equations are singular.
pub(super) fn coupled(
    body: &Body,
    linear: &Linearized,
    damping: f64,
) -> Option<(Cholesky, Array2<f64>)> {
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
        normal[[i, i]] += damping * normal[[i, i]] + LEAST_PRECISION;
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

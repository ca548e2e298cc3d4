//! The normal equations of a frame.

use super::prior::FramePrior;
use super::state::{Column, FrameState, FrameStates};
use crate::ik::tuning::frame_solver::LEAST_PRECISION;
use crate::numeric::small_linalg::{add, backward, dot, factorize, forward};
use crate::pose::kinematics::{DofMotion, Posture};
use crate::pose::rotation::rotation_vector_jacobian;
use glam::{DMat3, DVec3};
use ndarray::Array2;

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

/// Memory that frames are solved in.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    posture: Posture,
    motions: Vec<DofMotion>,
    dof_motions: Vec<DofMotion>,
    derivatives: Vec<DVec3>,
    deviations: Vec<f64>,
    normal: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    factor: Vec<f64>,
    step: Vec<f64>,
}

/// The equations of frames of one skeleton and one set of points.
pub(crate) struct FrameEquations<'a> {
    pub(crate) states: FrameStates<'a>,
    pub(super) prior: FramePrior,
    /// The bone whose end each point is.
    pub(super) joints: &'a [usize],
    /// The columns that move each joint.
    pub(super) moving: Vec<Vec<usize>>,
    /// c²; infinite where no point is an outlier.
    pub(super) outlier: f64,
}

impl FrameEquations<'_> {
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

    /// E at a state.
    pub(super) fn energy(
        &self,
        state: &FrameState,
        targets: &[f64],
        weights: &[f64],
        scratch: &mut Scratch,
    ) -> f64 {
        self.states.posture(state, &mut scratch.posture);
        let mut sum = 0.0;
        for ((&joint, y), w) in self.joints.iter().zip(targets.chunks_exact(3)).zip(weights) {
            let off = (scratch.posture.ends[joint] - DVec3::from_slice(y)).length_squared();
            if off.is_finite() {
                sum += self.cost(w * off);
            }
        }
        self.prior
            .set_deviations(&self.states, state, &mut scratch.deviations);
        let n = scratch.deviations.len();
        for (i, r) in scratch.deviations.iter().enumerate() {
            sum += r * dot(&self.prior.precision[i * n..][..n], &scratch.deviations);
        }
        let held = self.states.columns.iter().zip(&self.prior.held);
        let held = held.filter(|(_, held)| **held > 0.0);
        sum + held
            .map(|(c, held)| held * self.states.slide(*c, state).powi(2))
            .sum::<f64>()
    }

    /// Sets the normal equations (lower triangle) and half the gradient at the state whose energy
    /// was asked for last.
    pub(super) fn set_equations(
        &self,
        state: &FrameState,
        targets: &[f64],
        weights: &[f64],
        scratch: &mut Scratch,
    ) {
        let n = self.states.columns.len();
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
        self.add_prior(normal, gradient, deviations);
        for (c, (column, held)) in self.states.columns.iter().zip(&self.prior.held).enumerate() {
            normal[c * n + c] += held;
            gradient[c] += held
                * if *held > 0.0 {
                    self.states.slide(*column, state)
                } else {
                    0.0
                };
        }
    }

    /// Adds the prior: Bᵀ Λ B and Bᵀ Λ r, where B carries a step to the deviations.
    fn add_prior(&self, normal: &mut [f64], gradient: &mut [f64], deviations: &[f64]) {
        let (n, known) = (self.states.columns.len(), deviations.len());
        let precision = |i: usize| &self.prior.precision[i * known..][..known];
        let pull: Vec<f64> = (0..known).map(|i| dot(precision(i), deviations)).collect();
        // log(exp(d) exp(r)) ≈ r + J(−r) d, J(−r) = J(r)ᵀ
        let block = |&(bone, first, count): &(usize, usize, usize)| {
            let r = || DVec3::from_slice(&deviations[first..first + 3]);
            let own = self.states.is_ball[bone].then(|| rotation_vector_jacobian(r()));
            (first, count, own)
        };
        let blocks: Vec<_> = self.prior.bones.iter().map(block).collect();
        let mut rows = vec![0.0; 3 * known];
        for &(first, count, own) in &blocks {
            let rows = &mut rows[..count * known];
            for (c, row) in rows.chunks_exact_mut(known).enumerate() {
                let Some(own) = own else {
                    row.copy_from_slice(precision(first + c));
                    continue;
                };
                row.fill(0.0);
                (0..3).for_each(|k| add(row, own.col(k)[c], precision(first + k)));
            }
            for (c, row) in rows.chunks_exact(known).enumerate() {
                let at = first + c;
                let to = &mut normal[at * n..][..=at];
                for &(other, width, theirs) in blocks.iter().take_while(|b| b.0 <= first) {
                    let from = &row[other..other + width];
                    let carried: [f64; 3] = match theirs {
                        Some(theirs) => (theirs * DVec3::from_slice(from)).to_array(),
                        None => std::array::from_fn(|k| from.get(k).copied().unwrap_or(0.0)),
                    };
                    for (k, v) in carried.into_iter().enumerate().take(width) {
                        if other + k <= at {
                            to[other + k] += v;
                        }
                    }
                }
            }
            let pulls = &pull[first..first + count];
            match own {
                Some(own) => {
                    let carried = own * DVec3::from_slice(pulls);
                    (0..3).for_each(|c| gradient[first + c] += carried[c]);
                }
                None => add(&mut gradient[first..first + count], 1.0, pulls),
            }
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
        for column in &self.states.columns {
            motions.push(match *column {
                Column::Turn(bone, axis) => {
                    let above = self.states.skeleton.bones()[bone].parent;
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
                        self.states
                            .skeleton
                            .push_dof_motions(bone, values, posture, dof_motions);
                        last = Some(bone);
                    }
                    dof_motions[n]
                }
            });
        }
    }

    /// The state after a damped step, and by how much it lowers E if that is quadratic, but for the
    /// damping.
    pub(super) fn step(
        &self,
        state: &FrameState,
        damping: f64,
        scratch: &mut Scratch,
    ) -> (FrameState, f64) {
        let n = self.states.columns.len();
        scratch.factor.clone_from(&scratch.normal);
        scratch.step.clone_from(&scratch.gradient);
        for c in 0..n {
            scratch.factor[c * n + c] += damping * (scratch.normal[c * n + c] + LEAST_PRECISION);
        }
        factorize(&mut scratch.factor, n);
        forward(&scratch.factor, n, &mut scratch.step);
        backward(&scratch.factor, n, &mut scratch.step);
        let expected = dot(&scratch.gradient, &scratch.step);
        (self.states.applied(state, |c| -scratch.step[c]), expected)
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
        let n = self.states.columns.len();
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
        let above = self.states.above(bone);
        let position = at.posture.ends[bone];
        let of = |(c, column): (usize, &Column)| {
            if above.contains(&column.bone()) {
                scratch.motions[c].derivative(position)
            } else {
                DVec3::ZERO
            }
        };
        self.states.columns.iter().enumerate().map(of).collect()
    }

    /// The bones with a prior, and of each the points by which its rotation is seen.
    pub(crate) fn seen_by(&self) -> impl Iterator<Item = (usize, Vec<usize>)> + '_ {
        let bones = self.states.skeleton.bones();
        let has_lever = move |t: &usize, bone: usize| {
            self.joints[*t] != bone || bones[bone].offset != DVec3::ZERO
        };
        self.prior.bones.iter().map(move |&(bone, first, _)| {
            let moves = |t: &usize| self.moving[*t].contains(&first) && has_lever(t, bone);
            (bone, (0..self.joints.len()).filter(moves).collect())
        })
    }
}

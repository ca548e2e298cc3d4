//! P2 of Lai et al.: the values of a skeleton's own degrees of freedom that put its joints
//! where they are wanted.
//!
//! Minimizes `E(q) = Σ wₜ |fₜ(q) − yₜ|² + Σ aᵢ (qᵢ − rᵢ)² + Σ bᵢ (qᵢ − sᵢ)²` over the values q: f
//! the joints' positions and y the wanted ones (centimeters, those that are not missing), w their
//! weights (1 unless set), r the frame before, s the rest posture, a and b small weights. Lai et
//! al. solve `f(q) = ỹ` (15) by the damped Jacobian method; this is Levenberg's and Marquardt's
//! form of it: `(JᵀJ + A + B + λ D) δ = −gradient / 2`, λ falling as long as E falls. The weights
//! settle what the joints leave open (the twist of a straight arm, how the spine's twist is shared)
//! without pulling what they do determine: at 1e-4 cm² a squared radian an angle with a lever of 5
//! cm gives way by a hundred thousandth of its step.
//!
//! A step costs O(n depth²) for n free values. P2 is not convex: the solution is a local minimum
//! near the start.

use super::tree_cholesky::solve_tree;
use super::tuning::solver::*;
use crate::numeric::levenberg_marquardt::Damping;
use crate::pose::Skeleton;
use crate::pose::kinematics::{DofMotion, Posture};
use glam::DVec3;

/// The most values a skeleton may have: the normal equations are stored as a full matrix.
pub(crate) const MAX_DOFS: usize = 1200;

/// The step after rejected ones starts from close to the damping that did.
const SCHEDULE: Damping = Damping {
    start: DAMPING,
    accepted: |damping, first| {
        (damping * if first { RELAX } else { RELAX_RETRIED }).max(LEAST_DAMPING)
    },
    rejected: |damping| (damping * RAISE).max(LEAST_RAISED),
    most: MOST_DAMPING,
};

/// When a solution counts as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSettings {
    /// Steps at most. Lai et al.: "usually converge within 20 iterates".
    pub iterations: usize,
    /// Ends when a step lowers E by less than this, cm².
    pub tolerance: f64,
    /// Keep to the skeleton's limits. Off by default: CMU's own takes exceed theirs.
    pub limits: bool,
}

impl Default for IkSettings {
    fn default() -> Self {
        IkSettings {
            iterations: STEPS,
            tolerance: TOLERANCE,
            limits: false,
        }
    }
}

/// Regularization of the values that the joints leave open.
#[derive(Debug, Clone, Copy)]
pub struct Regularization<'a> {
    /// r: the frame before.
    pub previous: &'a [f64],
    /// a, cm² a squared radian (a hundredth of it a squared centimeter).
    pub previous_weight: f64,
    /// s: the rest posture.
    pub rest: &'a [f64],
    /// b, the same unit.
    pub rest_weight: f64,
}

/// How a solution ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSolution {
    /// E at the end, cm².
    pub energy: f64,
    /// Σ w |f − y|² at the end, cm².
    pub misfit: f64,
    /// Steps tried.
    pub iterations: usize,
    /// Whether the search ended at a minimum: within the tolerances, or where no step lowers E.
    pub converged: bool,
}

/// Solves frame after frame for one skeleton and one set of joints; the memory of the normal
/// equations is kept between frames.
///
/// ```
/// use posing_core::pose::{Bone, Channel, Dof, Skeleton, rotation::Axis};
/// use posing_joints::ik::solver::{IkSettings, IkSolver, Regularization};
/// # use glam::{DMat3, DVec3};
/// # let bone = |name: &str, parent, offset, dofs| {
/// #     Bone { name: name.into(), parent, offset, axis: DMat3::IDENTITY, dofs }
/// # };
/// # let turn = Dof { channel: Channel::Rotate(Axis::Z), limits: None, offset: 0.0 };
/// # let root = bone("root", None, DVec3::ZERO, vec![]);
/// # let arm = bone("arm", Some(0), DVec3::new(30.0, 0.0, 0.0), vec![turn]);
///
/// // One bone of 30 cm that turns about z, and where its end was seen.
/// let skeleton = Skeleton::new(vec![root, arm])?;
/// let mut solver = IkSolver::new(&skeleton, &[1], IkSettings::default());
/// let (previous, rest) = (&[0.0][..], &[0.0][..]);
/// let free = Regularization { previous, previous_weight: 0.0, rest, rest_weight: 0.0 };
/// let mut q = [0.3];
/// let solution = solver.solve(&[0.0, 30.0, 0.0], &[false], &free, &mut q);
/// assert!(solution.converged);
/// assert!((q[0] - 90_f64.to_radians()).abs() < 1e-2);
/// # Ok::<(), posing_core::Error>(())
/// ```
pub struct IkSolver<'a> {
    skeleton: &'a Skeleton,
    joints: &'a [usize],
    settings: IkSettings,
    limits: Vec<(f64, f64)>,
    /// w: the weight of each coordinate of the targets.
    weights: Vec<f64>,
    /// Whether each value is an angle.
    angle: Vec<bool>,
    /// The values that can move each joint, from the root on.
    affecting_dofs: Vec<Vec<usize>>,
    /// The value that moves all that each value moves, and comes just before it.
    dof_parents: Vec<Option<usize>>,
    posture: Posture,
    motions: Vec<DofMotion>,
    /// The columns of the Jacobian that move one joint, from the root on.
    columns: Vec<(usize, DVec3)>,
    /// The index of each value in the system being solved.
    index: Vec<Option<usize>>,
    free: Vec<usize>,
    /// The nearest value above each in the system being solved.
    parents: Vec<Option<usize>>,
    /// The system being solved, `JᵀJ + A + B` (lower triangle) and half the gradient of E, and
    /// what a step makes of them.
    normal: Vec<f64>,
    gradient: Vec<f64>,
    factor: Vec<f64>,
    step: Vec<f64>,
}

impl<'a> IkSolver<'a> {
    /// `joints[t]` is the bone whose end is target t.
    pub fn new(skeleton: &'a Skeleton, joints: &'a [usize], settings: IkSettings) -> IkSolver<'a> {
        let bones = skeleton.bones();
        let affecting_dofs = joints.iter().map(|&joint| {
            let (mut dofs, mut at) = (Vec::new(), Some(joint));
            while let Some(bone) = at {
                dofs.extend(skeleton.dofs_of(bone));
                at = bones[bone].parent;
            }
            dofs.sort_unstable();
            dofs
        });
        let all = || bones.iter().flat_map(|b| &b.dofs);
        IkSolver {
            skeleton,
            joints,
            settings,
            limits: if settings.limits {
                skeleton.limits()
            } else {
                Vec::new()
            },
            weights: vec![1.0; 3 * joints.len()],
            angle: all().map(|d| d.channel.is_angle()).collect(),
            affecting_dofs: affecting_dofs.collect(),
            dof_parents: dof_parents(skeleton),
            posture: Posture::default(),
            motions: Vec::new(),
            columns: Vec::new(),
            index: Vec::new(),
            free: Vec::new(),
            parents: Vec::new(),
            normal: Vec::new(),
            gradient: Vec::new(),
            factor: Vec::new(),
            step: Vec::new(),
        }
    }

    /// Sets the weight of each coordinate of the targets (3 per joint, 0 or more).
    #[doc(hidden)]
    pub fn set_weights(&mut self, weights: &[f64]) {
        self.weights.copy_from_slice(weights);
    }

    /// Carries values into the limits, if they are to be kept.
    pub(crate) fn clamp(&self, q: &mut [f64]) {
        for (q, &(low, high)) in q.iter_mut().zip(&self.limits) {
            *q = q.max(low).min(high);
        }
    }

    /// The weight of a value in the terms that regularization it.
    fn weight(&self, i: usize, w: f64) -> f64 {
        if self.angle[i] { w } else { LENGTH_WEIGHT * w }
    }

    /// Σ w |f − y|² over the targets that are there, for the values `q`.
    pub(crate) fn misfit(&mut self, q: &[f64], targets: &[f64]) -> f64 {
        self.skeleton.posture_into(q, &mut self.posture);
        let mut sum = 0.0;
        let weights = self.weights.chunks_exact(3);
        for ((&joint, y), w) in self.joints.iter().zip(targets.chunks_exact(3)).zip(weights) {
            if y.iter().all(|v| v.is_finite()) {
                let f = self.posture.ends[joint];
                sum += (0..3).map(|c| w[c] * (f[c] - y[c]).powi(2)).sum::<f64>();
            }
        }
        sum
    }

    fn energy(
        &mut self,
        q: &[f64],
        targets: &[f64],
        regularization: &Regularization,
    ) -> (f64, f64) {
        let misfit = self.misfit(q, targets);
        let held: f64 = self
            .free
            .iter()
            .map(|&i| {
                self.weight(i, regularization.previous_weight)
                    * (q[i] - regularization.previous[i]).powi(2)
                    + self.weight(i, regularization.rest_weight)
                        * (q[i] - regularization.rest[i]).powi(2)
            })
            .sum();
        (misfit + held, misfit)
    }

    /// Improves `q` for `targets` (3 numbers per joint, NaN is missing). Values that no target
    /// moves stay as they are, and so do those for which `fixed` is true.
    pub fn solve(
        &mut self,
        targets: &[f64],
        fixed: &[bool],
        regularization: &Regularization,
        q: &mut [f64],
    ) -> IkSolution {
        self.clamp(q);
        self.select_free_values(targets, fixed);
        let now = self.energy(q, targets, regularization);
        let start = (now.0, (now, q.to_vec()));
        let (most, mut iterations) = ((self.settings.iterations, self.settings.iterations), 0);
        let tolerance = (self.settings.tolerance, RELATIVE_TOLERANCE);
        let (end, converged) = SCHEDULE.minimize(most, tolerance, start, |at, damping, fresh| {
            iterations += 1;
            if fresh {
                self.set_normal_equations(targets, regularization, &at.1);
            }
            let next = self.step(damping, &at.1)?;
            let now = self.energy(&next, targets, regularization);
            Some((now.0, (now, next)))
        });
        let ((energy, misfit), best) = end;
        q.copy_from_slice(&best);
        IkSolution {
            energy,
            misfit,
            iterations,
            converged: converged && energy.is_finite(),
        }
    }

    /// The values that a target is there for.
    fn select_free_values(&mut self, targets: &[f64], fixed: &[bool]) {
        self.index.clear();
        self.index.resize(self.angle.len(), None);
        self.free.clear();
        for (affecting_dofs, y) in self.affecting_dofs.iter().zip(targets.chunks_exact(3)) {
            if y.iter().all(|v| v.is_finite()) {
                for &i in affecting_dofs {
                    if self.index[i].is_none() && !fixed[i] {
                        self.index[i] = Some(0);
                        self.free.push(i);
                    }
                }
            }
        }
        // In the skeleton's order, whatever the order of the targets.
        self.free.sort_unstable();
        for (at, &i) in self.free.iter().enumerate() {
            self.index[i] = Some(at);
        }
        let above = |i: usize| std::iter::successors(self.dof_parents[i], |&i| self.dof_parents[i]);
        let parent = |&i: &usize| above(i).find_map(|k| self.index[k]);
        self.parents = self.free.iter().map(parent).collect();
    }

    /// Sets the normal equations at `q`.
    fn set_normal_equations(
        &mut self,
        targets: &[f64],
        regularization: &Regularization,
        q: &[f64],
    ) {
        self.skeleton.posture_into(q, &mut self.posture);
        self.skeleton
            .dof_motions(q, &self.posture, &mut self.motions);
        let n = self.free.len();
        let (normal, gradient) = (&mut self.normal, &mut self.gradient);
        normal.clear();
        normal.resize(n * n, 0.0);
        gradient.clear();
        gradient.resize(n, 0.0);
        for (t, y) in targets.chunks_exact(3).enumerate() {
            let end = self.posture.ends[self.joints[t]];
            let residual = end - DVec3::from_slice(y);
            if !residual.is_finite() {
                continue;
            }
            let weight = DVec3::from_slice(&self.weights[3 * t..]);
            self.columns.clear();
            for &i in &self.affecting_dofs[t] {
                if let Some(a) = self.index[i] {
                    self.columns.push((a, self.motions[i].derivative(end)));
                }
            }
            for (m, &(a, v)) in self.columns.iter().enumerate() {
                let weighted = weight * v;
                gradient[a] += weighted.dot(residual);
                let row = &mut normal[a * n..][..=a];
                for &(b, other) in &self.columns[..=m] {
                    row[b] += weighted.dot(other);
                }
            }
        }
        for (a, &i) in self.free.iter().enumerate() {
            let (before, rest) = (
                self.weight(i, regularization.previous_weight),
                self.weight(i, regularization.rest_weight),
            );
            self.normal[a * n + a] += before + rest;
            self.gradient[a] += before * (q[i] - regularization.previous[i])
                + rest * (q[i] - regularization.rest[i]);
        }
    }

    /// The values after a damped step from `q`; `None` when the system cannot be solved.
    fn step(&mut self, damping: f64, q: &[f64]) -> Option<Vec<f64>> {
        let n = self.free.len();
        self.factor.clone_from(&self.normal);
        self.step.clone_from(&self.gradient);
        let (normal, step) = (&mut self.factor, &mut self.step);
        for (a, &i) in self.free.iter().enumerate() {
            // The floor damps what no target moves: cm² a squared radian.
            normal[a * n + a] += damping * (normal[a * n + a] + FLOOR);
            // At a limit that the step would cross: stay there.
            let held = self.limits.get(i).is_some_and(|&(low, high)| {
                (q[i] <= low && step[a] > 0.0) || (q[i] >= high && step[a] < 0.0)
            });
            if held {
                for b in 0..n {
                    normal[a.max(b) * n + a.min(b)] = 0.0;
                }
                normal[a * n + a] = 1.0;
                step[a] = 0.0;
            }
        }
        if !solve_tree(normal, &self.parents, step) {
            return None;
        }
        // No joint turns by more than a radian a step: beyond that the linear model says nothing.
        let moves = || self.free.iter().zip(&self.step);
        let longest = moves()
            .filter(|(i, _)| self.angle[**i])
            .fold(0.0, |z: f64, (_, s)| z.max(s.abs()));
        let scale = if longest > 1.0 { 1.0 / longest } else { 1.0 };
        let mut trial = q.to_vec();
        moves().for_each(|(&i, s)| trial[i] -= scale * s);
        self.clamp(&mut trial);
        Some(trial)
    }

    /// Where the joints stand for `q`.
    pub fn posture(&mut self, q: &[f64]) -> &Posture {
        self.skeleton.posture_into(q, &mut self.posture);
        &self.posture
    }
}

/// The value that comes just before each on the way from the root.
fn dof_parents(skeleton: &Skeleton) -> Vec<Option<usize>> {
    let bones = skeleton.bones();
    let mut parents = Vec::with_capacity(skeleton.dof_count());
    let mut last: Vec<Option<usize>> = Vec::with_capacity(bones.len());
    for (bone, b) in bones.iter().enumerate() {
        let mut above = b.parent.and_then(|p| last[p]);
        for i in skeleton.dofs_of(bone) {
            parents.push(above);
            above = Some(i);
        }
        last.push(above);
    }
    parents
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::{Axis, compose, parse_order};
    use crate::pose::{Bone, Channel, Dof};
    use glam::DMat3;

    fn dof(channel: Channel, limits: Option<(f64, f64)>) -> Dof {
        Dof {
            channel,
            limits,
            offset: 0.0,
        }
    }

    /// A root with six values, an upper arm that is a ball joint, a lower one that is a hinge.
    fn arm(limits: Option<(f64, f64)>) -> Skeleton {
        let axes = [Axis::X, Axis::Y, Axis::Z];
        let ball = || axes.map(|a| dof(Channel::Rotate(a), None));
        let slide = axes.map(|a| dof(Channel::Translate(a), None));
        let bone = |name: &str, parent, offset, dofs| Bone {
            name: name.into(),
            parent,
            offset,
            axis: match parent {
                None => DMat3::IDENTITY,
                Some(_) => compose(&parse_order("XYZ").unwrap(), &[0.3, -0.2, 0.5]),
            },
            dofs,
        };
        Skeleton::new(vec![
            bone("root", None, DVec3::ZERO, [slide, ball()].concat()),
            bone("left", Some(0), DVec3::new(10., 2., 0.), vec![]),
            bone("right", Some(0), DVec3::new(-10., 3., 0.), vec![]),
            bone("upper", Some(1), DVec3::new(0., 30., 1.), ball().to_vec()),
            bone(
                "lower",
                Some(3),
                DVec3::new(3., 25., 0.),
                vec![dof(Channel::Rotate(Axis::X), limits)],
            ),
        ])
        .unwrap()
    }

    fn positions(s: &Skeleton, q: &[f64], joints: &[usize]) -> Vec<f64> {
        let posture = s.posture(q);
        joints
            .iter()
            .flat_map(|&j| posture.ends[j].to_array())
            .collect()
    }

    fn solve(
        s: &Skeleton,
        joints: &[usize],
        targets: &[f64],
        q: &mut [f64],
        limits: bool,
    ) -> IkSolution {
        let settings = IkSettings {
            limits,
            ..IkSettings::default()
        };
        let zero = vec![0.0; q.len()];
        let before = q.to_vec();
        let regularization = Regularization {
            previous: &before,
            previous_weight: 1e-6,
            rest: &zero,
            rest_weight: 0.0,
        };
        let fixed = vec![false; q.len()];
        IkSolver::new(s, joints, settings).solve(targets, &fixed, &regularization, q)
    }

    #[test]
    fn a_posture_is_recovered_from_nearby() {
        let (s, joints) = (arm(None), [0, 1, 2, 3, 4]);
        let want: Vec<f64> = (0..s.dof_count()).map(|i| (i as f64 * 1.3).sin()).collect();
        let targets = positions(&s, &want, &joints);
        let mut q: Vec<f64> = want.iter().map(|v| v + 0.2).collect();
        let done = solve(&s, &joints, &targets, &mut q, false);
        assert!(done.converged && done.iterations <= 20, "{done:?}");
        assert!(done.misfit <= 1e-6, "{done:?}");
        let found = positions(&s, &q, &joints);
        assert!(
            found
                .iter()
                .zip(&targets)
                .all(|(a, b)| (a - b).abs() <= 1e-3)
        );
    }

    #[test]
    fn values_without_targets_stay() {
        let s = arm(None);
        let mut q: Vec<f64> = (0..s.dof_count()).map(|i| 0.1 * i as f64).collect();
        let joints = [0, 1, 2, 4];
        let mut targets = positions(&s, &q, &joints);
        targets[9..].fill(f64::NAN);
        let old = q.clone();
        q[0] += 3.0;
        solve(&s, &joints, &targets, &mut q, false);
        assert_eq!(q[6..], old[6..]);
        assert!((q[0] - old[0]).abs() <= 1e-4);
        // Nothing seen at all: nothing moves.
        let before = q.clone();
        let done = solve(&s, &joints, &[f64::NAN; 12], &mut q, false);
        assert!(done.converged);
        assert_eq!(q, before);
    }

    #[test]
    fn limits_are_kept_when_asked_for() {
        let (s, joints) = (arm(Some((0.0, 0.5))), [0, 1, 2, 3, 4]);
        let mut want = vec![0.0; s.dof_count()];
        let hinge = s.dofs_of(4).start;
        want[hinge] = 1.2;
        let targets = positions(&s, &want, &joints);
        let mut q = vec![0.0; s.dof_count()];
        q[hinge] = 0.3;
        solve(&s, &joints, &targets, &mut q, true);
        assert!((0.49..=0.5).contains(&q[hinge]), "{}", q[hinge]);
        solve(&s, &joints, &targets, &mut q, false);
        assert!((q[hinge] - 1.2).abs() <= 1e-4, "{}", q[hinge]);
        // What is beyond a limit comes back to it, and what stands on one may leave it.
        want[hinge] = 0.2;
        let targets = positions(&s, &want, &joints);
        solve(&s, &joints, &targets, &mut q, true);
        assert!((q[hinge] - 0.2).abs() <= 1e-4, "{}", q[hinge]);
    }
}

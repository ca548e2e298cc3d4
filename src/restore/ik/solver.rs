//! P2 of the posing paper: the values of a skeleton's own degrees of freedom that put its joints where they are wanted.
//!
//! Minimises `E(q) = Σ |fₜ(q) − yₜ|² + Σ aᵢ (qᵢ − rᵢ)² + Σ bᵢ (qᵢ − sᵢ)²` over the values q: f the joints' places and
//! y the wanted ones (centimetres, those that are not missing), r the frame before, s the rest posture, a and b small
//! weights. The paper solves `f(q) = ỹ` (15) by the damped Jacobian method; this is Levenberg's and Marquardt's form of
//! it: `(JᵀJ + A + B + λ D) δ = −gradient / 2`, λ falling as long as E falls. The weights settle what the joints leave
//! open (the twist of a straight arm, how the spine's twist is shared) without pulling what they do determine: at
//! 1e-4 cm² a squared radian an angle with a lever of 5 cm gives way by a hundred thousandth of its step.
//!
//! A step costs O(Σ depth² + n³ / 3) for n free values. P2 is not convex: the answer is a local minimum near the start.

use crate::numeric::linalg::cholesky_solve;
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use ndarray::{Array1, Array2};

/// The most values a skeleton may have: the normal equations are dense.
pub const MAX_DOFS: usize = 1200;

/// When a solution counts as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSettings {
    /// Steps at most. The paper: "usually converge within 20 iterates".
    pub iterations: usize,
    /// Ends when a step lowers E by less than this, cm².
    pub tolerance: f64,
    /// Keep to the skeleton's limits. Off by default: CMU's own takes exceed theirs.
    pub limits: bool,
}

impl Default for IkSettings {
    fn default() -> Self {
        IkSettings {
            iterations: 40,
            tolerance: 1e-9,
            limits: false,
        }
    }
}

/// Regularization of the values that the joints leave open.
#[derive(Debug, Clone, Copy)]
pub struct Regularization<'a> {
    /// r: the frame before.
    pub previous: &'a [f64],
    /// a, cm² a squared radian (a hundredth of it a squared centimetre).
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
    /// Σ |f − y|² at the end, cm².
    pub misfit: f64,
    /// Steps tried.
    pub iterations: usize,
    /// Whether it ended by the tolerance.
    pub converged: bool,
}

/// Solves frame after frame for one skeleton and one set of joints, without allocating but for the small systems.
pub struct IkSolver<'a> {
    skeleton: &'a Skeleton,
    joints: &'a [usize],
    settings: IkSettings,
    limits: Vec<(f64, f64)>,
    /// Whether each value is an angle.
    angle: Vec<bool>,
    /// The values that can move each joint.
    affecting_dofs: Vec<Vec<usize>>,
    posture: Posture,
    jacobian: Vec<f64>,
    trial: Vec<f64>,
    /// Where each value stands in the system being solved.
    place: Vec<Option<usize>>,
    free: Vec<usize>,
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
            angle: all().map(|d| d.channel.is_angle()).collect(),
            affecting_dofs: affecting_dofs.collect(),
            posture: Posture::default(),
            jacobian: Vec::new(),
            trial: Vec::new(),
            place: Vec::new(),
            free: Vec::new(),
        }
    }

    /// Carries values into the limits, if they are to be kept.
    pub fn clamp(&self, q: &mut [f64]) {
        for (q, &(low, high)) in q.iter_mut().zip(&self.limits) {
            *q = q.max(low).min(high);
        }
    }

    /// The weight of a value in the terms that regularization it.
    fn weight(&self, i: usize, w: f64) -> f64 {
        if self.angle[i] { w } else { 0.01 * w }
    }

    /// Σ |f − y|² over the targets that are there, for the values `q`.
    pub fn misfit(&mut self, q: &[f64], targets: &[f64]) -> f64 {
        self.skeleton.posture_into(q, &mut self.posture);
        let mut sum = 0.0;
        for (&joint, y) in self.joints.iter().zip(targets.chunks_exact(3)) {
            if y.iter().all(|v| v.is_finite()) {
                let f = self.posture.ends[joint];
                sum += (0..3).map(|c| (f[c] - y[c]).powi(2)).sum::<f64>();
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

    /// Improves `q` for `targets` (3 numbers a joint, NaN is missing). Values that no target moves stay as they are,
    /// and so do those for which `fixed` is true.
    pub fn solve(
        &mut self,
        targets: &[f64],
        fixed: &[bool],
        regularization: &Regularization,
        q: &mut [f64],
    ) -> IkSolution {
        self.clamp(q);
        self.select_free_values(targets, fixed);
        let (mut energy, mut misfit) = self.energy(q, targets, regularization);
        let mut out = IkSolution {
            energy,
            misfit,
            iterations: 0,
            converged: self.free.is_empty(),
        };
        let mut damping = 1e-6;
        while !out.converged && out.iterations < self.settings.iterations {
            let Some((normal, gradient)) = self.normal_equations(targets, regularization, q) else {
                break;
            };
            // Steps that do not lower E are tried again, shorter.
            loop {
                out.iterations += 1;
                let moved = self.step(&normal, &gradient, damping, q);
                if moved == Some(false) {
                    out.converged = true;
                    break;
                }
                let trial = std::mem::take(&mut self.trial);
                let (e, m) = match moved {
                    Some(_) => self.energy(&trial, targets, regularization),
                    None => (f64::INFINITY, f64::INFINITY),
                };
                let better = e < energy;
                if better {
                    out.converged = energy - e <= self.settings.tolerance + 1e-7 * e;
                    q.copy_from_slice(&trial);
                    (energy, misfit) = (e, m);
                    damping = (damping * 0.1).max(1e-12);
                }
                self.trial = trial;
                if better {
                    break;
                }
                damping = (damping * 10.0).max(1e-3);
                // Nothing gets better even a hair's breadth away: this is a minimum, to rounding.
                if damping > 1e8 || out.iterations >= self.settings.iterations {
                    out.converged = damping > 1e8 || e - energy <= self.settings.tolerance;
                    (out.energy, out.misfit) = (energy, misfit);
                    return out;
                }
                if e - energy <= self.settings.tolerance {
                    out.converged = true;
                    break;
                }
            }
        }
        (out.energy, out.misfit) = (energy, misfit);
        out
    }

    /// The values that a target is there for.
    fn select_free_values(&mut self, targets: &[f64], fixed: &[bool]) {
        self.place.clear();
        self.place.resize(self.angle.len(), None);
        self.free.clear();
        for (affecting_dofs, y) in self.affecting_dofs.iter().zip(targets.chunks_exact(3)) {
            if y.iter().all(|v| v.is_finite()) {
                for &i in affecting_dofs {
                    if self.place[i].is_none() && !fixed[i] {
                        self.place[i] = Some(0);
                        self.free.push(i);
                    }
                }
            }
        }
        // In the skeleton's order, whatever the order of the targets.
        self.free.sort_unstable();
        for (at, &i) in self.free.iter().enumerate() {
            self.place[i] = Some(at);
        }
    }

    /// `JᵀJ + A + B` (lower triangle) and half the gradient of E. `None` when something is not finite.
    fn normal_equations(
        &mut self,
        targets: &[f64],
        regularization: &Regularization,
        q: &[f64],
    ) -> Option<(Array2<f64>, Array1<f64>)> {
        self.skeleton.posture_into(q, &mut self.posture);
        self.skeleton
            .jacobian(q, &self.posture, self.joints, &mut self.jacobian);
        let n = self.free.len();
        let columns = self.angle.len();
        let (mut normal, mut gradient) = (vec![0.0; n * n], Array1::zeros(n));
        for (t, y) in targets.chunks_exact(3).enumerate() {
            if !y.iter().all(|v| v.is_finite()) {
                continue;
            }
            for c in 0..3 {
                let residual = self.posture.ends[self.joints[t]][c] - y[c];
                let row = &self.jacobian[(3 * t + c) * columns..][..columns];
                for &i in &self.affecting_dofs[t] {
                    let (Some(a), v) = (self.place[i], row[i]) else {
                        continue;
                    };
                    if v == 0.0 {
                        continue;
                    }
                    gradient[a] += v * residual;
                    for &k in &self.affecting_dofs[t] {
                        if let Some(b) = self.place[k].filter(|&b| b <= a) {
                            normal[a * n + b] += v * row[k];
                        }
                    }
                }
            }
        }
        for (a, &i) in self.free.iter().enumerate() {
            let (before, rest) = (
                self.weight(i, regularization.previous_weight),
                self.weight(i, regularization.rest_weight),
            );
            normal[a * n + a] += before + rest;
            gradient[a] += before * (q[i] - regularization.previous[i])
                + rest * (q[i] - regularization.rest[i]);
        }
        if !gradient.iter().all(|v: &f64| v.is_finite()) {
            return None;
        }
        Some((Array2::from_shape_vec((n, n), normal).ok()?, gradient))
    }

    /// Sets the next trial values: whether anything moves, or `None` when the system cannot be solved.
    fn step(
        &mut self,
        normal: &Array2<f64>,
        gradient: &Array1<f64>,
        damping: f64,
        q: &[f64],
    ) -> Option<bool> {
        let mut normal = normal.clone();
        let mut gradient = gradient.clone();
        for (a, &i) in self.free.iter().enumerate() {
            // The floor damps what no target moves: cm² a squared radian.
            normal[[a, a]] += damping * (normal[[a, a]] + 1e-3);
            // At a limit that the step would cross: stay there.
            let held = self.limits.get(i).is_some_and(|&(low, high)| {
                (q[i] <= low && gradient[a] > 0.0) || (q[i] >= high && gradient[a] < 0.0)
            });
            if held {
                for b in 0..self.free.len() {
                    normal[[a, b]] = 0.0;
                    normal[[b, a]] = 0.0;
                }
                normal[[a, a]] = 1.0;
                gradient[a] = 0.0;
            }
        }
        let step = cholesky_solve(normal, gradient)?;
        // No joint turns by more than a radian a step: beyond that the linear model says nothing.
        let longest = self
            .free
            .iter()
            .zip(&step)
            .filter(|(i, _)| self.angle[**i])
            .fold(0.0, |z: f64, (_, s)| z.max(s.abs()));
        let scale = if longest > 1.0 { 1.0 / longest } else { 1.0 };
        let mut trial = std::mem::take(&mut self.trial);
        trial.clear();
        trial.extend_from_slice(q);
        for (&i, s) in self.free.iter().zip(&step) {
            trial[i] -= scale * s;
        }
        self.clamp(&mut trial);
        let moved = trial.iter().zip(q).any(|(a, b)| a != b);
        self.trial = trial;
        Some(moved)
    }

    /// Where the joints stand for `q`.
    pub fn posture(&mut self, q: &[f64]) -> &Posture {
        self.skeleton.posture_into(q, &mut self.posture);
        &self.posture
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::{Axis, compose, parse_order};
    use crate::pose::{Bone, Channel, Dof};
    use glam::{DMat3, DVec3};

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

    fn places(s: &Skeleton, q: &[f64], joints: &[usize]) -> Vec<f64> {
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
        let targets = places(&s, &want, &joints);
        let mut q: Vec<f64> = want.iter().map(|v| v + 0.2).collect();
        let done = solve(&s, &joints, &targets, &mut q, false);
        assert!(done.converged && done.iterations <= 20, "{done:?}");
        assert!(done.misfit <= 1e-6, "{done:?}");
        let found = places(&s, &q, &joints);
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
        let mut targets = places(&s, &q, &joints);
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
        let targets = places(&s, &want, &joints);
        let mut q = vec![0.0; s.dof_count()];
        q[hinge] = 0.3;
        solve(&s, &joints, &targets, &mut q, true);
        assert!((0.49..=0.5).contains(&q[hinge]), "{}", q[hinge]);
        solve(&s, &joints, &targets, &mut q, false);
        assert!((q[hinge] - 1.2).abs() <= 1e-4, "{}", q[hinge]);
        // What is beyond a limit comes back to it, and what stands on one may leave it.
        want[hinge] = 0.2;
        let targets = places(&s, &want, &joints);
        solve(&s, &joints, &targets, &mut q, true);
        assert!((q[hinge] - 0.2).abs() <= 1e-4, "{}", q[hinge]);
    }
}

//! P1: a pose and its placement, found in turn (equations 7 to 13 of Lai et al.).
//!
//! ```text
//! min over x, R, t   Σ wᵢ |R (A x)ᵢ + t − yᵢ|² + Σ Wₖ (τₖ − τ₀ₖ)²
//!     with at most kappa entries of x
//! ```
//!
//! y are the observed points (cm), w their precisions (1/cm²), R = Rz Ry Rx of the angles τ
//! (radians). For fixed (R, t) the sparse code of the points in the model's space is P1a. For fixed
//! x the placement is P1b: closed form (Horn) without a rotation prior W, damped Gauss-Newton with
//! one. The code keeps its support where a new one would be worse, so the objective never rises.

use super::tuning::alternating::*;
use super::{PlacementSolution, PlacementSolver};
use crate::pose::rotation::{angles_zyx_between, rotation_zyx, rotation_zyx_derivatives};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::{Anchor, Observation, Similarity};
use crate::prior::{Prior, Reconstruction};
use glam::{DMat3, DVec3};

/// P1 from one start.
pub(crate) struct Alternation<'a> {
    pub solver: &'a PlacementSolver,
    pub prior: &'a dyn Prior,
    pub seen: Observation<'a>,
    pub anchor: &'a Anchor,
    pub start: Similarity,
}

impl Alternation<'_> {
    /// Alternates until the objective settles. `before` is a code to place first.
    pub(crate) fn descend(&self, before: Option<&Reconstruction>) -> PlacementSolution {
        let mut back = vec![0.0; self.seen.values.len()];
        let noise = self.seen.pointwise_variance();
        let mut code = |placement: &Similarity, before: Option<&Reconstruction>| {
            placement.undo_pose(self.seen.values, &mut back);
            let seen = Observation {
                values: &back,
                variance: &noise,
            };
            self.prior.reconstruct(&seen, before)
        };
        let cost = |placement: &Similarity| self.solver.prior_cost(placement, &self.start);
        let mut placement = match before {
            Some(before) => self.place(&self.start, before),
            None => self.at_root(),
        };
        let mut fit = code(&placement, before);
        let mut objective = fit.objective + cost(&placement);
        let mut iterations = 0;
        while iterations < self.solver.iterations {
            iterations += 1;
            let next = self.place(&placement, &fit);
            let next_fit = code(&next, Some(&fit));
            let next_objective = next_fit.objective + cost(&next);
            // Rounding aside the objective cannot rise; where it does not fall the search has
            // ended.
            if !(next_objective < objective) {
                break;
            }
            let settled = objective - next_objective <= self.solver.tolerance * objective;
            (placement, fit, objective) = (next, next_fit, next_objective);
            if settled {
                break;
            }
        }
        PlacementSolution {
            placement,
            fit: Some(fit),
            objective,
            iterations,
        }
    }

    /// The starting rotation, with the root where it is observed.
    fn at_root(&self) -> Similarity {
        let is_seen = |r: &usize| {
            let variance = &self.seen.variance[3 * r..3 * r + 3];
            variance.iter().all(|v| v.is_finite())
        };
        match self.anchor.root.filter(is_seen) {
            Some(r) => Similarity {
                shift: DVec3::from_slice(&self.seen.values[3 * r..]),
                ..self.start
            },
            None => self.start,
        }
    }

    /// P1b: the placement of a given pose of the model, from the placement `now`.
    fn place(&self, now: &Similarity, fit: &Reconstruction) -> Similarity {
        let at = |j: usize| DVec3::from_slice(&fit.pose[3 * j..3 * j + 3]);
        let seen = self.seen.points(self.prior.residual_variance());
        let pairs = seen.map(|(j, y, w)| (at(j), y, w));
        if self.solver.rotation_prior == DVec3::ZERO {
            return match fit_similarity(pairs, TransformKind::Rigid) {
                Some(f) => f.similarity,
                None => *now,
            };
        }
        let rotation = self.rotate_with_prior(pairs.clone(), &now.rotation);
        let (mut weight, mut sum) = (0.0, DVec3::ZERO);
        for (x, y, w) in pairs {
            weight += w;
            sum += (y - rotation * x) * w;
        }
        let shift = if weight > 0.0 {
            sum / weight
        } else {
            now.shift
        };
        Similarity {
            rotation,
            shift,
            ..*now
        }
    }

    /// Gauss-Newton on the angles of R = Rz Ry Rx · R_start with the prior W; each accepted step
    /// lowers the objective. (Lai et al.'s gradient (13) lacks the factor 2 and is not the
    /// derivative; this one is.)
    fn rotate_with_prior(
        &self,
        pairs: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone,
        now: &DMat3,
    ) -> DMat3 {
        let (start, weights) = (self.start.rotation, self.solver.rotation_prior);
        // The shift is eliminated: both sets about their weighted centers.
        let (mut weight, mut from, mut to) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for (a, b, w) in pairs.clone() {
            weight += w;
            from += a * w;
            to += b * w;
        }
        let (from, to) = (from / weight, to / weight);
        let cost = |tau: DVec3| {
            let r = rotation_zyx(tau) * start;
            let data: f64 = pairs
                .clone()
                .map(|(a, b, w)| w * (r * (a - from) - (b - to)).length_squared())
                .sum();
            data + (weights * tau * tau).element_sum()
        };
        let mut tau = angles_zyx_between(&start, now);
        let mut value = cost(tau);
        for _ in 0..STEPS {
            let derivatives = rotation_zyx_derivatives(tau);
            let (mut normal, mut gradient) = (DMat3::from_diagonal(weights), weights * tau);
            for (a, b, w) in pairs.clone() {
                let x = start * (a - from);
                let rest = rotation_zyx(tau) * x - (b - to);
                let j =
                    DMat3::from_cols(derivatives[0] * x, derivatives[1] * x, derivatives[2] * x);
                normal += (j.transpose() * j) * w;
                gradient += j.transpose() * rest * w;
            }
            let step = (normal + DMat3::IDENTITY * 1e-9).inverse() * gradient;
            let mut share = 1.0;
            let better = loop {
                let next = tau - step * share;
                let next_value = cost(next);
                if next_value < value {
                    break Some((next, next_value));
                }
                share /= 2.0;
                if share < LEAST_SHARE {
                    break None;
                }
            };
            let Some((next, next_value)) = better else {
                break;
            };
            let done = value - next_value <= SETTLED * value;
            (tau, value) = (next, next_value);
            if done {
                break;
            }
        }
        rotation_zyx(tau) * start
    }
}

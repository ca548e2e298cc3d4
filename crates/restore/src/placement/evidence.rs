//! A placement by maximum evidence: where the prior explains the observation best.
//!
//! Alternating as in P1 stops at once for a prior that can reproduce any six points wherever they
//! stand: its fit leaves no residual to rotate by. The log evidence of each placement still
//! differs:
//!
//! ```text
//! max over R, t   log p(Rᵀ (y − t)) − ½ Σ Wₖ (τₖ − τ₀ₖ)²
//! ```
//!
//! y are the observed points (cm), W a rotation prior. Levenberg-Marquardt steps δ (rotation,
//! radians) and ε (shift, cm) move y to Rᵀ (exp(−δ) (y − c − ε) + c − t), with c the center of the
//! observed points.

use super::tuning::evidence::*;
use super::{PlacementSolution, PlacementSolver};
use crate::numeric::linalg::cholesky_solve;
use crate::pose::Observation;
use crate::pose::Similarity;
use crate::pose::rotation::{angle_between, from_rotation_vector};
use crate::pose::rotation::{angles_zyx_between, rotation_zyx, rotation_zyx_derivatives};
use crate::prior::{EvidenceGradient, Prior};
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2};

/// How a search ended.
pub(crate) enum Ascent {
    /// Ended at a maximum.
    Top(PlacementSolution),
    /// Close to a known maximum.
    SameTop,
    /// Not begun: the prior gives no gradient.
    Flat,
}

/// Maximizes from one start; `tops` are the maxima found from other starts.
pub(crate) fn maximize(
    solver: &PlacementSolver,
    prior: &dyn Prior,
    seen: Observation<'_>,
    start: Similarity,
    tops: &[Similarity],
) -> Ascent {
    let noise = seen.pointwise_variance();
    let climber = EvidenceProblem {
        prior,
        seen,
        center: center(seen),
        noise,
    };
    let cost = |at: &Similarity| 0.5 * solver.prior_cost(at, &start);
    let weights = solver.rotation_prior;
    let mut now = start;
    let Some(mut slope) = climber.slope(&now) else {
        return Ascent::Flat;
    };
    let mut damping = UNDAMPED;
    let mut steps = 0;
    'steps: while steps < solver.iterations {
        if tops.iter().any(|top| climber.is_near(&now, top)) {
            return Ascent::SameTop;
        }
        steps += 1;
        if weights != DVec3::ZERO {
            add_wish(&mut slope, weights, &start, &now);
        }
        let value = slope.log_evidence - cost(&now);
        loop {
            let Some((step, gain)) = step(&slope, damping) else {
                break 'steps;
            };
            let next = climber.moved(&now, &step);
            if gain <= SETTLED && damping <= UNDAMPED {
                // The gain is below the precision of the evidence: another gradient is not worth
                // its cost.
                slope.log_evidence = value + gain + cost(&next);
                now = next;
                break 'steps;
            }
            let Some(there) = climber.slope(&next) else {
                return Ascent::Flat;
            };
            if there.log_evidence - cost(&next) >= value - if gain <= ROUGH { ROUGH } else { 0.0 } {
                (now, slope) = (next, there);
                damping = (damping * 0.2).max(1e-9);
                break;
            }
            damping = (damping * 10.0).max(UNDAMPED);
            if damping > MOST_DAMPED || gain <= SETTLED {
                break 'steps;
            }
        }
    }
    Ascent::Top(PlacementSolution {
        placement: now,
        fit: None,
        objective: 2.0 * (cost(&now) - slope.log_evidence),
        iterations: steps,
    })
}

/// Adds the rotation prior: with J = ∂τ/∂δ, Jᵀ W τ to the gradient and Jᵀ W J to the curvature.
fn add_wish(slope: &mut EvidenceGradient, weights: DVec3, start: &Similarity, now: &Similarity) {
    let angles = angles_zyx_between(&start.rotation, &now.rotation);
    // ∂R/∂τ Rᵀ is the cross product with the axis of the angle.
    let axes = rotation_zyx_derivatives(angles).map(|d| {
        let cross = d * rotation_zyx(angles).transpose();
        DVec3::new(cross.y_axis.z, cross.z_axis.x, cross.x_axis.y)
    });
    let by = DMat3::from_cols(axes[0], axes[1], axes[2]).inverse();
    let pull = by.transpose() * (weights * angles);
    let hold = by.transpose() * DMat3::from_diagonal(weights) * by;
    for i in 0..3 {
        slope.gradient[i] -= pull[i];
        for j in 0..3 {
            slope.curvature[6 * i + j] += hold.col(j)[i];
        }
    }
}

/// An observation to place.
struct EvidenceProblem<'a> {
    prior: &'a dyn Prior,
    seen: Observation<'a>,
    noise: Vec<f64>,
    center: DVec3,
}

impl EvidenceProblem<'_> {
    /// The gradient of the evidence along three rotations about the center, then three shifts.
    fn slope(&self, at: &Similarity) -> Option<EvidenceGradient> {
        let d = self.seen.values.len();
        let mut back = vec![0.0; d];
        at.undo_pose(self.seen.values, &mut back);
        let to_model = at.rotation.transpose();
        let mut moves = vec![vec![0.0; d]; 6];
        for p in 0..d / 3 {
            if !self.noise[3 * p].is_finite() {
                continue;
            }
            let from_center = DVec3::from_slice(&self.seen.values[3 * p..]) - self.center;
            for (k, axis) in DVec3::AXES.into_iter().enumerate() {
                let turned = -(to_model * axis.cross(from_center));
                let shifted = -(to_model * axis);
                moves[k][3 * p..3 * p + 3].copy_from_slice(&turned.to_array());
                moves[3 + k][3 * p..3 * p + 3].copy_from_slice(&shifted.to_array());
            }
        }
        let seen = Observation {
            values: &back,
            variance: &self.noise,
        };
        self.prior.evidence_gradient(&seen, &moves)
    }

    fn is_near(&self, a: &Similarity, b: &Similarity) -> bool {
        let center = |s: &Similarity| s.rotation.transpose() * (self.center - s.shift);
        angle_between(&a.rotation, &b.rotation) < SAME_TOP.0
            && (center(a) - center(b)).length() < SAME_TOP.1
    }

    fn moved(&self, from: &Similarity, step: &[f64; 6]) -> Similarity {
        let turn: DMat3 = from_rotation_vector(DVec3::from_slice(&step[..3]));
        let shift = DVec3::from_slice(&step[3..]);
        Similarity {
            rotation: turn * from.rotation,
            shift: turn * (from.shift - self.center) + self.center + shift,
            ..*from
        }
    }
}

/// The center of the whole points.
fn center(seen: Observation<'_>) -> DVec3 {
    let points = seen
        .values
        .chunks_exact(3)
        .zip(seen.variance.chunks_exact(3));
    let points = points.filter(|(_, n)| n.iter().all(|n| n.is_finite()));
    let (sum, count) = points.fold((DVec3::ZERO, 0.0), |(sum, count), (y, _)| {
        (sum + DVec3::from_slice(y), count + 1.0)
    });
    sum / f64::max(count, 1.0)
}

/// A damped Newton step, and its expected gain in nats.
fn step(slope: &EvidenceGradient, damping: f64) -> Option<([f64; 6], f64)> {
    let mut normal = Array2::from_shape_fn((6, 6), |(i, j)| slope.curvature[6 * i + j]);
    for k in 0..6 {
        normal[[k, k]] += damping * slope.curvature[7 * k] + 1e-9;
    }
    let solved = cholesky_solve(normal, Array1::from(slope.gradient.clone()))?;
    let gain = 0.5
        * slope
            .gradient
            .iter()
            .zip(&solved)
            .map(|(g, s)| g * s)
            .sum::<f64>();
    let length = |k: usize| DVec3::new(solved[k], solved[k + 1], solved[k + 2]).length();
    let by = (FARTHEST.0 / length(0))
        .min(FARTHEST.1 / length(3))
        .min(1.0);
    Some((std::array::from_fn(|k| by * solved[k]), gain))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::{Posterior, Want};
    use ndarray::ArrayView2;

    /// Points known to within 1 cm.
    struct Corner(Vec<f64>, Array2<f64>);

    impl Prior for Corner {
        fn residual_variance(&self) -> &[f64] {
            &self.0
        }
        fn posterior(&self, _: &Observation<'_>, _: Want) -> Posterior {
            Posterior::default()
        }
        fn evidence_gradient(
            &self,
            seen: &Observation<'_>,
            moves: &[Vec<f64>],
        ) -> Option<EvidenceGradient> {
            let along = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
            let off: Vec<f64> = seen
                .values
                .iter()
                .zip(&self.0)
                .map(|(y, m)| y - m)
                .collect();
            let pairs = moves.iter().flat_map(|a| moves.iter().map(|b| along(a, b)));
            Some(EvidenceGradient {
                log_evidence: -0.5 * along(&off, &off),
                gradient: moves.iter().map(|m| -along(m, &off)).collect(),
                curvature: pairs.collect(),
            })
        }
        fn representative_poses(&self) -> ArrayView2<'_, f64> {
            self.1.view()
        }
        fn mapped(&self, _: &crate::pose::PoseTransform) -> Box<dyn Prior> {
            Box::new(Corner(self.0.clone(), self.1.clone()))
        }
    }

    #[test]
    fn the_top_is_reached_from_afar_and_a_wish_holds_it_back() {
        let pose = vec![
            0.0, 0.0, 0.0, 30.0, 0.0, 5.0, 0.0, 40.0, 0.0, 3.0, -8.0, 50.0,
        ];
        let prior = Corner(pose.clone(), Array2::zeros((1, 12)));
        let stands = Similarity {
            rotation: from_rotation_vector(DVec3::new(0.5, -1.4, 0.3)),
            shift: DVec3::new(10.0, 90.0, -300.0),
            scale: 1.0,
        };
        let mut y = vec![0.0; 12];
        stands.apply_pose(&pose, &mut y);
        let noise = vec![1.0; 12];
        let seen = Observation {
            values: &y,
            variance: &noise,
        };
        let start = Similarity {
            rotation: from_rotation_vector(DVec3::new(0.0, 0.4, 0.0)),
            ..Similarity::IDENTITY
        };
        let top = |solver: &PlacementSolver, start, tops: &[Similarity]| match maximize(
            solver, &prior, seen, start, tops,
        ) {
            Ascent::Top(solution) => Some(solution),
            _ => None,
        };
        let free = top(&PlacementSolver::default(), start, &[]).unwrap();
        assert!((free.placement.shift - stands.shift).length() <= 1e-5);
        assert!(free.objective <= 1e-9 && free.iterations < 20);
        // Another start leads to the same maximum and stops early; a known maximum far away changes
        // nothing.
        let elsewhere = Similarity {
            rotation: from_rotation_vector(DVec3::new(0.1, -0.9, 0.0)),
            ..start
        };
        assert!(top(&PlacementSolver::default(), elsewhere, &[free.placement]).is_none());
        assert!(top(&PlacementSolver::default(), elsewhere, &[start]).is_some());
        for weight in [1e2, 1e3, 1e5] {
            let wish = PlacementSolver {
                rotation_prior: DVec3::new(1.0, 0.5, 2.0) * weight,
                iterations: 60,
                ..PlacementSolver::default()
            };
            let held = top(&wish, start, &[]).unwrap();
            let cost = |s: &PlacementSolution| wish.prior_cost(&s.placement, &start);
            assert!(cost(&held) < cost(&free) && held.iterations < 60);
            // At the maximum no small rotation or shift is better.
            let value = |at: &Similarity| {
                let mut back = vec![0.0; 12];
                at.undo_pose(&y, &mut back);
                let seen = Observation {
                    values: &back,
                    variance: &noise,
                };
                let evidence = prior.evidence_gradient(&seen, &[]).unwrap().log_evidence;
                wish.prior_cost(at, &start) - 2.0 * evidence
            };
            let best = value(&held.placement);
            assert!((best - held.objective).abs() <= SETTLED);
            for (k, by) in (0..3).flat_map(|k| [(k, 1e-3), (k, -1e-3)]) {
                let mut turned = held.placement;
                turned.rotation = from_rotation_vector(DVec3::AXES[k] * by) * turned.rotation;
                let mut shifted = held.placement;
                shifted.shift += DVec3::AXES[k] * by;
                assert!(
                    value(&turned) > best && value(&shifted) > best,
                    "{weight} {k}"
                );
            }
        }
    }
}

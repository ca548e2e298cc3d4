//! P1: a pose and its placement, found in turn (equations 7 to 13 of the posing paper).
//!
//! ```text
//! min over x, R, t   Σ wᵢ |R (A x)ᵢ + t − yᵢ|² + Σ Wₖ (τₖ − τ₀ₖ)²    with at most kappa entries of x
//! ```
//!
//! y are the observed points (cm), w their precisions (1/cm²), R = Rz Ry Rx of the angles τ (radians). For fixed (R,
//! t) the sparse code of the points in the model's space is P1a. For fixed x the placement is P1b: closed form (Horn)
//! without a rotation prior W, damped Gauss-Newton with one. The code keeps its support where a new one would be
//! worse, so the objective never rises. The problem is not convex: starting placements come from fitting
//! representative poses to the points, so a rotated observation gives the rotated result. Where a prior gives the
//! gradient of its evidence ([`Prior::evidence_gradient`]), `evidence` maximizes that instead.

use super::evidence::{self, Ascent};
use crate::pose::Observation;
use crate::pose::rotation::angle_between;
use crate::pose::rotation::{angles_zyx_between, rotation_zyx, rotation_zyx_derivatives};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::{Anchor, Similarity};
use crate::prior::{Prior, Reconstruction};
use glam::{DMat3, DVec3};

/// Starting rotations that differ by less are one, radians.
const SAME_HEADING: f64 = 0.35;

/// Parameters of the placement search.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacementSolver {
    /// Largest number of starting placements, the best fits first.
    pub headings: usize,
    /// Largest number of iterations from each.
    pub iterations: usize,
    /// An iteration that lowers the objective by a smaller share is the last.
    pub tolerance: f64,
    /// W of the rotation prior about x, y and z, 1/radian²; 0: no prior, closed form.
    pub rotation_prior: DVec3,
}

impl Default for PlacementSolver {
    fn default() -> Self {
        PlacementSolver {
            headings: 4,
            iterations: 30,
            tolerance: 1e-5,
            rotation_prior: DVec3::ZERO,
        }
    }
}

/// A solution of P1.
#[derive(Debug, Clone)]
pub struct PlacementSolution {
    /// From the model's space to the world.
    pub placement: Similarity,
    /// The code in the model's space, with objective (7) without the rotation prior; `None` where evidence was
    /// maximized.
    pub fit: Option<Reconstruction>,
    /// Objective (7) with the rotation prior; −2 times the log evidence where that was maximized.
    pub objective: f64,
    /// Iterations from the start that won.
    pub iterations: usize,
}

impl PlacementSolution {
    /// A placement without a code, to start from.
    pub fn from_placement(placement: Similarity) -> PlacementSolution {
        PlacementSolution {
            placement,
            fit: None,
            objective: f64::INFINITY,
            iterations: 0,
        }
    }
}

impl PlacementSolver {
    /// Solves P1 from `known` placements (that of the pelvis, that of the frame before), or else from representative
    /// poses.
    ///
    /// `None` when the points do not determine a rotation: fewer than three, or all on a line.
    pub fn solve(
        &self,
        prior: &dyn Prior,
        seen: Observation<'_>,
        anchor: &Anchor,
        known: &[Similarity],
    ) -> Option<PlacementSolution> {
        let starts = self.headings(prior, seen, known)?;
        let mut best: Option<PlacementSolution> = None;
        let mut tops = Vec::new();
        for start in starts {
            let solved = match evidence::maximize(self, prior, seen, start, &tops) {
                Ascent::Top(solved) => {
                    // A rotation prior depends on the start, and a search that ran out of iterations is at no maximum.
                    let is_top = solved.iterations < self.iterations;
                    if is_top && self.rotation_prior == DVec3::ZERO {
                        tops.push(solved.placement);
                    }
                    solved
                }
                Ascent::SameTop => continue,
                Ascent::Flat => self.descend(prior, seen, anchor, start, None),
            };
            if best.as_ref().is_none_or(|b| solved.objective < b.objective) {
                best = Some(solved);
            }
        }
        best
    }

    /// Solves P1 from the solution of the frame before, as while a point is dragged. Its atoms stay where new ones
    /// would be worse.
    ///
    /// `None` as for [`PlacementSolver::solve`].
    pub fn follow(
        &self,
        prior: &dyn Prior,
        seen: Observation<'_>,
        anchor: &Anchor,
        before: &PlacementSolution,
    ) -> Option<PlacementSolution> {
        let start = *self.headings(prior, seen, &[before.placement])?.first()?;
        match evidence::maximize(self, prior, seen, start, &[]) {
            Ascent::Top(solved) => Some(solved),
            _ => Some(self.descend(prior, seen, anchor, start, before.fit.as_ref())),
        }
    }

    /// The starting placements: the known ones, or those of the best fitting representative poses, far apart.
    fn headings(
        &self,
        prior: &dyn Prior,
        seen: Observation<'_>,
        known: &[Similarity],
    ) -> Option<Vec<Similarity>> {
        let points = seen.points(prior.residual_variance());
        let typical = prior.representative_poses();
        let fits = typical.rows().into_iter().map(|pose| {
            let at = |j: usize| DVec3::new(pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]);
            fit_similarity(
                points.clone().map(|(j, y, w)| (at(j), y, w)),
                TransformKind::Similarity,
            )
        });
        let mut determined = fits.flatten().filter(|f| f.determined);
        if !known.is_empty() {
            return determined.next().map(|_| known.to_vec());
        }
        let mut found: Vec<(f64, Similarity)> = determined
            .map(|f| {
                let start = Similarity {
                    scale: 1.0,
                    ..f.similarity
                };
                (f.error, start)
            })
            .collect();
        if found.is_empty() {
            return None;
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut starts: Vec<Similarity> = Vec::new();
        for (_, start) in found {
            let near = |s: &Similarity| angle_between(&s.rotation, &start.rotation) < SAME_HEADING;
            if !starts.iter().any(near) {
                starts.push(start);
            }
            if starts.len() == self.headings.max(1) {
                break;
            }
        }
        Some(starts)
    }

    /// Alternates from one start until the objective settles. `before` is a code to place first.
    fn descend(
        &self,
        prior: &dyn Prior,
        seen: Observation<'_>,
        anchor: &Anchor,
        start: Similarity,
        before: Option<&Reconstruction>,
    ) -> PlacementSolution {
        let mut back = vec![0.0; seen.values.len()];
        let noise = seen.pointwise_variance();
        let mut code = |placement: &Similarity, before: Option<&Reconstruction>| {
            placement.undo_pose(seen.values, &mut back);
            let seen = Observation {
                values: &back,
                variance: &noise,
            };
            prior.reconstruct(&seen, before)
        };
        let mut placement = match before {
            Some(before) => self.place(prior, seen, anchor, &start, &start, before),
            None => self.shifted(prior, seen, anchor, start, None),
        };
        let mut fit = code(&placement, before);
        let mut objective = fit.objective + self.prior_cost(&placement, &start);
        for iteration in 1..=self.iterations {
            let next = self.place(prior, seen, anchor, &start, &placement, &fit);
            let next_fit = code(&next, Some(&fit));
            let next_objective = next_fit.objective + self.prior_cost(&next, &start);
            // Rounding aside the objective cannot rise; where it does not fall the search has ended.
            if !(next_objective < objective) {
                return PlacementSolution {
                    placement,
                    fit: Some(fit),
                    objective,
                    iterations: iteration,
                };
            }
            let settled = objective - next_objective <= self.tolerance * objective;
            (placement, fit, objective) = (next, next_fit, next_objective);
            if settled {
                return PlacementSolution {
                    placement,
                    fit: Some(fit),
                    objective,
                    iterations: iteration,
                };
            }
        }
        PlacementSolution {
            placement,
            fit: Some(fit),
            objective,
            iterations: self.iterations,
        }
    }

    /// P1b: the placement of a given pose of the model.
    fn place(
        &self,
        prior: &dyn Prior,
        seen: Observation<'_>,
        anchor: &Anchor,
        start: &Similarity,
        now: &Similarity,
        fit: &Reconstruction,
    ) -> Similarity {
        let at = |j: usize| DVec3::from_slice(&fit.pose[3 * j..3 * j + 3]);
        let pairs = || {
            seen.points(prior.residual_variance())
                .map(|(j, y, w)| (at(j), y, w))
        };
        if self.rotation_prior == DVec3::ZERO {
            return match fit_similarity(pairs(), TransformKind::Rigid) {
                Some(f) => f.similarity,
                None => *now,
            };
        }
        let rotation = self.rotate_with_prior(pairs(), &start.rotation, &now.rotation);
        let turned = Similarity { rotation, ..*now };
        self.shifted(prior, seen, anchor, turned, Some(fit))
    }

    /// The best shift for a rotation: that of the root where observed, else of the weighted center.
    fn shifted(
        &self,
        prior: &dyn Prior,
        seen: Observation<'_>,
        anchor: &Anchor,
        start: Similarity,
        fit: Option<&Reconstruction>,
    ) -> Similarity {
        if let Some(fit) = fit {
            let (mut weight, mut sum) = (0.0, DVec3::ZERO);
            for (j, y, w) in seen.points(prior.residual_variance()) {
                weight += w;
                sum += (y - start.rotation * DVec3::from_slice(&fit.pose[3 * j..3 * j + 3])) * w;
            }
            return Similarity {
                shift: if weight > 0.0 {
                    sum / weight
                } else {
                    start.shift
                },
                ..start
            };
        }
        let root = anchor.root.filter(|&r| {
            seen.variance[3 * r..3 * r + 3]
                .iter()
                .all(|n| n.is_finite())
        });
        match root {
            Some(r) => Similarity {
                shift: DVec3::from_slice(&seen.values[3 * r..]),
                ..start
            },
            None => start,
        }
    }

    pub(super) fn prior_cost(&self, placement: &Similarity, start: &Similarity) -> f64 {
        if self.rotation_prior == DVec3::ZERO {
            return 0.0;
        }
        let angles = angles_zyx_between(&start.rotation, &placement.rotation);
        (self.rotation_prior * angles * angles).element_sum()
    }

    /// Gauss-Newton on the angles of R = Rz Ry Rx · R_start with the prior W; each accepted step lowers the objective.
    /// (The paper's gradient (13) lacks the factor 2 and is not the derivative; this one is.)
    fn rotate_with_prior(
        &self,
        pairs: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone,
        start: &DMat3,
        now: &DMat3,
    ) -> DMat3 {
        // The shift is eliminated: both sets about their weighted centers.
        let (mut weight, mut from, mut to) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for (a, b, w) in pairs.clone() {
            weight += w;
            from += a * w;
            to += b * w;
        }
        let (from, to) = (from / weight, to / weight);
        let cost = |tau: DVec3| {
            let r = rotation_zyx(tau) * *start;
            let data: f64 = pairs
                .clone()
                .map(|(a, b, w)| w * (r * (a - from) - (b - to)).length_squared())
                .sum();
            data + (self.rotation_prior * tau * tau).element_sum()
        };
        let mut tau = angles_zyx_between(start, now);
        let mut value = cost(tau);
        for _ in 0..10 {
            let derivatives = rotation_zyx_derivatives(tau);
            let (mut normal, mut gradient) = (
                DMat3::from_diagonal(self.rotation_prior),
                self.rotation_prior * tau,
            );
            for (a, b, w) in pairs.clone() {
                let x = *start * (a - from);
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
                if share < 1e-3 {
                    break None;
                }
            };
            let Some((next, next_value)) = better else {
                break;
            };
            let done = value - next_value <= 1e-12 * value;
            (tau, value) = (next, next_value);
            if done {
                break;
            }
        }
        rotation_zyx(tau) * *start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Atoms of six points of a body that turns a little, and a pose of them placed elsewhere, without its last point.
    fn scene() -> (crate::prior::SparseCodingPrior, Anchor, Vec<f64>, Vec<f64>) {
        let names = ["root", "lhipjoint", "rhipjoint", "thorax", "head", "lhand"];
        let names = names.map(String::from);
        let at = |i: usize, c: usize| {
            let (point, axis) = (c / 3, c % 3);
            let still = [
                0.0, -6.0, 2.0, 6.0, 8.0, 0.0, 4.0, 0.0, 40.0, 0.0, 60.0, 9.0, 45.0, 20.0, 30.0,
            ];
            still[(c * 2) % 15] + point as f64 * ((i + 3 * axis) as f64 * 0.7).sin() * 4.0
        };
        let atoms = ndarray::Array2::from_shape_fn((3000, 18), |(i, c)| at(i, c) as f32);
        let mut model = crate::io::Model::new("sparse", &names, "body");
        model.insert("atoms", atoms);
        model.meta.training_rms = Some(0.5);
        let prior =
            crate::prior::SparseCodingPrior::from_model(&model, &Default::default(), "made");
        let away = Similarity {
            scale: 1.0,
            rotation: DMat3::from_rotation_y(0.9),
            shift: DVec3::new(30.0, 80.0, -10.0),
        };
        let pose: Vec<f64> = (0..18).map(|c| at(7, c) + 0.3 * (c as f64).cos()).collect();
        let mut y = vec![0.0; 18];
        away.apply_pose(&pose, &mut y);
        let noise = (0..18).map(|c| if c < 15 { 0.0 } else { f64::INFINITY });
        (
            prior.unwrap(),
            Anchor::pelvis(&names).unwrap(),
            y,
            noise.collect(),
        )
    }

    #[test]
    fn following_a_solution_never_makes_it_worse() {
        let (prior, anchor, mut y, noise) = scene();
        let solver = PlacementSolver {
            iterations: 3,
            ..PlacementSolver::default()
        };
        let seen = Observation {
            values: &y,
            variance: &noise,
        };
        let first = solver.solve(&prior, seen, &anchor, &[]).unwrap();
        let again = solver.follow(&prior, seen, &anchor, &first).unwrap();
        assert!(
            again.objective <= first.objective,
            "{} {}",
            again.objective,
            first.objective
        );
        // A point is dragged: the code and the placement follow it.
        y[12] += 3.0;
        let seen = Observation {
            values: &y,
            variance: &noise,
        };
        let alone = solver
            .solve(&prior, seen, &anchor, &[first.placement])
            .unwrap();
        let moved = solver.follow(&prior, seen, &anchor, &again).unwrap();
        assert!(moved.objective <= 2.0 * alone.objective + 1e-9);
        assert!((moved.placement.shift - again.placement.shift).length() < 5.0);
        // Two points determine no placement.
        let hidden: Vec<f64> = (0..18)
            .map(|c| if c < 6 { 0.0 } else { f64::INFINITY })
            .collect();
        let seen = Observation {
            values: &y,
            variance: &hidden,
        };
        assert!(solver.follow(&prior, seen, &anchor, &again).is_none());
    }
}

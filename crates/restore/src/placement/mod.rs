//! Placement: the rotation R (3, 3) and shift t (3, cm) from the model's space to the world, found
//! together with the pose.
//!
//! Where a prior gives the gradient of its evidence ([`Prior::evidence_gradient`]), `evidence`
//! maximizes that; for sparse codes `alternating` solves P1 of Lai et al.; `orthographic`
//! places 2-D input. The problem is not convex: starting placements come from fitting
//! representative poses to the points, so a rotated observation gives the rotated result.

mod alternating;
mod evidence;
#[doc(hidden)]
pub mod orthographic;
mod tuning;

use crate::pose::rotation::{angle_between, angles_zyx_between};
use crate::pose::similarity::{TransformKind, fit_similarity};
use crate::pose::{Anchor, Observation, Similarity};
use crate::prior::{Prior, Reconstruction};
use alternating::Alternation;
use evidence::Ascent;
use glam::DVec3;
use tuning::solver::*;

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
            headings: HEADINGS,
            iterations: ITERATIONS,
            tolerance: TOLERANCE,
            rotation_prior: DVec3::ZERO,
        }
    }
}

/// A solution of P1.
#[derive(Debug, Clone)]
pub struct PlacementSolution {
    /// Transform from the model's space to the world.
    pub placement: Similarity,
    /// The code in the model's space, with objective (7) without the rotation prior; `None` where
    /// evidence was maximized.
    pub fit: Option<Reconstruction>,
    /// Objective (7) with the rotation prior; −2 times the log evidence where that was maximized.
    pub objective: f64,
    /// Iterations from the start that won.
    pub iterations: usize,
}

impl PlacementSolution {
    /// A placement without a code, to start from.
    #[doc(hidden)]
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
    /// Solves P1 from `known` placements (that of the pelvis, that of the frame before), or else
    /// from representative poses.
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
        let alternation = |start| Alternation {
            solver: self,
            prior,
            seen,
            anchor,
            start,
        };
        let mut best: Option<PlacementSolution> = None;
        let mut tops = Vec::new();
        for start in starts {
            let solved = match evidence::maximize(self, prior, seen, start, &tops) {
                Ascent::Top(solved) => {
                    // A rotation prior depends on the start, and a search that ran out of
                    // iterations is at no maximum.
                    let is_top = solved.iterations < self.iterations;
                    if is_top && self.rotation_prior == DVec3::ZERO {
                        tops.push(solved.placement);
                    }
                    solved
                }
                Ascent::SameTop => continue,
                Ascent::Flat => alternation(start).descend(None),
            };
            if best.as_ref().is_none_or(|b| solved.objective < b.objective) {
                best = Some(solved);
            }
        }
        best
    }

    /// Solves P1 from the solution of the frame before, as while a point is dragged. Its atoms stay
    /// where new ones would be worse.
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
            _ => {
                let alternation = Alternation {
                    solver: self,
                    prior,
                    seen,
                    anchor,
                    start,
                };
                Some(alternation.descend(before.fit.as_ref()))
            }
        }
    }

    /// The starting placements: the known ones, or those of the best fitting representative poses,
    /// far apart.
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

    /// Σ Wₖ (τₖ − τ₀ₖ)² of a placement.
    fn prior_cost(&self, placement: &Similarity, start: &Similarity) -> f64 {
        if self.rotation_prior == DVec3::ZERO {
            return 0.0;
        }
        let angles = angles_zyx_between(&start.rotation, &placement.rotation);
        (self.rotation_prior * angles * angles).element_sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    /// Atoms of six points of a body that turns a little, and a pose of them placed elsewhere,
    /// without its last point.
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

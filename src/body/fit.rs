//! The pose and the shape of a body from markers on it.
//!
//! The full energy is E_H(y) + w_Z Σ |y_m - z_m|² over the vertices y, the rotations R and the
//! shape β. For given R and β the best y is known in closed form. With r = P synth(R, β) - z what
//! the markers miss, and K how they give when they are pulled (P A⁻¹ Pᵀ), what remains, less the
//! model's disagreement with itself, is
//!
//! ```text
//! rᵀ (I / w_Z + K)⁻¹ r,   with one shift of all markers free
//! ```
//!
//! The minimum over R and β is found by damped Gauss-Newton steps (Levenberg-Marquardt), every one
//! of which lowers it, with weak priors on the twists of the joints and on β. The paper's block
//! descent takes hundreds of rounds, and its energy rises between them.

use super::fit_prior::{FitPrior, NormalEquations, twist_derivatives};
use super::marker_model::{MarkerModel, MarkerPositions};
use crate::Result;
use crate::numeric::levenberg_marquardt::Damping;
use crate::numeric::linalg::Cholesky;
use crate::pose::rotation::from_rotation_vector;
use crate::pose::similarity::{TransformKind, fit_similarity};
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2, s};

/// The weight w_Z of the markers against the edges.
pub(crate) const MARKER_WEIGHT: f64 = 3.0;
/// Markers that determine a pose at all.
pub const FEWEST: usize = 4;
/// Steps accepted at most.
const MOST_STEPS: usize = 60;
/// A step that lowers the energy by less than this share is the last.
const SMALL: f64 = 1e-8;
/// The last damping tried is 1e7: `most` lies between it and the next, however they are rounded.
const DAMPING: Damping = Damping {
    start: 1e-4,
    accepted: |damping, _| (damping / 10.0).max(1e-10),
    rejected: |damping| damping * 10.0,
    most: 5e7,
};

/// A pose and a shape.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyState {
    /// The rotation of each part.
    pub rotations: Vec<DMat3>,
    /// β.
    pub shape: Vec<f64>,
}

/// What was fitted to one frame.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The pose and the shape.
    pub state: BodyState,
    /// The energy, cm².
    pub energy: f64,
    /// The energy before the first and after each step that was taken.
    pub energies: Vec<f64>,
    /// What the predicted vertices are moved by, once the marker model's positions are known.
    pub shift: DVec3,
    /// The markers that were seen, and what pulls the completed surface there (the multipliers of
    /// the warp).
    pub pulls: Vec<(usize, DVec3)>,
    /// The root mean square distance of the predicted markers from those seen, centimeters.
    pub rms: f64,
}

/// The markers of one frame.
#[derive(Debug, Clone)]
pub struct FitProblem<'a> {
    model: &'a MarkerModel,
    prior: &'a FitPrior,
    seen: Vec<usize>,
    targets: Vec<DVec3>,
    /// (I / w_Z + K)⁻¹ for the markers seen, with one shift free.
    weights: Array2<f64>,
    /// What gives the best shift: -Σ_m s_m r_m.
    shift: Array1<f64>,
}

/// The energy of a state, and what its derivatives need.
struct Evaluation {
    at: MarkerPositions,
    /// Residual (seen, 3).
    residual: Array2<f64>,
    energy: f64,
}

impl<'a> FitProblem<'a> {
    /// A problem of the markers that are not missing (`None`).
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: there are fewer than [`FEWEST`] markers.
    pub fn new(
        model: &'a MarkerModel,
        prior: &'a FitPrior,
        markers: &[Option<DVec3>],
    ) -> Result<FitProblem<'a>> {
        let seen: Vec<usize> = (0..markers.len())
            .filter(|m| markers[*m].is_some())
            .collect();
        if seen.len() < FEWEST {
            return Err(
                format!("has {} markers, a body needs {FEWEST} or more", seen.len()).into(),
            );
        }
        let mut stiff = Array2::from_shape_fn((seen.len(), seen.len()), |(i, j)| {
            model.compliance[[seen[i], seen[j]]]
        });
        stiff.diag_mut().mapv_inplace(|v| v + 1.0 / MARKER_WEIGHT);
        let inverse = Cholesky::new(stiff)
            .and_then(|c| c.solve(&Array2::eye(seen.len())))
            .ok_or("has markers whose weights are not finite")?;
        let sums = inverse.sum_axis(ndarray::Axis(1));
        let total = sums.sum();
        let weights = Array2::from_shape_fn(inverse.dim(), |(i, j)| {
            inverse[[i, j]] - sums[i] * sums[j] / total
        });
        Ok(FitProblem {
            targets: markers.iter().flatten().copied().collect(),
            shift: sums / total,
            model,
            prior,
            seen,
            weights,
        })
    }

    /// Fits rotations, and the shape if the model has components. Without a start the pose begins
    /// from the rigid fit of all markers and from that of the markers of each part, and the
    /// better end is kept.
    pub fn solve(&self, start: Option<&BodyState>) -> Fit {
        match start {
            Some(start) => self.descend(start.clone()),
            None => {
                let fits = self.starts().into_iter().map(|s| self.descend(s));
                let best = fits.min_by(|a, b| a.energy.total_cmp(&b.energy));
                best.unwrap_or_else(|| self.descend(self.upright()))
            }
        }
    }

    /// The same markers for another model of them.
    pub fn with_model<'b>(&self, model: &'b MarkerModel) -> FitProblem<'b>
    where
        'a: 'b,
    {
        FitProblem {
            model,
            ..self.clone()
        }
    }

    /// The second derivatives and the gradient in the shape alone, where the rotations follow it.
    /// `None` if the markers do not determine them.
    pub(super) fn reduced_to_shape(&self, state: &BodyState) -> Option<NormalEquations> {
        let turns = 3 * self.model.parts();
        let mut normal = self.normal_equations(&self.evaluate(state), state);
        normal.hessian.diag_mut().mapv_inplace(|v| v + 1e-9);
        let (hessian, gradient) = (&normal.hessian, &normal.gradient);
        let factor = Cholesky::new(hessian.slice(s![..turns, ..turns]).to_owned())?;
        let mixed = hessian.slice(s![..turns, turns..]).to_owned();
        let solved = factor.solve(&mixed)?;
        let own = hessian.slice(s![turns.., turns..]);
        let pull = solved.t().dot(&gradient.slice(s![..turns]));
        Some(NormalEquations {
            hessian: &own - &mixed.t().dot(&solved),
            gradient: &gradient.slice(s![turns..]) - &pull,
        })
    }

    fn upright(&self) -> BodyState {
        BodyState {
            rotations: vec![DMat3::IDENTITY; self.model.parts()],
            shape: vec![0.0; self.model.components()],
        }
    }

    /// The whole body turned, and each part turned where its own markers tell how.
    fn starts(&self) -> Vec<BodyState> {
        let upright = self.upright();
        let rest = self.model.evaluate(&upright.rotations, &upright.shape);
        let fit = |of: &dyn Fn(usize) -> bool| {
            let pairs = (self.seen.iter().zip(&self.targets))
                .filter(|(m, _)| of(**m))
                .map(|(m, target)| (rest.positions[*m], *target, 1.0));
            fit_similarity(pairs, TransformKind::Rigid)
        };
        let whole = fit(&|_| true).map_or(DMat3::IDENTITY, |f| f.similarity.rotation);
        let count = |part: usize| {
            let of = |m: &&usize| self.model.part_of(**m) == part;
            self.seen.iter().filter(of).count()
        };
        let mut by_part = vec![whole; self.model.parts()];
        // Parts without markers of their own go with the part nearer to the root, which stands
        // before them.
        let order = self.model.joints().iter().map(|j| (j[1], Some(j[0])));
        let root = self.model.joints().first().map_or(0, |j| j[0]);
        for (part, parent) in std::iter::once((root, None)).chain(order) {
            let own = fit(&|m| self.model.part_of(m) == part);
            by_part[part] = match (own, parent) {
                (Some(own), _) if own.determined && count(part) >= 3 => own.similarity.rotation,
                (_, Some(parent)) => by_part[parent],
                _ => whole,
            };
        }
        let state = |rotations| BodyState {
            rotations,
            shape: upright.shape.clone(),
        };
        vec![state(vec![whole; self.model.parts()]), state(by_part)]
    }

    fn descend(&self, state: BodyState) -> Fit {
        let now = self.evaluate(&state);
        let (mut normal, mut energies) = (NormalEquations::zeros(0), Vec::new());
        let start = (now.energy, (now, state));
        let step = |(now, state): &(Evaluation, BodyState), damping, fresh| {
            if fresh {
                normal = self.normal_equations(now, state);
                energies.push(now.energy);
            }
            let next = self.moved(state, &damped_step(&normal, damping)?);
            let at = self.evaluate(&next);
            Some((at.energy, (at, next)))
        };
        let ((now, state), _) =
            DAMPING.minimize((MOST_STEPS, usize::MAX), (0.0, SMALL), start, step);
        // The end is there already if steps from it were rejected.
        energies.push(now.energy);
        energies.dedup();
        self.finish(state, &now, energies)
    }

    fn finish(&self, state: BodyState, now: &Evaluation, energies: Vec<f64>) -> Fit {
        let shift = -self.shift.dot(&now.residual);
        let pulls = self.weights.dot(&now.residual);
        let pulls = self.seen.iter().zip(pulls.rows());
        let left = (now.residual.rows().into_iter())
            .map(|r| (0..3).map(|a| (r[a] + shift[a]).powi(2)).sum::<f64>());
        Fit {
            state,
            energy: now.energy,
            energies,
            rms: (left.sum::<f64>() / self.seen.len() as f64).sqrt(),
            shift: DVec3::new(shift[0], shift[1], shift[2]),
            pulls: pulls
                .map(|(m, p)| (*m, DVec3::new(p[0], p[1], p[2])))
                .collect(),
        }
    }

    fn evaluate(&self, state: &BodyState) -> Evaluation {
        let at = self.model.evaluate(&state.rotations, &state.shape);
        let residual = Array2::from_shape_fn((self.seen.len(), 3), |(i, a)| {
            at.positions[self.seen[i]][a] - self.targets[i][a]
        });
        let data = (&residual * &self.weights.dot(&residual)).sum();
        let prior = self.prior.energy(&at.twists, &state.shape);
        Evaluation {
            energy: data + prior_weight(self.prior) * prior,
            at,
            residual,
        }
    }

    fn normal_equations(&self, now: &Evaluation, state: &BodyState) -> NormalEquations {
        let n = 3 * self.model.parts() + state.shape.len();
        let mut normal = NormalEquations::zeros(n);
        let joints = self.model.joints();
        let turns = twist_derivatives(joints, &now.at.twists, &state.rotations);
        let jacobian = self.jacobian(now, &turns, n);
        for axis in 0..3 {
            let rows = jacobian.slice(s![axis..;3, ..]);
            let weighted = self.weights.dot(&rows);
            normal.hessian += &rows.t().dot(&weighted);
            normal.gradient += &weighted.t().dot(&now.residual.column(axis));
        }
        let weight = prior_weight(self.prior);
        let twists = &now.at.twists;
        (self.prior).add(weight, joints, twists, &turns, &state.shape, &mut normal);
        normal
    }

    /// The derivatives of the markers seen (3 seen, n).
    fn jacobian(&self, now: &Evaluation, turns: &[DMat3], n: usize) -> Array2<f64> {
        let mut jacobian = Array2::zeros((3 * self.seen.len(), n));
        for (i, m) in self.seen.iter().enumerate() {
            let mut add = |column: usize, v: DVec3, sign: f64| {
                for axis in 0..3 {
                    jacobian[[3 * i + axis, column]] += sign * v[axis];
                }
            };
            for (part, by_part) in now.at.by_part.iter().enumerate() {
                for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                    add(3 * part + axis, unit.cross(by_part[*m]), 1.0);
                }
            }
            for (j, [a, b]) in self.model.joints().iter().enumerate() {
                let by = |c: usize| now.at.by_twist[3 * j + c][*m];
                let by_turn = DMat3::from_cols(by(0), by(1), by(2)) * turns[j];
                for axis in 0..3 {
                    add(3 * b + axis, by_turn.col(axis), 1.0);
                    add(3 * a + axis, by_turn.col(axis), -1.0);
                }
            }
            for (k, by_shape) in now.at.by_shape.iter().enumerate() {
                add(3 * now.at.by_part.len() + k, by_shape[*m], 1.0);
            }
        }
        jacobian
    }

    fn moved(&self, state: &BodyState, step: &Array1<f64>) -> BodyState {
        let parts = state.rotations.len();
        let turn = |p: usize| DVec3::new(step[3 * p], step[3 * p + 1], step[3 * p + 2]);
        BodyState {
            rotations: (0..parts)
                .map(|p| orthonormal(from_rotation_vector(turn(p)) * state.rotations[p]))
                .collect(),
            shape: (state.shape.iter().enumerate())
                .map(|(k, b)| b + step[3 * parts + k])
                .collect(),
        }
    }
}

/// How much the priors count against the squared centimeters of the energy.
pub(super) fn prior_weight(prior: &FitPrior) -> f64 {
    MARKER_WEIGHT * prior.variance()
}

/// The step that solves (H + damping · diag H) x = -g.
fn damped_step(normal: &NormalEquations, damping: f64) -> Option<Array1<f64>> {
    let mut damped = normal.hessian.clone();
    damped
        .diag_mut()
        .mapv_inplace(|v| v * (1.0 + damping) + 1e-12);
    let right = normal.gradient.mapv(|v| -v).insert_axis(ndarray::Axis(1));
    let step = Cholesky::new(damped)?.solve(&right)?;
    step.iter()
        .all(|v| v.is_finite())
        .then(|| step.column(0).to_owned())
}

/// The rotation whose rounding errors have been taken off (one step of Gram and Schmidt).
fn orthonormal(r: DMat3) -> DMat3 {
    let x = r.x_axis.normalize_or(DVec3::X);
    let y = (r.y_axis - x * x.dot(r.y_axis)).normalize_or(DVec3::Y);
    DMat3::from_cols(x, y, x.cross(y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::marker_model::Marker;
    use crate::body::testdata::bending_body;

    fn energy(problem: &FitProblem<'_>, state: &BodyState) -> f64 {
        problem.evaluate(state).energy
    }

    #[test]
    fn the_gradient_agrees_with_differences_and_vanishes_at_the_end() {
        let body = bending_body();
        let markers: Vec<Marker> = (0..48).step_by(3).map(Marker::on).collect();
        let model = MarkerModel::new(&body, &markers);
        let mesh = body.synthesize(&body.training_rotations[3], &[0.5, -0.3]);
        let seen: Vec<_> = (0..48)
            .step_by(3)
            .map(|v| Some(mesh[v] + DVec3::X))
            .collect();
        let prior = body.fit_prior();
        let problem = FitProblem::new(&model, &prior, &seen).unwrap();
        let turn = |by: DVec3| from_rotation_vector(by);
        let state = BodyState {
            rotations: vec![
                turn(DVec3::new(0.2, 0.1, -0.1)) * body.training_rotations[3][0],
                turn(DVec3::new(-0.1, 0.3, 0.1)) * body.training_rotations[3][1],
            ],
            shape: vec![0.1; model.components()],
        };
        let gradient = |state: &BodyState| {
            problem
                .normal_equations(&problem.evaluate(state), state)
                .gradient
        };
        let start = gradient(&state);
        let h = 1e-6;
        for k in 0..start.len() {
            let mut step = Array1::zeros(start.len());
            step[k] = h;
            let up = energy(&problem, &problem.moved(&state, &step));
            step[k] = -h;
            let down = energy(&problem, &problem.moved(&state, &step));
            let slope = (up - down) / (2.0 * h);
            let scale = 1.0 + start[k].abs();
            assert!(
                (slope / 2.0 - start[k]).abs() < 1e-4 * scale,
                "{k}: {slope}"
            );
        }
        let fit = problem.solve(Some(&state));
        assert!(fit.energies.windows(2).all(|w| w[1] < w[0]));
        let norm = |g: &Array1<f64>| g.dot(g).sqrt();
        assert!(norm(&gradient(&fit.state)) < 1e-3 * norm(&start));
        assert!(fit.rms < 0.05, "{}", fit.rms);
        // From no start at all it ends as well.
        assert!(problem.solve(None).energy < fit.energy * 1.01);
    }

    #[test]
    fn a_part_without_markers_is_held_by_the_prior_and_few_markers_are_told() {
        let body = bending_body();
        let lower: Vec<usize> = (0..20).step_by(3).collect();
        let markers: Vec<Marker> = lower.iter().map(|v| Marker::on(*v)).collect();
        let model = MarkerModel::new(&body, &markers);
        let seen: Vec<_> = lower
            .iter()
            .map(|v| Some(body.template.vertices[*v]))
            .collect();
        let prior = body.fit_prior();
        let fit = FitProblem::new(&model, &prior, &seen).unwrap().solve(None);
        let rotations = &fit.state.rotations;
        let bend = (rotations[0].transpose() * rotations[1]).to_cols_array();
        let (mean, _) = prior.twists[0];
        let expected = from_rotation_vector(mean).to_cols_array();
        let (lower, upper) = (
            body.template.joints[0].parts[0],
            body.template.joints[0].parts[1],
        );
        assert_eq!((lower, upper), (0, 1));
        assert!(bend.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.1));
        let few = [
            Some(DVec3::ZERO),
            None,
            None,
            Some(DVec3::X),
            None,
            None,
            None,
        ];
        assert!(FitProblem::new(&model, &prior, &few).is_err());
    }
}

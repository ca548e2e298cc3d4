//! The pose and the shape of a body from markers on it.
//!
//! With r = synth(R, β) - z what the markers miss, in centimeters, and one shift of all free,
//!
//! ```text
//! Σ_m w_m |r_m|² + σ² (squared standard deviations of the twists and of β)
//! ```
//!
//! is least over the rotations R and the shape β, by damped Gauss-Newton steps
//! (Levenberg-Marquardt), every one of which lowers it. σ is what the markers and the model itself
//! miss: it is estimated from the fit. Markers that are many σ off are left out: their weights fall
//! first as those of Geman and McClure do. The energy of Anguelov et al. lets
//! the markers pull the surface off the model at no cost for low frequencies, so that more markers
//! make the model's pose worse; and its block descent takes hundreds of rounds, between which its
//! energy rises.

use super::fit_prior::{FitPrior, NormalEquations, twist_derivatives};
use super::marker_model::{MarkerModel, MarkerPositions};
use crate::Result;
use crate::numeric::levenberg_marquardt::Damping;
use crate::numeric::linalg::Cholesky;
use crate::numeric::statistics::median;
use crate::pose::rotation::from_rotation_vector;
use crate::pose::similarity::{TransformKind, fit_similarity};
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2, ArrayView2, Axis, s};

/// Markers that determine a pose at all.
pub const FEWEST: usize = 4;
/// Steps accepted at most.
const MOST_STEPS: usize = 60;
/// Rounds of weights and σ, and the change of σ² that ends them.
const ROUNDS: usize = 8;
/// Steps of a round: weights and σ change again before an end is worth its steps.
const ROUND_STEPS: usize = 5;
const SETTLED: f64 = 0.02;
/// The median and the mean of the squared length of a normal vector in space.
const MEDIAN_SQUARE: f64 = 2.366;
/// A marker counts a quarter where it is so many σ off, and is left out where it is so many.
const DOUBTED: f64 = 3.0;
const LEFT_OUT: f64 = 6.0;
/// The least share of the residuals' variance that a fit leaves.
const LEAST_FREE: f64 = 0.1;
/// A fit is poor where σ² is so large, cm², or one marker in so many is left out; the mirror image
/// fits far better where its σ² is this share.
const POOR: f64 = 2.0;
const POOR_SHARE: usize = 5;
const MIRRORED: f64 = 0.4;
/// The least σ by which markers are left out, cm.
const LEAST_DOUBT: f64 = 1.0;
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
    /// Where the predicted markers are that count, and how far those seen are from there.
    pub missed: Vec<(DVec3, DVec3)>,
    /// The root mean square distance of the predicted markers from those that count, centimeters.
    pub rms: f64,
    /// The markers that do not fit, and how far each is from its position on the body, centimeters.
    pub left_out: Vec<(usize, f64)>,
    /// σ², cm² a coordinate: what markers and model miss.
    pub variance: f64,
    /// Whether the mirror image of the markers fits far better: left and right are exchanged.
    pub is_mirrored: bool,
}

impl Fit {
    fn is_poor(&self) -> bool {
        let out = self.left_out.len();
        self.variance > POOR || out * POOR_SHARE > out + self.missed.len()
    }
}

/// The markers of one frame.
#[derive(Debug, Clone)]
pub struct FitProblem<'a> {
    model: &'a MarkerModel,
    prior: &'a FitPrior,
    seen: Vec<usize>,
    targets: Vec<DVec3>,
    /// The weight of each marker that is seen.
    weights: Array1<f64>,
    /// σ².
    variance: f64,
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
        Ok(FitProblem {
            targets: markers.iter().flatten().copied().collect(),
            weights: Array1::ones(seen.len()),
            variance: prior.variance(),
            model,
            prior,
            seen,
        })
    }

    /// Fits rotations, and the shape if the model has components. Without a start the pose begins
    /// from the rigid fit of all markers and from that of the markers of each part, and the
    /// better end is kept. Markers that do not fit are left out.
    pub fn solve(&self, start: Option<&BodyState>) -> Fit {
        match start {
            Some(start) => self.settled(start.clone()),
            None => {
                let mut best = self.best();
                best.is_mirrored = best.is_poor() && {
                    let turned = self.targets.iter().map(|t| DVec3::new(-t.x, t.y, t.z));
                    let mirrored = FitProblem {
                        targets: turned.collect(),
                        ..self.clone()
                    };
                    mirrored.best().variance < MIRRORED * best.variance
                };
                best
            }
        }
    }

    /// The best end of all starts.
    fn best(&self) -> Fit {
        let fits = self.starts().into_iter().map(|s| self.settled(s));
        let best = fits.min_by(|a, b| a.variance.total_cmp(&b.variance));
        best.unwrap_or_else(|| self.settled(self.upright()))
    }

    /// Rounds of fits, of weights of the markers and of σ.
    fn settled(&self, start: BodyState) -> Fit {
        let mut problem = self.clone();
        let mut fit = problem.descend(start);
        for _ in 0..ROUNDS {
            let now = problem.evaluate(&fit.state);
            let squares = problem.squares(&now);
            let free = problem.free(&now, &fit.state);
            let of_median = median(squares.to_vec()).unwrap_or(0.0) / MEDIAN_SQUARE / free;
            let variance = of_median.max(self.prior.variance());
            let reach = DOUBTED * DOUBTED * variance.max(LEAST_DOUBT * LEAST_DOUBT);
            problem.weights = squares.mapv(|d| (1.0 + d / reach).powi(-2));
            let change = (variance / problem.variance).ln().abs();
            problem.variance = variance;
            fit = problem.descended(fit.state, ROUND_STEPS);
            if change < SETTLED {
                break;
            }
        }
        // The median is that of the best: those that count tell σ, and which others count too.
        for _ in 0..ROUNDS {
            let squares = problem.squares(&problem.evaluate(&fit.state));
            let variance = problem.variance.max(LEAST_DOUBT * LEAST_DOUBT);
            let counts = |d: f64| d <= LEFT_OUT * LEFT_OUT * variance;
            let weights = squares.mapv(|d| if counts(d) { 1.0 } else { 0.0 });
            if weights == problem.weights || weights.sum() < FEWEST as f64 {
                break;
            }
            problem.weights = weights;
            fit = problem.descended(fit.state, ROUND_STEPS);
            let now = problem.evaluate(&fit.state);
            let square = problem.weights.dot(&problem.squares(&now)) / problem.weights.sum();
            let free = problem.free(&now, &fit.state);
            problem.variance = (square / 3.0 / free).max(self.prior.variance());
        }
        problem.weights.mapv_inplace(f64::round);
        problem.descend(fit.state)
    }

    /// The squared distance of each marker that is seen from its position, cm².
    fn squares(&self, now: &Evaluation) -> Array1<f64> {
        let shift = self.shift(now);
        let square = |r: ndarray::ArrayView1<'_, f64>| -> f64 {
            (0..3).map(|a| (r[a] + shift[a]).powi(2)).sum()
        };
        now.residual.rows().into_iter().map(square).collect()
    }

    /// The share of the residuals' variance that the fit leaves them: what it is free to follow it
    /// takes away.
    fn free(&self, now: &Evaluation, state: &BodyState) -> f64 {
        let normal = self.normal_equations(now, state);
        let n = normal.gradient.len();
        let mut prior = NormalEquations::zeros(n);
        self.add_prior(now, state, &mut prior);
        let mut hessian = normal.hessian;
        hessian.diag_mut().mapv_inplace(|v| v + 1e-9);
        let held = Cholesky::new(hessian).and_then(|c| c.solve(&prior.hessian));
        let followed = held.map_or(0.0, |held| n as f64 - held.diag().sum());
        let count = 3.0 * self.weights.sum();
        ((count - 3.0 - followed) / count).max(LEAST_FREE)
    }

    /// This problem with the weights and the σ that a fit of it found.
    pub(super) fn as_in(&self, fit: &Fit) -> FitProblem<'a> {
        let is_out = |m: &usize| fit.left_out.iter().any(|(out, _)| out == m);
        let weight = |m: &usize| if is_out(m) { 0.0 } else { 1.0 };
        FitProblem {
            weights: self.seen.iter().map(weight).collect(),
            variance: fit.variance,
            ..self.clone()
        }
    }

    /// σ², by which the priors count.
    pub(super) fn variance(&self) -> f64 {
        self.variance
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

    /// The least energy from a start, with the weights and the σ that the problem has.
    pub(super) fn descend(&self, state: BodyState) -> Fit {
        self.descended(state, MOST_STEPS)
    }

    /// A state some steps nearer to it.
    fn descended(&self, state: BodyState, most: usize) -> Fit {
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
        let ((now, state), _) = DAMPING.minimize((most, usize::MAX), (0.0, SMALL), start, step);
        // The end is there already if steps from it were rejected.
        energies.push(now.energy);
        energies.dedup();
        self.finish(state, &now, energies)
    }

    fn finish(&self, state: BodyState, now: &Evaluation, energies: Vec<f64>) -> Fit {
        let shift = self.shift(now);
        let squares = self.squares(now);
        let counts = |i: &usize| self.weights[*i] > 0.0;
        let (own, others): (Vec<usize>, Vec<usize>) = (0..self.seen.len()).partition(counts);
        let left: f64 = own.iter().map(|i| squares[*i]).sum();
        let missed = |i: &usize| {
            let at = now.at.positions[self.seen[*i]] + shift;
            (at, self.targets[*i] - at)
        };
        Fit {
            state,
            energy: now.energy,
            energies,
            rms: (left / own.len().max(1) as f64).sqrt(),
            shift,
            missed: own.iter().map(missed).collect(),
            left_out: (others.iter())
                .map(|i| (self.seen[*i], squares[*i].sqrt()))
                .collect(),
            variance: self.variance,
            is_mirrored: false,
        }
    }

    /// The shift of the predicted markers that leaves least.
    fn shift(&self, now: &Evaluation) -> DVec3 {
        let sum = self.weights.dot(&now.residual);
        -DVec3::new(sum[0], sum[1], sum[2]) / self.weights.sum()
    }

    /// W x, with one shift free.
    fn weighted(&self, x: &ArrayView2<'_, f64>) -> Array2<f64> {
        let means = self.weights.dot(x) / self.weights.sum();
        let weights = self.weights.view().insert_axis(Axis(1));
        (x - &means) * weights
    }

    fn add_prior(&self, now: &Evaluation, state: &BodyState, to: &mut NormalEquations) {
        let (joints, twists) = (self.model.joints(), &now.at.twists);
        let turns = twist_derivatives(joints, twists, &state.rotations);
        (self.prior).add(self.variance, joints, twists, &turns, &state.shape, to);
    }

    fn evaluate(&self, state: &BodyState) -> Evaluation {
        let at = self.model.evaluate(&state.rotations, &state.shape);
        let residual = Array2::from_shape_fn((self.seen.len(), 3), |(i, a)| {
            at.positions[self.seen[i]][a] - self.targets[i][a]
        });
        let data = (&residual * &self.weighted(&residual.view())).sum();
        let prior = self.prior.energy(&at.twists, &state.shape);
        Evaluation {
            energy: data + self.variance * prior,
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
            let weighted = self.weighted(&rows);
            normal.hessian += &rows.t().dot(&weighted);
            normal.gradient += &weighted.t().dot(&now.residual.column(axis));
        }
        self.add_prior(now, state, &mut normal);
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

/// The step that solves (H + damping · diag H) x = -g.
fn damped_step(normal: &NormalEquations, damping: f64) -> Option<Array1<f64>> {
    let mut damped = normal.hessian.clone();
    damped
        .diag_mut()
        .mapv_inplace(|v| v * (1.0 + damping) + 1e-12);
    let right = normal.gradient.mapv(|v| -v).insert_axis(Axis(1));
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
    use crate::marker_model::Marker;
    use crate::testdata::bending_body;

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
    fn markers_that_do_not_fit_are_left_out() {
        let body = bending_body();
        let on: Vec<usize> = (0..48).step_by(2).collect();
        let markers: Vec<Marker> = on.iter().map(|v| Marker::on(*v)).collect();
        let model = MarkerModel::new(&body, &markers);
        let mesh = body.synthesize(&body.training_rotations[3], &[0.5, -0.3]);
        let mut seen: Vec<_> = on.iter().map(|v| Some(mesh[*v])).collect();
        let prior = body.fit_prior();
        let fit =
            |seen: &[Option<DVec3>]| FitProblem::new(&model, &prior, seen).unwrap().solve(None);
        let right = fit(&seen);
        assert_eq!(right.left_out, []);
        seen[5] = seen[5].map(|at| at + DVec3::new(12.0, 16.0, 0.0));
        seen.swap(2, 20);
        let found = fit(&seen);
        let out: Vec<usize> = found.left_out.iter().map(|(m, _)| *m).collect();
        assert_eq!(out, [2, 5, 20]);
        assert!((found.left_out[1].1 - 20.0).abs() < 1.0);
        let turned = |f: &Fit, part: usize| f.state.rotations[part].to_cols_array();
        for part in 0..2 {
            let pairs = turned(&right, part).into_iter().zip(turned(&found, part));
            assert!(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 0.05);
        }
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

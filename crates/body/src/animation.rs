//! A take of markers: one shape for all frames, each frame from the pose before.
//!
//! Where the markers are not quite on the vertices that are named, as the joints of a skeleton are
//! not, the mean of what each one misses over the take, in the frame of its part, becomes its
//! offset.

use super::fit::{BodyState, Fit, FitProblem};
use super::fit_prior::{FitPrior, NormalEquations};
use super::marker_model::MarkerModel;
use crate::Result;
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel;
use glam::DVec3;
use ndarray::{Array1, Axis, s};

/// Rounds of shape and offsets in turn.
const OFFSET_ROUNDS: usize = 3;
/// Frames that the shape is learned from.
const SHAPE_FRAMES: usize = 16;
const SHAPE_ROUNDS: usize = 10;
/// A frame whose markers are missed by more than this times the usual distance (a running mean),
/// and by more than [`FAR`], is fitted afresh.
const LOST: f64 = 2.0;
/// Centimeters.
const FAR: f64 = 2.0;

/// A take as poses of one body.
#[derive(Debug, Clone)]
pub struct Animation {
    /// β, the same in all frames.
    pub shape: Vec<f64>,
    /// The fit of each frame; its state has no shape. `None` where a frame has fewer than
    /// [`super::fit::FEWEST`] markers.
    pub fits: Vec<Option<Fit>>,
}

/// The markers of a frame, in the model's order, cm; `None` is missing.
pub type MarkerFrame = Vec<Option<DVec3>>;

/// Whether markers sit on the body where [`MarkerModel`] has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Offsets {
    /// They do.
    Known,
    /// Each is off by a constant offset of its own, which is learned from the take.
    Learned,
}

/// Fits a take of one person, each frame from the fit of the frame before. The shape is learned
/// first, from frames spread over the take that have the most markers.
///
/// # Errors
/// [`crate::Error::Unfit`]: no frame has markers enough.
pub fn animate(
    model: &MarkerModel,
    prior: &FitPrior,
    frames: &[MarkerFrame],
    offsets: Offsets,
) -> Result<Animation> {
    let chosen = shape_frames(frames);
    let mut model = model.clone();
    let mut shape = shared_shape(&model, prior, &chosen)?;
    if offsets == Offsets::Learned {
        for _ in 0..OFFSET_ROUNDS {
            model = model.with_offsets(&learned_offsets(&model, prior, &chosen, &shape));
            shape = shared_shape(&model, prior, &chosen)?;
        }
    }
    let model = model.with_shape(&shape);
    let mut fits: Vec<Option<Fit>> = Vec::with_capacity(frames.len());
    // The frame before: its state, how many markers it left out, and the usual distance.
    let mut last: Option<(BodyState, usize, f64)> = None;
    for frame in frames {
        let Ok(problem) = FitProblem::new(&model, prior, frame) else {
            fits.push(None);
            continue;
        };
        let mut fit = problem.solve(last.as_ref().map(|(state, ..)| state));
        let is_lost = last.as_ref().is_some_and(|(_, left_out, usual)| {
            fit.left_out.len() > *left_out || fit.rms > FAR && fit.rms > LOST * usual
        });
        if is_lost {
            let afresh = problem.solve(None);
            let worth = |fit: &Fit| (fit.left_out.len(), fit.energy);
            if worth(&afresh) < worth(&fit) {
                fit = afresh;
            }
        }
        let usual = last.map_or(fit.rms, |(.., usual)| 0.9 * usual + 0.1 * fit.rms);
        last = Some((fit.state.clone(), fit.left_out.len(), usual));
        fits.push(Some(fit));
    }
    if fits.iter().any(Option::is_some) {
        Ok(Animation { shape, fits })
    } else {
        Err("no frame has four of the body's points or more".into())
    }
}

/// Frames with the most markers, spread over the take.
fn shape_frames(frames: &[MarkerFrame]) -> Vec<&MarkerFrame> {
    let seen = |f: &MarkerFrame| f.iter().flatten().count();
    let blocks = SHAPE_FRAMES.min(frames.len());
    let block = |k: usize| {
        let range = k * frames.len() / blocks..(k + 1) * frames.len() / blocks;
        frames[range].iter().rev().max_by_key(|f| seen(f))
    };
    (0..blocks).filter_map(block).collect()
}

/// The offset of each marker: the mean over the frames of where it is from its position on the
/// body, in the frame of its part.
fn learned_offsets(
    model: &MarkerModel,
    prior: &FitPrior,
    frames: &[&MarkerFrame],
    shape: &[f64],
) -> Vec<DVec3> {
    let model = model.with_shape(shape);
    let mut sums = vec![(DVec3::ZERO, 0.0); frames[0].len()];
    for frame in frames {
        let Ok(problem) = FitProblem::new(&model, prior, frame) else {
            continue;
        };
        let fit = problem.solve(None);
        let at = model.evaluate(&fit.state.rotations, &[]);
        for (m, seen) in frame.iter().enumerate() {
            if let Some(seen) = seen {
                let missed = *seen - at.positions[m] - fit.shift;
                let turn = fit.state.rotations[model.part_of(m)].transpose();
                sums[m] = (sums[m].0 + turn * missed, sums[m].1 + 1.0);
            }
        }
    }
    let mean = |(m, (sum, count)): (usize, &(DVec3, f64))| {
        model.offset(m)
            + if *count > 0.0 {
                *sum / *count
            } else {
                DVec3::ZERO
            }
    };
    sums.iter().enumerate().map(mean).collect()
}

/// The shape that all frames share: of the sum of their energies, the rotations of each frame are
/// eliminated (Schur complement).
fn shared_shape(
    model: &MarkerModel,
    prior: &FitPrior,
    frames: &[&MarkerFrame],
) -> Result<Vec<f64>> {
    let problems: Vec<FitProblem<'_>> = (frames.iter())
        .filter_map(|f| FitProblem::new(model, prior, f).ok())
        .collect();
    if problems.is_empty() {
        return Err("no frame has four of the body's points or more".into());
    }
    let first = parallel::map_chunks(problems.len(), 1, |k| problems[k.start].solve(None));
    let problems: Vec<FitProblem<'_>> = (problems.iter().zip(&first))
        .map(|(problem, fit)| problem.as_in(fit))
        .collect();
    let mut rotations: Vec<_> = first.iter().map(|f| f.state.rotations.clone()).collect();
    let count = model.components();
    if count == 0 {
        return Ok(Vec::new());
    }
    let mean = |b: usize| first.iter().map(|f| f.state.shape[b]).sum::<f64>() / first.len() as f64;
    let mut shape: Vec<f64> = (0..count).map(mean).collect();
    for _ in 0..SHAPE_ROUNDS {
        let fixed = model.with_shape(&shape);
        let parts = parallel::map_chunks(problems.len(), 1, |k| {
            let start = BodyState {
                rotations: rotations[k.start].clone(),
                shape: Vec::new(),
            };
            let problem = problems[k.start].with_model(&fixed);
            let fit = problem.descend(start);
            let state = BodyState {
                rotations: fit.state.rotations,
                shape: shape.clone(),
            };
            let reduced = problems[k.start].reduced_to_shape(&state);
            (state.rotations, reduced)
        });
        let mut sum = NormalEquations::zeros(count);
        for (k, (turned, reduced)) in parts.into_iter().enumerate() {
            rotations[k] = turned;
            let reduced = reduced.ok_or("has markers that determine no pose")?;
            sum.hessian += &reduced.hessian;
            sum.gradient += &reduced.gradient;
        }
        // Each frame has brought the prior of the one shape; it counts once.
        let all: f64 = problems.iter().map(FitProblem::variance).sum();
        let surplus = all - all / problems.len() as f64;
        sum.hessian.diag_mut().mapv_inplace(|v| v - surplus);
        sum.gradient
            .scaled_add(-surplus, &Array1::from(shape.clone()));
        let right = sum.gradient.mapv(|v| -v).insert_axis(Axis(1));
        let step = Cholesky::new(sum.hessian).and_then(|c| c.solve(&right));
        let step = step.ok_or("has markers that determine no shape")?;
        for (beta, step) in shape.iter_mut().zip(step.slice(s![.., 0])) {
            *beta += step;
        }
        if step.iter().all(|s| s.abs() < 1e-3) {
            break;
        }
    }
    Ok(shape)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::marker_model::Marker;
    use crate::testdata::bending_body;

    #[test]
    fn a_take_gives_back_its_shape_and_frames_without_markers_stay_empty() {
        let body = bending_body();
        let on: Vec<usize> = (0..48).step_by(2).collect();
        let markers: Vec<Marker> = on.iter().map(|v| Marker::on(*v)).collect();
        let model = MarkerModel::new(&body, &markers);
        let mut prior = body.fit_prior();
        prior.noise = 0.01;
        let shape = [0.8, -0.5];
        let mut frames: Vec<MarkerFrame> = (body.training_rotations.iter())
            .map(|rotations| {
                let mesh = body.synthesize(rotations, &shape);
                on.iter().map(|v| Some(mesh[*v])).collect()
            })
            .collect();
        frames[2] = vec![None; on.len()];
        let found = animate(&model, &prior, &frames, Offsets::Known).unwrap();
        assert!((found.shape[0] - 0.8).abs() < 0.02, "{:?}", found.shape);
        assert!((found.shape[1] + 0.5).abs() < 0.02, "{:?}", found.shape);
        assert!(found.fits[2].is_none());
        let fits = found.fits.iter().flatten();
        assert!(fits.clone().all(|f| f.rms < 0.01));
        assert_eq!(fits.count(), frames.len() - 1);
        // Markers that all stand off: their offsets are learned.
        for (frame, rotations) in frames.iter_mut().zip(&body.training_rotations) {
            for (seen, v) in frame.iter_mut().zip(&on) {
                let turn = rotations[body.template.vertex_parts[*v]];
                *seen = seen.map(|p| p + turn * DVec3::new(0.1, 0.0, 0.2));
            }
        }
        let rms = |offsets: Offsets| {
            let fits = animate(&model, &prior, &frames, offsets).unwrap().fits;
            let all: Vec<f64> = fits.iter().flatten().map(|f| f.rms).collect();
            all.iter().sum::<f64>() / all.len() as f64
        };
        let (known, learned) = (rms(Offsets::Known), rms(Offsets::Learned));
        assert!(learned < 0.9 * known, "{known} {learned}");
    }
}

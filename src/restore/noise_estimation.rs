//! How noisy a capture is: by a point's motion, or by what the model leaves of a frame.

use super::bound_model::BoundModel;
use super::kalman_smoother;
use super::rigid::noise_floor::NoiseFloor;
use crate::prior::EXACT_VARIANCE;
use ndarray::ArrayView2;
use std::ops::Range;

/// Up to this noise of most points, cm, the others of a frame are outliers; above, all is noise unless distances tell
/// otherwise.
pub const NEARLY_CLEAN: f64 = 1.0;

/// Whether outliers are looked for in a frame of such a base noise.
pub fn worth_a_search(base: &NoiseFloor) -> bool {
    base.sd <= NEARLY_CLEAN || base.has_outliers()
}

/// A noise that was found in one frame, cm, to an eighth of an octave: it is no surer than that, and frames that have the
/// same noise share what a model makes for it.
pub fn shared(noise: f64) -> f64 {
    if noise * noise > EXACT_VARIANCE {
        ((noise.log2() * 8.0).round() / 8.0).exp2()
    } else {
        noise
    }
}

/// The variance of a number's noise (cm²; infinite missing) by the standard deviation of all.
pub fn variance(value: f64, noise: f64) -> f64 {
    if value.is_finite() {
        (noise * noise).max(EXACT_VARIANCE)
    } else {
        f64::INFINITY
    }
}

/// The noise of one frame by itself: what the model leaves of most of its points beyond what it leaves of clean ones.
///
/// The quarter of the points that fits worst does not count, as it may be outliers.
pub fn of_frame(restorer: &super::FrameRestorer<'_>, y: &[f64]) -> f64 {
    // First guess: a centimetre, so that the answer does not follow the noise.
    let first: Vec<f64> = y.iter().map(|v| variance(*v, 1.0)).collect();
    let Some(found) = restorer.restore(y, &first) else {
        return 0.0;
    };
    let model = restorer.prior.residual_variance();
    let mut rest: Vec<f64> = (0..y.len() / 3)
        .filter(|p| y[3 * p..3 * p + 3].iter().all(|v| v.is_finite()))
        .map(|p| {
            let v: f64 = model[3 * p..3 * p + 3].iter().sum();
            // The answer lies between model and observation: y - mean = (noise + v) share of the residual.
            let share = 3.0 / (3.0 + v);
            let d = super::frame_restorer::moved(y, &found.mean, p) / share;
            (d * d - v) / 3.0
        })
        .collect();
    rest.sort_by(f64::total_cmp);
    rest.truncate((rest.len() * 3).div_ceil(4));
    let mean = rest.iter().sum::<f64>() / rest.len().max(1) as f64;
    // Three quarters of the points, the better ones, hold about half of the squared noise of all.
    (2.0 * mean).max(0.0).sqrt()
}

/// The noise of each point, cm: given, or from the third differences of its coordinates. A point that is not seen long
/// enough on end takes the median of the others; where none is, the model tells the noise of some frames.
pub fn by_point(
    bound: &BoundModel,
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    given: Option<f64>,
) -> Vec<f64> {
    let points = xyz.ncols() / 3;
    if let Some(noise) = given {
        return vec![noise; points];
    }
    let of_column = |i: usize| {
        // Runs are joined by a missing value, which no difference crosses.
        let ends = [f64::NAN];
        let series: Vec<f64> = runs
            .iter()
            .flat_map(|r| r.clone().map(|t| xyz[[t, i]]).chain(ends))
            .collect();
        kalman_smoother::noise_of(&series)
    };
    let measured: Vec<Option<f64>> = (0..points)
        .map(|p| {
            let found: Vec<f64> = (3 * p..3 * p + 3).filter_map(of_column).collect();
            (!found.is_empty()).then(|| found.iter().sum::<f64>() / found.len() as f64)
        })
        .collect();
    let mut known: Vec<f64> = measured.iter().flatten().copied().collect();
    if known.is_empty() {
        let restorer = bound.restorer(&None);
        let step = xyz.nrows().div_ceil(20).max(1);
        known = (0..xyz.nrows())
            .step_by(step)
            .map(|t| of_frame(&restorer, &xyz.row(t).to_vec()))
            .collect();
    }
    known.sort_by(f64::total_cmp);
    let usual = known.get(known.len() / 2).copied().unwrap_or(0.0);
    measured.into_iter().map(|m| m.unwrap_or(usual)).collect()
}

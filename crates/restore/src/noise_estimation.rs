//! How noisy a capture is: by the motion of its points, or by what the model leaves of a frame.

use super::frame_estimator::{FrameEstimator, displacement};
use super::pose_model::PoseModel;
use super::rigid::noise_floor::NoiseFloor;
use super::take::Take;
use super::tuning::noise_estimation::*;
use crate::numeric::statistics::median;
use crate::numeric::track_noise::{Track, TrackNoise};
use crate::pose::repeated_frames::RepeatedFrames;
use crate::prior::EXACT_VARIANCE;
use ndarray::ArrayView2;
use std::ops::Range;

/// Whether a frame with this noise floor is searched for outliers.
pub(crate) fn is_worth_searching(floor: &NoiseFloor) -> bool {
    floor.sd <= NEARLY_CLEAN || floor.outlier_evidence > 0.0
}

/// Rounds a standard deviation (cm) to an eighth of an octave. An estimate from one frame is no
/// better than that, and frames of the same noise share what a prior computes for it.
pub(crate) fn rounded(sd: f64) -> f64 {
    if sd * sd > EXACT_VARIANCE {
        ((sd.log2() * 8.0).round() / 8.0).exp2()
    } else {
        sd
    }
}

/// Noise variances (3 J, cm²) of coordinates measured with standard deviation `sd` (cm; 0: exact);
/// infinite where a coordinate is missing or its point `hidden`.
pub(crate) fn variances(y: &[f64], sd: f64, hidden: &[usize]) -> Vec<f64> {
    let variance = |(i, v): (usize, &f64)| {
        if v.is_finite() && !hidden.contains(&(i / 3)) {
            (sd * sd).max(EXACT_VARIANCE)
        } else {
            f64::INFINITY
        }
    };
    y.iter().enumerate().map(variance).collect()
}

/// Standard deviation of a coordinate (cm) in one frame: what the model leaves of most points
/// beyond what it leaves of clean ones. The quarter of the points that fits worst is left out, as
/// these may be outliers.
pub(crate) fn of_frame(estimator: &FrameEstimator<'_>, y: &[f64]) -> f64 {
    // A first guess of 1 cm, so that the estimate does not follow the noise.
    let Some(found) = estimator.estimate(y, &variances(y, 1.0, &[])) else {
        return 0.0;
    };
    let model = estimator.prior.residual_variance();
    let mut squares: Vec<f64> = (0..y.len() / 3)
        .filter(|p| y[3 * p..3 * p + 3].iter().all(|v| v.is_finite()))
        .map(|p| {
            let v: f64 = model[3 * p..3 * p + 3].iter().sum();
            // The estimate lies between model and observation, at this share of the residual.
            let share = 3.0 / (3.0 + v);
            let residual = displacement(y, &found.mean, p) / share;
            (residual * residual - v) / 3.0
        })
        .collect();
    squares.sort_by(f64::total_cmp);
    squares.truncate((squares.len() * 3).div_ceil(4));
    let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    // The best three quarters of the points hold about half of the squared noise of all.
    (2.0 * mean).max(0.0).sqrt()
}

/// The noise of the points of a take (frames, 3 J; cm), a track each.
pub(crate) fn point_noise(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> TrackNoise {
    let of_point = |p: usize| {
        let row = |t: usize| {
            let at = |axis: usize| xyz[[t, 3 * p + axis]];
            [at(0), at(1), at(2), 0.0]
        };
        // Runs are joined by a missing value, which no difference crosses.
        let of_run = |r: &Range<usize>| r.clone().map(row).chain([[f64::NAN; 4]]);
        Track {
            rows: runs.iter().flat_map(of_run).collect(),
            freedoms: 3,
        }
    };
    TrackNoise::of(&(0..xyz.ncols() / 3).map(of_point).collect::<Vec<_>>())
}

/// Standard deviation of a coordinate of each point (J), cm. `None` for a point that is never seen
/// long enough, or rests.
pub(crate) fn from_time(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> Vec<Option<f64>> {
    let variance = point_noise(xyz, runs).variance;
    variance.into_iter().map(|v| v.map(f64::sqrt)).collect()
}

/// Standard deviation of a coordinate of each point (J), cm: `given`, or measured over time
/// ([`point_noise`]). A point that is never seen long enough takes the median of the
/// others; where there is none, `model` measures some frames, given beside it in its own order of
/// points.
pub(crate) fn by_point(
    model: Option<(&PoseModel, ArrayView2<'_, f64>)>,
    take: &Take<'_>,
    given: Option<f64>,
) -> Vec<f64> {
    sd_by_point(model, take, given, |noise| noise.variance)
}

/// [`by_point`], with any motion that may be noise: what a path may deviate by.
pub(crate) fn most_by_point(
    model: Option<(&PoseModel, ArrayView2<'_, f64>)>,
    take: &Take<'_>,
    given: Option<f64>,
) -> Vec<f64> {
    sd_by_point(model, take, given, |noise| noise.most)
}

/// [`by_point`], by these variances of what was measured.
fn sd_by_point(
    model: Option<(&PoseModel, ArrayView2<'_, f64>)>,
    take: &Take<'_>,
    given: Option<f64>,
    variances: impl Fn(TrackNoise) -> Vec<Option<f64>>,
) -> Vec<f64> {
    if let Some(noise) = given {
        return vec![noise; take.xyz.ncols() / 3];
    }
    let measured = variances(point_noise(take.xyz, take.runs)).into_iter();
    let measured: Vec<Option<f64>> = measured.map(|v| v.map(f64::sqrt)).collect();
    let mut known: Vec<f64> = measured.iter().flatten().copied().collect();
    if let Some((model, in_model)) = model.filter(|_| known.is_empty()) {
        let step = in_model.nrows().div_ceil(SAMPLED_FRAMES).max(1);
        known = (0..in_model.nrows())
            .step_by(step)
            .map(|t| of_frame(&model.estimator(), &in_model.row(t).to_vec()))
            .collect();
    }
    let median = median(known).unwrap_or(0.0);
    measured.into_iter().map(|m| m.unwrap_or(median)).collect()
}

/// The median over the points of a take of the noise that is measured over time
/// (`numeric::track_noise`), cm, if it is noise; 0 where none is measured. Repeated frames count
/// once.
pub fn typical_noise(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> f64 {
    let repeated = RepeatedFrames::of(xyz);
    let rows = repeated.rows(xyz);
    point_noise(rows.view(), &repeated.kept_runs(runs))
        .typical()
        .sqrt()
}

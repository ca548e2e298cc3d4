//! Denoising: captured values are changed to what they more likely were.
//!
//! Frame by frame, the model answers from all points, each trusted by its noise. In a take, a smoother first takes the
//! noise that neighbouring frames can tell from motion; what it leaves is what the model is told of.

use super::bound_model::BoundModel;
use super::complete::{self, Complete};
use super::frame_restorer::RestoredFrames;
use super::kalman_smoother;
use super::noise_estimation;
use super::outliers::{Outliers, leave_out};
use crate::numeric::parallel;
use crate::pose::Observation;
use crate::pose::Status;
use crate::prior::EXACT_VARIANCE;
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// Up to this noise of a smoothed coordinate, cm, a take tells its body's lengths well enough to hold poses to them.
const MEASURES: f64 = 0.3;

/// How noise is dealt with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Denoise {
    /// The standard deviation of a coordinate, cm; `None`: found from the take or the frame.
    pub noise: Option<f64>,
    /// Whether points that cannot be where they were captured count for nothing.
    pub outliers: bool,
    /// Whether missing points are filled in as well.
    pub fill: bool,
}

impl Default for Denoise {
    fn default() -> Self {
        Denoise {
            noise: None,
            outliers: true,
            fill: false,
        }
    }
}

/// One frame's answer.
struct Answer {
    found: Option<super::RestoredFrame>,
    outliers: Vec<usize>,
    noise: f64,
    /// Nats; see [`RestoredFrames::unlike`].
    unlike: f64,
}

impl Answer {
    /// What `restorer` found.
    fn new(
        restorer: &super::FrameRestorer<'_>,
        found: Option<super::RestoredFrame>,
        outliers: Vec<usize>,
        noise: f64,
    ) -> Answer {
        let judge = |f: &super::RestoredFrame| restorer.unlike(&f.mean, &f.placement);
        Answer {
            unlike: found.as_ref().map_or(f64::NAN, judge),
            found,
            outliers,
            noise,
        }
    }
}

/// Denoises frames each by itself (in the model's order).
///
/// Rigid distances tell how noisy most points of a frame are, if the model knows any: where that is little, or the others are
/// too far off for it, those are outliers. A noise that is given is that of every coordinate, or where it is little of clean ones.
pub fn frames(bound: &BoundModel, xyz: ArrayView2<'_, f64>, settings: Denoise) -> RestoredFrames {
    let answers = parallel::map_chunks(xyz.nrows(), 8, |range| {
        range
            .map(|t| one(bound, xyz.slice(s![t..t + 1, ..]), settings))
            .collect::<Vec<_>>()
    });
    gather(xyz, answers.into_iter().flatten(), settings)
}

fn one(bound: &BoundModel, frame: ArrayView2<'_, f64>, settings: Denoise) -> Answer {
    let y = frame.row(0).to_vec();
    if let Some(answer) = with_outliers(bound, &y, settings) {
        return answer;
    }
    let adapted = bound.prior_for(frame, settings.noise.unwrap_or(2.0));
    let restorer = bound.restorer(&adapted);
    // Distances tell it, where enough are seen; else the model has to.
    let noise = settings.noise.unwrap_or_else(|| {
        let noise_variance = bound.noise_floor_of(&y).map(|(_, base)| base.sd);
        noise_estimation::shared(
            noise_variance.unwrap_or_else(|| noise_estimation::of_frame(&restorer, &y)),
        )
    });
    let rigid = bound.treatment_for(&adapted, frame, noise);
    let restorer = restorer.with_rigid_model(&rigid);
    let variances: Vec<f64> = y
        .iter()
        .map(|v| noise_estimation::variance(*v, noise))
        .collect();
    let found = restorer.restore(&y, &variances);
    Answer::new(&restorer, found, Vec::new(), noise)
}

/// The answer for a frame most points of which are nearly clean, by the distances between them.
fn with_outliers(bound: &BoundModel, y: &[f64], settings: Denoise) -> Option<Answer> {
    if !settings.outliers {
        return None;
    }
    let (rigid, found) = bound.noise_floor_of(y)?;
    let base = match settings.noise {
        Some(noise) => (noise <= noise_estimation::NEARLY_CLEAN).then_some(noise)?,
        None => noise_estimation::worth_a_search(&found)
            .then_some(noise_estimation::shared(found.sd))?,
    };
    let own = bound.restorer(&None).with_rigid_model(rigid);
    // The distances have told whose lengths they may be: nothing is to be adapted but the placement's own.
    let (found, corrupt) = own.restore_outliers(y, base * base)?;
    let outliers = (0..corrupt.len()).filter(|&p| corrupt[p] > 0.5).collect();
    Some(Answer::new(&own, Some(found), outliers, base))
}

/// Denoises one take: `runs` are the stretches of frames that follow one another, `rate` frames a second.
pub fn take(
    bound: &BoundModel,
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
    settings: Denoise,
    done: &(dyn Fn(usize) + Sync),
) -> RestoredFrames {
    let rejects = match settings.outliers {
        true => Outliers::find(bound, xyz, runs, rate, settings.noise),
        false => Outliers::none(xyz.nrows()),
    };
    let mut counted = xyz.to_owned();
    leave_out(&mut counted, &rejects.points);
    let noise = noise_estimation::by_point(bound, counted.view(), runs, settings.noise);
    let usual = noise.iter().sum::<f64>() / noise.len().max(1) as f64;
    let (mean, variances) = smoothed(&counted, runs, rate, &noise, &rejects.spikes);
    let seen = mean_where_seen(&counted, &mean);
    let adapted = bound.prior_for(seen.view(), 0.0);
    let noise_left = left(&counted, &variances);
    let rigid = bound.treatment_for(&adapted, seen.view(), noise_left);
    let mut restorer = bound.restorer(&adapted);
    // Lengths measured through noise are all too long: kept, they would do more harm than good.
    if adapted.is_none() || noise_left <= MEASURES {
        restorer = restorer.with_rigid_model(&rigid);
    }
    let answers = parallel::map_chunks(xyz.nrows(), 8, |range| {
        let out: Vec<Answer> = range
            .clone()
            .map(|t| {
                let found =
                    smoothed_frame(&restorer, &mean.row(t).to_vec(), &variances.row(t).to_vec());
                Answer::new(&restorer, found, rejects.points[t].clone(), usual)
            })
            .collect();
        done(range.len());
        out
    });
    let mut out = gather(
        xyz,
        answers.into_iter().flatten(),
        Denoise {
            fill: false,
            ..settings
        },
    );
    if settings.fill {
        fill(bound, &mut out, runs, rate);
    }
    out
}

/// The answer for a smoothed frame. Points seen in part among whole ones count as missing, which costs no descent; what was
/// seen of them is as the smoother left it.
fn smoothed_frame(
    restorer: &super::FrameRestorer<'_>,
    y: &[f64],
    variances: &[f64],
) -> Option<super::RestoredFrame> {
    let seen = Observation {
        values: y,
        variance: variances,
    };
    let parts = seen.removable_partial_points();
    let mut found = restorer.restore(y, &seen.variance_without(&parts))?;
    let parts = parts.iter().flat_map(|p| 3 * p..3 * p + 3);
    for i in parts.filter(|&i| variances[i].is_finite()) {
        found.mean[i] = y[i];
    }
    Some(found)
}

/// Fills what is missing from the denoised points, as completing does: carried over from both ends of a gap.
fn fill(bound: &BoundModel, out: &mut RestoredFrames, runs: &[Range<usize>], rate: f64) {
    let filled = complete::take(
        bound,
        out.xyz.view(),
        runs,
        rate,
        Complete::default(),
        &|_| {},
    );
    for t in 0..out.xyz.nrows() {
        for p in 0..out.points() {
            if out.of_point(t, p).0 == Status::Unknown {
                let (status, sd) = filled.of_point(t, p);
                out.set(t, p, status, sd);
            }
        }
        if filled.unlike[t].is_finite() {
            out.unlike[t] = filled.unlike[t];
        }
    }
    out.xyz = filled.xyz;
}

/// The smoothed coordinates and their variances; infinite where the smoother cannot say more than the model.
fn smoothed(
    counted: &Array2<f64>,
    runs: &[Range<usize>],
    rate: f64,
    noise: &[f64],
    spikes: &[Vec<usize>],
) -> (Array2<f64>, Array2<f64>) {
    let columns = parallel::map_chunks(counted.ncols(), 1, |range| {
        let column = counted.column(range.start);
        let r = (noise[range.start / 3].powi(2)).max(EXACT_VARIANCE);
        let (mut mean, mut variance) = (column.to_vec(), vec![f64::INFINITY; column.len()]);
        for run in runs {
            let series = column.slice(s![run.clone()]).to_vec();
            let is_seen = series.iter().any(|v| v.is_finite());
            let out = kalman_smoother::smooth(&series, r, 1.0 / rate);
            for (k, t) in run.clone().enumerate() {
                // A missing value is the model's business: the smoother only guesses there.
                if series[k].is_finite() {
                    mean[t] = out.mean[k];
                    variance[t] = out.variance[k].clamp(EXACT_VARIANCE, r);
                } else if is_seen && spikes[t].contains(&(range.start / 3)) {
                    mean[t] = out.mean[k];
                    variance[t] = out.variance[k].max(EXACT_VARIANCE);
                }
            }
        }
        (mean, variance)
    });
    let (mut mean, mut variances) = (counted.clone(), counted.clone());
    for (i, (m, v)) in columns.into_iter().enumerate() {
        mean.column_mut(i).assign(&ndarray::Array1::from(m));
        variances.column_mut(i).assign(&ndarray::Array1::from(v));
    }
    (mean, variances)
}

/// The standard deviation of the noise that smoothing leaves, cm.
fn left(counted: &Array2<f64>, variances: &Array2<f64>) -> f64 {
    let both = counted.iter().zip(variances);
    let known = both
        .filter(|(c, v)| c.is_finite() && v.is_finite())
        .map(|b| b.1);
    let (sum, n) = known.fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
    (sum / n.max(1) as f64).sqrt()
}

fn mean_where_seen(counted: &Array2<f64>, mean: &Array2<f64>) -> Array2<f64> {
    let mut out = mean.clone();
    out.zip_mut_with(counted, |m, c| {
        if c.is_nan() {
            *m = f64::NAN;
        }
    });
    out
}

/// Puts the answers together.
fn gather(
    xyz: ArrayView2<'_, f64>,
    answers: impl Iterator<Item = Answer>,
    settings: Denoise,
) -> RestoredFrames {
    let mut out = RestoredFrames::of(xyz.to_owned());
    for (t, answer) in answers.enumerate() {
        out.too_little += usize::from(answer.found.is_none());
        out.noise += answer.noise / xyz.nrows() as f64;
        out.unlike[t] = answer.unlike;
        let before = xyz.row(t).to_vec();
        for p in 0..out.points() {
            let missing = before[3 * p..3 * p + 3].iter().any(|v| v.is_nan());
            let (status, sd) = match &answer.found {
                None if missing => (Status::Unknown, f64::NAN),
                None => (Status::Observed, answer.noise),
                Some(_) if missing && !settings.fill => (Status::Unknown, f64::NAN),
                Some(found) => {
                    for i in 3 * p..3 * p + 3 {
                        out.xyz[[t, i]] = found.mean[i];
                    }
                    let status = if missing {
                        Status::Inferred
                    } else if answer.outliers.contains(&p) {
                        Status::Rejected
                    } else if super::frame_restorer::moved(&before, &found.mean, p) <= 1e-9 {
                        Status::Observed
                    } else {
                        Status::Changed
                    };
                    (status, found.sd[p])
                }
            };
            out.set(t, p, status, sd);
        }
    }
    out
}

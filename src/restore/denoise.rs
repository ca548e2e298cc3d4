//! Denoising: measured points move to where they more likely were.
//!
//! A frame by itself is an observation whose coordinates all have the frame's noise variance; outliers are found by rigid
//! distances and the prior. In a take, spikes and outliers are removed first; a Kalman smoother then removes the noise that
//! neighboring frames reveal, and each smoothed frame is an observation with the variances that the smoother left.

use super::complete::Complete;
use super::frame_restorer::{FrameRestorer, RestoredFrame, displacement};
use super::kalman_smoother;
use super::loaded_model::LoadedModel;
use super::noise_estimation;
use super::outliers::{LIKELY, Outliers, remove};
use super::restored_frames::{BoundModel, Method, RestoredFrames};
use crate::numeric::parallel;
use crate::pose::{Observation, Status};
use crate::prior::EXACT_VARIANCE;
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// Up to this noise of a smoothed coordinate, cm, a take shows its body's lengths well enough to hold poses to them.
const MEASURES_LENGTHS: f64 = 0.3;
/// Noise assumed to measure the body of one frame by, cm, where none is given.
const UNKNOWN_NOISE: f64 = 2.0;
/// A point that moves by no more, cm, is unchanged.
const UNCHANGED: f64 = 1e-9;
/// Frames of one parallel task.
const CHUNK: usize = 8;

/// How to denoise.
#[derive(Debug, Clone, PartialEq)]
pub struct Denoise {
    /// Standard deviation of the noise of a coordinate, cm, outliers aside; `None`: estimated.
    pub noise: Option<f64>,
    /// Whether to detect and replace outliers.
    pub outliers: bool,
    /// Whether to fill missing points too.
    pub fill: bool,
    /// Frames a second, for a table without times.
    pub fps: Option<f64>,
    /// Restores each frame by itself, without its neighbors in time.
    pub per_frame: bool,
}

impl Default for Denoise {
    fn default() -> Self {
        Denoise {
            noise: None,
            outliers: true,
            fill: false,
            fps: None,
            per_frame: false,
        }
    }
}

impl Method for Denoise {
    fn frames(&self, bound: &BoundModel<'_>, xyz: ArrayView2<'_, f64>) -> RestoredFrames {
        let estimates = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
            range
                .map(|t| self.frame(bound.model, xyz.slice(s![t..t + 1, ..])))
                .collect::<Vec<_>>()
        });
        gather(xyz, estimates.into_iter().flatten(), self.fill)
    }

    fn take(
        &self,
        bound: &BoundModel<'_>,
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        rate: f64,
        done: &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames {
        let model = bound.model;
        let outliers = match self.outliers {
            true => Outliers::find(model, xyz, runs, rate, self.noise).0,
            false => Outliers::none(xyz.nrows()),
        };
        let mut clean = xyz.to_owned();
        remove(&mut clean, &outliers.points);
        let noise = noise_estimation::by_point(model, clean.view(), runs, self.noise);
        let typical = noise.iter().sum::<f64>() / noise.len().max(1) as f64;
        let smoothed = Smoothed::new(&clean, runs, rate, &noise, &outliers.spikes);
        let seen = smoothed.mean_where_seen(&clean);
        let noise_left = smoothed.noise_left(&clean);
        let adapted = model.adapt_prior(seen.view(), 0.0);
        let adapted = adapted.with_lengths_from(seen.view(), noise_left);
        // Lengths measured through noise are all too long: keeping them would do more harm than good.
        let keeps_lengths = adapted.is_own_body() || noise_left <= MEASURES_LENGTHS;
        let restorer = match keeps_lengths {
            true => adapted.rigid_restorer(),
            false => adapted.restorer(),
        };
        let estimates = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
            let estimate = |t: usize| {
                let (mean, variance) = (smoothed.mean.row(t), smoothed.variance.row(t));
                let found = restore_smoothed(&restorer, &mean.to_vec(), &variance.to_vec());
                Estimate::new(&restorer, found, outliers.points[t].clone(), typical)
            };
            let part: Vec<Estimate> = range.clone().map(estimate).collect();
            done(range.len());
            part
        });
        let mut out = gather(xyz, estimates.into_iter().flatten(), false);
        if self.fill {
            fill(bound, &mut out, runs, rate);
        }
        out
    }
}

/// The estimate of a frame.
struct Estimate {
    found: Option<RestoredFrame>,
    outliers: Vec<usize>,
    /// Standard deviation of a coordinate, cm.
    noise: f64,
    /// Nats; see [`RestoredFrames::novelty`].
    novelty: f64,
}

impl Estimate {
    /// An estimate by `restorer`.
    fn new(
        restorer: &FrameRestorer<'_>,
        found: Option<RestoredFrame>,
        outliers: Vec<usize>,
        noise: f64,
    ) -> Estimate {
        let novelty = |f: &RestoredFrame| restorer.novelty(&f.mean, &f.placement);
        Estimate {
            novelty: found.as_ref().map_or(f64::NAN, novelty),
            found,
            outliers,
            noise,
        }
    }
}

impl Denoise {
    /// Denoises one frame (1, 3 J).
    fn frame(&self, model: &LoadedModel, frame: ArrayView2<'_, f64>) -> Estimate {
        let y = frame.row(0).to_vec();
        let floor = model.noise_floor(&y);
        if let Some((rigid, floor)) = floor.as_ref().filter(|_| self.outliers) {
            // A noise that is given is that of clean points where it is small, and of all points otherwise.
            let noise = match self.noise {
                Some(noise) => (noise <= noise_estimation::NEARLY_CLEAN).then_some(noise),
                None => noise_estimation::is_worth_searching(floor)
                    .then(|| noise_estimation::rounded(floor.sd)),
            };
            // These distances fit the unknown body already: the model's own is not adapted.
            let own = model.unadapted();
            let restorer = own.restorer().with_rigid_model(rigid);
            let found = noise.and_then(|n| Some((n, restorer.restore_with_outliers(&y, n * n)?)));
            if let Some((noise, (found, probability))) = found {
                let outliers = (0..probability.len()).filter(|&p| probability[p] > LIKELY);
                return Estimate::new(&restorer, Some(found), outliers.collect(), noise);
            }
        }
        let adapted = model.adapt_prior(frame, self.noise.unwrap_or(UNKNOWN_NOISE));
        let noise = self.noise.unwrap_or_else(|| {
            let by_distances = floor.map(|(_, floor)| floor.sd);
            let by_model = || noise_estimation::of_frame(&adapted.restorer(), &y);
            noise_estimation::rounded(by_distances.unwrap_or_else(by_model))
        });
        let adapted = adapted.with_lengths_from(frame, noise);
        let restorer = adapted.rigid_restorer();
        let variances: Vec<f64> =
            (y.iter().map(|v| noise_estimation::variance(*v, noise))).collect();
        let found = restorer.restore(&y, &variances);
        Estimate::new(&restorer, found, Vec::new(), noise)
    }
}

/// Restores a smoothed frame. Points seen in part among whole ones count as missing, which saves a search for the placement;
/// what was seen of them stays as the smoother left it.
fn restore_smoothed(
    restorer: &FrameRestorer<'_>,
    y: &[f64],
    variances: &[f64],
) -> Option<RestoredFrame> {
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

/// Completes the denoised points of a take.
fn fill(bound: &BoundModel<'_>, out: &mut RestoredFrames, runs: &[Range<usize>], rate: f64) {
    let filled = Complete::default().take(bound, out.xyz.view(), runs, rate, &|_| {});
    for t in 0..out.xyz.nrows() {
        for p in 0..out.points() {
            if out.of_point(t, p).0 == Status::Unknown {
                let (status, sd) = filled.of_point(t, p);
                out.set(t, p, status, sd);
            }
        }
        if filled.novelty[t].is_finite() {
            out.novelty[t] = filled.novelty[t];
        }
    }
    out.xyz = filled.xyz;
}

/// The smoothed coordinates of a take.
struct Smoothed {
    /// (frames, 3 J), cm.
    mean: Array2<f64>,
    /// cm²; infinite where the smoother says no more than the model.
    variance: Array2<f64>,
}

impl Smoothed {
    /// Smooths each coordinate of `clean` by itself; `noise` is that of each point, cm. A missing coordinate is left to the
    /// model, but for `spikes`, whose path is known.
    fn new(
        clean: &Array2<f64>,
        runs: &[Range<usize>],
        rate: f64,
        noise: &[f64],
        spikes: &[Vec<usize>],
    ) -> Smoothed {
        let columns = parallel::map_chunks(clean.ncols(), 1, |range| {
            let column = clean.column(range.start);
            let r = (noise[range.start / 3].powi(2)).max(EXACT_VARIANCE);
            let (mut mean, mut variance) = (column.to_vec(), vec![f64::INFINITY; column.len()]);
            for run in runs {
                let series = column.slice(s![run.clone()]).to_vec();
                let is_seen = series.iter().any(|v| v.is_finite());
                let smooth = kalman_smoother::smooth(&series, r, 1.0 / rate);
                for (k, t) in run.clone().enumerate() {
                    if series[k].is_finite() {
                        mean[t] = smooth.mean[k];
                        variance[t] = smooth.variance[k].clamp(EXACT_VARIANCE, r);
                    } else if is_seen && spikes[t].contains(&(range.start / 3)) {
                        mean[t] = smooth.mean[k];
                        variance[t] = smooth.variance[k].max(EXACT_VARIANCE);
                    }
                }
            }
            (mean, variance)
        });
        let (mut mean, mut variance) = (clean.clone(), clean.clone());
        for (i, (m, v)) in columns.into_iter().enumerate() {
            mean.column_mut(i).assign(&ndarray::Array1::from(m));
            variance.column_mut(i).assign(&ndarray::Array1::from(v));
        }
        Smoothed { mean, variance }
    }

    /// The mean of the coordinates that are not missing in `clean`.
    fn mean_where_seen(&self, clean: &Array2<f64>) -> Array2<f64> {
        let mut out = self.mean.clone();
        out.zip_mut_with(clean, |m, c| {
            if c.is_nan() {
                *m = f64::NAN;
            }
        });
        out
    }

    /// Standard deviation of the noise that smoothing leaves, cm.
    fn noise_left(&self, clean: &Array2<f64>) -> f64 {
        let all = clean.iter().zip(&self.variance);
        let known = (all.filter(|(c, v)| c.is_finite() && v.is_finite())).map(|(_, v)| v);
        let (sum, n) = known.fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
        (sum / n.max(1) as f64).sqrt()
    }
}

/// The estimates of all frames put together; with `fill` also those of missing points.
fn gather(
    xyz: ArrayView2<'_, f64>,
    estimates: impl Iterator<Item = Estimate>,
    fill: bool,
) -> RestoredFrames {
    let mut out = RestoredFrames::of(xyz.to_owned());
    for (t, estimate) in estimates.enumerate() {
        out.too_little += usize::from(estimate.found.is_none());
        out.noise += estimate.noise / xyz.nrows() as f64;
        out.novelty[t] = estimate.novelty;
        let before = xyz.row(t).to_vec();
        for p in 0..out.points() {
            let is_missing = before[3 * p..3 * p + 3].iter().any(|v| v.is_nan());
            let (status, sd) = match &estimate.found {
                None if is_missing => (Status::Unknown, f64::NAN),
                None => (Status::Observed, estimate.noise),
                Some(_) if is_missing && !fill => (Status::Unknown, f64::NAN),
                Some(found) => {
                    for i in 3 * p..3 * p + 3 {
                        out.xyz[[t, i]] = found.mean[i];
                    }
                    let status = if is_missing {
                        Status::Inferred
                    } else if estimate.outliers.contains(&p) {
                        Status::Rejected
                    } else if displacement(&before, &found.mean, p) <= UNCHANGED {
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

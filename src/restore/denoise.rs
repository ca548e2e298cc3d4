//! Denoising: measured points move to where they more likely were.
//!
//! A frame by itself is an observation whose coordinates all have the frame's noise variance;
//! outliers are found by rigid distances and the prior. In a take, spikes and outliers are removed
//! first; a Kalman smoother then removes the noise that neighboring frames reveal, and each
//! smoothed frame is an observation with the variances that the smoother left.

use super::adaptive_smoothing::smooth_path;
use super::complete::{fill_gaps, is_known, put};
use super::frame_restorer::{FrameRestorer, RestoredFrame, displacement};
use super::gap::{FilledGap, Gap, find_gaps};
use super::loaded_model::{AdaptedModel, LoadedModel};
use super::noise_estimation;
use super::outliers::{LIKELY, Outliers, find_outliers, remove};
use super::restored_frames::{BoundModel, Method, RestoredFrames, Take};
use crate::numeric::parallel;
use crate::pose::{Observation, Status};
use crate::prior::EXACT_VARIANCE;
use glam::DVec3;
use ndarray::{Array1, Array2, ArrayView2, s};

/// Up to this noise of a smoothed coordinate, cm, a take shows its body's lengths well enough to
/// hold poses to them.
const MEASURES_LENGTHS: f64 = 0.3;
/// Noise assumed to measure the body of one frame by, cm, where none is given.
const UNKNOWN_NOISE: f64 = 2.0;
/// A point that moves by no more, cm, is unchanged.
const UNCHANGED: f64 = 1e-9;
/// The variance of a coordinate about the model's answer that the noise is weighed against, cm².
const MODEL_VARIANCE: f64 = 0.04;
/// The share of the noise's variance that trembles in the model's answers.
const ANSWERS_NOISE: f64 = 0.02;
/// The noise variance that motion without any reads as, cm².
const MOTION_VARIANCE: f64 = 2e-4;
/// The least noise variance that a path is smoothed by, cm².
const LEAST_VARIANCE: f64 = 1e-8;
/// An outlier this many standard deviations from where it is expected is none.
const FORGIVEN: f64 = 3.0;
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
    /// Longest gap to fill, in seconds; `None`: no limit. Needs a frame rate.
    pub max_gap: Option<f64>,
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
            max_gap: None,
            fps: None,
            per_frame: false,
        }
    }
}

impl Method for Denoise {
    fn frames(&self, bound: &BoundModel<'_>, table: ArrayView2<'_, f64>) -> RestoredFrames {
        if bound.is_mapped {
            // A model of another skeleton tells no noise from it.
            return RestoredFrames::captured(table);
        }
        let xyz = bound.gather(table);
        let estimates = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
            range
                .map(|t| self.frame(bound.model, xyz.slice(s![t..t + 1, ..])))
                .collect::<Vec<_>>()
        });
        let out = gather(xyz.view(), estimates.into_iter().flatten(), self.fill);
        bound.scatter(table, &out)
    }

    fn take(
        &self,
        bound: Option<&BoundModel<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames {
        // A model of another skeleton tells no noise from it.
        let bound = bound.filter(|bound| !bound.is_mapped);
        let (mut outliers, adapted) = match self.outliers {
            true => find_outliers(bound, take, self.noise),
            false => (Outliers::none(take.xyz.nrows()), None),
        };
        let mut smoothed = Smoothed::new(bound, take, &outliers.points, self.noise);
        if outliers.points != outliers.spikes {
            let gaps = find_gaps(smoothed.mean.view(), take.runs);
            let of_outliers = outliers.gaps(&gaps);
            let seen = smoothed.mean.view();
            let filled = fill_gaps(bound, adapted.as_ref(), take, seen, &of_outliers, &|_| ());
            if forgive(
                &mut outliers,
                take.xyz,
                &smoothed.noise,
                &of_outliers,
                &filled,
            ) {
                smoothed = Smoothed::new(bound, take, &outliers.points, self.noise);
            }
        }
        let mut out = RestoredFrames::captured(take.xyz);
        out.noise = smoothed.noise.iter().sum::<f64>() / smoothed.noise.len().max(1) as f64;
        let seen = smoothed.mean.view();
        let adapted = bound.map(|b| {
            let seen = b.gather(seen);
            let adapted = b.model.adapt_prior(seen.view(), 0.0);
            adapted.with_lengths_from(seen.view(), smoothed.noise_left())
        });
        out.take_alone = !is_known(bound, adapted.as_ref(), seen, smoothed.noise_left());
        let model = bound.zip(adapted.as_ref()).filter(|_| !out.take_alone);
        let answers = model.map(|(b, adapted)| Answers::new(b, adapted, &smoothed, take, done));
        put_denoised(&mut out, take, &smoothed, answers.as_ref());
        self.put_filled(&mut out, model, take, &outliers);
        out
    }
}

impl Denoise {
    /// Fills the outliers, and with [`Denoise::fill`] what was missing too.
    fn put_filled(
        &self,
        out: &mut RestoredFrames,
        model: Option<(&BoundModel<'_>, &AdaptedModel<'_>)>,
        take: &Take<'_>,
        outliers: &Outliers,
    ) {
        let mut seen = out.xyz.clone();
        remove(&mut seen, &outliers.points);
        let gaps = find_gaps(seen.view(), take.runs);
        let of_outliers = outliers.gaps(&gaps);
        let is_long = |g: &Gap| match self.max_gap {
            Some(longest) => g.frames.len() as f64 / take.rate > longest * (1.0 + 1e-9),
            None => false,
        };
        let is_filled = |g: &Gap| self.fill && !is_long(g);
        let gaps: Vec<Gap> = gaps
            .into_iter()
            .filter(|g| is_filled(g) || of_outliers.contains(g))
            .collect();
        if gaps.is_empty() {
            return;
        }
        let (bound, adapted) = model.unzip();
        let filled = fill_gaps(bound, adapted, take, seen.view(), &gaps, &|_| ());
        for (gap, filled) in gaps.iter().zip(&filled) {
            put(out, take.xyz, gap, filled.as_ref(), !is_filled(gap));
        }
    }
}

/// Takes outliers for good that are where the rest of the take expects them: within three standard
/// deviations of what was filled in. Returns whether there were any.
fn forgive(
    outliers: &mut Outliers,
    xyz: ArrayView2<'_, f64>,
    noise: &[f64],
    gaps: &[Gap],
    filled: &[Option<FilledGap>],
) -> bool {
    let mut is_any = false;
    for (gap, filled) in gaps.iter().zip(filled) {
        let Some(filled) = filled else { continue };
        for (k, t) in gap.frames.clone().enumerate() {
            let p = gap.point;
            let off = |axis: usize| (xyz[[t, 3 * p + axis]] - filled.xyz[[k, axis]]).powi(2);
            let expected = 3.0 * (filled.variance[k] + noise[p] * noise[p]);
            let is_spike = outliers.spikes[t].contains(&p);
            if !is_spike && (0..3).map(off).sum::<f64>() <= FORGIVEN * FORGIVEN * expected {
                outliers.points[t].retain(|q| *q != p);
                is_any = true;
            }
        }
    }
    is_any
}

/// The model's answers for the smoothed frames of a take, in the table's order of points.
struct Answers {
    /// (frames, 3 J), cm; NaN where the model says nothing.
    mean: Array2<f64>,
    /// (frames x J), cm.
    sd: Vec<f64>,
    /// Nats, one a frame.
    novelty: Vec<f64>,
    too_little: usize,
}

impl Answers {
    fn new(
        bound: &BoundModel<'_>,
        adapted: &AdaptedModel<'_>,
        smoothed: &Smoothed,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> Answers {
        let seen = bound.gather(smoothed.mean.view());
        let variance = bound.gather(smoothed.variance.view());
        // Lengths measured through noise are all too long: keeping them would do more harm than
        // good.
        let keeps_lengths = adapted.is_own_body() || smoothed.noise_left() <= MEASURES_LENGTHS;
        let restorer = match keeps_lengths {
            true => adapted.rigid_restorer(),
            false => adapted.restorer(),
        };
        let found = parallel::map_chunks(seen.nrows(), CHUNK, |range| {
            let restore = |t: usize| {
                let noise: Vec<f64> = (seen.row(t).iter().zip(variance.row(t)))
                    .map(|(y, v)| if y.is_finite() { *v } else { f64::INFINITY })
                    .collect();
                restore_smoothed(&restorer, &seen.row(t).to_vec(), &noise)
            };
            let part: Vec<_> = range.clone().map(restore).collect();
            done(range.len());
            part
        });
        let found: Vec<Option<RestoredFrame>> = found.into_iter().flatten().collect();
        let novelty = |f: &RestoredFrame| restorer.novelty(&f.mean, &f.placement);
        let offsets = personal_offsets(&seen, &found);
        let points = take.names.len();
        let mut out = Answers {
            mean: Array2::from_elem(take.xyz.dim(), f64::NAN),
            sd: vec![f64::NAN; take.xyz.nrows() * points],
            novelty: (found.iter())
                .map(|f| f.as_ref().map_or(f64::NAN, novelty))
                .collect(),
            too_little: found.iter().filter(|f| f.is_none()).count(),
        };
        for (t, found) in found.iter().enumerate() {
            let Some(found) = found else { continue };
            for (p, offset) in offsets.iter().enumerate() {
                let Some(column) = bound.in_table(p) else {
                    continue;
                };
                let mean = DVec3::from_slice(&found.mean[3 * p..]);
                let mean = mean + found.placement.rotation * *offset;
                (0..3).for_each(|axis| out.mean[[t, 3 * column + axis]] = mean[axis]);
                out.sd[t * points + column] = found.sd[p];
            }
        }
        out.smooth(take, &smoothed.noise);
        out
    }

    /// Smooths the answers over time: what is left of the noise trembles in them.
    fn smooth(&mut self, take: &Take<'_>, noise: &[f64]) {
        let columns = parallel::map_chunks(noise.len(), 1, |range| {
            let p = range.start;
            let path = [0, 1, 2].map(|axis| self.mean.column(3 * p + axis).to_vec());
            let views = [&path[0][..], &path[1][..], &path[2][..]];
            let r = (ANSWERS_NOISE * noise[p] * noise[p]).max(LEAST_VARIANCE);
            smooth_path(views, take.runs, r, 1.0 / take.rate)
        });
        for (i, smooth) in columns.into_iter().flatten().enumerate() {
            self.mean.column_mut(i).assign(&Array1::from(smooth.mean));
        }
    }
}

/// By how much a person's points are elsewhere than the model has them (J; cm, in the model's
/// directions): the mean over the frames of what was `seen` (frames, 3 J) less what was `found`.
fn personal_offsets(seen: &Array2<f64>, found: &[Option<RestoredFrame>]) -> Vec<DVec3> {
    let mut sums = vec![(DVec3::ZERO, 0.0); seen.ncols() / 3];
    for (row, found) in seen.outer_iter().zip(found) {
        let Some(found) = found else { continue };
        let row = row.to_vec();
        for (p, (sum, count)) in sums.iter_mut().enumerate() {
            let off = DVec3::from_slice(&row[3 * p..]) - DVec3::from_slice(&found.mean[3 * p..]);
            if off.is_finite() {
                *sum += found.placement.rotation.transpose() * off;
                *count += 1.0;
            }
        }
    }
    (sums.into_iter())
        .map(|(sum, count)| sum / f64::max(count, 1.0))
        .collect()
}

/// Puts smoothed points, drawn to the model's answers by as much as they are noisy, in place.
fn put_denoised(
    out: &mut RestoredFrames,
    take: &Take<'_>,
    smoothed: &Smoothed,
    answers: Option<&Answers>,
) {
    if let Some(answers) = answers {
        out.novelty.clone_from(&answers.novelty);
        out.too_little = answers.too_little;
    }
    let points = out.points();
    for t in 0..take.xyz.nrows() {
        for p in 0..points {
            if (3 * p..3 * p + 3).any(|i| smoothed.mean[[t, i]].is_nan()) {
                continue;
            }
            let r = smoothed.noise[p] * smoothed.noise[p];
            let answer = answers.filter(|a| a.mean[[t, 3 * p]].is_finite());
            let share = if answer.is_some() {
                r / (r + MODEL_VARIANCE)
            } else {
                0.0
            };
            let mut moved = 0.0;
            for i in 3 * p..3 * p + 3 {
                let answer = answer.map_or(0.0, |a| share * a.mean[[t, i]]);
                out.xyz[[t, i]] = (1.0 - share) * smoothed.mean[[t, i]] + answer;
                moved += (out.xyz[[t, i]] - take.xyz[[t, i]]).powi(2);
            }
            let sd = smoothed.variance[[t, 3 * p]].sqrt();
            let sd = answer.map_or(sd, |a| (1.0 - share) * sd + share * a.sd[t * points + p]);
            let status = match moved <= UNCHANGED * UNCHANGED {
                true => Status::Observed,
                false => Status::Changed,
            };
            out.set(t, p, status, sd);
        }
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
            // A noise that is given is that of clean points where it is small, and of all points
            // otherwise.
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

/// Restores a smoothed frame. Points seen in part among whole ones count as missing, which saves a
/// search for the placement; what was seen of them stays as the smoother left it.
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

/// A measured noise variance less what motion without noise reads as, cm²: a clean take stays as it
/// is.
fn beyond_motion(r: f64) -> f64 {
    r * r / (r + MOTION_VARIANCE)
}

/// The paths of a take, smoothed point by point, in the table's order of points.
struct Smoothed {
    /// (frames, 3 J), cm; NaN where a point is missing or an outlier.
    mean: Array2<f64>,
    /// (frames, 3 J), cm².
    variance: Array2<f64>,
    /// The noise of each point (J), cm.
    noise: Vec<f64>,
}

impl Smoothed {
    fn new(
        bound: Option<&BoundModel<'_>>,
        take: &Take<'_>,
        outliers: &[Vec<usize>],
        noise: Option<f64>,
    ) -> Smoothed {
        let mut clean = take.xyz.to_owned();
        remove(&mut clean, outliers);
        let in_model = bound.map(|b| b.gather(clean.view()));
        let model = bound.zip(in_model.as_ref());
        let model = model.map(|(b, in_model)| (b.model, in_model.view()));
        let noise = noise_estimation::by_point(model, clean.view(), take.runs, noise);
        let columns = parallel::map_chunks(noise.len(), 1, |range| {
            let p = range.start;
            let path = [0, 1, 2].map(|axis| clean.column(3 * p + axis).to_vec());
            let views = [&path[0][..], &path[1][..], &path[2][..]];
            let r = beyond_motion(noise[p] * noise[p]).max(LEAST_VARIANCE);
            let mut smooth = smooth_path(views, take.runs, r, 1.0 / take.rate);
            for (path, smooth) in path.iter().zip(&mut smooth) {
                for t in 0..path.len() {
                    if path[t].is_nan() {
                        (smooth.mean[t], smooth.variance[t]) = (f64::NAN, f64::NAN);
                    } else if smooth.mean[t].is_nan() {
                        // Seen in part: there is no path to smooth.
                        (smooth.mean[t], smooth.variance[t]) = (path[t], r);
                    }
                    smooth.variance[t] = smooth.variance[t].min(r);
                }
            }
            smooth
        });
        let mut out = Smoothed {
            mean: clean.clone(),
            variance: clean,
            noise,
        };
        for (i, smooth) in columns.into_iter().flatten().enumerate() {
            out.mean.column_mut(i).assign(&Array1::from(smooth.mean));
            (out.variance.column_mut(i)).assign(&Array1::from(smooth.variance));
        }
        out.variance.mapv_inplace(|v| v.max(EXACT_VARIANCE));
        out
    }

    /// Standard deviation of the noise that smoothing leaves, cm.
    fn noise_left(&self) -> f64 {
        let known = self
            .mean
            .iter()
            .zip(&self.variance)
            .filter(|(m, _)| m.is_finite());
        let (sum, n) = known.fold((0.0, 0usize), |(s, n), (_, v)| (s + v, n + 1));
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

//! The paths of a take smoothed as strongly as they bear, place by place.
//!
//! Kalman smoothers of many strengths (`kalman_smoother`) run side by side. Stein's unbiased
//! estimate says what each costs, at each frame t and over the point's three coordinates y:
//!
//! ```text
//! risk_q(t) = Σ [(y_t − m_q,t)² − r + 2 v_q,t]
//!     m, v the smoother's mean and variance, r the noise variance (cm²)
//! ```
//!
//! Averaged over the neighbors in time, these risks ρ_q weigh the strengths: w_q ∝ exp(−n ρ_q / 4
//! r), n the number of values averaged over. A planted foot is so smoothed more than the step
//! before it. The neighborhood is as wide as the best single strength needs: 8 λ^¼ frames, λ = r /
//! (q h³).

use super::kalman_smoother::{Smoothed, smooth};
use super::noise_estimation;
use super::take::{PointMapping, Take};
use super::tuning::adaptive_smoothing::*;
use crate::numeric::parallel;
use crate::prior::EXACT_VARIANCE;
use ndarray::{Array1, Array2, ArrayView2};
use std::ops::Range;

/// The paths of a take, smoothed point by point, in the table's order of points.
pub(crate) struct SmoothedTake {
    /// (frames, 3 J), cm; NaN where a point is missing.
    pub mean: Array2<f64>,
    /// (frames, 3 J), cm².
    pub variance: Array2<f64>,
    /// The noise of each point (J), cm.
    pub noise: Vec<f64>,
}

impl SmoothedTake {
    /// Smooths the paths of a take without outliers; `noise` is the standard deviation of a
    /// coordinate, cm, if known.
    pub(crate) fn new(
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        noise: Option<f64>,
    ) -> SmoothedTake {
        let in_model = mapping.map(|mapping| (mapping.model, mapping.gather(take.xyz)));
        let model = (in_model.as_ref()).map(|(model, seen)| (*model, seen.view()));
        let noise = noise_estimation::by_point(model, take, noise);
        let columns = parallel::map_chunks(noise.len(), 1, |range| {
            let path = path_of(take.xyz, range.start);
            // Less what motion without noise reads as: a clean take stays as it is.
            let r = noise[range.start] * noise[range.start];
            let r = (r * r / (r + MOTION_VARIANCE)).max(LEAST_VARIANCE);
            let mut smooth = smooth_path(&path, take.runs, r, 1.0 / take.rate);
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
        let mut out = SmoothedTake {
            mean: take.xyz.to_owned(),
            variance: take.xyz.to_owned(),
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
    pub(crate) fn noise_left(&self) -> f64 {
        let known = self
            .mean
            .iter()
            .zip(&self.variance)
            .filter(|(m, _)| m.is_finite());
        let (sum, n) = known.fold((0.0, 0usize), |(s, n), (_, v)| (s + v, n + 1));
        (sum / n.max(1) as f64).sqrt()
    }
}

/// The three coordinates of a point of `xyz` (frames, 3 J), one after the other.
pub(crate) fn path_of(xyz: ArrayView2<'_, f64>, point: usize) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| xyz.column(3 * point + axis).to_vec())
}

/// Smooths the coordinates of a point over its `runs`: `path` in cm, NaN where missing; noise
/// variance `r`, cm²; `step` seconds per frame. A run in which the point is never seen stays
/// missing.
pub(crate) fn smooth_path(
    path: &[Vec<f64>; 3],
    runs: &[Range<usize>],
    r: f64,
    step: f64,
) -> [Smoothed; 3] {
    let empty = || Smoothed {
        mean: vec![f64::NAN; path[0].len()],
        variance: vec![f64::INFINITY; path[0].len()],
    };
    let mut out = [empty(), empty(), empty()];
    for run in runs {
        let series = [0, 1, 2].map(|axis| &path[axis][run.clone()]);
        if series.iter().any(|s| s.iter().all(|v| v.is_nan())) {
            continue;
        }
        let smooth = smooth_run(series, r, step);
        for (out, smooth) in out.iter_mut().zip(smooth) {
            out.mean[run.clone()].copy_from_slice(&smooth.mean);
            out.variance[run.clone()].copy_from_slice(&smooth.variance);
        }
    }
    out
}

fn smooth_run(series: [&[f64]; 3], r: f64, step: f64) -> [Smoothed; 3] {
    let all: Vec<[Smoothed; 3]> = (DENSITIES.iter())
        .map(|q| series.map(|s| smooth(s, r, step, *q)))
        .collect();
    let risks: Vec<Vec<Option<f64>>> = all.iter().map(|one| risk(series, one, r)).collect();
    let total = |risk: &Vec<Option<f64>>| risk.iter().flatten().sum::<f64>();
    let best = (0..all.len()).min_by(|a, b| total(&risks[*a]).total_cmp(&total(&risks[*b])));
    let lambda = r / (DENSITIES[best.unwrap_or(0)] * step.powi(3));
    let width = (FRAMES * lambda.powf(0.25)).max(LEAST_FRAMES);
    let local: Vec<Vec<(f64, f64)>> = risks.iter().map(|risk| averages(risk, width)).collect();
    let mut out = [0, 1, 2].map(|_| Smoothed {
        mean: vec![0.0; series[0].len()],
        variance: vec![0.0; series[0].len()],
    });
    for t in 0..series[0].len() {
        let least = local.iter().map(|l| l[t].0).fold(f64::INFINITY, f64::min);
        let weight = |l: &Vec<(f64, f64)>| {
            let (risk, count) = l[t];
            (-(risk - least) * 3.0 * count / (SPREAD * r)).exp()
        };
        let weights: Vec<f64> = local.iter().map(weight).collect();
        let sum: f64 = weights.iter().sum();
        for (w, one) in weights.iter().zip(&all) {
            for (out, one) in out.iter_mut().zip(one) {
                out.mean[t] += w / sum * one.mean[t];
                out.variance[t] += w / sum * one.variance[t];
            }
        }
    }
    out
}

/// Stein's estimate of the squared error of a coordinate in each frame, the mean of three; `None`
/// where one is missing.
fn risk(series: [&[f64]; 3], smooth: &[Smoothed; 3], r: f64) -> Vec<Option<f64>> {
    let of = |t: usize| {
        let terms = (0..3).map(|c| {
            let rest = series[c][t] - smooth[c].mean[t];
            rest * rest - r + 2.0 * smooth[c].variance[t].min(r)
        });
        let sum: f64 = terms.sum();
        sum.is_finite().then_some(sum / 3.0)
    };
    (0..series[0].len()).map(of).collect()
}

/// The mean of the values around each place, weighted by exp(−|distance| / width), and how many
/// values that is worth.
fn averages(values: &[Option<f64>], width: f64) -> Vec<(f64, f64)> {
    let keep = (-1.0 / width).exp();
    let sums = |order: &mut dyn Iterator<Item = usize>| {
        let mut out = vec![(0.0, 0.0); values.len()];
        let (mut sum, mut count) = (0.0, 0.0);
        for t in order {
            (sum, count) = (sum * keep, count * keep);
            if let Some(v) = values[t] {
                (sum, count) = (sum + v, count + 1.0);
            }
            out[t] = (sum, count);
        }
        out
    };
    let forth = sums(&mut (0..values.len()));
    let back = sums(&mut (0..values.len()).rev());
    let both = forth.into_iter().zip(back).zip(values);
    both.map(|((a, b), v)| {
        let (own, one) = v.map_or((0.0, 0.0), |v| (v, 1.0));
        let (sum, count) = (a.0 + b.0 - own, a.1 + b.1 - one);
        // The sum of squared weights is half the sum of weights.
        (sum / count.max(1e-300), 2.0 * count)
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};

    /// One run of so many frames.
    fn whole(frames: usize) -> Vec<Range<usize>> {
        std::iter::once(0..frames).collect()
    }

    #[test]
    fn a_path_at_rest_is_smoothed_more_than_one_in_motion() {
        let mut generator = parallel::rng(4, 0);
        let noise = Normal::new(0.0, 0.3).unwrap();
        // At rest for five seconds, then swinging.
        let truth: Vec<f64> = (0..1200)
            .map(|t| match t {
                0..600 => 0.0,
                _ => 20.0 * (1.0 - ((t - 600) as f64 * 0.08).cos()),
            })
            .collect();
        let path = [0, 1, 2].map(|_| {
            let noisy = truth.iter().map(|x| x + noise.sample(&mut generator));
            noisy.collect::<Vec<f64>>()
        });
        let error = |smooth: &[f64], frames: Range<usize>| {
            let n = frames.len() as f64;
            (frames.map(|t| (smooth[t] - truth[t]).powi(2)).sum::<f64>() / n).sqrt()
        };
        let local = smooth_path(&path, &whole(1200), 0.09, 1.0 / 120.0);
        assert!(error(&local[0].mean, 30..550) <= 0.06);
        assert!(error(&local[0].mean, 650..1170) <= 0.2);
        // No single strength does both as well.
        let single = DENSITIES.map(|q| smooth(&path[0], 0.09, 1.0 / 120.0, q));
        let all = 0..1200;
        let best =
            (single.iter().map(|s| error(&s.mean, all.clone()))).fold(f64::INFINITY, f64::min);
        assert!(error(&local[0].mean, all.clone()) <= 0.95 * best);
    }

    #[test]
    fn missing_frames_are_bridged_and_what_is_never_seen_stays_missing() {
        let line: Vec<f64> = (0..60)
            .map(|t| {
                if (20..23).contains(&t) {
                    f64::NAN
                } else {
                    t as f64
                }
            })
            .collect();
        let smooth = smooth_path(&[0; 3].map(|_| line.clone()), &whole(60), 1e-4, 0.01);
        assert!((smooth[0].mean[21] - 21.0).abs() <= 0.01);
        assert!(smooth[0].variance[21] > smooth[0].variance[10]);
        let unseen = [line.clone(), vec![f64::NAN; 60], line];
        let smooth = smooth_path(&unseen, &whole(60), 1e-4, 0.01);
        assert!(smooth[0].mean[5].is_nan() && smooth[0].variance[5].is_infinite());
    }

    #[test]
    fn averages_fade_with_the_distance() {
        let mut values = vec![Some(1.0); 400];
        values[200] = Some(101.0);
        values[10] = None;
        let found = averages(&values, 10.0);
        assert!((found[0].0 - 1.0).abs() <= 1e-6);
        // Σ exp(−|d| / 10) is 20.02.
        assert!((found[200].0 - 1.0 - 100.0 / 20.0).abs() <= 0.02);
        assert!((found[200].1 - 40.0).abs() <= 0.1 && found[0].1 < 25.0);
    }
}

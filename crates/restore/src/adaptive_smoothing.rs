//! The paths of a take smoothed as strongly as they bear, value by value.
//!
//! Kalman smoothers of many strengths (`kalman_smoother`) run side by side. Stein's unbiased
//! estimate says what each costs, at each frame t and over the point's three coordinates y:
//!
//! ```text
//! risk_q(t) = Σ [(y_t − m_q,t)² − r + 2 v_q,t]
//!     m, v the smoother's mean and variance, r the noise variance (cm²)
//! ```
//!
//! That holds for noise that is correlated in time too: v is the covariance of the smoother's mean
//! with the noise, whatever the noise's own.
//!
//! Averaged over the neighbors in time, these risks ρ_q weigh the strengths: w_q ∝ exp(−n ρ_q / 4
//! r), n the number of values averaged over. A planted foot is so smoothed more than the step
//! before it. The neighborhood is as wide as the best single strength needs: 8 λ^¼ frames, λ = r /
//! (q h³).

use super::capture_noise::CaptureNoise;
use super::kalman_smoother::{PathNoise, smooth};
use super::take::{PointMapping, Take};
use super::tuning::adaptive_smoothing::*;
use crate::numeric::parallel;
use crate::prior::EXACT_VARIANCE;
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// The paths of a take, smoothed point by point, in the table's order of points.
pub(crate) struct SmoothedTake {
    /// (frames, 3 J), cm; NaN where a point is missing.
    pub mean: Array2<f64>,
    /// (frames, 3 J), cm².
    pub variance: Array2<f64>,
    /// The noise of the capture.
    pub noise: CaptureNoise,
}

impl SmoothedTake {
    /// Smooths the paths of a take without outliers; `noise` is the standard deviation of a
    /// coordinate, cm, if known.
    pub(crate) fn new(
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        noise: Option<f64>,
    ) -> SmoothedTake {
        let noise = CaptureNoise::measure(mapping, take, noise);
        let paths = parallel::map_chunks(noise.sd.len(), 1, |range| {
            let own = noise.of_path(range.start);
            let path = path_of(take.xyz, range.start);
            let mut smooth = smooth_path(&path, take.runs, own, 1.0 / take.rate);
            for axis in 0..3 {
                let (mean, variance) = (&mut smooth.mean[axis], &mut smooth.variance[axis]);
                for t in 0..path[axis].len() {
                    if path[axis][t].is_nan() {
                        (mean[t], variance[t]) = (f64::NAN, f64::NAN);
                    } else if mean[t].is_nan() {
                        // Seen in part: there is no path to smooth.
                        (mean[t], variance[t]) = (path[axis][t], own.variance);
                    }
                    variance[t] = variance[t].min(own.variance);
                }
            }
            smooth
        });
        let mut out = SmoothedTake {
            mean: take.xyz.to_owned(),
            variance: take.xyz.to_owned(),
            noise,
        };
        for (p, path) in paths.into_iter().enumerate() {
            put_path(&mut out.mean, p, &path.mean);
            put_path(&mut out.variance, p, &path.variance);
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

/// Writes the three coordinates of a point into `xyz` (frames, 3 J).
pub(crate) fn put_path(xyz: &mut Array2<f64>, point: usize, path: &[Vec<f64>; 3]) {
    for (axis, values) in path.iter().enumerate() {
        let mut column = xyz.column_mut(3 * point + axis);
        column.iter_mut().zip(values).for_each(|(to, v)| *to = *v);
    }
}

/// A smoothed path, with values at every frame.
pub(crate) struct SmoothedPath {
    /// The coordinates, cm; NaN in a run in which one is never seen.
    pub mean: [Vec<f64>; 3],
    /// Their variances, cm².
    pub variance: [Vec<f64>; 3],
}

/// Smooths the coordinates of a point over its `runs`: `path` in cm, NaN where missing; `step`
/// seconds per frame. A run in which the point is never seen stays missing.
pub(crate) fn smooth_path(
    path: &[Vec<f64>; 3],
    runs: &[Range<usize>],
    noise: PathNoise,
    step: f64,
) -> SmoothedPath {
    let all = |value: f64| [0, 1, 2].map(|_| vec![value; path[0].len()]);
    let mut out = SmoothedPath {
        mean: all(f64::NAN),
        variance: all(f64::INFINITY),
    };
    for run in runs {
        let series = [0, 1, 2].map(|axis| &path[axis][run.clone()]);
        if series.iter().any(|s| s.iter().all(|v| v.is_nan())) {
            continue;
        }
        smooth_run(series, noise, step, run.start, &mut out);
    }
    out
}

/// A path smoothed with one strength. The variance is that of all coordinates, where they are seen
/// in the same frames.
struct OneStrength {
    mean: [Vec<f64>; 3],
    variance: Vec<Vec<f64>>,
}

impl OneStrength {
    fn new(series: [&[f64]; 3], noise: PathNoise, step: f64, q: f64) -> OneStrength {
        let is_seen = |axis: usize, t: usize| series[axis][t].is_nan();
        let mut frames = 0..series[0].len();
        if frames.all(|t| is_seen(0, t) == is_seen(1, t) && is_seen(0, t) == is_seen(2, t)) {
            let all = smooth(series, noise, step, q);
            return OneStrength {
                mean: all.mean,
                variance: vec![all.variance],
            };
        }
        let mut variance = Vec::new();
        let mean = series.map(|series| {
            let smooth = smooth([series], noise, step, q);
            variance.push(smooth.variance);
            let [mean] = smooth.mean;
            mean
        });
        OneStrength { mean, variance }
    }

    fn variance(&self, axis: usize) -> &[f64] {
        &self.variance[axis.min(self.variance.len() - 1)]
    }
}

/// Smooths a run, and writes it from frame `first` on.
fn smooth_run(
    series: [&[f64]; 3],
    noise: PathNoise,
    step: f64,
    first: usize,
    out: &mut SmoothedPath,
) {
    let (r, a) = (noise.variance, noise.correlation);
    let all: Vec<OneStrength> = (DENSITIES.iter())
        .map(|q| OneStrength::new(series, noise, step, *q))
        .collect();
    let risks: Vec<Vec<Option<f64>>> = all.iter().map(|one| risk(series, one, r)).collect();
    let total = |risk: &Vec<Option<f64>>| risk.iter().flatten().sum::<f64>();
    let best = (0..all.len()).min_by(|a, b| total(&risks[*a]).total_cmp(&total(&risks[*b])));
    // What of the noise is slow decides how far one looks; squares of noise that is correlated are
    // worth fewer.
    let slow = r * (1.0 + a) / (1.0 - a);
    let worth = (1.0 - a * a) / (1.0 + a * a);
    let lambda = slow / (DENSITIES[best.unwrap_or(0)] * step.powi(3));
    let width = (FRAMES * lambda.powf(0.25)).max(LEAST_FRAMES);
    let local: Vec<Vec<(f64, f64)>> = risks.iter().map(|risk| averages(risk, width)).collect();
    for t in 0..series[0].len() {
        let least = local.iter().map(|l| l[t].0).fold(f64::INFINITY, f64::min);
        let weight = |l: &Vec<(f64, f64)>| {
            let (risk, count) = l[t];
            (-(risk - least) * 3.0 * worth * count / (SPREAD * r)).exp()
        };
        let weights: Vec<f64> = local.iter().map(weight).collect();
        let sum: f64 = weights.iter().sum();
        for axis in 0..3 {
            let mixed = |of: &dyn Fn(&OneStrength) -> f64| {
                let parts = weights.iter().zip(&all).map(|(w, one)| w * of(one));
                parts.sum::<f64>() / sum
            };
            out.mean[axis][first + t] = mixed(&|one| one.mean[axis][t]);
            out.variance[axis][first + t] = mixed(&|one| one.variance(axis)[t]);
        }
    }
}

/// Stein's estimate of the squared error of a coordinate in each frame, the mean of three; `None`
/// where one is missing.
fn risk(series: [&[f64]; 3], smooth: &OneStrength, r: f64) -> Vec<Option<f64>> {
    let of = |t: usize| {
        let terms = (0..3).map(|c| {
            let rest = series[c][t] - smooth.mean[c][t];
            rest * rest - r + 2.0 * smooth.variance(c)[t].min(r)
        });
        let sum: f64 = terms.sum();
        sum.is_finite().then_some(sum / 3.0)
    };
    (0..series[0].len()).map(of).collect()
}

/// The mean of the values around each frame, weighted by exp(−|distance| / width), and how many
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
        let white = PathNoise::white(0.09);
        let local = smooth_path(&path, &whole(1200), white, 1.0 / 120.0);
        assert!(error(&local.mean[0], 30..550) <= 0.06);
        assert!(error(&local.mean[0], 650..1170) <= 0.2);
        // No single strength does both as well.
        let single = DENSITIES.map(|q| smooth([&path[0]], white, 1.0 / 120.0, q));
        let all = 0..1200;
        let best =
            (single.iter().map(|s| error(&s.mean[0], all.clone()))).fold(f64::INFINITY, f64::min);
        assert!(error(&local.mean[0], all.clone()) <= 0.95 * best);
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
        let white = PathNoise::white(1e-4);
        let smooth = smooth_path(&[0; 3].map(|_| line.clone()), &whole(60), white, 0.01);
        assert!((smooth.mean[0][21] - 21.0).abs() <= 0.01);
        assert!(smooth.variance[0][21] > smooth.variance[0][10]);
        let unseen = [line.clone(), vec![f64::NAN; 60], line];
        let smooth = smooth_path(&unseen, &whole(60), white, 0.01);
        assert!(smooth.mean[0][5].is_nan() && smooth.variance[0][5].is_infinite());
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

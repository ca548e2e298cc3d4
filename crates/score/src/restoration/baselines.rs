//! The simple methods: linear interpolation, PCHIP, a Gaussian, a Butterworth filter.

use crate::damage::gaps::Gap;
use crate::numeric::linalg::Cholesky;
use crate::numeric::pchip::pchip;
use crate::restore::{LocalPoses, local_anchor};
use ndarray::{Array1, Array2, ArrayView2, Axis, s};
use std::f64::consts::{PI, SQRT_2};

/// Seconds on either side of a gap that PCHIP looks at.
const REACH: f64 = 1.0 / 6.0;
/// Variance of a predictor's noise in the Gaussian, cm².
const RIDGE: f64 = 0.01;

/// A gap to fill.
pub(super) struct CutGap<'a> {
    /// The names of the points (J).
    pub names: &'a [String],
    /// (n, 3 J), cm; NaN missing, the gap too.
    pub xyz: ArrayView2<'a, f64>,
    /// The gap.
    pub gap: &'a Gap,
    /// Frames a second.
    pub rate: f64,
}

impl CutGap<'_> {
    /// Straight lines between the ends; with one end, what is there. (frames of the gap, 3 points).
    pub(crate) fn linear(&self) -> Array2<f64> {
        let columns = self.gap.columns();
        Array2::from_shape_fn((self.gap.frames.len(), columns.len()), |(i, c)| {
            let at = |t: usize| self.xyz[[t, columns[c]]];
            let before = at(self.gap.frames.start - 1);
            if self.gap.frames.end < self.xyz.nrows() {
                before + (at(self.gap.frames.end) - before) * self.share(i)
            } else {
                before
            }
        })
    }

    /// How far frame `i` of the gap is from its start to its end, 0 to 1.
    fn share(&self, i: usize) -> f64 {
        (i + 1) as f64 / (self.gap.frames.len() + 1) as f64
    }

    /// PCHIP through the frames around; with one end, what is there.
    pub(crate) fn pchip(&self) -> Array2<f64> {
        if self.gap.frames.end >= self.xyz.nrows() {
            return self.linear();
        }
        let reach = (REACH * self.rate).round().max(2.0) as usize;
        let near = self.gap.frames.start.saturating_sub(reach)
            ..(self.gap.frames.end + reach).min(self.xyz.nrows());
        let at: Vec<f64> = self.gap.frames.clone().map(|t| t as f64).collect();
        let mut out = Array2::zeros((at.len(), 3 * self.gap.points.len()));
        for (c, column) in self.gap.columns().into_iter().enumerate() {
            let seen = |t: &usize| self.xyz[[*t, column]].is_finite();
            let frames: Vec<usize> = near.clone().filter(seen).collect();
            let x: Vec<f64> = frames.iter().map(|t| *t as f64).collect();
            let y: Vec<f64> = frames.iter().map(|t| self.xyz[[*t, column]]).collect();
            out.column_mut(c).assign(&Array1::from(pchip(&x, &y, &at)));
        }
        out
    }

    /// The conditional mean under one Gaussian of the take's own frames and, half and half, of
    /// `others` (of poses in the pelvis's frame), joined to both ends by a ramp. `None` where
    /// fewer than two frames are complete.
    pub(crate) fn gaussian(&self, others: Option<&Moments>) -> Option<Array2<f64>> {
        let is_seen = |t: usize, p: usize| self.xyz[[t, 3 * p]].is_finite();
        let predictors: Vec<usize> = (0..self.names.len())
            .filter(|p| {
                !self.gap.points.contains(p) && (0..self.xyz.nrows()).all(|t| is_seen(t, *p))
            })
            .collect();
        let frames: Vec<usize> = (0..self.xyz.nrows())
            .filter(|t| self.gap.points.iter().all(|p| is_seen(*t, *p)))
            .collect();
        let anchor = local_anchor(self.names, self.xyz, &predictors, &frames)?;
        let own = LocalPoses::new(&anchor, self.xyz, &predictors, &self.gap.points);
        let complete: Vec<usize> = frames.into_iter().filter(|t| own.is_complete(*t)).collect();
        if complete.len() < 2 {
            return None;
        }
        let joined = |poses: &LocalPoses, rows: &[usize]| {
            let both = [poses.predictors.view(), poses.targets.view()];
            // The shapes agree.
            ndarray::concatenate(Axis(1), &both)
                .map(|all| all.select(Axis(0), rows))
                .ok()
        };
        let mut moments = Moments::of(&joined(&own, &complete)?)?;
        if let (Some(others), Some(_)) = (others, anchor.root) {
            let points = predictors.iter().chain(&self.gap.points);
            let columns: Vec<usize> = points.flat_map(|p| 3 * p..3 * p + 3).collect();
            let others = others.select(&columns);
            moments.mean = (moments.mean + others.mean) / 2.0;
            moments.covariance = (moments.covariance + others.covariance) / 2.0;
        }
        let Moments { mean, covariance } = moments;
        let n = own.predictors.ncols();
        let mut seen = covariance.slice(s![..n, ..n]).to_owned();
        seen.diag_mut().mapv_inplace(|v| v + RIDGE);
        let gain = Cholesky::new(seen)?.solve(&covariance.slice(s![..n, n..]).to_owned())?;
        let estimate = |t: usize| {
            &mean.slice(s![n..]) + &(&own.predictors.row(t) - &mean.slice(s![..n])).dot(&gain)
        };
        let error = |t: usize| {
            let error = &own.targets.row(t) - &estimate(t);
            if error.iter().all(|e| e.is_finite()) {
                error
            } else {
                Array1::zeros(error.len())
            }
        };
        let before = error(self.gap.frames.start - 1);
        let after = if self.gap.frames.end < self.xyz.nrows() {
            error(self.gap.frames.end)
        } else {
            before.clone()
        };
        let mut out = Array2::zeros((self.gap.frames.len(), 3 * self.gap.points.len()));
        for (i, t) in self.gap.frames.clone().enumerate() {
            let share = self.share(i);
            let local = estimate(t) + &before * (1.0 - share) + &after * share;
            let placement = own.placements[t]?;
            for c in (0..local.len()).step_by(3) {
                let world = placement.apply([local[c], local[c + 1], local[c + 2]].into());
                (out[[i, c]], out[[i, c + 1]], out[[i, c + 2]]) = (world.x, world.y, world.z);
            }
        }
        Some(out)
    }
}

/// Mean and covariance of poses.
#[derive(Debug, Clone)]
pub(super) struct Moments {
    /// cm.
    mean: Array1<f64>,
    /// cm².
    covariance: Array2<f64>,
}

impl Moments {
    /// Those of the rows (n, coordinates); `None` without rows.
    pub(crate) fn of(rows: &Array2<f64>) -> Option<Moments> {
        let mean = rows.mean_axis(Axis(0))?;
        let centered = rows - &mean;
        let covariance = centered.t().dot(&centered) / (rows.nrows() as f64 - 1.0).max(1.0);
        Some(Moments { mean, covariance })
    }

    /// Those of some coordinates, in this order.
    fn select(&self, columns: &[usize]) -> Moments {
        Moments {
            mean: self.mean.select(Axis(0), columns),
            covariance: self
                .covariance
                .select(Axis(0), columns)
                .select(Axis(1), columns),
        }
    }
}

/// A Butterworth low-pass filter of second order, run forwards and backwards over each run of
/// known values, so that it has no lag. `cutoff` and `rate` in Hz, `cutoff` below half the rate.
pub(super) fn butterworth(values: &[f64], cutoff: f64, rate: f64) -> Vec<f64> {
    let mut out = values.to_vec();
    let mut t = 0;
    while t < out.len() {
        let end = (t..out.len())
            .find(|i| out[*i].is_nan())
            .unwrap_or(out.len());
        if end > t {
            let filtered = zero_lag(&out[t..end], cutoff, rate);
            out[t..end].copy_from_slice(&filtered);
        }
        t = end + 1;
    }
    out
}

/// Values reflected about their ends are filtered both ways.
fn zero_lag(y: &[f64], cutoff: f64, rate: f64) -> Vec<f64> {
    /// Frames of reflection: three times the filter's length.
    const PAD: usize = 9;
    let n = y.len();
    let pad = PAD.min(n - 1);
    let before = (1..=pad).rev().map(|i| 2.0 * y[0] - y[i]);
    let after = (1..=pad).map(|i| 2.0 * y[n - 1] - y[n - 1 - i]);
    let mut padded: Vec<f64> = before.chain(y.iter().copied()).chain(after).collect();
    for _ in 0..2 {
        low_pass(&mut padded, cutoff, rate);
        padded.reverse();
    }
    padded[pad..pad + n].to_vec()
}

/// The filter once (bilinear transform), from the steady state of the first value.
fn low_pass(values: &mut [f64], cutoff: f64, rate: f64) {
    let k = (PI * cutoff / rate).tan();
    let norm = 1.0 / (1.0 + SQRT_2 * k + k * k);
    let b = [k * k * norm, 2.0 * k * k * norm, k * k * norm];
    let a = [
        2.0 * (k * k - 1.0) * norm,
        (1.0 - SQRT_2 * k + k * k) * norm,
    ];
    let first = values.first().copied().unwrap_or(0.0);
    let mut z = [(1.0 - b[0]) * first, (b[2] - a[1]) * first];
    for value in values {
        let x = *value;
        let y = b[0] * x + z[0];
        z = [b[1] * x - a[0] * y + z[1], b[2] * x - a[1] * y];
        *value = y;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_keeps_slow_motion_and_halves_the_power_twice_at_its_cutoff() {
        let wave = |hz: f64| -> Vec<f64> {
            (0..1200)
                .map(|t| (2.0 * PI * hz * f64::from(t) / 120.0).sin())
                .collect()
        };
        let amplitude = |v: &[f64]| v[300..900].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        // |H|² = 1/2 at the cutoff, and the filter runs twice: the amplitude is halved.
        assert!((amplitude(&butterworth(&wave(6.0), 6.0, 120.0)) - 0.5).abs() < 0.01);
        let slow = wave(0.5);
        let kept = butterworth(&slow, 6.0, 120.0);
        assert!((300..900).all(|t| (kept[t] - slow[t]).abs() < 1e-3));
        let gappy: Vec<f64> = [1.0, f64::NAN, 2.0, 2.0].to_vec();
        let filtered = butterworth(&gappy, 6.0, 120.0);
        assert!(filtered[1].is_nan() && (filtered[0] - 1.0).abs() < 1e-9);
        assert!((filtered[3] - 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_linear_relation_is_found_by_the_gaussian() {
        let names: Vec<String> = ["a", "b", "c", "d", "e"].map(String::from).to_vec();
        // Three points stand still, two move together.
        let mut xyz = Array2::from_shape_fn((60, 15), |(t, c)| {
            let (p, s) = (c / 3, 4.0 * (t as f64 * 0.2).sin());
            let still = [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 40.0, 0.0]];
            let moving = [[60.0, 20.0, s], [10.0 + s, 20.0, 2.0 * s]];
            [&still[..], &moving[..]].concat()[p][c % 3]
        });
        let truth = xyz.clone();
        xyz.slice_mut(s![20..30, 12..]).fill(f64::NAN);
        let cut = CutGap {
            names: &names,
            xyz: xyz.view(),
            gap: &Gap {
                frames: 20..30,
                points: vec![4],
            },
            rate: 60.0,
        };
        let worst = |found: Array2<f64>| {
            (&found - &truth.slice(s![20..30, 12..]))
                .iter()
                .fold(0.0_f64, |m, e| m.max(e.abs()))
        };
        // The frame of reference is fitted to all predictors, so that the relation is not quite
        // linear.
        assert!(worst(cut.gaussian(None).unwrap()) < 0.1 * worst(cut.pchip()));
        assert!(worst(cut.linear()) > 1.0 && worst(cut.pchip()) < worst(cut.linear()));
    }
}

//! A gap filled by the point's own path: PCHIP, where the path is smooth enough.
//!
//! A point that rests on either side of a short gap rests in it. Else a path is smooth enough where
//! going straight on from one end misses the other by at most 4 cm, as in commercial practice.

use super::tuning::path::*;
use super::{FilledGap, Gap};
use crate::numeric::pchip::pchip;
use crate::pose::FillMethod;
use ndarray::{Array2, ArrayView2};
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// The variances of a coordinate in the middle of gaps of a take, by point and length (cm²):
/// simulated once each, as a take may have as many gaps as frames.
#[derive(Default)]
pub(crate) struct PathVariances(Mutex<HashMap<(usize, usize), f64>>);

impl PathVariances {
    /// How many were simulated.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    fn of(&self, track: &Track<'_>, length: usize) -> f64 {
        let all = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (track.point, length);
        let before = all().get(&key).copied();
        before.unwrap_or_else(|| {
            let variance = track.simulated_variance(length);
            all().insert(key, variance);
            variance
        })
    }
}

/// Fills `gap` of the captured frames (frames, 3 J) at `rate` frames a second; `variances` are
/// those of the take. `None` where it lacks an end or its path is not smooth enough.
pub(crate) fn interpolate(
    captured: ArrayView2<'_, f64>,
    gap: &Gap,
    rate: f64,
    variances: &PathVariances,
) -> Option<FilledGap> {
    let (before, after) = (gap.before?, gap.after?);
    let track = Track::new(captured, gap.point, rate);
    if track.miss(before, after)? > MISS {
        return None;
    }
    let middle = variances.of(&track, gap.frames.len());
    track.filled(gap, middle)
}

/// Fills `gap` where its point rests on either side, such as a foot that is planted: by its path.
/// `None` where it moves.
pub(crate) fn interpolate_rest(
    captured: ArrayView2<'_, f64>,
    gap: &Gap,
    rate: f64,
) -> Option<FilledGap> {
    let (before, after) = (gap.before?, gap.after?);
    let track = Track::new(captured, gap.point, rate);
    let rests = (REST_SECONDS * rate).ceil() as usize;
    let stays = |from: usize, frames: Range<usize>, within: f64| {
        let from = track.seen_at(from)?;
        let near = |t: usize| {
            let at = track.seen_at(t)?;
            let square = (0..3)
                .map(|axis| (at[axis] - from[axis]).powi(2))
                .sum::<f64>();
            (square <= within * within).then_some(())
        };
        frames.map(near).collect::<Option<()>>()
    };
    if gap.frames.len() as f64 > RESTS_SECONDS * rate || after + rests >= captured.nrows() {
        return None;
    }
    stays(before, before.checked_sub(rests)?..before, REST)?;
    stays(after, after + 1..after + rests + 1, REST)?;
    stays(before, after..after + 1, RESTS_WITHIN)?;
    track.filled(gap, RESTS_SD * RESTS_SD)
}

/// The path of one point.
struct Track<'a> {
    captured: ArrayView2<'a, f64>,
    point: usize,
    /// Frames on either side of a gap that count.
    reach: usize,
}

impl<'a> Track<'a> {
    fn new(captured: ArrayView2<'a, f64>, point: usize, rate: f64) -> Track<'a> {
        Track {
            captured,
            point,
            reach: ((REACH * rate).ceil() as usize).max(2),
        }
    }

    /// A gap filled by PCHIP; `middle` is the variance of a coordinate in its middle, cm².
    fn filled(&self, gap: &Gap, middle: f64) -> Option<FilledGap> {
        let n = gap.frames.len() as f64;
        let variance = (0..gap.frames.len()).map(|k| {
            let u = (k as f64 + 1.0) / (n + 1.0);
            middle * (4.0 * u * (1.0 - u)).powi(2)
        });
        Some(FilledGap {
            variance: variance.collect(),
            xyz: self.interpolated(&gap.frames)?,
            method: FillMethod::Interpolation,
            contacts: Vec::new(),
        })
    }

    fn is_seen(&self, t: usize) -> bool {
        self.seen_at(t).is_some()
    }

    fn seen_at(&self, t: usize) -> Option<[f64; 3]> {
        let at = [0, 1, 2].map(|axis| self.captured[[t, 3 * self.point + axis]]);
        at.iter().all(|v| v.is_finite()).then_some(at)
    }

    /// By how much going straight on from one end misses the other, cm: the smaller of both ways.
    /// `None` where neither end has a direction.
    fn miss(&self, before: usize, after: usize) -> Option<f64> {
        let way = |end: usize, inner: Option<usize>, other: usize| {
            let inner = inner?;
            let frames = end.abs_diff(other) as f64 / end.abs_diff(inner) as f64;
            let (at, inner, other_at) = (
                self.seen_at(end)?,
                self.seen_at(inner)?,
                self.seen_at(other)?,
            );
            let square = |axis: usize| {
                (at[axis] + (at[axis] - inner[axis]) * frames - other_at[axis]).powi(2)
            };
            Some((0..3).map(square).sum::<f64>().sqrt())
        };
        let from = before.saturating_sub(NEXT);
        let to = (after + 1 + NEXT).min(self.captured.nrows());
        let forth = (from..before).rev().find(|t| self.is_seen(*t));
        let back = (after + 1..to).find(|t| self.is_seen(*t));
        let (forth, back) = (way(before, forth, after), way(after, back, before));
        match (forth, back) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (one, other) => one.or(other),
        }
    }

    /// PCHIP through the frames around a gap (frames, 3).
    fn interpolated(&self, gap: &Range<usize>) -> Option<Array2<f64>> {
        let start = gap.start.saturating_sub(self.reach);
        let end = (gap.end + self.reach).min(self.captured.nrows());
        let frames: Vec<usize> = (start..gap.start)
            .chain(gap.end..end)
            .filter(|t| self.is_seen(*t))
            .collect();
        let x: Vec<f64> = frames.iter().map(|t| *t as f64).collect();
        let at: Vec<f64> = gap.clone().map(|t| t as f64).collect();
        let mut out = Array2::zeros((gap.len(), 3));
        for axis in 0..3 {
            let y: Vec<f64> = frames
                .iter()
                .map(|t| self.captured[[*t, 3 * self.point + axis]])
                .collect();
            let values = pchip(&x, &y, &at);
            out.column_mut(axis)
                .iter_mut()
                .zip(values)
                .for_each(|(o, v)| *o = v);
        }
        out.iter().all(|v: &f64| v.is_finite()).then_some(out)
    }

    /// The variance of a coordinate in the middle of gaps of a length, by gaps simulated where the
    /// point is seen, cm². With no room for one, that of a path that misses as far as is
    /// allowed.
    fn simulated_variance(&self, length: usize) -> f64 {
        let last = self.captured.nrows();
        let mut seen = 0;
        let mut starts = Vec::new();
        for t in 0..last {
            seen = if self.is_seen(t) { seen + 1 } else { 0 };
            if seen >= length + 4 {
                starts.push(t - length - 1);
            }
        }
        let step = starts.len().div_ceil(SIMULATED).max(1);
        let errors: Vec<f64> = starts
            .iter()
            .step_by(step)
            .filter_map(|&start| {
                let middle = length / 2;
                let found = self.interpolated(&(start..start + length))?;
                let truth = self.seen_at(start + middle)?;
                Some(
                    (0..3)
                        .map(|axis| (found[[middle, axis]] - truth[axis]).powi(2))
                        .sum::<f64>()
                        / 3.0,
                )
            })
            .collect();
        match errors.len() {
            0 => (0.5 * MISS).powi(2),
            n => (errors.iter().sum::<f64>() / n as f64).max(1e-6),
        }
    }
}

//! The estimates of a gap's points: those of each process of the regression, and over time PCHIP
//! and a cubic that meets both ends with the velocities there (`numeric::hermite`).
//!
//! What a regression misses at the gap's ends is known there; it is carried into the gap by the
//! mean of a ramp and of PCHIP, and where the gap has one end only, it fades within [`FADES`].

use super::regression::{Learned, Prediction, Regression, Wanted};
use super::tuning::{estimates::*, path::REACH};
use crate::numeric::{hermite::hermite, pchip::pchip};
use ndarray::{Array1, Array2, ArrayView2};
use std::ops::Range;

/// The points that are to be estimated together, in one or more gaps.
pub(crate) struct Targets<'a> {
    /// What they are regressed on.
    pub regression: &'a Regression<'a>,
    /// The captured table (frames, 3 J), world space.
    pub captured: ArrayView2<'a, f64>,
    /// The targets' columns: three each.
    pub columns: &'a [usize],
}

/// The estimates for some frames of a gap, in the regression's frame of reference.
#[derive(Debug, Clone)]
pub(crate) struct Estimates {
    /// One (frames, 3 T) a process; then those over time, PCHIP and Hermite, if the gap has two
    /// ends.
    pub means: Vec<Array2<f64>>,
    /// (frames, 3 T), cm²: the mean of the processes that know time, and the variance of the
    /// estimates about their mean. They disagree most where the take has seen nothing alike.
    pub variance: Array2<f64>,
}

/// A gap and the frames in it that are to be estimated.
#[derive(Debug, Clone)]
pub(crate) struct GapFrames {
    /// The frames that are not known.
    pub gap: Range<usize>,
    /// Those of them to estimate, in order.
    pub frames: Vec<usize>,
}

/// Some rows of what is predicted.
fn rows_of<'a>(all: &'a Array2<f64>, rows: &Range<usize>) -> ArrayView2<'a, f64> {
    all.slice(ndarray::s![rows.clone(), ..])
}

/// The variance of estimates (frames, 3 T) about their mean, cm².
fn spread_of(means: &[Array2<f64>]) -> Array2<f64> {
    let n = means.len() as f64;
    let zero = Array2::zeros(means[0].dim());
    let mean = means.iter().fold(zero.clone(), |sum, m| sum + m) / n;
    (means.iter()).fold(zero, |sum, m| sum + (m - &mean).mapv(|v| v * v)) / n
}

impl Targets<'_> {
    /// The estimates for `gaps`: the one that was learned for, or those simulated for it. `None`
    /// where they have no frame of reference.
    pub(crate) fn estimates(
        &self,
        learned: &Learned,
        gaps: &[GapFrames],
        is_simulated: bool,
    ) -> Option<Vec<Estimates>> {
        let hidden: Vec<Range<usize>> = gaps.iter().map(|w| w.gap.clone()).collect();
        let beside: Vec<Vec<usize>> = hidden.iter().map(|g| self.beside(g, &hidden)).collect();
        let frames: Vec<usize> = gaps.iter().flat_map(|w| w.frames.clone()).collect();
        let wanted = Wanted {
            frames: &frames,
            beside: &beside.concat(),
            is_simulated,
        };
        let predictions = learned.predict(self.regression, &wanted)?;
        let (mut first, mut first_beside) = (0, 0);
        let mut out = Vec::new();
        for (gap, beside) in gaps.iter().zip(&beside) {
            let rows = first..first + gap.frames.len();
            let rows_beside = first_beside..first_beside + beside.len();
            (first, first_beside) = (rows.end, rows_beside.end);
            let of_gap = |p: &Prediction| {
                let errors = self.known(beside) - rows_of(&p.beside, &rows_beside);
                rows_of(&p.mean, &rows).to_owned() + self.bridge(gap, beside, &errors)
            };
            let mut means: Vec<Array2<f64>> = predictions.iter().map(of_gap).collect();
            let mut variance = Array2::zeros(means[0].dim());
            let timed = predictions.iter().filter(|p| !p.variance.is_empty());
            let count = timed.clone().count().max(1) as f64;
            timed.for_each(|p| variance += &rows_of(&p.variance, &rows));
            variance /= count;
            variance += &(spread_of(&means) * DISAGREE);
            means.extend(self.over_time(gap, &hidden).into_iter().flatten());
            out.push(Estimates { means, variance });
        }
        Some(out)
    }

    /// How fast the targets move beside a gap, cm a frame; NaN where it is not seen.
    pub(crate) fn speed_beside(&self, gap: &Range<usize>) -> f64 {
        let reach = ((SPEED_REACH * self.regression.rate).round() as usize).max(1);
        let before = gap.start.checked_sub(1 + reach);
        let after = Some(gap.end).filter(|t| t + reach < self.captured.nrows());
        let sides = before.into_iter().chain(after);
        let speeds = sides.map(|t| {
            let moved =
                |c: &usize| (self.captured[[t + reach, *c]] - self.captured[[t, *c]]).powi(2);
            self.columns.iter().map(moved).sum::<f64>().sqrt() / reach as f64
        });
        let known: Vec<f64> = speeds.filter(|v| v.is_finite()).collect();
        known.iter().sum::<f64>() / known.len() as f64
    }

    /// The targets in complete frames, (frames, 3 T).
    fn known(&self, frames: &[usize]) -> Array2<f64> {
        self.regression.own.targets.select(ndarray::Axis(0), frames)
    }

    /// Complete frames next to a gap, in order, none in any gap.
    fn beside(&self, gap: &Range<usize>, gaps: &[Range<usize>]) -> Vec<usize> {
        let is_known =
            |t: &usize| self.regression.complete[*t] && !gaps.iter().any(|g| g.contains(t));
        self.around(gap, ERROR_REACH).filter(is_known).collect()
    }

    /// Frames of the gap's run around it, up to some seconds away; at least one on each side.
    fn around(&self, gap: &Range<usize>, seconds: f64) -> impl Iterator<Item = usize> + use<> {
        let all = self.regression.seconds;
        let reach = seconds.max(1.01 / self.regression.rate) * (1.0 + 1e-9);
        let start = all.partition_point(|s| *s < all[gap.start] - reach);
        let end = all.partition_point(|s| *s <= all[gap.end - 1] + reach);
        (start..gap.start).chain(gap.end..end)
    }

    /// Errors that are known beside a gap, carried to the wanted frames (n, 3 T).
    fn bridge(&self, wanted: &GapFrames, beside: &[usize], errors: &Array2<f64>) -> Array2<f64> {
        let seconds = self.regression.seconds;
        let at: Vec<f64> = wanted.frames.iter().map(|&t| seconds[t]).collect();
        let x: Vec<f64> = beside.iter().map(|&t| seconds[t]).collect();
        let before = beside.partition_point(|t| *t < wanted.gap.start);
        let ends = (
            before.checked_sub(1),
            (before < beside.len()).then_some(before),
        );
        let mut out = Array2::zeros((at.len(), errors.ncols()));
        for (c, mut column) in out.columns_mut().into_iter().enumerate() {
            let e = errors.column(c).to_vec();
            let carried: Vec<f64> = match ends {
                (Some(a), Some(b)) => {
                    let smooth = pchip(&x, &e, &at);
                    let ramp = |t: &f64| e[a] + (e[b] - e[a]) * (t - x[a]) / (x[b] - x[a]);
                    at.iter()
                        .zip(smooth)
                        .map(|(t, s)| 0.5 * (ramp(t) + s))
                        .collect()
                }
                (Some(k), None) | (None, Some(k)) => at
                    .iter()
                    .map(|t| e[k] * (-(t - x[k]).abs() / FADES).exp())
                    .collect(),
                (None, None) => continue,
            };
            column.iter_mut().zip(carried).for_each(|(o, v)| *o = v);
        }
        out
    }

    /// PCHIP and Hermite in world space between the frames around a gap, in the frame of reference;
    /// `None` where the gap lacks an end.
    fn over_time(&self, wanted: &GapFrames, gaps: &[Range<usize>]) -> Option<[Array2<f64>; 2]> {
        let seconds = self.regression.seconds;
        let at: Vec<f64> = wanted.frames.iter().map(|&t| seconds[t]).collect();
        let mut out = [(); 2].map(|()| Array2::zeros((at.len(), self.columns.len())));
        for (c, &column) in self.columns.iter().enumerate() {
            let is_seen = |t: &usize| {
                self.captured[[*t, column]].is_finite() && !gaps.iter().any(|g| g.contains(t))
            };
            let around: Vec<usize> = self.around(&wanted.gap, REACH).filter(is_seen).collect();
            let before = around.partition_point(|t| *t < wanted.gap.start);
            if before == 0 || before == around.len() {
                return None;
            }
            let x: Vec<f64> = around.iter().map(|&t| seconds[t]).collect();
            let y: Vec<f64> = around.iter().map(|&t| self.captured[[t, column]]).collect();
            let step = 1.0 / self.regression.rate;
            let both = [pchip(&x, &y, &at), hermite(&x, &y, before, &at, step)];
            for (out, values) in out.iter_mut().zip(both) {
                out.column_mut(c).assign(&Array1::from(values));
            }
        }
        for out in &mut out {
            for (t, mut row) in wanted.frames.iter().zip(out.outer_iter_mut()) {
                let placement = self.regression.own.placements[*t]?;
                for c in (0..row.len()).step_by(3) {
                    let local = placement.undo([row[c], row[c + 1], row[c + 2]].into());
                    (row[c], row[c + 1], row[c + 2]) = (local.x, local.y, local.z);
                }
            }
        }
        Some(out)
    }
}

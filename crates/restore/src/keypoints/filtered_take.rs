//! A take whose tracks are filtered, and the noise that they show.

use super::bands::Filtered;
use super::line_of_sight::noise_axes;
use super::put;
use crate::numeric::parallel;
use crate::numeric::statistics::median;
use crate::pose::{point_at, ranges};
use crate::take::Take;
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};
use std::ops::Range;

/// Filtered tracks, along the axes of their noise.
pub(super) struct FilteredTake {
    /// The axes, as columns; the last is the line of sight.
    pub axes: DMat3,
    /// The points, and their stretches of frames with values, within the runs.
    pub pieces: Vec<(usize, Range<usize>)>,
    /// The median over these of the variance of the fast noise along each axis, cm².
    pub variance: DVec3,
    filtered: Vec<Option<Filtered>>,
}

impl FilteredTake {
    /// Filters the points of a take that are at `xyz` (frames, 3 J); `None` where no stretch is
    /// long enough.
    pub(super) fn of(xyz: ArrayView2<'_, f64>, take: &Take<'_>) -> Option<FilteredTake> {
        let axes = noise_axes(xyz, take.runs);
        let of_point = |p: usize| {
            let is_known = move |t: &usize| point_at(xyz, *t, p).is_finite();
            let of_run = move |run: &Range<usize>| ranges(run.clone().filter(is_known));
            let all = take.runs.iter().flat_map(of_run);
            all.map(move |frames| (p, frames)).collect::<Vec<_>>()
        };
        let pieces: Vec<_> = (0..xyz.ncols() / 3).flat_map(of_point).collect();
        let filtered = parallel::map_chunks(pieces.len(), 1, |chunk| {
            let (p, frames) = &pieces[chunk.start];
            let at = |t: usize| axes.transpose() * point_at(xyz, t, *p);
            Filtered::of(frames.clone().map(at).collect(), take.rate)
        });
        let variances = || filtered.iter().flatten().map(|f| f.variance);
        let along = |axis: usize| median(variances().map(|v| v[axis]).collect());
        let variance = DVec3::new(along(0)?, along(1)?, along(2)?);
        Some(FilteredTake {
            axes,
            pieces,
            variance,
            filtered,
        })
    }

    /// Writes the filtered values.
    pub(super) fn put(&self, xyz: &mut Array2<f64>) {
        for ((p, frames), filtered) in self.pieces.iter().zip(&self.filtered) {
            let values = filtered.iter().flat_map(|f| &f.values);
            for (t, at) in frames.clone().zip(values) {
                put(xyz, t, *p, self.axes * *at);
            }
        }
    }

    /// The covariance of the fast noise, cm².
    pub(super) fn covariance(&self) -> DMat3 {
        self.axes * DMat3::from_diagonal(self.variance) * self.axes.transpose()
    }
}

//! What the model expects in the smoothed frames of a take.

use super::adapted_prior::AdaptedPrior;
use super::adaptive_smoothing::{SmoothedTake, path_of, put_path, smooth_path};
use super::frame_estimator::{FrameEstimate, FrameEstimator};
use super::kalman_smoother::PathNoise;
use super::knots::Knots;
use super::take::{FRAMES_PER_TASK, Take};
use super::tuning::{adaptive_smoothing::LEAST_VARIANCE, model_estimates::*};
use crate::numeric::parallel;
use crate::numeric::statistics::mean_of_finite;
use crate::pose::{Observation, point_at};
use glam::DVec3;
use ndarray::{Array2, Axis};

/// The model's estimates of the smoothed frames of a take, in the table's order of points.
pub(crate) struct ModelEstimates {
    /// (frames, 3 J), cm; NaN where the model says nothing.
    pub mean: Array2<f64>,
    /// (frames x J), cm.
    pub sd: Vec<f64>,
    /// Nats, one per frame: that of the nearest frame that was estimated.
    pub novelty: Vec<f64>,
    /// Frames with too little seen to estimate them.
    pub too_little: usize,
}

impl ModelEstimates {
    /// Estimates the frames of [`Knots`], moves their points by the person's own offsets,
    /// corrects the frames between as those beside them, and smooths over time.
    pub(crate) fn new(
        adapted: &AdaptedPrior<'_>,
        smoothed: &SmoothedTake,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> ModelEstimates {
        let at_knots = KnotEstimates::new(adapted, smoothed, take, done);
        let mut out = ModelEstimates {
            mean: Array2::from_elem(take.xyz.dim(), f64::NAN),
            sd: vec![f64::NAN; take.xyz.nrows() * take.names.len()],
            novelty: vec![f64::NAN; take.xyz.nrows()],
            too_little: 0,
        };
        for t in 0..take.xyz.nrows() {
            at_knots.put(adapted, t, &mut out);
        }
        out.smooth(smoothed, take);
        out
    }

    /// Smooths the estimates: what is left of the noise trembles in them.
    fn smooth(&mut self, smoothed: &SmoothedTake, take: &Take<'_>) {
        let paths = parallel::map_chunks(take.names.len(), 1, |range| {
            let p = range.start;
            let own = smoothed.noise.of_path(p);
            let left = PathNoise {
                variance: (SHARE_LEFT * own.variance).max(LEAST_VARIANCE),
                ..own
            };
            let path = path_of(self.mean.view(), p);
            smooth_path(&path, take.runs, left, 1.0 / take.rate)
        });
        for (p, path) in paths.into_iter().enumerate() {
            put_path(&mut self.mean, p, &path.mean);
        }
    }

    /// The mean over the points of each frame of the variance of a coordinate, cm²; NaN where
    /// nothing is estimated.
    pub(crate) fn mean_variances(&self) -> Vec<f64> {
        let of_frame = |sd: &[f64]| mean_of_finite(sd.iter().map(|sd| sd * sd)).unwrap_or(f64::NAN);
        let points = self.mean.ncols() / 3;
        self.sd.chunks_exact(points.max(1)).map(of_frame).collect()
    }
}

/// What the model finds in the frames of [`Knots`], in its own order of points.
struct KnotEstimates {
    knots: Knots,
    /// The smoothed frames of the take (frames, 3 J), cm.
    seen: Array2<f64>,
    /// By knot.
    found: Vec<Option<FrameEstimate>>,
    /// Nats, by knot.
    novelty: Vec<f64>,
    /// See [`personal_offsets`].
    offsets: Vec<DVec3>,
}

impl KnotEstimates {
    fn new(
        adapted: &AdaptedPrior<'_>,
        smoothed: &SmoothedTake,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> KnotEstimates {
        let seen = adapted.mapping.gather(smoothed.mean.view());
        let variance = adapted.mapping.gather(smoothed.variance.view());
        // Lengths measured through noise are all too long: keeping them would do more harm than
        // good.
        let keeps_lengths = adapted.is_own_body() || smoothed.noise_left() <= MEASURES_LENGTHS;
        let estimator = if keeps_lengths {
            adapted.rigid_estimator()
        } else {
            adapted.estimator()
        };
        let knots = Knots::new(seen.nrows(), take.runs, take.rate);
        let found = parallel::map_chunks(knots.frames.len(), FRAMES_PER_TASK, |range| {
            let estimate = |t: &usize| {
                let noise: Vec<f64> = (seen.row(*t).iter().zip(variance.row(*t)))
                    .map(|(y, v)| if y.is_finite() { *v } else { f64::INFINITY })
                    .collect();
                estimate_smoothed(&estimator, &seen.row(*t).to_vec(), &noise)
            };
            let part: Vec<_> = knots.frames[range.clone()].iter().map(estimate).collect();
            let until = |k: usize| k * seen.nrows() / knots.frames.len();
            done(until(range.end) - until(range.start));
            part
        });
        let found: Vec<Option<FrameEstimate>> = found.into_iter().flatten().collect();
        let novelty = |f: &FrameEstimate| estimator.novelty(&f.mean, &f.placement);
        KnotEstimates {
            novelty: (found.iter())
                .map(|f| f.as_ref().map_or(f64::NAN, novelty))
                .collect(),
            offsets: personal_offsets(&seen.select(Axis(0), &knots.frames), &found),
            knots,
            seen,
            found,
        }
    }

    /// Writes the estimate of a frame.
    fn put(&self, adapted: &AdaptedPrior<'_>, t: usize, out: &mut ModelEstimates) {
        let is_any_seen = self.seen.row(t).iter().any(|v| v.is_finite());
        let nearest = (self.knots)
            .nearest(t, |k| self.found[k].is_some())
            .filter(|_| is_any_seen);
        let Some(near) = nearest else {
            out.too_little += 1;
            return;
        };
        out.novelty[t] = self.novelty[near];
        let points = out.mean.ncols() / 3;
        for (p, in_table) in adapted.mapping.pairs() {
            let correction = |k: usize| {
                let found = self.found[k].as_ref()?;
                let mean = DVec3::from_slice(&found.mean[3 * p..]);
                let seen = point_at(self.seen.view(), self.knots.frames[k], p);
                Some(mean + found.placement.rotation * self.offsets[p] - seen)
                    .filter(|c| c.is_finite())
            };
            let Some(by) = self.knots.between(t, correction, DVec3::lerp) else {
                continue;
            };
            let mean = point_at(self.seen.view(), t, p) + by;
            (0..3).for_each(|axis| out.mean[[t, 3 * in_table + axis]] = mean[axis]);
            // At the edge of a gap: as sure as where it was seen.
            let own = self.knots.nearest(t, |k| correction(k).is_some());
            let sd = own.and_then(|k| Some(self.found[k].as_ref()?.sd[p]));
            out.sd[t * points + in_table] = sd.unwrap_or(f64::NAN);
        }
    }
}

/// Estimates a smoothed frame. Points seen in part among whole ones count as missing, which saves a
/// search for the placement; what was seen of them stays as the smoother left it.
fn estimate_smoothed(
    estimator: &FrameEstimator<'_>,
    y: &[f64],
    variances: &[f64],
) -> Option<FrameEstimate> {
    let seen = Observation {
        values: y,
        variance: variances,
    };
    let parts = seen.removable_partial_points();
    let mut found = estimator.estimate(y, &seen.variance_without(&parts))?;
    let parts = parts.iter().flat_map(|p| 3 * p..3 * p + 3);
    for i in parts.filter(|&i| variances[i].is_finite()) {
        found.mean[i] = y[i];
    }
    Some(found)
}

/// By how much a person's points are elsewhere than the model has them (J; cm, in the model's
/// directions): the mean over the frames of what was `seen` (frames, 3 J) less what was `found`.
fn personal_offsets(seen: &Array2<f64>, found: &[Option<FrameEstimate>]) -> Vec<DVec3> {
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

//! A frame by itself, denoised: an observation whose coordinates all have the frame's noise
//! variance; outliers are found by rigid distances and the prior.

use super::adapted_prior::AdaptedPrior;
use super::frame_estimator::{FrameEstimate, FrameEstimator, displacement};
use super::noise_estimation;
use super::outliers::LIKELY;
use super::take::{PointMapping, TakeResult};
use super::tuning::denoise::{UNCHANGED, UNKNOWN_NOISE};
use super::tuning::noise_estimation::NEARLY_CLEAN;
use crate::pose::Status;
use ndarray::ArrayView2;

/// A frame by itself, denoised.
pub(crate) struct DenoisedFrame {
    found: Option<FrameEstimate>,
    outliers: Vec<usize>,
    /// Standard deviation of a coordinate, cm.
    noise: f64,
    /// Nats; see [`TakeResult::novelty`].
    novelty: f64,
}

impl DenoisedFrame {
    /// Denoises one frame (1, 3 J), whose noise is `given` if it is known: standard deviation of a
    /// coordinate, cm.
    pub(crate) fn new(
        mapping: &PointMapping<'_>,
        frame: ArrayView2<'_, f64>,
        given: Option<f64>,
        outliers: bool,
    ) -> DenoisedFrame {
        let y = frame.row(0).to_vec();
        let floor = mapping.model.noise_floor(&y);
        if let Some((rigid, floor)) = floor.as_ref().filter(|_| outliers) {
            // A noise that is given is that of clean points where it is small, and of all points
            // otherwise.
            let noise = match given {
                Some(noise) => (noise <= NEARLY_CLEAN).then_some(noise),
                None => noise_estimation::is_worth_searching(floor)
                    .then(|| noise_estimation::rounded(floor.sd)),
            };
            // These distances fit the unknown body already: the model's own is not adapted.
            let own = mapping.model.estimator().with_rigid_model(rigid);
            let found = noise.and_then(|n| Some((n, own.estimate_with_outliers(&y, n * n)?)));
            if let Some((noise, (found, probability))) = found {
                let outliers = (0..probability.len()).filter(|&p| probability[p] > LIKELY);
                return DenoisedFrame::of(&own, Some(found), outliers.collect(), noise);
            }
        }
        let adapted = AdaptedPrior::new(mapping, frame, given.unwrap_or(UNKNOWN_NOISE));
        let noise = given.unwrap_or_else(|| {
            let by_distances = floor.map(|(_, floor)| floor.sd);
            let by_model = || noise_estimation::of_frame(&adapted.estimator(), &y);
            noise_estimation::rounded(by_distances.unwrap_or_else(by_model))
        });
        let adapted = adapted.with_lengths_from(frame, noise);
        let estimator = adapted.rigid_estimator();
        let found = estimator.estimate(&y, &noise_estimation::variances(&y, noise, &[]));
        DenoisedFrame::of(&estimator, found, Vec::new(), noise)
    }

    /// Writes it as frame t; with `fill` its missing points too.
    pub(crate) fn put(&self, out: &mut TakeResult, t: usize, fill: bool) {
        out.too_little += usize::from(self.found.is_none());
        out.noise += self.noise / out.xyz.nrows() as f64;
        out.novelty[t] = self.novelty;
        let before = out.xyz.row(t).to_vec();
        for p in 0..out.points() {
            let is_missing = before[3 * p..3 * p + 3].iter().any(|v| v.is_nan());
            let (status, sd) = match &self.found {
                None if is_missing => (Status::Unknown, f64::NAN),
                None => (Status::Observed, self.noise),
                Some(_) if is_missing && !fill => (Status::Unknown, f64::NAN),
                Some(found) => {
                    for i in 3 * p..3 * p + 3 {
                        out.xyz[[t, i]] = found.mean[i];
                    }
                    let status = if is_missing {
                        Status::Inferred
                    } else if self.outliers.contains(&p) {
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

    /// What `estimator` found.
    fn of(
        estimator: &FrameEstimator<'_>,
        found: Option<FrameEstimate>,
        outliers: Vec<usize>,
        noise: f64,
    ) -> DenoisedFrame {
        let novelty = |f: &FrameEstimate| estimator.novelty(&f.mean, &f.placement);
        DenoisedFrame {
            novelty: found.as_ref().map_or(f64::NAN, novelty),
            found,
            outliers,
            noise,
        }
    }
}

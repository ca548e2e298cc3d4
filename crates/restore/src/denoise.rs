//! Denoising: measured points move to where they more likely were.
//!
//! In a take, spikes and outliers are removed first; a Kalman smoother then removes the noise that
//! neighboring frames reveal, and each smoothed frame is an observation with the variances that the
//! smoother left. For a frame by itself see `denoised_frame`.

use super::adapted_prior::AdaptedPrior;
use super::adaptive_smoothing::SmoothedTake;
use super::bone_lengths;
use super::denoised_frame::DenoisedFrame;
use super::exchanged::{Exchanged, put_back};
use super::gap::{Gap, bare_frames, fill_gaps, find_gaps, hold_feet, put_filled};
use super::model_estimates::ModelEstimates;
use super::noise_estimation::{point_noise, typical_noise};
use super::outliers::spikes_by_time;
use super::sifted_take::SiftedTake;
use super::take::{Method, PointMapping, Take, TakeResult, restore_each_frame, without};
use super::tuning::{denoise::*, noise_estimation::NOISE_LIMIT};
use crate::pose::Status;
use ndarray::ArrayView2;

/// How to denoise.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_io::Table;
/// use posing_restore::{Denoise, Restorer};
///
/// // A slow motion with an error of half a centimeter, up in one frame and down in the next.
/// let value = |(t, _)| (t as f64 / 30.0).sin() * 40.0 + if t % 2 == 0 { 0.5 } else { -0.5 };
/// let xyz = ndarray::Array2::from_shape_fn((200, 3), value);
/// let table = Table::from_poses(Poses { points: vec!["knee".into()], xyz, ..Poses::default() });
/// let options = Denoise { noise: Some(0.5), fps: Some(100.0), ..Denoise::default() };
/// let denoised = Restorer::without_model().denoise(&table, &options)?;
/// let truth = (100.0_f64 / 30.0).sin() * 40.0;
/// assert!((denoised.xyz()[[100, 0]] - truth).abs() < 0.1);
/// # Ok::<(), posing_core::Error>(())
/// ```
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
    fn restore_frames(&self, mapping: &PointMapping<'_>, table: ArrayView2<'_, f64>) -> TakeResult {
        if mapping.is_mapped {
            // One frame does not tell whether the points stand where the model's do.
            return TakeResult::captured(table);
        }
        let restore = |frame: ArrayView2<'_, f64>| {
            DenoisedFrame::new(mapping, frame, self.noise, self.outliers)
        };
        restore_each_frame(mapping, table, restore, |out, t, found| {
            found.put(out, t, self.fill);
        })
    }

    fn restore_take(
        &self,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult {
        // 1. What is exchanged left and right, put back.
        let captured = take.xyz;
        let exchanged = self.put_back(take);
        let take = &take.with_xyz(exchanged.xyz.view());
        // 2. The outliers, and the paths of the other points, smoothed.
        let SiftedTake {
            mut outliers,
            smoothed,
        } = if self.outliers {
            SiftedTake::new(mapping, take, self.noise)
        } else {
            SiftedTake::whole(mapping, take, self.noise)
        };
        let each = outliers.iter_mut().zip(&exchanged.emptied);
        each.for_each(|(all, more)| all.extend(more));
        // 3. The model for the body that the smoothed frames show, and what it expects in each.
        let (mean, noise_left) = (smoothed.mean.view(), smoothed.noise_left());
        let adapted = mapping.map(|mapping| AdaptedPrior::of_smoothed(mapping, mean, noise_left));
        let known = (adapted.as_ref()).filter(|a| a.knows(mean, noise_left));
        let expected = known.map(|adapted| ModelEstimates::new(adapted, &smoothed, take, done));
        // 4. The smoothed points, drawn there by as much as they are noisy.
        let mut out = TakeResult::captured(take.xyz);
        out.is_unknown = adapted.is_some() && known.is_none();
        out.noise = smoothed.noise.mean();
        if self.noise.is_none() {
            let measured = point_noise(take.xyz, take.runs);
            let level = measured.typical().sqrt();
            let is_doubtful = level > NOISE_LIMIT && !measured.is_noise(take.rate);
            out.doubtful_noise = is_doubtful.then_some(level);
        }
        out.exchanged = exchanged.count;
        put_denoised(&mut out, captured, &smoothed, expected.as_ref());
        // 5. Outliers filled, and what was missing where that is wanted.
        self.fill(&mut out, captured, take, &outliers, adapted.as_ref());
        out.vacate(&exchanged.emptied);
        // 6. The bones of the limbs, of one length each.
        let bones = mapping.map_or(Vec::new(), PointMapping::limb_bones);
        bone_lengths::hold(&mut out, &bones);
        out
    }
}

/// Writes smoothed points, drawn to what the model expects by as much as they are noisy.
fn put_denoised(
    out: &mut TakeResult,
    captured: ArrayView2<'_, f64>,
    smoothed: &SmoothedTake,
    expected: Option<&ModelEstimates>,
) {
    if let Some(expected) = expected {
        out.novelty.clone_from(&expected.novelty);
        out.too_little = expected.too_little;
    }
    let points = out.points();
    let common = expected.map_or(Vec::new(), ModelEstimates::mean_variances);
    for t in 0..captured.nrows() {
        for p in 0..points {
            if (3 * p..3 * p + 3).any(|i| smoothed.mean[[t, i]].is_nan()) {
                continue;
            }
            let r = smoothed.noise.sd[p] * smoothed.noise.sd[p];
            let expected = expected.filter(|e| e.mean[[t, 3 * p]].is_finite());
            let share = expected.map_or(0.0, |_| r / (r + MODEL_VARIANCE));
            let mut moved = 0.0;
            for i in 3 * p..3 * p + 3 {
                let expected = expected.map_or(0.0, |e| share * e.mean[[t, i]]);
                out.xyz[[t, i]] = (1.0 - share) * smoothed.mean[[t, i]] + expected;
                moved += (out.xyz[[t, i]] - captured[[t, i]]).powi(2);
            }
            let left = smoothed.variance[[t, 3 * p]];
            let sd = expected.map_or(left.sqrt(), |e| {
                let common = COMMON_SHARE * left / (left + HALF_COMMON) * common[t];
                let variance = OWN_SHARE * e.sd[t * points + p].powi(2) + common;
                // Little noise leaves less than the model knows of.
                let variance = variance * left / (left + HALF_OWN);
                (1.0 - share) * left.sqrt() + share * variance.sqrt()
            });
            let status = if moved <= UNCHANGED * UNCHANGED {
                Status::Observed
            } else {
                Status::Changed
            };
            out.set(t, p, status, sd);
        }
    }
}

impl Denoise {
    /// The take with left and right as they are; as captured where outliers are not wanted.
    fn put_back(&self, take: &Take<'_>) -> Exchanged {
        if !self.outliers {
            return Exchanged::none(take.xyz);
        }
        // Spikes are on the way to the other side at times.
        let seen = without(take.xyz, &spikes_by_time(take, self.noise));
        let noise = self.noise;
        let noise = noise.unwrap_or_else(|| typical_noise(seen.view(), take.runs));
        put_back(&take.with_xyz(seen.view()), take.xyz, noise)
    }

    /// Fills the outliers of a denoised take; with [`Denoise::fill`] its missing points too.
    fn fill(
        &self,
        out: &mut TakeResult,
        captured: ArrayView2<'_, f64>,
        take: &Take<'_>,
        outliers: &[Vec<usize>],
        adapted: Option<&AdaptedPrior<'_>>,
    ) {
        let seen = without(out.xyz.view(), outliers);
        let is_filled = |gap: &Gap| self.fill && !gap.is_longer(self.max_gap, take.rate);
        let mut gaps = find_gaps(seen.view(), take.runs);
        gaps.retain(|gap| is_filled(gap) || gap.is_any_of(outliers));
        if gaps.is_empty() {
            return;
        }
        let sd = out.sd();
        let seen = Take {
            sd: Some(sd.view()),
            ..take.with_xyz(seen.view())
        };
        let is_known = !out.is_unknown;
        let (mut filled, bodies) =
            fill_gaps(adapted, is_known, &seen, &gaps, self.max_gap, &|_| ());
        out.bodies = bodies;
        hold_feet(&seen, &gaps, &mut filled);
        for (gap, filled) in gaps.iter().zip(&filled) {
            put_filled(out, captured, gap, filled.as_ref(), !is_filled(gap));
        }
        // What is bridged has enough.
        let bare = bare_frames(take.xyz);
        let is_unknown = |t: usize, p: usize| out.state(t, p).status == Status::Unknown;
        let is_bridged = |t: &usize| bare[*t] && !(0..out.points()).any(|p| is_unknown(*t, p));
        let bridged = (0..bare.len()).filter(is_bridged).count();
        out.too_little = out.too_little.saturating_sub(bridged);
    }
}

//! Completing: missing points are filled, seen points stay.
//!
//! Each frame is an observation whose seen coordinates are exact and whose others have infinite
//! variance; the restored frame fills the missing points. In a take, outliers count as missing, the
//! model is adapted to the take's body, and the gaps are filled from the frames around them, else
//! by the model frame by frame (`gap`).

use super::adapted_prior::AdaptedPrior;
use super::frame_estimator::FrameEstimate;
use super::gap::{empty_gaps, fill_gaps, find_gaps, hold_feet, put_filled};
use super::noise_estimation::{typical_noise, variances};
use super::outliers::find_outliers;
use super::take::{
    FRAMES_PER_TASK, Method, PointMapping, Take, TakeResult, restore_each_frame, without,
};
use crate::numeric::parallel;
use crate::pose::{Similarity, Status};
use crate::{Error, Result};
use ndarray::ArrayView2;

/// How to complete.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_io::Table;
/// use posing_restore::{Complete, Restorer};
///
/// let mut xyz = ndarray::Array2::from_shape_fn((60, 3), |(t, c)| (t + c) as f64);
/// xyz.slice_mut(ndarray::s![10..12, ..]).fill(f64::NAN);
/// xyz.slice_mut(ndarray::s![20..50, ..]).fill(f64::NAN);
/// let table = Table::from_poses(Poses { points: vec!["knee".into()], xyz, ..Poses::default() });
/// let options = Complete { max_gap: Some(0.1), fps: Some(100.0), ..Complete::default() };
/// let complete = Restorer::without_model().complete(&table, &options)?;
/// assert_eq!(complete.filled(), 2); // 0.02 seconds; the gap of 0.3 stays
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Complete {
    /// Longest gap to fill, in seconds; `None`: no limit. Needs a frame rate.
    pub max_gap: Option<f64>,
    /// Replaces outliers by their estimate too.
    pub overwrite_outliers: bool,
    /// Points that count as seen; all others count as missing. `None`: all points.
    pub observe: Option<Vec<String>>,
    /// Frames a second, for a table without times.
    pub fps: Option<f64>,
    /// Restores each frame by itself, without its neighbors in time.
    pub per_frame: bool,
}

impl Complete {
    /// Checks the options against the points of a table.
    ///
    /// # Errors
    /// [`Error::Usage`] if a point to observe is not among `points`.
    #[doc(hidden)]
    pub fn check(&self, points: &[String]) -> Result<()> {
        match self.observe.iter().flatten().find(|n| !points.contains(n)) {
            Some(name) => Err(Error::usage(format!(
                "observe {name}: the table has no point of this name"
            ))),
            None => Ok(()),
        }
    }
}

impl Method for Complete {
    fn restore_frames(&self, mapping: &PointMapping<'_>, table: ArrayView2<'_, f64>) -> TakeResult {
        let complete = |frame: ArrayView2<'_, f64>| {
            let y = frame.row(0).to_vec();
            let is_missing = |(p, _): (usize, usize)| has_missing(&y, p);
            if !mapping.pairs().any(is_missing) {
                return (None, f64::NAN);
            }
            let adapted = AdaptedPrior::measured(mapping, frame, 0.0);
            let estimator = adapted.rigid_estimator();
            let noise = variances(&y, 0.0, &[]);
            let upright = adapted.upright_poses(frame, false);
            let found = adapted.estimate(upright.as_ref(), &y, &noise);
            let novelty = found.as_ref().map_or(f64::NAN, |found| {
                // What the frame still lacks is that of the estimate.
                let all = y.iter().zip(&found.mean);
                let pose = all.map(|(y, m)| if y.is_finite() { *y } else { *m });
                estimator.novelty(&pose.collect::<Vec<_>>(), &found.placement)
            });
            (found, novelty)
        };
        restore_each_frame(mapping, table, complete, |out, t, (found, novelty)| {
            fill_frame(mapping, out, t, found.as_ref());
            out.novelty[t] = novelty;
        })
    }

    fn restore_take(
        &self,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        done: &(dyn Fn(usize) + Sync),
    ) -> TakeResult {
        let sd = take.typical_sd();
        let (outliers, adapted) = find_outliers(mapping, take, sd);
        let captured = without(take.xyz, &outliers.points);
        let gaps = find_gaps(captured.view(), take.runs);
        let mut out = TakeResult::captured(take.xyz);
        let noise = typical_noise(captured.view(), take.runs).max(sd.unwrap_or(0.0));
        out.is_unknown = (adapted.as_ref()).is_some_and(|a| !a.knows(captured.view(), noise));
        let seen = take.with_xyz(captured.view());
        let (mut filled, bodies) = fill_gaps(
            adapted.as_ref(),
            !out.is_unknown,
            &seen,
            &gaps,
            self.max_gap,
            done,
        );
        out.bodies = bodies;
        hold_feet(&seen, &gaps, &mut filled);
        for (gap, filled) in gaps.iter().zip(&filled) {
            put_filled(&mut out, take.xyz, gap, filled.as_ref(), false);
        }
        out.too_little = count_unknown(&out);
        if let Some(adapted) = &adapted {
            out.novelty = novelty_of_filled(adapted, &out);
        }
        if !self.overwrite_outliers {
            for (t, points) in outliers.points.iter().enumerate() {
                for i in points.iter().flat_map(|p| 3 * p..3 * p + 3) {
                    out.xyz[[t, i]] = take.xyz[[t, i]];
                }
            }
        }
        if self.max_gap.is_some() {
            let long = gaps.iter().filter(|g| g.is_longer(self.max_gap, take.rate));
            empty_gaps(&mut out, take.xyz, long);
        }
        out
    }
}

/// The number of frames with a point that stays unknown.
fn count_unknown(out: &TakeResult) -> usize {
    let is_unknown =
        |t: usize| (0..out.points()).any(|p| out.state(t, p).status == Status::Unknown);
    (0..out.xyz.nrows()).filter(|t| is_unknown(*t)).count()
}

/// The novelty of each frame in which something was filled, nats.
fn novelty_of_filled(adapted: &AdaptedPrior<'_>, out: &TakeResult) -> Vec<f64> {
    let estimator = adapted.rigid_estimator();
    let poses = adapted.mapping.gather(out.xyz.view());
    parallel::map_chunks(poses.nrows(), FRAMES_PER_TASK, |range| {
        let of = |t: usize| {
            let pose = poses.row(t).to_vec();
            if out.is_any_filled(t) && pose.iter().all(|v| v.is_finite()) {
                estimator.novelty(&pose, &Similarity::IDENTITY)
            } else {
                f64::NAN
            }
        };
        range.map(of).collect::<Vec<_>>()
    })
    .concat()
}

/// Whether a coordinate of a point is missing.
fn has_missing(y: &[f64], point: usize) -> bool {
    y[3 * point..3 * point + 3].iter().any(|v| !v.is_finite())
}

/// Fills the missing points of a frame from its estimate, and sets their statuses.
fn fill_frame(
    mapping: &PointMapping<'_>,
    out: &mut TakeResult,
    t: usize,
    found: Option<&FrameEstimate>,
) {
    let mut is_incomplete = false;
    for (p, _) in mapping.pairs() {
        let missing: Vec<usize> = (3 * p..3 * p + 3)
            .filter(|&i| out.xyz[[t, i]].is_nan())
            .collect();
        if missing.is_empty() {
            continue;
        }
        // A model of another unit of length may overflow: what is not finite is no estimate.
        let Some(found) = found.filter(|f| !has_missing(&f.mean, p)) else {
            is_incomplete = true;
            out.set(t, p, Status::Unknown, f64::NAN);
            continue;
        };
        out.set(t, p, Status::Inferred, found.sd[p]);
        missing
            .iter()
            .for_each(|&i| out.xyz[[t, i]] = found.mean[i]);
    }
    out.too_little += usize::from(is_incomplete);
}

//! Completing: missing points are filled, seen points stay.
//!
//! Each frame is an observation whose seen coordinates are exact and whose others have infinite variance; the restored frame
//! fills the missing points. In a take, outliers count as missing, the model is adapted to the take's body, and the
//! estimates are made continuous over each gap (`gap_interpolation`).

use super::frame_restorer::{FrameRestorer, RestoredFrame};
use super::gap_interpolation::{Corrections, Gap, find_gaps, smooth_filled};
use super::noise_estimation::exact_noise;
use super::outliers::{Outliers, remove};
use super::restored_frames::{BoundModel, Method, RestoredFrames};
use crate::numeric::parallel;
use crate::pose::{Observation, Status};
use crate::{Error, Result};
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;

/// Frames of one parallel task.
const CHUNK: usize = 8;
/// Up to this length, seconds, a point seen in part is better interpolated over time than estimated from the part.
const BRIEF: f64 = 0.25;

/// How to complete.
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
    fn frames(&self, bound: &BoundModel<'_>, xyz: ArrayView2<'_, f64>) -> RestoredFrames {
        let estimates = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
            let estimate = |t: usize| {
                let y = xyz.row(t).to_vec();
                if bound.is_complete(&y) {
                    return (Estimate::NotNeeded, f64::NAN);
                }
                let adapted = bound.model.adapt(xyz.slice(s![t..t + 1, ..]), 0.0);
                let restorer = adapted.rigid_restorer();
                match restorer.restore(&y, &exact_noise(&y, &[])) {
                    Some(found) => {
                        let novelty = novelty(&restorer, &y, &found);
                        (Estimate::Found(found), novelty)
                    }
                    None => (Estimate::TooLittleSeen, f64::NAN),
                }
            };
            range.map(estimate).collect::<Vec<_>>()
        });
        let mut out = RestoredFrames::of(xyz.to_owned());
        for (t, (estimate, novelty)) in estimates.into_iter().flatten().enumerate() {
            fill(bound, &mut out, t, &estimate, &[], None);
            out.novelty[t] = novelty;
        }
        out
    }

    fn take(
        &self,
        bound: &BoundModel<'_>,
        xyz: ArrayView2<'_, f64>,
        runs: &[Range<usize>],
        rate: f64,
        done: &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames {
        let (outliers, adapted) = Outliers::find(bound.model, xyz, runs, rate, None);
        let outliers = outliers.points;
        let restorer = adapted.rigid_restorer();
        let mut seen = xyz.to_owned();
        remove(&mut seen, &outliers);
        let partial = brief_partial_points(&seen, runs, rate);
        remove(&mut seen, &partial);
        let gaps = find_gaps(&seen, runs);
        let estimates = estimate_frames(bound, &restorer, &seen, done);
        let found: Vec<Option<&RestoredFrame>> = estimates.iter().map(Estimate::found).collect();
        let corrections = Corrections::new(&restorer, &seen, &found, &gaps, rate);
        let mut out = RestoredFrames::of(xyz.to_owned());
        for (t, estimate) in estimates.iter().enumerate() {
            fill(
                bound,
                &mut out,
                t,
                estimate,
                &outliers[t],
                Some(&corrections),
            );
        }
        smooth_filled(&mut out, &seen, &gaps, runs, rate);
        keep(&mut out, xyz, &partial);
        out.novelty = parallel::map_chunks(found.len(), CHUNK, |range| {
            let of = |t: usize| {
                found[t].map_or(f64::NAN, |f| {
                    novelty(&restorer, &out.xyz.row(t).to_vec(), f)
                })
            };
            range.map(of).collect::<Vec<_>>()
        })
        .concat();
        if !self.overwrite_outliers {
            // Their estimates were needed until here, to smooth their neighbors with.
            for (t, points) in outliers.iter().enumerate() {
                for i in points.iter().flat_map(|p| 3 * p..3 * p + 3) {
                    out.xyz[[t, i]] = xyz[[t, i]];
                }
            }
        }
        if let Some(longest) = self.max_gap {
            let is_long = |g: &&Gap| g.frames.len() as f64 / rate > longest * (1.0 + 1e-9);
            empty_gaps(&mut out, xyz, gaps.iter().filter(is_long));
        }
        out
    }
}

/// The estimate of a frame.
enum Estimate {
    /// Nothing is missing.
    NotNeeded,
    TooLittleSeen,
    Found(RestoredFrame),
}

impl Estimate {
    fn found(&self) -> Option<&RestoredFrame> {
        match self {
            Estimate::Found(found) => Some(found),
            _ => None,
        }
    }
}

/// The estimates of all frames of a take.
fn estimate_frames(
    bound: &BoundModel<'_>,
    restorer: &FrameRestorer<'_>,
    seen: &Array2<f64>,
    done: &(dyn Fn(usize) + Sync),
) -> Vec<Estimate> {
    let parts = parallel::map_chunks(seen.nrows(), CHUNK, |range| {
        let estimate = |t: usize| {
            let y = seen.row(t).to_vec();
            if bound.is_complete(&y) {
                return Estimate::NotNeeded;
            }
            let found = restorer.restore(&y, &exact_noise(&y, &[]));
            found.map_or(Estimate::TooLittleSeen, Estimate::Found)
        };
        let part: Vec<Estimate> = range.clone().map(estimate).collect();
        done(range.len());
        part
    });
    parts.into_iter().flatten().collect()
}

/// Novelty of a completed frame, nats. What the frame still lacks is taken from the estimate.
fn novelty(restorer: &FrameRestorer<'_>, frame: &[f64], found: &RestoredFrame) -> f64 {
    let all = frame.iter().zip(&found.mean);
    let pose: Vec<f64> = all
        .map(|(y, m)| if y.is_finite() { *y } else { *m })
        .collect();
    restorer.novelty(&pose, &found.placement)
}

/// Fills the missing points and the `outliers` of a frame from its estimate, and sets their statuses.
fn fill(
    bound: &BoundModel<'_>,
    out: &mut RestoredFrames,
    t: usize,
    estimate: &Estimate,
    outliers: &[usize],
    corrections: Option<&Corrections>,
) {
    let mut is_incomplete = false;
    for p in (0..out.points()).filter(|&p| bound.in_table(p).is_some()) {
        let missing: Vec<usize> = (3 * p..3 * p + 3)
            .filter(|&i| out.xyz[[t, i]].is_nan())
            .collect();
        let is_outlier = outliers.contains(&p);
        if missing.is_empty() && !is_outlier {
            continue;
        }
        // A model of another unit of length may overflow: what is not finite is no estimate.
        let is_finite = |f: &&RestoredFrame| f.mean[3 * p..3 * p + 3].iter().all(|v| v.is_finite());
        let Some(found) = estimate.found().filter(is_finite) else {
            is_incomplete = true;
            let status = match missing.is_empty() {
                true => Status::Rejected,
                false => Status::Unknown,
            };
            out.set(t, p, status, f64::NAN);
            continue;
        };
        let correction = corrections.map(|c| c.at(t, p));
        let sd = found.sd[p] * correction.map_or(1.0, |c| c.sd_factor);
        let status = match is_outlier {
            true => Status::Rejected,
            false => Status::Inferred,
        };
        out.set(t, p, status, sd);
        for axis in 0..3 {
            let i = 3 * p + axis;
            if is_outlier || missing.contains(&i) {
                out.xyz[[t, i]] = found.mean[i] + correction.map_or(0.0, |c| c.shift[axis]);
            }
        }
    }
    out.too_little += usize::from(is_incomplete && !matches!(estimate, Estimate::NotNeeded));
}

/// Puts back the coordinates of `xyz` that were seen of the given points of each frame.
fn keep(out: &mut RestoredFrames, xyz: ArrayView2<'_, f64>, points: &[Vec<usize>]) {
    for (t, points) in points.iter().enumerate() {
        let coordinates = points.iter().flat_map(|p| 3 * p..3 * p + 3);
        for i in coordinates.filter(|&i| xyz[[t, i]].is_finite()) {
            out.xyz[[t, i]] = xyz[[t, i]];
        }
    }
}

/// Leaves gaps empty. A frame of which nothing is left filled has no novelty.
fn empty_gaps<'a>(
    out: &mut RestoredFrames,
    xyz: ArrayView2<'_, f64>,
    gaps: impl Iterator<Item = &'a Gap>,
) {
    for gap in gaps {
        let columns = 3 * gap.point..3 * gap.point + 3;
        for t in gap.frames.clone() {
            let captured = xyz.slice(s![t, columns.clone()]);
            if captured.iter().all(|v| v.is_finite()) {
                continue;
            }
            out.xyz.slice_mut(s![t, columns.clone()]).assign(&captured);
            out.set(t, gap.point, Status::Unknown, f64::NAN);
        }
    }
    for t in 0..out.xyz.nrows() {
        let is_filled =
            |p: usize| matches!(out.of_point(t, p).0, Status::Inferred | Status::Rejected);
        if !(0..out.points()).any(is_filled) {
            out.novelty[t] = f64::NAN;
        }
    }
}

/// The points of each frame that are seen in part, for a short time between frames where they are seen whole: interpolation
/// over time is more accurate there than an estimate from the part, and cheaper.
fn brief_partial_points(seen: &Array2<f64>, runs: &[Range<usize>], rate: f64) -> Vec<Vec<usize>> {
    let partial: Vec<Vec<usize>> = (seen.rows().into_iter())
        .map(|row| {
            let y = row.to_vec();
            let noise = exact_noise(&y, &[]);
            let seen = Observation {
                values: &y,
                variance: &noise,
            };
            seen.removable_partial_points()
        })
        .collect();
    let mut brief = vec![Vec::new(); partial.len()];
    for gap in find_gaps(seen, runs) {
        let is_between = gap.before.is_some() && gap.after.is_some();
        if is_between && gap.frames.len() as f64 <= BRIEF * rate {
            let here = gap.frames.filter(|&t| partial[t].contains(&gap.point));
            here.for_each(|t| brief[t].push(gap.point));
        }
    }
    brief
}

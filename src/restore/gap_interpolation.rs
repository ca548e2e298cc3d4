//! Estimates of one frame each, made continuous over the gaps of a take.
//!
//! A gap is a point that is missing for some frames on end. At its ends the point is seen, so the error e of the estimate is
//! known there: the estimate is made once more with the gap's points hidden. The error inside the gap is predicted from
//! both ends as a Gaussian process over time, by simple kriging, in the directions of the model:
//!
//! ```text
//! e(t) = [k(t − t₀) k(t₁ − t)] [1 k(t₁ − t₀); k(t₁ − t₀) 1]⁻¹ [e(t₀); e(t₁)]      k(s) = ½ exp(−s / ¼) + ½ exp(−s / 4)
//! ```
//!
//! with s in seconds and e in cm. Afterwards a Gaussian of 25 ms smooths what was filled.

use super::frame_restorer::{FrameRestorer, RestoredFrame};
use super::noise_estimation::exact_noise;
use super::restored_frames::RestoredFrames;
use crate::numeric::parallel;
use crate::pose::Status;
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;
use std::ops::Range;

/// Standard deviation of the smoothing Gaussian, seconds.
const SMOOTHING: f64 = 0.025;
/// Share of the error's variance that stays unexplained at least: the correlation is a guess.
const UNEXPLAINED: f64 = 0.01;

/// A point that is missing for some frames on end.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    pub point: usize,
    pub frames: Range<usize>,
    /// The frame before, where the point is seen.
    pub before: Option<usize>,
    /// The frame after, where the point is seen.
    pub after: Option<usize>,
}

/// The gaps of `seen` (frames, 3 J; NaN missing) within its `runs` of consecutive frames.
pub fn find_gaps(seen: &Array2<f64>, runs: &[Range<usize>]) -> Vec<Gap> {
    runs.iter().flat_map(|run| gaps_of(seen, run)).collect()
}

fn gaps_of(seen: &Array2<f64>, run: &Range<usize>) -> Vec<Gap> {
    let mut gaps = Vec::new();
    for point in 0..seen.ncols() / 3 {
        let is_missing = |t: usize| (3 * point..3 * point + 3).any(|i| seen[[t, i]].is_nan());
        let mut t = run.start;
        while t < run.end {
            if !is_missing(t) {
                t += 1;
                continue;
            }
            let start = t;
            while t < run.end && is_missing(t) {
                t += 1;
            }
            gaps.push(Gap {
                point,
                frames: start..t,
                before: (start > run.start).then(|| start - 1),
                after: (t < run.end).then_some(t),
            });
        }
    }
    gaps
}

/// Correction of the estimate of a point in a gap.
#[derive(Debug, Clone, Copy)]
pub struct Correction {
    /// cm, in world directions.
    pub shift: DVec3,
    /// Factor of the estimate's standard deviation.
    pub sd_factor: f64,
}

const NO_CORRECTION: Correction = Correction {
    shift: DVec3::ZERO,
    sd_factor: 1.0,
};

/// The corrections of the estimates of a take.
pub struct Corrections(BTreeMap<usize, Vec<Correction>>);

impl Corrections {
    /// Corrections for `estimates` (one a frame, `None` where there is none) of the missing points of `seen` (frames, 3 J);
    /// `rate` is in frames a second.
    pub fn new(
        restorer: &FrameRestorer<'_>,
        seen: &Array2<f64>,
        estimates: &[Option<&RestoredFrame>],
        gaps: &[Gap],
        rate: f64,
    ) -> Corrections {
        let errors = errors_at_ends(restorer, seen, gaps);
        let mut out = BTreeMap::new();
        for gap in gaps {
            let error = |end: Option<(usize, usize)>| {
                let (frame, beside) = end?;
                let errors = errors.get(&(frame, missing_points(seen, beside)))?;
                (errors.as_ref().map(|e| e[gap.point])).filter(|e| e.is_finite())
            };
            let [before, after] = ends(gap).map(error);
            if before.is_none() && after.is_none() {
                continue;
            }
            let span = correlation((gap.frames.len() + 1) as f64 / rate);
            for t in gap.frames.clone() {
                let Some(estimate) = estimates[t] else {
                    continue;
                };
                let a = correlation((t + 1 - gap.frames.start) as f64 / rate);
                let b = correlation((gap.frames.end - t) as f64 / rate);
                let (wa, wb) = match (before, after) {
                    (Some(_), Some(_)) => {
                        let det = 1.0 - span * span;
                        ((a - span * b) / det, (b - span * a) / det)
                    }
                    (Some(_), None) => (a, 0.0),
                    _ => (0.0, b),
                };
                let error = before.unwrap_or(DVec3::ZERO) * wa + after.unwrap_or(DVec3::ZERO) * wb;
                out.entry(t)
                    .or_insert_with(|| vec![NO_CORRECTION; seen.ncols() / 3])[gap.point] =
                    Correction {
                        shift: estimate.placement.rotation * error,
                        sd_factor: (1.0 - wa * a - wb * b).max(UNEXPLAINED).sqrt(),
                    };
            }
        }
        Corrections(out)
    }

    /// The correction of a point in a frame.
    pub fn at(&self, frame: usize, point: usize) -> Correction {
        (self.0.get(&frame)).map_or(NO_CORRECTION, |points| points[point])
    }
}

/// (frame, points hidden there) -> the errors of the estimate in the directions of the model.
type Errors = BTreeMap<(usize, Vec<usize>), Option<Vec<DVec3>>>;

/// The points that are missing in a frame.
fn missing_points(seen: &Array2<f64>, t: usize) -> Vec<usize> {
    (0..seen.ncols() / 3)
        .filter(|&p| (3 * p..3 * p + 3).any(|i| seen[[t, i]].is_nan()))
        .collect()
}

/// Each end of a gap: the frame where the point is seen, and the frame of the gap beside it.
fn ends(gap: &Gap) -> [Option<(usize, usize)>; 2] {
    [
        gap.before.map(|b| (b, gap.frames.start)),
        gap.after.map(|a| (a, gap.frames.end - 1)),
    ]
}

/// The errors of the estimates at the ends of gaps, made with the gap's points hidden.
fn errors_at_ends(restorer: &FrameRestorer<'_>, seen: &Array2<f64>, gaps: &[Gap]) -> Errors {
    let mut keys: Vec<(usize, Vec<usize>)> = gaps
        .iter()
        .flat_map(ends)
        .flatten()
        .map(|(frame, beside)| (frame, missing_points(seen, beside)))
        .collect();
    keys.sort();
    keys.dedup();
    let found = parallel::map_chunks(keys.len(), 1, |range| {
        let (frame, hidden) = &keys[range.start];
        let truth = seen.row(*frame).to_vec();
        let estimate = restorer.restore(&truth, &exact_noise(&truth, hidden))?;
        let to_model = estimate.placement.rotation.transpose();
        let error = |p: usize| {
            let [truth, mean] = [&truth, &estimate.mean].map(|x| DVec3::from_slice(&x[3 * p..]));
            to_model * (truth - mean)
        };
        Some((0..truth.len() / 3).map(error).collect())
    });
    keys.into_iter().zip(found).collect()
}

/// Correlation of the estimate's errors `seconds` apart.
fn correlation(seconds: f64) -> f64 {
    0.5 * (-seconds / 0.25).exp() + 0.5 * (-seconds / 4.0).exp()
}

/// Smooths the filled points of `out` over time; coordinates that were `seen` stay.
pub fn smooth_filled(
    out: &mut RestoredFrames,
    seen: &Array2<f64>,
    gaps: &[Gap],
    runs: &[Range<usize>],
    rate: f64,
) {
    let sigma = SMOOTHING * rate;
    let reach = (3.0 * sigma).floor() as usize;
    if reach == 0 {
        return;
    }
    let before = out.xyz.clone();
    for gap in gaps {
        let Some(run) = runs.get(runs.partition_point(|r| r.end <= gap.frames.start)) else {
            continue;
        };
        for t in gap.frames.clone() {
            if !matches!(
                out.of_point(t, gap.point).0,
                Status::Inferred | Status::Rejected
            ) {
                continue;
            }
            // Never past either end of the run, and symmetric, so that a straight line stays one.
            let reach = reach.min(t - run.start).min(run.end - 1 - t);
            for i in (3 * gap.point..3 * gap.point + 3).filter(|&i| seen[[t, i]].is_nan()) {
                let (mut sum, mut weight) = (0.0, 0.0);
                for k in t - reach..=t + reach {
                    let w = (-0.5 * ((k as f64 - t as f64) / sigma).powi(2)).exp();
                    sum += w * before[[k, i]];
                    weight += w;
                }
                if (sum / weight).is_finite() {
                    out.xyz[[t, i]] = sum / weight;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_found_with_their_ends() {
        let mut xyz = Array2::<f64>::zeros((6, 6));
        xyz[[0, 1]] = f64::NAN;
        xyz[[2, 4]] = f64::NAN;
        xyz[[3, 3]] = f64::NAN;
        xyz[[5, 5]] = f64::NAN;
        let gap = |point, frames: Range<usize>, before, after| Gap {
            point,
            frames,
            before,
            after,
        };
        assert_eq!(
            gaps_of(&xyz, &(0..6)),
            [
                gap(0, 0..1, None, Some(1)),
                gap(1, 2..4, Some(1), Some(4)),
                gap(1, 5..6, Some(4), None)
            ]
        );
        // The edge of a run is an end like that of the take.
        assert_eq!(gaps_of(&xyz, &(3..6))[0], gap(1, 3..4, None, Some(4)));
    }

    #[test]
    fn errors_decorrelate_between_the_ends() {
        assert!((correlation(0.0) - 1.0).abs() <= 1e-12);
        assert!(correlation(0.1) > correlation(1.0) && correlation(20.0) < 0.01);
    }
}

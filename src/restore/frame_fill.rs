//! Gaps filled by the model frame by frame, where too few frames around them show the point: one
//! that is never seen, or a take of a few frames.
//!
//! Each frame is answered by itself. At a gap's ends the point is seen, so the error of the answer
//! is known there: it is answered once more with the gap's points hidden. The error is carried into
//! the gap as a ramp, and fades from a single end. Noise that is the model's own, from frame to
//! frame, is smoothed away; where the answers jump from one pose to another, as much as it takes
//! for a path that a body can follow.

use super::adaptive_smoothing::smooth_path;
use super::frame_restorer::{FrameRestorer, RestoredFrame};
use super::gap::{FilledGap, Gap, MotionLimits};
use super::noise_estimation::{exact_noise, noise_of_path};
use crate::numeric::parallel;
use crate::pose::FillMethod;
use glam::DVec3;
use ndarray::{Array2, ArrayView2, s};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Frames of one parallel task.
const CHUNK: usize = 8;
/// Seconds after which e⁻¹ of an error is left where a gap has one end.
const FADES: f64 = 0.25;
/// Noise of answers to which no end belongs, in their standard deviations: errors last for some
/// frames.
const JUMPS: f64 = 4.0;
/// A point's variance: so much of the stated one, and so much of the mean over the missing points.
/// By calibration on 51 takes of people that the model does not know, of which six joints were
/// seen.
const OWN_SHARE: f64 = 1.5;
const COMMON_SHARE: f64 = 2.0;
/// Noise that is assumed, cm, as long as the answers are no path that a body can follow.
const STRONGER: [f64; 5] = [2.0, 4.0, 8.0, 16.0, 32.0];

/// The model's answers for the frames of a take.
pub struct FrameFill<'a> {
    /// Restores frames of the take's body.
    pub restorer: &'a FrameRestorer<'a>,
    /// What counts as seen, in the model's order of points (frames, 3 J), cm; NaN missing.
    pub seen: ArrayView2<'a, f64>,
    /// Ranges of consecutive frames.
    pub runs: &'a [Range<usize>],
    /// Frames a second.
    pub rate: f64,
}

/// (frame, points hidden there)
type Key = (usize, Vec<usize>);

impl FrameFill<'_> {
    /// Fills gaps, whose points are the model's. `None` for a gap in which a frame shows too
    /// little.
    pub fn fill(&self, gaps: &[Gap], done: &(dyn Fn(usize) + Sync)) -> Vec<Option<FilledGap>> {
        let answers = self.answers(gaps, done);
        let limits = MotionLimits::measure(self.seen, self.runs, self.rate, gaps);
        gaps.iter()
            .map(|gap| self.fill_gap(gap, &answers, &limits))
            .collect()
    }

    /// The answers for all frames of gaps, and for the frames at their ends with what is missing
    /// beside hidden.
    fn answers(&self, gaps: &[Gap], done: &(dyn Fn(usize) + Sync)) -> BTreeMap<Key, RestoredFrame> {
        let inside = gaps
            .iter()
            .flat_map(|g| g.frames.clone())
            .map(|t| (t, Vec::new()));
        let keys: BTreeSet<Key> = gaps
            .iter()
            .flat_map(|g| self.ends(g))
            .chain(inside)
            .collect();
        let keys: Vec<Key> = keys.into_iter().collect();
        let found = parallel::map_chunks(keys.len(), CHUNK, |range| {
            done(range.len());
            let answer = |(t, hidden): &Key| {
                let y = self.seen.row(*t).to_vec();
                self.restorer.restore(&y, &exact_noise(&y, hidden))
            };
            keys[range].iter().map(answer).collect::<Vec<_>>()
        });
        let found = found.into_iter().flatten();
        keys.iter()
            .cloned()
            .zip(found)
            .filter_map(|(k, f)| Some((k, f?)))
            .collect()
    }

    /// The frames at a gap's ends, with the points that are missing in the gap's frame beside each.
    fn ends(&self, gap: &Gap) -> Vec<Key> {
        let missing = |t: usize| {
            let is_missing = |p: &usize| (3 * p..3 * p + 3).any(|i| self.seen[[t, i]].is_nan());
            (0..self.seen.ncols() / 3).filter(is_missing).collect()
        };
        let before = gap.before.map(|b| (b, missing(gap.frames.start)));
        let after = gap.after.map(|a| (a, missing(gap.frames.end - 1)));
        before.into_iter().chain(after).collect()
    }

    fn fill_gap(
        &self,
        gap: &Gap,
        answers: &BTreeMap<Key, RestoredFrame>,
        limits: &MotionLimits,
    ) -> Option<FilledGap> {
        let at = |values: &[f64]| DVec3::from_slice(&values[3 * gap.point..]);
        // What was answered at the gap's ends, and the error there.
        let ends: Vec<(usize, DVec3, DVec3)> = (self.ends(gap).into_iter())
            .filter_map(|key| {
                let answer = at(&answers.get(&key)?.mean);
                let error = at(&self.seen.row(key.0).to_vec()) - answer;
                error.is_finite().then_some((key.0, answer, error))
            })
            .collect();
        let mut xyz = Array2::zeros((gap.frames.len(), 3));
        let mut variance = Vec::with_capacity(gap.frames.len());
        let mut answered = 0.0;
        for (k, t) in gap.frames.clone().enumerate() {
            let answer = answers.get(&(t, Vec::new()))?;
            let mean = at(&answer.mean);
            if !mean.is_finite() {
                return None;
            }
            (0..3).for_each(|axis| xyz[[k, axis]] = mean[axis]);
            variance.push(self.variance(t, &answer.sd, gap.point));
            answered += answer.sd[gap.point].powi(2);
        }
        let typical_sd = (answered / gap.frames.len() as f64).sqrt();
        let errors: Vec<(f64, DVec3)> = ends.iter().map(|e| (e.0 as f64, e.2)).collect();
        for (k, t) in gap.frames.clone().enumerate() {
            variance[k] *= carried(&errors, t as f64, self.rate).1;
        }
        let path = [0, 1, 2].map(|axis| xyz.column(axis).to_vec());
        let measured = noise_of_path([&path[0][..], &path[1][..], &path[2][..]]).unwrap_or(0.0);
        let measured = match ends.is_empty() {
            // No end says which of the poses that the answers jump between is right: their mean
            // over time is nearest to it.
            true => measured.max(JUMPS * typical_sd),
            false => measured,
        };
        let with_noise = |noise: f64| self.joined(gap, &xyz, &ends, noise);
        let filled = |xyz: Array2<f64>, noise: f64| FilledGap {
            xyz,
            variance: variance.iter().map(|v| v + noise * noise).collect(),
            method: FillMethod::Model,
        };
        let plain = filled(with_noise(measured), 0.0);
        if limits.allow(self.seen, gap, &plain) {
            return Some(plain);
        }
        let mut stronger = STRONGER
            .iter()
            .map(|&noise| filled(with_noise(noise), noise));
        let followed = stronger.find(|f| limits.allow(self.seen, gap, f));
        Some(followed.unwrap_or(plain))
    }

    /// The variance of a point's answer in frame `t`, cm², by the standard deviations that the
    /// model states: they leave out how sure the body's placement is, which moves all points
    /// together, and people's proportions.
    fn variance(&self, t: usize, sd: &[f64], point: usize) -> f64 {
        let is_missing = |p: &usize| (3 * p..3 * p + 3).any(|i| self.seen[[t, i]].is_nan());
        let missing: Vec<f64> = (0..sd.len())
            .filter(is_missing)
            .map(|p| sd[p].powi(2))
            .collect();
        let mean = missing.iter().sum::<f64>() / missing.len().max(1) as f64;
        OWN_SHARE * sd[point].powi(2) + COMMON_SHARE * mean
    }

    /// The answers for a gap (frames, 3), smoothed with those at its ends, and joined to what is
    /// seen there. An end: the frame, its answer, and the answer's error.
    fn joined(
        &self,
        gap: &Gap,
        answers: &Array2<f64>,
        ends: &[(usize, DVec3, DVec3)],
        noise: f64,
    ) -> Array2<f64> {
        let n = answers.nrows();
        let first = usize::from(ends.iter().any(|e| e.0 < gap.frames.start));
        let row_of = |t: usize| if t < gap.frames.start { 0 } else { first + n };
        let mut path = Array2::zeros((n + ends.len(), 3));
        path.slice_mut(s![first..first + n, ..]).assign(answers);
        for (t, answer, _) in ends {
            (0..3).for_each(|axis| path[[row_of(*t), axis]] = answer[axis]);
        }
        self.smooth(&mut path, noise);
        let error = |&(t, answer, error): &(usize, DVec3, DVec3)| {
            let smooth = DVec3::from_array([0, 1, 2].map(|axis| path[[row_of(t), axis]]));
            (t as f64, answer + error - smooth)
        };
        let errors: Vec<(f64, DVec3)> = ends.iter().map(error).collect();
        let mut xyz = path.slice(s![first..first + n, ..]).to_owned();
        for (k, t) in gap.frames.clone().enumerate() {
            let (shift, _) = carried(&errors, t as f64, self.rate);
            (0..3).for_each(|axis| xyz[[k, axis]] += shift[axis]);
        }
        xyz
    }

    /// Smooths a path (frames, 3) with so much noise, cm.
    fn smooth(&self, xyz: &mut Array2<f64>, noise: f64) {
        if noise > 0.0 {
            let path = [0, 1, 2].map(|axis| xyz.column(axis).to_vec());
            let views = [&path[0][..], &path[1][..], &path[2][..]];
            let run = 0..path[0].len();
            let smooth = smooth_path(views, &[run], noise * noise, 1.0 / self.rate);
            for (mut column, smooth) in xyz.columns_mut().into_iter().zip(smooth) {
                column.assign(&ndarray::Array1::from(smooth.mean));
            }
        }
    }
}

/// The error at frame `t` by those at the ends, and the share of the variance that is left.
fn carried(errors: &[(f64, DVec3)], t: f64, rate: f64) -> (DVec3, f64) {
    match errors {
        [(a, before), (b, after)] => {
            let u = (t - a) / (b - a);
            (*before * (1.0 - u) + *after * u, 4.0 * u * (1.0 - u))
        }
        [(end, error)] => {
            let left = (-(t - end).abs() / rate / FADES).exp();
            (*error * left, 1.0 - left * left)
        }
        _ => (DVec3::ZERO, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_carried_from_both_ends_or_fade_from_one() {
        let ends = [(9.0, DVec3::X), (19.0, DVec3::Y)];
        let (middle, share) = carried(&ends, 14.0, 100.0);
        assert_eq!((middle, share), (DVec3::new(0.5, 0.5, 0.0), 1.0));
        let (near, share) = carried(&ends[..1], 10.0, 100.0);
        assert!((near.x - (-0.04f64).exp()).abs() <= 1e-12 && share < 0.1);
        assert_eq!(carried(&[], 3.0, 100.0), (DVec3::ZERO, 1.0));
    }
}

//! Gaps filled by the model frame by frame, where too few frames around them show the point: one
//! that is never seen, or a take of a few frames.
//!
//! Each frame is estimated by itself. At a gap's ends the point is seen, so the error of the
//! estimate is known there: the frame is estimated once more with the gap's points hidden. The
//! error is carried into the gap as a ramp, and fades from a single end. Noise that is the model's
//! own, from frame to frame, is smoothed away; where the estimates jump from one pose to another,
//! as much as it takes for a path that a body can follow.

use super::motion_limits::MotionLimits;
use super::tuning::{estimates::FADES, model_fill::*};
use super::{FilledGap, Gap};
use crate::adapted_prior::AdaptedPrior;
use crate::adaptive_smoothing::{path_of, put_path, smooth_path};
use crate::frame_estimator::FrameEstimate;
use crate::kalman_smoother::PathNoise;
use crate::noise_estimation::{from_time, variances};
use crate::numeric::parallel;
use crate::pose::FillMethod;
use crate::take::{FRAMES_PER_TASK, Take};
use crate::upright::UprightPoses;
use glam::DVec3;
use ndarray::{Array2, ArrayView2, s};
use std::collections::{BTreeMap, BTreeSet};

/// (frame, points hidden there)
type Key = (usize, Vec<usize>);

/// Fills the gaps of a take that are left in `filled` by the model, frame by frame; one whose
/// estimate by the frames around it was `implausible`, by the surer of both.
pub(crate) fn fill(
    adapted: &AdaptedPrior<'_>,
    take: &Take<'_>,
    gaps: &[Gap],
    filled: &mut [Option<FilledGap>],
    mut implausible: Vec<Option<FilledGap>>,
    done: &(dyn Fn(usize) + Sync),
) {
    let of_model = |k: usize| {
        let point = adapted.mapping.in_model(gaps[k].point)?;
        let gap = gaps[k].clone();
        filled[k].is_none().then_some((k, Gap { point, ..gap }))
    };
    let (left, open): (Vec<usize>, Vec<Gap>) = (0..gaps.len()).filter_map(of_model).unzip();
    let mut seen = adapted.mapping.gather(take.xyz);
    let known = put_known(adapted, gaps, filled, &mut seen);
    let gaps = open;
    let take = take.with_xyz(seen.view());
    let upright = (!gaps.is_empty())
        .then(|| adapted.upright_poses(seen.view(), true))
        .flatten();
    let model = ModelFill {
        seen: seen.view(),
        rate: take.rate,
        known,
        limits: MotionLimits::measure(&take, &gaps),
        estimates: BTreeMap::new(),
        is_upright: upright.is_some(),
    };
    let model = model.estimated(adapted, upright.as_ref(), &gaps, done);
    let variance = |filled: &FilledGap| filled.variance.iter().sum::<f64>();
    for (k, gap) in left.into_iter().zip(&gaps) {
        let by_model = model.fill_gap(gap);
        let both = by_model.into_iter().chain(implausible[k].take());
        filled[k] = both.min_by(|a, b| variance(a).total_cmp(&variance(b)));
    }
}

/// Puts gaps that are filled for sure, such as a tracker that was rejected for a moment, into what
/// counts as seen (frames, 3 J), in the model's order of points; without them the body would be
/// another one in these frames. Their variances by frame and point, cm².
fn put_known(
    adapted: &AdaptedPrior<'_>,
    gaps: &[Gap],
    filled: &[Option<FilledGap>],
    seen: &mut Array2<f64>,
) -> BTreeMap<(usize, usize), f64> {
    let mut known = BTreeMap::new();
    for (gap, filled) in gaps.iter().zip(filled) {
        let point = adapted.mapping.in_model(gap.point);
        let (Some(filled), Some(p)) = (filled, point) else {
            continue;
        };
        if filled.variance.iter().any(|v| !(*v <= KNOWN_SD * KNOWN_SD)) {
            continue;
        }
        let columns = 3 * p..3 * p + 3;
        (seen.slice_mut(s![gap.frames.clone(), columns])).assign(&filled.xyz);
        let frames = gap.frames.clone().zip(&filled.variance);
        known.extend(frames.map(|(t, variance)| ((t, p), *variance)));
    }
    known
}

/// The model's estimates of the frames of a take, in the model's order of points.
struct ModelFill<'a> {
    /// What counts as seen (frames, 3 J), cm; NaN missing.
    seen: ArrayView2<'a, f64>,
    /// The variances of a coordinate of points that were filled, by frame and point, cm².
    known: BTreeMap<(usize, usize), f64>,
    /// Frames a second.
    rate: f64,
    /// What the points that have gaps can do.
    limits: MotionLimits,
    /// Those of all frames of gaps, and of the frames at their ends with what is missing beside
    /// hidden.
    estimates: BTreeMap<Key, FrameEstimate>,
    /// Whether they are by upright poses, which know how sure the placement is.
    is_upright: bool,
}

impl ModelFill<'_> {
    /// Estimates the frames of gaps and those at their ends.
    fn estimated(
        mut self,
        adapted: &AdaptedPrior<'_>,
        upright: Option<&UprightPoses>,
        gaps: &[Gap],
        done: &(dyn Fn(usize) + Sync),
    ) -> Self {
        let inside = gaps.iter().flat_map(|g| g.frames.clone());
        let inside = inside.map(|t| (t, Vec::new()));
        let ends = gaps.iter().flat_map(|g| self.ends(g));
        let keys: BTreeSet<Key> = ends.chain(inside).collect();
        let keys: Vec<Key> = keys.into_iter().collect();
        let found = parallel::map_chunks(keys.len(), FRAMES_PER_TASK, |range| {
            done(range.len());
            let estimate = |(t, hidden): &Key| {
                let y = self.seen.row(*t).to_vec();
                let mut noise = variances(&y, 0.0, hidden);
                for ((_, p), variance) in self.known.range((*t, 0)..(*t + 1, 0)) {
                    let own = noise[3 * p..3 * p + 3].iter_mut();
                    own.for_each(|noise| *noise = noise.max(*variance));
                }
                adapted.estimate(upright, &y, &noise)
            };
            keys[range].iter().map(estimate).collect::<Vec<_>>()
        });
        let found = keys.into_iter().zip(found.into_iter().flatten());
        self.estimates = found.filter_map(|(k, f)| Some((k, f?))).collect();
        self
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

    /// Fills a gap; `None` where a frame of it shows too little.
    fn fill_gap(&self, gap: &Gap) -> Option<FilledGap> {
        let at = |values: &[f64]| DVec3::from_slice(&values[3 * gap.point..]);
        // The estimates at the gap's ends, and their errors.
        let ends: Vec<(usize, DVec3, DVec3)> = (self.ends(gap).into_iter())
            .filter_map(|key| {
                let estimate = at(&self.estimates.get(&key)?.mean);
                let error = at(&self.seen.row(key.0).to_vec()) - estimate;
                error.is_finite().then_some((key.0, estimate, error))
            })
            .collect();
        let mut xyz = Array2::zeros((gap.frames.len(), 3));
        let mut variance = Vec::with_capacity(gap.frames.len());
        let mut stated = 0.0;
        for (k, t) in gap.frames.clone().enumerate() {
            let estimate = self.estimates.get(&(t, Vec::new()))?;
            let mean = at(&estimate.mean);
            if !mean.is_finite() {
                return None;
            }
            (0..3).for_each(|axis| xyz[[k, axis]] = mean[axis]);
            variance.push(self.variance(t, &estimate.sd, gap.point));
            stated += estimate.sd[gap.point].powi(2);
        }
        let typical_sd = (stated / gap.frames.len() as f64).sqrt();
        let errors: Vec<(f64, DVec3)> = ends.iter().map(|e| (e.0 as f64, e.2)).collect();
        for (k, t) in gap.frames.clone().enumerate() {
            variance[k] *= carried(&errors, t as f64, self.rate).1;
        }
        let run = 0..gap.frames.len();
        let measured = from_time(xyz.view(), std::slice::from_ref(&run))[0].unwrap_or(0.0);
        let measured = match ends.is_empty() {
            // No end says which of the poses that the estimates jump between is right: their mean
            // over time is nearest to it.
            true if self.is_upright => measured.max(UPRIGHT_JUMPS * typical_sd),
            true => measured.max(JUMPS * typical_sd),
            false => measured,
        };
        let with_noise = |noise: f64| self.joined(gap, &xyz, &ends, noise);
        let filled = |xyz: Array2<f64>, noise: f64| FilledGap {
            xyz,
            variance: variance.iter().map(|v| v + noise * noise).collect(),
            method: FillMethod::Model,
            contacts: Vec::new(),
        };
        let plain = filled(with_noise(measured), 0.0);
        if self.limits.allow(self.seen, gap, &plain) {
            return Some(plain);
        }
        let mut stronger = STRONGER
            .iter()
            .map(|&noise| filled(with_noise(noise), noise));
        let followed = stronger.find(|f| self.limits.allow(self.seen, gap, f));
        Some(followed.unwrap_or(plain))
    }

    /// The variance of a point's estimate in frame `t`, cm², by the standard deviations that the
    /// model states: they leave out how sure the body's placement is, which moves all points
    /// together, and people's proportions.
    fn variance(&self, t: usize, sd: &[f64], point: usize) -> f64 {
        if self.is_upright {
            return sd[point].powi(2);
        }
        let is_missing = |p: &usize| (3 * p..3 * p + 3).any(|i| self.seen[[t, i]].is_nan());
        let missing: Vec<f64> = (0..sd.len())
            .filter(is_missing)
            .map(|p| sd[p].powi(2))
            .collect();
        let mean = missing.iter().sum::<f64>() / missing.len().max(1) as f64;
        OWN_SHARE * sd[point].powi(2) + COMMON_SHARE * mean
    }

    /// The estimates for a gap (frames, 3), smoothed with those at its ends, and joined to what is
    /// seen there. An end: the frame, its estimate, and the estimate's error.
    fn joined(
        &self,
        gap: &Gap,
        estimates: &Array2<f64>,
        ends: &[(usize, DVec3, DVec3)],
        noise: f64,
    ) -> Array2<f64> {
        let n = estimates.nrows();
        let first = usize::from(ends.iter().any(|e| e.0 < gap.frames.start));
        let row_of = |t: usize| if t < gap.frames.start { 0 } else { first + n };
        let mut path = Array2::zeros((n + ends.len(), 3));
        path.slice_mut(s![first..first + n, ..]).assign(estimates);
        for (t, estimate, _) in ends {
            (0..3).for_each(|axis| path[[row_of(*t), axis]] = estimate[axis]);
        }
        self.smooth(&mut path, noise);
        let error = |&(t, estimate, error): &(usize, DVec3, DVec3)| {
            let smooth = DVec3::from_array([0, 1, 2].map(|axis| path[[row_of(t), axis]]));
            (t as f64, estimate + error - smooth)
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
            let (path, run) = (path_of(xyz.view(), 0), 0..xyz.nrows());
            let noise = PathNoise::white(noise * noise);
            let smooth = smooth_path(&path, &[run], noise, 1.0 / self.rate);
            put_path(xyz, 0, &smooth.mean);
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

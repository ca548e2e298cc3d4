//! What each estimate of a gap is worth, by gaps of the same length simulated where the take is
//! known.
//!
//! ```text
//! w = argmin wᵀ G w + .1 g |w − w₀|²,   w ≥ 0,  Σ w = 1;     used is (n w + h w₀) / (n + h)
//! ```
//!
//! G is the Gram matrix of the estimates' errors in the simulated gaps, g the median of its
//! diagonal, n the number of these gaps, h one and more in long gaps. w₀ is the plain mean of the
//! processes and, in long gaps, of the conditional alone; in brief ones interpolation has a share.
//! The variance of the weighted estimate is that of the processes times a factor: the geometric
//! mean of what the errors show and of the usual one.

use super::estimates::{Estimates, GapFrames, Targets};
use super::regression::{Learned, spread};
use super::tuning::weights::*;
use crate::numeric::mixing::best_weights;
use ndarray::{Array1, Array2, Axis, s};
use std::ops::Range;

/// The estimate of a gap.
pub(crate) struct Weighed {
    /// (frames, 3 T), in the regression's frame of reference, cm.
    pub mean: Array2<f64>,
    /// (frames, 3 T), cm².
    pub variance: Array2<f64>,
    /// The share of what is interpolated over time, of each target (T).
    pub over_time: Vec<f64>,
    /// The mean squared error of a coordinate of each target in the simulated gaps (T), cm²; NaN
    /// where none was simulated.
    pub error: Vec<f64>,
}

/// Weighs the estimates of `gap`. `None` where there is nothing to learn from.
pub(crate) fn weigh(targets: &Targets<'_>, gap: &Range<usize>) -> Option<Weighed> {
    let whole = GapFrames {
        gap: gap.clone(),
        frames: gap.clone().collect(),
    };
    let mut simulated = simulated_gaps(targets, gap);
    let hidden: Vec<Range<usize>> = simulated.iter().map(|g| g.gap.clone()).collect();
    let learned = match targets.regression.learn(gap, &hidden) {
        Some(learned) => learned,
        // Simulated gaps leave nothing to learn from.
        None => {
            simulated.clear();
            targets.regression.learn(gap, &[])?
        }
    };
    let estimates = targets.estimates(&learned, &[whole], false)?.pop()?;
    let simulated = Simulated::new(targets, &learned, gap, simulated, estimates.means.len());
    let processes = targets.regression.kernels(gap).len();
    let seconds = gap.len() as f64 / targets.regression.rate;
    let points = targets.columns.len() / 3;
    let usual = match targets.regression.others {
        Some(_) => USUAL_FACTOR,
        None => OWN_USUAL_FACTOR + OWN_FACTOR * seconds,
    };
    let noise = targets.regression.noise;
    let usual = usual * (1.0 + (NOISY - 1.0) * noise / (noise + HALF_NOISY));
    let mut out = Weighed {
        mean: Array2::zeros(estimates.variance.dim()),
        variance: estimates.variance.clone(),
        over_time: Vec::new(),
        error: Vec::new(),
    };
    for point in 0..points {
        let columns = s![.., 3 * point..3 * point + 3];
        let plain = plain_weights(
            processes,
            seconds,
            estimates.means.len(),
            targets.regression.rate,
        );
        let (weights, factor, error) = match &simulated {
            Some(simulated) => {
                let hold = 1.0 + HOLD_SECONDS * seconds;
                simulated.judge(point, processes, (&plain, hold), usual)
            }
            None if seconds <= BRIEF && plain.len() > processes + 1 => {
                // Time says more than all else.
                let each = 1.0 / (plain.len() - processes - 1) as f64;
                let of = |k: usize| if k > processes { each } else { 0.0 };
                let weights = (Array1::from_shape_fn(plain.len(), of) + plain) / 2.0;
                (weights, usual, f64::NAN)
            }
            None => (plain, usual, f64::NAN),
        };
        for (w, mean) in weights.iter().zip(&estimates.means) {
            out.mean
                .slice_mut(columns)
                .scaled_add(*w, &mean.slice(columns));
        }
        out.variance.slice_mut(columns).mapv_inplace(|v| v * factor);
        out.over_time.push(weights.iter().skip(processes + 1).sum());
        out.error.push(error);
    }
    Some(out)
}

/// w₀ for a gap of some seconds: the `processes` weigh the same, the conditional up to as much the
/// longer the gap; those over time have a share that ends with [`TIME_ENDS`].
fn plain_weights(processes: usize, seconds: f64, estimates: usize, rate: f64) -> Array1<f64> {
    let conditional = seconds / (seconds + CONDITIONAL_SECONDS);
    let over_time = estimates.saturating_sub(processes + 1);
    let share = match over_time {
        0 => 0.0,
        _ => TIME_SHARE * (1.0 - (seconds - 1.0 / rate) / TIME_ENDS).clamp(0.0, 1.0),
    };
    let each = (1.0 - share) / (processes as f64 + conditional);
    let of = |k: usize| match k {
        _ if k < processes => each,
        _ if k == processes => each * conditional,
        _ => share / over_time as f64,
    };
    Array1::from_shape_fn(estimates, of)
}

/// Simulated gaps: what was estimated in them, and the truth.
struct Simulated {
    estimates: Vec<Estimates>,
    truth: Vec<Array2<f64>>,
    /// How many times as long the true gap is.
    longer: f64,
}

/// Gaps that are simulated like `gap`, or shorter ones where it is not long and the take has no
/// room for two; none where it has no room for these either. (What is learned beside them may
/// still be too little: then none is simulated.)
fn simulated_gaps(targets: &Targets<'_>, gap: &Range<usize>) -> Vec<GapFrames> {
    let is_long = gap.len() as f64 > LONG * targets.regression.rate;
    let parts = if is_long { &SHORTER[..1] } else { &SHORTER };
    let mut lengths = parts.iter().map(|part| gap.len() / part).filter(|l| *l > 0);
    (lengths.find_map(|length| gaps_of_length(targets, gap, length))).unwrap_or_default()
}

/// Simulated gaps of `length` frames with the ends of `gap`. `None` where the take has no room for
/// two.
fn gaps_of_length(
    targets: &Targets<'_>,
    gap: &Range<usize>,
    length: usize,
) -> Option<Vec<GapFrames>> {
    let regression = targets.regression;
    let ends = ends(regression.complete, gap);
    let beyond = (BEYOND * regression.rate).ceil() as usize;
    let starts = starts(regression.complete, regression.seconds, gap, length);
    let room = regression.complete.iter().filter(|c| **c).count() as f64 / (ROOM * length as f64);
    let count = SIMULATED.min(room as usize);
    let mut chosen: Vec<usize> = Vec::new();
    for k in 0..count {
        let part = &starts[k * starts.len() / count..(k + 1) * starts.len() / count];
        let clear: Vec<usize> = (part.iter().copied())
            .filter(|start| chosen.iter().all(|c| start.abs_diff(*c) > length + 2))
            .collect();
        chosen.extend(like(targets, gap, length, &clear));
    }
    let last = regression.complete.len();
    let simulated = |&start: &usize| {
        let own = start..start + length;
        let frames = spread(&own, KNOTS);
        // A gap with one end is simulated with its other end out of reach.
        let gap = match ends {
            (true, false) => start..(own.end + beyond).min(last),
            (false, true) => start.saturating_sub(beyond)..own.end,
            _ => own,
        };
        GapFrames { gap, frames }
    };
    (chosen.len() >= 2).then(|| chosen.iter().map(simulated).collect())
}

/// The one of `starts` where a simulated gap of `length` frames is most like `gap`: what is best
/// where a body is slow is not where it is fast. Long gaps see both: the middle one.
fn like(
    targets: &Targets<'_>,
    gap: &Range<usize>,
    length: usize,
    starts: &[usize],
) -> Option<usize> {
    let speed = targets.speed_beside(gap);
    if gap.len() as f64 > LONG * targets.regression.rate || speed.is_nan() {
        return starts.get(starts.len() / 2).copied();
    }
    let unlike = |start: &usize| {
        let own = targets.speed_beside(&(*start..start + length));
        ((own / speed).ln().abs(), *start)
    };
    let some = starts
        .iter()
        .step_by(starts.len().div_ceil(LOOKED_AT).max(1));
    let nearest = some.map(unlike).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map(|(_, start)| start)
}

/// Whether a gap has complete frames right before and after it.
fn ends(complete: &[bool], gap: &Range<usize>) -> (bool, bool) {
    let is_complete = |t: Option<usize>| t.and_then(|t| complete.get(t)).is_some_and(|c| *c);
    (
        is_complete(gap.start.checked_sub(1)),
        is_complete(Some(gap.end)),
    )
}

/// Where a gap of `length` frames can be simulated: in complete frames of one run, with one on
/// either side, clear of `gap`.
fn starts(complete: &[bool], seconds: &[f64], gap: &Range<usize>, length: usize) -> Vec<usize> {
    let mut since = 0;
    let mut starts = Vec::new();
    for t in 0..complete.len() {
        let is_new_run = t > 0 && seconds[t] - seconds[t - 1] > 1e3;
        if !complete[t] {
            since = t + 1;
        } else if is_new_run {
            since = t;
        }
        if t + 1 >= since + length + 2 {
            let start = t - length;
            if start + length + 2 < gap.start || start > gap.end + 2 {
                starts.push(start);
            }
        }
    }
    starts
}

impl Simulated {
    /// What is estimated in the gaps simulated for `gap`, which has so many `estimates`. `None`
    /// where there are not two with as many.
    fn new(
        targets: &Targets<'_>,
        learned: &Learned,
        gap: &Range<usize>,
        simulated: Vec<GapFrames>,
        estimates: usize,
    ) -> Option<Simulated> {
        let frames = &simulated.first()?.frames;
        let longer = gap.len() as f64 / (frames.last()? + 1 - frames.first()?) as f64;
        let found = targets.estimates(learned, &simulated, true)?;
        let (estimates, truth): (Vec<_>, Vec<_>) = (found.into_iter().zip(simulated))
            .filter(|(found, _)| found.means.len() >= estimates)
            .map(|(found, gap)| {
                let truth = targets.regression.own.targets.select(Axis(0), &gap.frames);
                (found, truth)
            })
            .unzip();
        (estimates.len() >= 2).then_some(Simulated {
            estimates,
            truth,
            longer,
        })
    }

    /// The weights of the estimates of a point, the factor of its variance, which is `usual` where
    /// little is simulated, and the mean squared error of a coordinate, cm².
    fn judge(
        &self,
        point: usize,
        processes: usize,
        (plain, hold): (&Array1<f64>, f64),
        usual: f64,
    ) -> (Array1<f64>, f64, f64) {
        let columns = s![.., 3 * point..3 * point + 3];
        let errors: Vec<Array1<f64>> = (0..plain.len())
            .map(|k| {
                let both = self.estimates.iter().zip(&self.truth);
                // The error of interpolation grows with the square of the length.
                let scale = if k > processes {
                    self.longer.powi(2)
                } else {
                    1.0
                };
                both.flat_map(|(e, truth)| {
                    let error = (&e.means[k].slice(columns) - &truth.slice(columns)) * scale;
                    error.into_iter()
                })
                .collect()
            })
            .collect();
        let n = errors[0].len() as f64;
        let gram = Array2::from_shape_fn((plain.len(), plain.len()), |(a, b)| {
            errors[a].dot(&errors[b]) / n
        });
        let simulated = self.estimates.len() as f64;
        let best = best_weights(&gram, plain, SHRINKAGE);
        let weights = (best * simulated + plain * hold) / (simulated + hold);
        let mut error = Array1::<f64>::zeros(errors[0].len());
        weights
            .iter()
            .zip(&errors)
            .for_each(|(w, e)| error.scaled_add(*w, e));
        let variance = self
            .estimates
            .iter()
            .flat_map(|e| e.variance.slice(columns).to_owned().into_iter());
        let ratio = error
            .iter()
            .zip(variance)
            .map(|(e, v)| e * e / v.max(1e-12))
            .sum::<f64>()
            / n;
        let count = self.estimates.len() as f64;
        let logs = count * ratio.max(LEAST_FACTOR).ln() + USUAL_COUNT * usual.ln();
        let factor = (logs / (count + USUAL_COUNT)).exp();
        (weights, factor, error.dot(&error) / n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_has_half_of_a_frame_and_none_of_a_long_gap() {
        let over_time = |seconds: f64| {
            let plain = plain_weights(3, seconds, 6, 120.0);
            assert!((plain.sum() - 1.0).abs() < 1e-12 && plain.iter().all(|w| *w >= 0.0));
            plain[4] + plain[5]
        };
        assert!((over_time(1.0 / 120.0) - 0.5).abs() < 1e-12);
        assert!(over_time(0.1) > 0.3 && over_time(0.2) < over_time(0.1));
        assert_eq!(over_time(0.4), 0.0);
        // A gap with one end has no path over time.
        assert!((plain_weights(2, 0.05, 3, 120.0).sum() - 1.0).abs() < 1e-12);
    }
}

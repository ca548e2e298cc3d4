//! A track cut into bands of frequencies, of each of which stays what is more than noise.
//!
//! ```text
//! e(t) = mean of b² near t                        power of a band b along an axis
//! n    = D median e_top · width / width_top       power of the noise: the highest band is nothing
//!                                                 else most of the time
//! own  = e − W n, shared = Σ (e − W n) / n² / Σ 1 / n²     of one axis, and of all three
//! s    = √(own · shared)                          0 where one is below 0
//! b s / (s + n)                                   what stays of the band (Wiener)
//! ```
//!
//! The axes share what they show since along the line of sight noise hides what the others see.

use super::tuning::*;
use crate::numeric::butterworth::{FEWEST, LowPass};
use crate::numeric::statistics::median;
use glam::DVec3;

/// A track without its noise.
pub(super) struct Filtered {
    /// The values, along the axes of the noise.
    pub values: Vec<DVec3>,
    /// The variance of a coordinate's noise along each axis, if it is as dense everywhere as in
    /// the highest band.
    pub variance: DVec3,
}

impl Filtered {
    /// Filters consecutive values along the axes of their noise, at `rate` a second; `None` of too
    /// few.
    pub(super) fn of(values: Vec<DVec3>, rate: f64) -> Option<Filtered> {
        let edges: Vec<f64> = (EDGES.into_iter())
            .take_while(|edge| *edge <= LAST_EDGE * rate)
            .collect();
        let (last, nyquist) = (*edges.last()?, rate / 2.0);
        if values.len() < FEWEST {
            return None;
        }
        let mut lower = low_passed(values.clone(), edges[0], rate);
        let mut out = lower.clone();
        let top: Vec<DVec3> = less(&values, &low_passed(values.clone(), last, rate));
        let of_top = power(&top, nyquist - last, rate);
        let median = |axis: usize| median(of_top.iter().map(|e| e[axis]).collect());
        let density = DVec3::new(median(0)?, median(1)?, median(2)?) / (nyquist - last);
        let ends = edges[1..].iter().copied().chain([nyquist]);
        for (start, end) in edges.iter().zip(ends) {
            let mut upper = values.clone();
            if end < nyquist {
                upper = low_passed(upper, end, rate);
            }
            let band = less(&upper, &lower);
            let power = power(&band, end - start, rate);
            let noise = DENSER * density * (end - start);
            for ((out, band), power) in out.iter_mut().zip(&band).zip(power) {
                *out += kept(power, noise) * *band;
            }
            lower = upper;
        }
        Some(Filtered {
            values: out,
            variance: DENSER * density * nyquist,
        })
    }
}

/// The share of a band that stays along each axis.
fn kept(power: DVec3, noise: DVec3) -> DVec3 {
    let more = power - NOISE_WEIGHT * noise;
    let weight = (noise * noise)
        .recip()
        .map(|w| if w.is_finite() { w } else { 0.0 });
    let shared = more.dot(weight) / weight.element_sum();
    let motion = (more.max(DVec3::ZERO) * shared.max(0.0)).map(f64::sqrt);
    let share = motion / (motion + noise);
    // Without noise all stays.
    DVec3::select(noise.cmpgt(DVec3::ZERO), share, DVec3::ONE)
}

/// The power of a band of a width, Hz, near each value.
fn power(band: &[DVec3], width: f64, rate: f64) -> Vec<DVec3> {
    let sigma = (PERIODS / width).min(MOST_SECONDS) * rate;
    let reach = (3.0 * sigma).ceil() as usize;
    let weights: Vec<f64> = (0..=reach)
        .map(|n| (-0.5 * (n as f64 / sigma).powi(2)).exp())
        .collect();
    let near = |t: usize| {
        let range = t.saturating_sub(reach)..(t + reach + 1).min(band.len());
        let (mut sum, mut all) = (DVec3::ZERO, 0.0);
        for k in range {
            let weight = weights[k.abs_diff(t)];
            sum += weight * band[k] * band[k];
            all += weight;
        }
        sum / all
    };
    (0..band.len()).map(near).collect()
}

/// Consecutive values below a frequency, Hz; as they are, where these are too few or the rate too
/// low.
pub(super) fn low_passed(mut values: Vec<DVec3>, cutoff: f64, rate: f64) -> Vec<DVec3> {
    let Some(filter) = LowPass::new(cutoff, rate) else {
        return values;
    };
    for axis in 0..3 {
        let mut along: Vec<f64> = values.iter().map(|v| v[axis]).collect();
        filter.apply(&mut along);
        for (value, along) in values.iter_mut().zip(along) {
            value[axis] = along;
        }
    }
    values
}

fn less(a: &[DVec3], b: &[DVec3]) -> Vec<DVec3> {
    a.iter().zip(b).map(|(a, b)| *a - *b).collect()
}

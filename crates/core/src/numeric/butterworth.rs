//! The low-pass filter of biomechanics: a Butterworth filter of second order, run forwards and
//! backwards.
//!
//! Both runs together have no lag and fourth order. Two runs damp the stated cutoff twice; so that
//! the pair has its −3 dB there, each is designed at the angular cutoff tan(π cutoff / rate) / (√2
//! − 1)^¼ (Winter, Biomechanics and Motor Control of Human Movement, 4th edition, section 3.4.4.2).

use std::f64::consts::{PI, SQRT_2};

/// Fewer values are not filtered: the ends would be all there is.
pub const FEWEST: usize = 10;

/// A low-pass filter for values at one rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass {
    /// The weights of the last three inputs.
    inputs: [f64; 3],
    /// The weights of the last two outputs.
    outputs: [f64; 2],
}

impl LowPass {
    /// A filter whose two runs pass half the power at `cutoff`, for `rate` values a second; `None`
    /// unless 0 < cutoff < .4 rate.
    pub fn new(cutoff: f64, rate: f64) -> Option<LowPass> {
        if !(cutoff > 0.0 && cutoff < 0.4 * rate) {
            return None;
        }
        let twice = (SQRT_2 - 1.0).powf(0.25);
        let w = (PI * cutoff / rate).tan() / twice;
        let (k1, k2) = (SQRT_2 * w, w * w);
        let a0 = k2 / (1.0 + k1 + k2);
        let b1 = 2.0 * a0 * (1.0 / k2 - 1.0);
        Some(LowPass {
            inputs: [a0, 2.0 * a0, a0],
            outputs: [b1, 1.0 - 4.0 * a0 - b1],
        })
    }

    /// Filters values on end, which go on beyond their ends as their point reflections do; fewer
    /// than [`FEWEST`] stay as they are.
    pub fn apply(&self, values: &mut [f64]) {
        let n = values.len();
        if n < FEWEST {
            return;
        }
        let pad = (n - 1).min(3 * FEWEST);
        let before = (1..=pad).rev().map(|i| 2.0 * values[0] - values[i]);
        let after = (1..=pad).map(|i| 2.0 * values[n - 1] - values[n - 1 - i]);
        let mut padded: Vec<f64> = before.chain(values.iter().copied()).chain(after).collect();
        self.run(&mut padded);
        padded.reverse();
        self.run(&mut padded);
        padded.reverse();
        values.copy_from_slice(&padded[pad..pad + n]);
    }

    /// One run, from the rest at the first value.
    fn run(&self, values: &mut [f64]) {
        let (mut x, mut y) = ([values[0]; 2], [values[0]; 2]);
        for value in values {
            let new = self.inputs[0] * *value
                + self.inputs[1] * x[0]
                + self.inputs[2] * x[1]
                + self.outputs[0] * y[0]
                + self.outputs[1] * y[1];
            (x, y) = ([*value, x[0]], [new, y[0]]);
            *value = new;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is left of a sine of so many hertz in the middle of ten seconds at 100 a second.
    fn left(hertz: f64, cutoff: f64) -> f64 {
        let wave = |t: usize| (2.0 * PI * hertz * t as f64 / 100.0).sin();
        let mut values: Vec<f64> = (0..1000).map(wave).collect();
        LowPass::new(cutoff, 100.0).unwrap().apply(&mut values);
        let power = |f: &dyn Fn(usize) -> f64| (300..700).map(|t| f(t).powi(2)).sum::<f64>();
        (power(&|t| values[t]) / power(&wave)).sqrt()
    }

    #[test]
    fn half_the_power_passes_at_the_cutoff() {
        for cutoff in [3.0, 6.0, 12.0] {
            assert!((left(cutoff, cutoff) - 0.5_f64.sqrt()).abs() < 0.01);
            assert!(left(cutoff / 4.0, cutoff) > 0.99);
            assert!(left(3.0 * cutoff, cutoff) < 0.03);
        }
    }

    #[test]
    fn straight_lines_pass_and_short_values_stay() {
        let filter = LowPass::new(6.0, 120.0).unwrap();
        let line: Vec<f64> = (0..50).map(|t| 3.0 + 0.25 * t as f64).collect();
        let mut values = line.clone();
        filter.apply(&mut values);
        assert!(values.iter().zip(&line).all(|(a, b)| (a - b).abs() < 0.02));
        let mut few = [1.0, 5.0, 2.0];
        filter.apply(&mut few);
        assert_eq!(few, [1.0, 5.0, 2.0]);
        for (cutoff, rate) in [
            (0.0, 100.0),
            (-1.0, 100.0),
            (50.0, 100.0),
            (f64::NAN, 100.0),
        ] {
            assert_eq!(LowPass::new(cutoff, rate), None);
        }
    }
}

//! The low-pass filter before a lower rate: a sinc in a Kaiser window, symmetric, so that nothing
//! lags.
//!
//! At a new rate f what is faster than f / 2 would turn into slower movement. What is slower than
//! .4 f passes, to a ten-thousandth; what is faster than .6 f, which would come out below .4 f,
//! does not. The length of the window follows from both (Kaiser 1974: attenuation 80 dB).

use std::f64::consts::PI;

/// Half of the band between what passes and what does not, relative to the new rate.
const HALF_BAND: f64 = 0.1;
/// Attenuation beyond it, dB.
const ATTENUATION: f64 = 80.0;
/// The filter is no longer to each side than this: what is slower by far is cut.
const LONGEST: f64 = 20_000.0;

/// The filter for one ratio of rates.
#[derive(Debug, Clone, PartialEq)]
pub struct AntiAlias {
    /// From the middle of the symmetric filter to its end.
    weights: Vec<f64>,
}

impl AntiAlias {
    /// The filter for a rate that is `ratio` of the old one; `None` where nothing would turn into
    /// what passes: for a higher rate, or one that is hardly lower.
    pub fn new(ratio: f64) -> Option<AntiAlias> {
        if !(ratio > 0.0 && ratio * (0.5 + HALF_BAND) < 0.5) {
            return None;
        }
        let half = (ATTENUATION - 7.95) / (14.36 * 2.0 * HALF_BAND * ratio) / 2.0;
        let half = half.min(LONGEST);
        let beta = 0.1102 * (ATTENUATION - 8.7);
        let weight = |k: usize| {
            let (x, place) = (PI * ratio * k as f64, k as f64 / half);
            let sinc = if k == 0 { 1.0 } else { x.sin() / x };
            sinc * bessel(beta * (1.0 - place * place).max(0.0).sqrt())
        };
        let mut weights: Vec<f64> = (0..=half as usize).map(weight).collect();
        let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
        weights.iter_mut().for_each(|w| *w /= sum);
        Some(AntiAlias { weights })
    }

    /// Filters values on end, which go on beyond their ends as their point reflections do, and
    /// beyond these evenly.
    pub fn apply(&self, values: &mut [f64]) {
        let (n, half) = (values.len(), self.weights.len() - 1);
        if n < 2 {
            return;
        }
        let last = n - 1;
        let before = (1..=half)
            .rev()
            .map(|k| 2.0 * values[0] - values[k.min(last)]);
        let after = (1..=half).map(|k| 2.0 * values[last] - values[last - k.min(last)]);
        let padded: Vec<f64> = before.chain(values.iter().copied()).chain(after).collect();
        for (t, value) in values.iter_mut().enumerate() {
            let middle = t + half;
            let pairs =
                (1..=half).map(|k| self.weights[k] * (padded[middle - k] + padded[middle + k]));
            *value = self.weights[0] * padded[middle] + pairs.sum::<f64>();
        }
    }
}

/// The modified Bessel function of the first kind, of order 0, by its power series.
fn bessel(x: f64) -> f64 {
    let (mut sum, mut term) = (1.0, 1.0);
    for k in 1..40 {
        term *= (x / (2.0 * f64::from(k))).powi(2);
        sum += term;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest error against a sine of that frequency (relative to the new rate) that is passed
    /// `share` of, in the middle of 1000 values.
    fn error(frequency: f64, ratio: f64, share: f64) -> f64 {
        let wave = |t: usize| (2.0 * PI * frequency * ratio * t as f64 + 0.4).sin();
        let mut values: Vec<f64> = (0..1000).map(wave).collect();
        AntiAlias::new(ratio).unwrap().apply(&mut values);
        (300..700)
            .map(|t| (values[t] - share * wave(t)).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn what_the_new_rate_holds_passes_and_nothing_else() {
        for ratio in [0.25, 0.5, 0.1, 0.8] {
            for slow in [0.0, 0.1, 0.3, 0.4] {
                assert!(error(slow, ratio, 1.0) < 2e-4, "{slow} {ratio}");
            }
            for fast in [0.6, 0.9, 1.5] {
                if fast * ratio < 0.5 {
                    assert!(error(fast, ratio, 0.0) < 2e-4, "{fast} {ratio}");
                }
            }
        }
    }

    #[test]
    fn lines_pass_to_their_ends_and_few_values_stay_finite() {
        let filter = AntiAlias::new(0.25).unwrap();
        let line = |t: usize| 3.0 - 0.5 * t as f64;
        let mut values: Vec<f64> = (0..200).map(line).collect();
        filter.apply(&mut values);
        assert!((0..200).all(|t| (values[t] - line(t)).abs() < 1e-9));
        for n in 0..5 {
            let mut few = vec![2.0; n];
            filter.apply(&mut few);
            assert!(few.iter().all(|v| (v - 2.0).abs() < 1e-12));
        }
    }

    #[test]
    fn only_a_lower_rate_is_filtered() {
        for none in [1.0, 2.0, 0.999, 0.84, 0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(AntiAlias::new(none).is_none(), "{none}");
        }
    }
}

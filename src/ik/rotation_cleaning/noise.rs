//! The noise of a track, from its differences in time.
//!
//! ```text
//! v = min_k median_t |D^k y_t|² / (C(2k, k) χ),   k = 3 … 6
//!     y track (frames, d), D difference, χ median of chi-squared with the track's freedoms
//! ```
//!
//! Motion shrinks with the order of the difference, white noise does not: hence the least. Slow
//! noise, correlated over more than some frames, looks like motion and is not seen.

use super::tuning::*;
use crate::numeric::statistics::median;

/// The variance of the white noise of a coordinate of `track`, of which frames that are not `seen`
/// do not count; `freedoms` (1 or 3) of its four coordinates are free. 0 where it is too short.
pub(super) fn noise_variance(track: &[[f64; 4]], seen: &[bool], freedoms: usize) -> f64 {
    let chi = if freedoms == 1 { CHI_1 } else { CHI_3 };
    let masked = track.iter().zip(seen);
    let mut y: Vec<[f64; 4]> = masked
        .map(|(y, s)| if *s { *y } else { [f64::NAN; 4] })
        .collect();
    let (mut least, mut binomial) = (f64::INFINITY, 1.0);
    for k in 1..=*NOISE_ORDERS.end() {
        binomial *= (2 * (2 * k - 1)) as f64 / k as f64;
        for t in 1..y.len() {
            for c in 0..4 {
                y[t - 1][c] = y[t][c] - y[t - 1][c];
            }
        }
        y.pop();
        if !NOISE_ORDERS.contains(&k) {
            continue;
        }
        let squares = y.iter().map(|y| y.iter().map(|v| v * v).sum::<f64>());
        let squares: Vec<f64> = squares.filter(|s| s.is_finite()).collect();
        if squares.len() >= LEAST_WINDOWS
            && let Some(median) = median(squares)
        {
            least = least.min(median / (binomial * chi));
        }
    }
    if least.is_finite() { least } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use rand_distr::{Distribution, Normal};

    #[test]
    fn white_noise_is_measured_beside_motion_and_motion_alone_is_none() {
        let mut random = parallel::rng(3, 0);
        let noise = Normal::new(0.0, 0.02).unwrap();
        for freedoms in [1, 3] {
            let mut at = |t: usize, sd: f64| {
                let mut y = [0.0; 4];
                for (c, y) in y.iter_mut().enumerate().take(freedoms) {
                    let motion = (0.05 * t as f64 + c as f64).sin();
                    *y = motion + sd * noise.sample(&mut random);
                }
                y
            };
            let noisy: Vec<[f64; 4]> = (0..2000).map(|t| at(t, 1.0)).collect();
            let clean: Vec<[f64; 4]> = (0..2000).map(|t| at(t, 0.0)).collect();
            let mut seen = vec![true; 2000];
            let sd = noise_variance(&noisy, &seen, freedoms).sqrt();
            assert!((0.018..0.022).contains(&sd), "{sd}");
            let sd = noise_variance(&clean, &seen, freedoms).sqrt();
            assert!(sd < 1e-5, "{sd}");
            // Missing frames do not count.
            let mut wild = noisy.clone();
            for t in (0..2000).step_by(30) {
                (wild[t], seen[t]) = ([99.0; 4], false);
            }
            let sd = noise_variance(&wild, &seen, freedoms).sqrt();
            assert!((0.017..0.023).contains(&sd), "{sd}");
        }
    }

    #[test]
    fn what_is_too_short_has_no_noise() {
        for frames in [0, 1, 2, 8] {
            let track = vec![[1.0; 4]; frames];
            assert_eq!(noise_variance(&track, &vec![true; frames], 3), 0.0);
        }
        assert_eq!(noise_variance(&[[0.3; 4]; 50], &[false; 50], 3), 0.0);
    }
}

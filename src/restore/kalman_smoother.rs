//! The Kalman smoother of a path.
//!
//! Each coordinate y_t (cm) is that of a point of constant velocity, but for white acceleration of
//! density q (cm²/s³), measured with noise variance r (cm²):
//!
//! ```text
//! x_{t+1} = [1 h; 0 1] x_t + N(0, q [h³/3 h²/2; h²/2 h]),   y_t = [1 0] x_t + N(0, r)
//!     h seconds per frame
//! ```
//!
//! A Kalman filter and a Rauch-Tung-Striebel smoother solve it. Its mean is a cubic smoothing
//! spline of strength r / q.

/// A smoothed series, with a value at every frame, measured or not.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Smoothed {
    /// Means.
    pub mean: Vec<f64>,
    /// Variances.
    pub variance: Vec<f64>,
}

/// Smooths one coordinate of a run: `series` in cm, NaN where missing; noise variance `r`, cm²;
/// `step` seconds per frame; density `q` of white acceleration, cm²/s³.
pub(crate) fn smooth(series: &[f64], r: f64, step: f64, q: f64) -> Smoothed {
    backward(&filter(series, r, step, q), step, q)
}

/// Mean (position, velocity) and covariance (pp, pv, vv).
type State = ([f64; 2], [f64; 3]);

fn predict((m, p): State, h: f64, q: f64) -> State {
    let mean = [m[0] + h * m[1], m[1]];
    let covariance = [
        p[0] + 2.0 * h * p[1] + h * h * p[2] + q * h * h * h / 3.0,
        p[1] + h * p[2] + q * h * h / 2.0,
        p[2] + q * h,
    ];
    (mean, covariance)
}

fn filter(series: &[f64], r: f64, h: f64, q: f64) -> Vec<State> {
    let first = series
        .iter()
        .copied()
        .find(|v| v.is_finite())
        .unwrap_or(0.0);
    // Initially anywhere near the first value, at up to some meters a second.
    let mut state: State = ([first, 0.0], [1e4, 0.0, 1e5]);
    let mut states = Vec::with_capacity(series.len());
    for (i, &y) in series.iter().enumerate() {
        if i > 0 {
            state = predict(state, h, q);
        }
        if y.is_finite() {
            let (m, p) = state;
            let s = p[0] + r;
            let rest = y - m[0];
            let gain = [p[0] / s, p[1] / s];
            state = (
                [m[0] + gain[0] * rest, m[1] + gain[1] * rest],
                [
                    p[0] - gain[0] * p[0],
                    p[1] - gain[0] * p[1],
                    p[2] - gain[1] * p[1],
                ],
            );
        }
        states.push(state);
    }
    states
}

fn backward(states: &[State], h: f64, q: f64) -> Smoothed {
    let n = states.len();
    let mut out = Smoothed {
        mean: vec![0.0; n],
        variance: vec![0.0; n],
    };
    let mut later: Option<State> = None;
    for i in (0..n).rev() {
        let (m, p) = states[i];
        let state = match later {
            None => (m, p),
            Some((lm, lp)) => {
                let (pm, pp) = predict((m, p), h, q);
                // G = P Fᵀ (F P Fᵀ + Q)⁻¹ with F = [[1, h], [0, 1]].
                let det = (pp[0] * pp[2] - pp[1] * pp[1]).max(1e-300);
                let inv = [pp[2] / det, -pp[1] / det, pp[0] / det];
                let pf = [[p[0] + h * p[1], p[1]], [p[1] + h * p[2], p[2]]];
                let g = [0, 1].map(|r| {
                    [
                        pf[r][0] * inv[0] + pf[r][1] * inv[1],
                        pf[r][0] * inv[1] + pf[r][1] * inv[2],
                    ]
                });
                let d = [lm[0] - pm[0], lm[1] - pm[1]];
                let dp = [lp[0] - pp[0], lp[1] - pp[1], lp[2] - pp[2]];
                let mean = [0, 1].map(|r| m[r] + g[r][0] * d[0] + g[r][1] * d[1]);
                let quad = |a: usize, b: usize| {
                    g[a][0] * (dp[0] * g[b][0] + dp[1] * g[b][1])
                        + g[a][1] * (dp[1] * g[b][0] + dp[2] * g[b][1])
                };
                (
                    mean,
                    [p[0] + quad(0, 0), p[1] + quad(0, 1), p[2] + quad(1, 1)],
                )
            }
        };
        out.mean[i] = state.0[0];
        out.variance[i] = state.1[0].max(0.0);
        later = Some(state);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};

    fn noisy(sd: f64, frames: usize) -> (Vec<f64>, Vec<f64>) {
        let mut rng = crate::numeric::parallel::rng(3, 0);
        let truth: Vec<f64> = (0..frames)
            .map(|i| 40.0 * (i as f64 / 120.0 * 4.0).sin())
            .collect();
        let seen = truth
            .iter()
            .map(|t| {
                let n: f64 = StandardNormal.sample(&mut rng);
                t + sd * n
            })
            .collect();
        (truth, seen)
    }

    #[test]
    fn smoothing_takes_most_of_the_noise_and_knows_how_sure_it_is() {
        let (truth, mut seen) = noisy(5.0, 600);
        seen[200..230].fill(f64::NAN);
        let out = smooth(&seen, 25.0, 1.0 / 120.0, 1e4);
        let error = |range: std::ops::Range<usize>| {
            let n = range.len() as f64;
            (range.map(|i| (out.mean[i] - truth[i]).powi(2)).sum::<f64>() / n).sqrt()
        };
        assert!(error(0..600) <= 2.5, "{}", error(0..600));
        let z: f64 = (0..600)
            .map(|i| (out.mean[i] - truth[i]).powi(2) / out.variance[i])
            .sum::<f64>()
            / 600.0;
        assert!((0.3..3.0).contains(&z), "{z}");
        assert!(out.variance[215] > out.variance[100]);
    }

    #[test]
    fn short_and_empty_series() {
        assert!(smooth(&[], 1.0, 0.01, 1e5).mean.is_empty());
        assert_eq!(smooth(&[f64::NAN; 3], 1.0, 0.01, 1e5).mean.len(), 3);
        assert!((smooth(&[5.0], 1e-9, 0.01, 1e5).mean[0] - 5.0).abs() <= 1e-6);
    }
}

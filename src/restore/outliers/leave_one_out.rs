//! Undecided points put back with the noise of an assignment, without asking the prior again.
//!
//! The prior expects the hidden points at N(m, P). Observing them as y with noise R gives m + P K (y − m) and P − P K
//! P with K = (P + R)⁻¹, for all points; and the expectation of each from all others.

use super::frame_state::FrameState;
use crate::numeric::small_linalg::{backward, factorise, forward};
use crate::prior::Posterior;
use crate::restore::rigid::distances::MIN_OUTLIER_VARIANCE;
use glam::DMat3;

/// How wrong a prior may be: weight, factor of its variance, variance added (cm²).
pub const SCALES: [(f64, f64, f64); 4] = [
    (0.4, 1.0, 0.01 * MIN_OUTLIER_VARIANCE),
    (0.3, 4.0, 0.05 * MIN_OUTLIER_VARIANCE),
    (0.2, 16.0, 0.2 * MIN_OUTLIER_VARIANCE),
    (0.1, 64.0, 0.5 * MIN_OUTLIER_VARIANCE),
];

/// The expectation of a point from all observations but its own.
pub struct LeaveOneOut {
    /// Observed minus expected, cm.
    pub off: [f64; 3],
    /// Covariance (3, 3) by rows, cm².
    pub covariance: [f64; 9],
}

/// The undecided points of a frame, observed again.
pub struct Reinserted<'a> {
    frame: &'a FrameState,
    expected: &'a Posterior,
    /// The coordinates of the undecided points.
    at: Vec<usize>,
    /// Noise variance of each coordinate, cm².
    noise: Vec<f64>,
    /// Cholesky factor of P + R at these coordinates, (n, n) by rows.
    factor: Vec<f64>,
    /// (P + R)⁻¹ (y − m).
    pull: Vec<f64>,
}

impl<'a> Reinserted<'a> {
    /// Observes the undecided points under an assignment; `expected` is the posterior without them.
    pub fn of(frame: &'a FrameState, expected: &'a Posterior, assigned: &[bool]) -> Reinserted<'a> {
        let noise = frame.noise(Some(assigned));
        let at: Vec<usize> = frame
            .undecided
            .iter()
            .flat_map(|p| 3 * p..3 * p + 3)
            .collect();
        let n = at.len();
        let mut factor = vec![0.0; n * n];
        for (k, i) in at.iter().enumerate() {
            for (l, j) in at[..=k].iter().enumerate() {
                factor[k * n + l] = expected.covariance[[*i, *j]];
            }
            factor[k * n + k] += noise[*i];
        }
        factorise(&mut factor, n);
        let mut pull: Vec<f64> = at.iter().map(|i| frame.y[*i] - expected.mean[*i]).collect();
        forward(&factor, n, &mut pull);
        backward(&factor, n, &mut pull);
        Reinserted {
            frame,
            expected,
            at,
            noise,
            factor,
            pull,
        }
    }

    /// The posterior of all points.
    pub fn belief(&self) -> Posterior {
        let n = self.at.len();
        let mut out = self.expected.clone();
        for (i, pull) in self.at.iter().zip(&self.pull) {
            let row = self.expected.covariance.row(*i);
            out.mean
                .iter_mut()
                .zip(row)
                .for_each(|(m, c)| *m += pull * c);
        }
        let mut column = vec![0.0; n];
        let mut rows: Vec<Vec<f64>> = vec![vec![0.0; out.mean.len()]; n];
        for c in 0..out.mean.len() {
            for (v, i) in column.iter_mut().zip(&self.at) {
                *v = self.expected.covariance[[*i, c]];
            }
            forward(&self.factor, n, &mut column);
            rows.iter_mut()
                .zip(&column)
                .for_each(|(row, v)| row[c] = *v);
        }
        for row in &rows {
            for (i, v) in row.iter().enumerate() {
                let mut target = out.covariance.row_mut(i);
                target.iter_mut().zip(row).for_each(|(t, w)| *t -= v * w);
            }
        }
        out.covariance.diag_mut().mapv_inplace(|v| v.max(0.0));
        out
    }

    /// The expectation of each undecided point from all others, the undecided ones included.
    pub fn cavities(&self) -> Vec<LeaveOneOut> {
        (0..self.frame.undecided.len())
            .map(|p| self.cavity(p))
            .collect()
    }

    /// With K = (P + R)⁻¹, the inverse of its block K_pp is C + R, and y − m without point p is K_pp⁻¹ (K (y − m))_p.
    /// This avoids the cancellation of removing an exact observation from a posterior that used it.
    fn cavity(&self, p: usize) -> LeaveOneOut {
        let (n, at) = (self.at.len(), 3 * p..3 * p + 3);
        let columns: [Vec<f64>; 3] = std::array::from_fn(|c| {
            let mut unit = vec![0.0; n];
            unit[3 * p + c] = 1.0;
            forward(&self.factor, n, &mut unit);
            unit
        });
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum();
        let own: [f64; 9] = std::array::from_fn(|k| product(&columns[k / 3], &columns[k % 3]));
        let mut covariance = DMat3::from_cols_array(&own).inverse().to_cols_array();
        let pull = &self.pull[at.clone()];
        let off = std::array::from_fn(|c| product(&covariance[3 * c..3 * c + 3], pull));
        for (c, i) in self.at[at].iter().enumerate() {
            covariance[4 * c] -= self.noise[*i];
        }
        LeaveOneOut { off, covariance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rigid_pairs::RigidPairs;
    use crate::restore::rigid::body_lengths::BodyMixture;
    use ndarray::Array2;

    /// Four points that are expected to move together, observed elsewhere, some of them undecided.
    fn frame(undecided: &[usize]) -> (FrameState, Posterior) {
        let pairs = RigidPairs::default();
        let y: Vec<f64> = (0..12).map(|i| f64::from((7 * i) % 5)).collect();
        let noise_variance: Vec<f64> = (0..12).map(|i| f64::from(i % 4) * 0.1).collect();
        let mut frame = FrameState::new(&pairs, &BodyMixture::of(&pairs), y, noise_variance);
        frame.undecided = undecided.to_vec();
        frame.corrupt.fill(false);
        let of = |i: usize, j: usize| match i.abs_diff(j) {
            0 => 3.0,
            d => 2.0 / (1.0 + d as f64),
        };
        let expected = Posterior {
            mean: vec![1.0; 12],
            covariance: Array2::from_shape_fn((12, 12), |(i, j)| of(i, j)),
            ..Posterior::default()
        };
        (frame, expected)
    }

    #[test]
    fn a_cavity_is_what_is_expected_where_all_but_that_point_are_shown() {
        let (all, expected) = frame(&[0, 1, 3]);
        let assigned = [false, true, false];
        let shown = Reinserted::of(&all, &expected, &assigned);
        for (k, p) in [0, 1, 3].into_iter().enumerate() {
            let others = |k: usize| (0..3).filter(move |o| *o != k);
            let undecided: Vec<usize> = others(k).map(|o| [0, 1, 3][o]).collect();
            let (rest, expected) = frame(&undecided);
            let assigned: Vec<bool> = others(k).map(|o| assigned[o]).collect();
            let belief = Reinserted::of(&rest, &expected, &assigned).belief();
            let cavity = &shown.cavities()[k];
            for c in 0..3 {
                let off = rest.y[3 * p + c] - belief.mean[3 * p + c];
                assert!((cavity.off[c] - off).abs() <= 1e-6, "{p} {c}");
                for d in 0..3 {
                    let v = belief.covariance[[3 * p + c, 3 * p + d]];
                    assert!((cavity.covariance[3 * c + d] - v).abs() <= 1e-6, "{p} {c}");
                }
            }
        }
    }

    #[test]
    fn what_is_shown_with_less_noise_is_nearer_to_where_it_was_seen_and_tells_more_of_the_others() {
        let (mut frame, expected) = frame(&[1]);
        frame.noise_variance[3..6].fill(0.0);
        let exact = Reinserted::of(&frame, &expected, &[false]).belief();
        let noisy = Reinserted::of(&frame, &expected, &[true]).belief();
        for i in 3..6 {
            assert!((exact.mean[i] - frame.y[i]).abs() <= 1e-4);
            assert!(exact.covariance[[i, i]] <= 1e-4);
            assert!((noisy.mean[i] - frame.y[i]).abs() >= (exact.mean[i] - frame.y[i]).abs());
        }
        assert!(exact.covariance[[6, 6]] < noisy.covariance[[6, 6]]);
        assert!(noisy.covariance[[6, 6]] < expected.covariance[[6, 6]]);
    }
}

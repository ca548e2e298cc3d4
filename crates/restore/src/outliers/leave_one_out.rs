//! A point's expectation without its own observation, and how far off an outlier is by it.

use super::frame_state::FrameState;
use super::tuning::leave_one_out::*;
use crate::prior::Posterior;
use glam::DMat3;

/// The expectation of a point from all observations but its own.
struct LeaveOneOut {
    /// Observed minus expected, cm.
    off: [f64; 3],
    /// Covariance (3, 3) by rows, cm².
    covariance: [f64; 9],
}

/// Raises the variances of points that may be outliers to the squared distance from where the prior
/// expects them. A distance measures a deviation along itself only. The variance stays below the
/// square of the worst distance: a point with right distances is no outlier because the prior did
/// not expect it.
///
/// `expected` is the posterior with [`FrameState::noise`] of no assignment, which this does not
/// change. Variances only rise; the probabilities by distances keep the variances they were
/// computed with.
pub(crate) fn raise_outlier_variances(frame: &mut FrameState, expected: &Posterior) {
    let shown = frame.noise(None);
    let may = |p: &usize| frame.corrupt[*p] || frame.undecided.contains(p);
    let may: Vec<usize> = (0..frame.points()).filter(may).collect();
    for p in may {
        let Some(own) = left_out(&frame.y, expected, p, shown[3 * p]) else {
            continue;
        };
        let square = |c: usize| own.off[c].powi(2) - own.covariance[4 * c];
        let off = (0..3).map(square).sum::<f64>() / 3.0;
        if off.is_finite() {
            let outlier_variance = &mut frame.likelihood.outlier_variance[p];
            *outlier_variance = outlier_variance.max(off.min(frame.likelihood.farthest[p]));
        }
    }
}

/// The expectation of a point with its own observation of variance `r` divided out (infinite `r`:
/// it had none). `None` where the posterior leaves more than the observation's noise, as mixtures
/// may, or nearly as much: the posterior then is the observation.
fn left_out(y: &[f64], belief: &Posterior, p: usize, r: f64) -> Option<LeaveOneOut> {
    // P_out = P (I − P/r)⁻¹ and y − m_out = (I − P/r)⁻¹ (y − m).
    let left = |by: f64| -> [f64; 9] {
        std::array::from_fn(|k| {
            let v = belief.covariance[[3 * p + k / 3, 3 * p + k % 3]] / r;
            f64::from(u8::from(k / 3 == k % 3)) - by * v
        })
    };
    if !is_positive(&left(1.0 / MOST_OWN)) {
        return None;
    }
    let inverse = DMat3::from_cols_array(&left(1.0)).inverse().to_cols_array();
    let off: [f64; 3] = std::array::from_fn(|c| y[3 * p + c] - belief.mean[3 * p + c]);
    let without = std::array::from_fn(|a| (0..3).map(|b| inverse[3 * a + b] * off[b]).sum());
    let covariance = std::array::from_fn(|k| {
        let (a, b) = (k / 3, k % 3);
        let of = |c: usize| inverse[3 * a + c] * belief.covariance[[3 * p + c, 3 * p + b]];
        (0..3).map(of).sum()
    });
    Some(LeaveOneOut {
        off: without,
        covariance,
    })
}

/// Whether a symmetric matrix (3, 3) is positive definite: its leading minors are above 0.
fn is_positive(a: &[f64; 9]) -> bool {
    let minor = a[0] * a[4] - a[1] * a[3];
    a[0] > 0.0 && minor > 0.0 && DMat3::from_cols_array(a).determinant() > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rigid_pairs::{Pair, RigidPairs};
    use crate::rigid::body_lengths::BodyMixture;
    use ndarray::Array2;

    #[test]
    fn without_its_own_observation_a_point_is_expected_where_the_others_say() {
        // x ~ N(m, S) in three coordinates, observed with noise r: dividing the observation out of
        // the posterior gives N(m, S) back.
        let (m, y, r) = ([1.0, -2.0, 0.5], [3.0, -1.0, 0.0], 0.7);
        let s = [2.0, 0.3, 0.1, 0.3, 1.0, -0.2, 0.1, -0.2, 0.5];
        let mut a = s;
        (0..3).for_each(|k| a[4 * k] += r);
        let inverse = DMat3::from_cols_array(&a).inverse().to_cols_array();
        let product = |x: &[f64; 9], y: &[f64; 9]| -> [f64; 9] {
            std::array::from_fn(|k| (0..3).map(|c| x[3 * (k / 3) + c] * y[3 * c + k % 3]).sum())
        };
        let gain = product(&s, &inverse);
        let mean =
            (0..3).map(|i| m[i] + (0..3).map(|c| gain[3 * i + c] * (y[c] - m[c])).sum::<f64>());
        let noise_variance = product(&gain, &s);
        let belief = Posterior {
            mean: mean.collect(),
            covariance: Array2::from_shape_fn((3, 3), |(i, j)| {
                s[3 * i + j] - noise_variance[3 * i + j]
            }),
            ..Posterior::default()
        };
        let LeaveOneOut { off, covariance } = left_out(&y, &belief, 0, r).unwrap();
        for k in 0..3 {
            assert!((off[k] - (y[k] - m[k])).abs() <= 1e-9, "{off:?}");
            assert!(
                (covariance[4 * k] - s[4 * k]).abs() <= 1e-9,
                "{covariance:?}"
            );
        }
    }

    #[test]
    fn a_belief_that_leaves_more_open_than_the_noise_tells_nothing() {
        let belief = |v: f64| Posterior {
            mean: vec![0.0; 3],
            covariance: Array2::eye(3) * v,
            ..Posterior::default()
        };
        assert!(left_out(&[1.0; 3], &belief(0.9), 0, 1.0).is_some());
        assert!(left_out(&[1.0; 3], &belief(1.1), 0, 1.0).is_none());
        // Nearly the observation.
        assert!(left_out(&[1.0; 3], &belief(0.99), 0, 1.0).is_none());
        assert!(left_out(&[1.0; 3], &belief(f64::NAN), 0, 1.0).is_none());
    }

    /// A frame of a chain of six points, 10 cm apart, along x; some of them observed elsewhere.
    fn chain(seen: &[(usize, f64)]) -> (FrameState, Vec<f64>) {
        let rigid = |k| Pair {
            ends: [k, k + 1],
            sd: 0.0,
            still: false,
        };
        let pairs = RigidPairs {
            pairs: (0..5).map(rigid).collect(),
            bodies: Array2::from_elem((1, 5), 10.0),
            shares: vec![1.0],
        };
        let pose: Vec<f64> = (0..6).flat_map(|p| [10.0 * p as f64, 0.0, 0.0]).collect();
        let mut y = pose.clone();
        seen.iter().for_each(|(i, v)| y[*i] = *v);
        let frame = FrameState::new(&pairs, &BodyMixture::of(&pairs), y, vec![0.0; 18]);
        (frame, pose)
    }

    fn belief(mean: Vec<f64>, variance: &[f64]) -> Posterior {
        Posterior {
            mean,
            covariance: Array2::from_diag(&ndarray::arr1(variance)),
            ..Posterior::default()
        }
    }

    /// Squared deviation of a point from its expectation, a coordinate; the expectation itself has
    /// variance 1.
    fn off(frame: &FrameState, pose: &[f64], p: usize) -> f64 {
        let square = |i: usize| (frame.y[i] - pose[i]).powi(2) - 1.0;
        (3 * p..3 * p + 3).map(square).sum::<f64>() / 3.0
    }

    #[test]
    fn a_point_is_as_far_off_as_from_where_it_is_expected_but_no_farther_than_its_worst_distance() {
        // Turned about its neighbor: one of its distances is right, the other shows the deviation.
        let (mut frame, pose) = chain(&[(9, 21.0), (10, 9.9)]);
        frame.likelihood.corrupt[3] = 0.5;
        frame.undecided = vec![3];
        frame.corrupt.fill(false);
        let before = frame.likelihood.outlier_variance[3];
        raise_outlier_variances(&mut frame, &belief(pose.clone(), &[1.0; 18]));
        let noise_variance = off(&frame, &pose, 3);
        assert!(before < noise_variance && noise_variance < frame.likelihood.farthest[3]);
        assert!(
            (frame.likelihood.outlier_variance[3] - noise_variance).abs() <= 1e-9 * noise_variance
        );
        // An expectation that is not finite changes nothing.
        let (raised, shown) = (frame.likelihood.outlier_variance.clone(), frame.noise(None));
        raise_outlier_variances(&mut frame, &belief(vec![f64::NAN; 18], &[1.0; 18]));
        assert_eq!(frame.likelihood.outlier_variance, raised);
        // Expected farther away than the worst distance.
        let far = pose.iter().map(|v| v + 400.0).collect();
        raise_outlier_variances(&mut frame, &belief(far, &[1.0; 18]));
        assert_eq!(
            frame.likelihood.outlier_variance[3],
            frame.likelihood.farthest[3]
        );
        assert_eq!(frame.noise(None), shown);
    }

    #[test]
    fn a_point_decided_to_be_corrupt_was_shown_and_is_judged_without_that() {
        let (mut frame, pose) = chain(&[(9, 21.0), (10, 9.9)]);
        frame.likelihood.corrupt[3] = 1.0;
        frame.undecided = vec![];
        frame.corrupt = (0..6).map(|p| p == 3).collect();
        // The posterior of each coordinate, expected with variance 1, after its observation.
        let shown = frame.noise(None);
        assert_eq!(
            shown[9],
            frame.likelihood.farthest[3].max(frame.likelihood.outlier_variance[3])
        );
        let gain = |i: usize| 1.0 / (1.0 + shown[i]);
        let at = |i: usize| pose[i] + gain(i) * (frame.y[i] - pose[i]);
        let variance: Vec<f64> = (0..18).map(|i| 1.0 - gain(i)).collect();
        let noise_variance = belief((0..18).map(at).collect(), &variance);
        raise_outlier_variances(&mut frame, &noise_variance);
        let whole = off(&frame, &pose, 3);
        assert!(
            (frame.likelihood.outlier_variance[3] - whole).abs() <= 1e-6 * whole,
            "{} {whole}",
            frame.likelihood.outlier_variance[3]
        );
    }

    #[test]
    fn points_whose_distances_are_right_are_not_off_where_the_belief_does_not_expect_them() {
        let (mut frame, pose) = chain(&[]);
        frame.likelihood.corrupt.fill(0.5);
        frame.undecided = (0..6).collect();
        let before = frame.likelihood.outlier_variance.clone();
        let far = pose.iter().map(|v| v + 400.0).collect();
        raise_outlier_variances(&mut frame, &belief(far, &[1.0; 18]));
        assert_eq!(frame.likelihood.outlier_variance, before);
    }
}

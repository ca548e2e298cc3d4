//! Points scored one by one, each by its expectation without its own observation.

use super::assignment::Assignment;
use super::frame_state::{FrameState, MOST, expected_by_prior};
use super::leave_one_out::{LeaveOneOut, Reinserted, SCALES};
use super::rigid_likelihood::log_odds;
use crate::numeric::small_linalg::{factorise, forward, log_sum};
use crate::prior::{Posterior, Prior};
use crate::restore::rigid::distances::{MIN_OUTLIER_VARIANCE, OUTLIER_SHARE, base_of, is_seen};
use glam::DMat3;

/// Factor of a point's log likelihood ratio in [`rescore`]: the weights of the assignments have used the point
/// already.
const SECOND: f64 = 0.5;

/// A posterior that keeps more than this share of the observation's variance has no information but that observation.
const MOST_OWN: f64 = 0.98;

/// Where too many points are undecided to hide them all, scores each point by the prior's posterior of the whole
/// frame.
pub fn score_crowded(prior: &dyn Prior, frames: &mut [FrameState]) {
    let crowded: Vec<usize> = (0..frames.len())
        .filter(|&t| frames[t].undecided.len() > MOST)
        .collect();
    let noise = |f: &FrameState| -> Vec<f64> {
        f.noise_variance
            .iter()
            .map(|v| v.max(MIN_OUTLIER_VARIANCE * OUTLIER_SHARE))
            .collect()
    };
    let beliefs = expected_by_prior(prior, &crowded, |t| {
        (frames[t].y.clone(), noise(&frames[t]))
    });
    for (&t, belief) in crowded.iter().zip(&beliefs) {
        let frame = &mut frames[t];
        let guess = noise(frame);
        let odds = |p: usize| {
            let cavity = left_out(&frame.y, belief, p, guess[3 * p]);
            let noise_variance = cavity.and_then(|c| logs(frame, &c, p));
            log_odds() + noise_variance.map_or(0.0, |[clean, corrupt]| corrupt - clean)
        };
        let unary = of_seen(frame, odds);
        frame.judge(&unary);
    }
}

/// Raises the variances of points that may be outliers to the squared distance from where the prior expects them. A
/// distance measures a deviation along itself only. The variance stays below the square of the worst distance: a point
/// with right distances is no outlier because the prior did not expect it.
///
/// `expected` is the posterior with [`FrameState::noise`] of no assignment, which this does not change. Variances only
/// rise; the probabilities by distances keep the variances they were computed with.
pub fn raise_outlier_variances(frame: &mut FrameState, expected: &Posterior) {
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

/// Scores all points again, by what the others expect of each under the likely assignments. `expected` is the
/// posterior without the undecided points.
pub fn rescore(frame: &mut FrameState, expected: &Posterior, assignments: &[Assignment]) {
    // Undecided points are left out exactly; for the others the own observation is divided out, which works where it
    // was not exact.
    let noise = frame.noise(None);
    let under = |a: &Assignment| -> Vec<Option<LeaveOneOut>> {
        let shown = Reinserted::of(frame, expected, &a.corrupt);
        let belief = shown.belief();
        let mut own = shown.cavities().into_iter();
        (0..frame.points())
            .map(|p| match frame.undecided.contains(&p) {
                true => own.next(),
                false => left_out(&frame.y, &belief, p, noise[3 * p]),
            })
            .collect()
    };
    let noise_variance: Vec<(f64, Vec<Option<LeaveOneOut>>)> = (assignments.iter())
        .map(|a| (a.weight.ln(), under(a)))
        .collect();
    let odds = |p: usize| {
        let (mut clean, mut corrupt) = (Vec::new(), Vec::new());
        for (weight, each) in &noise_variance {
            if let Some(logs) = each[p].as_ref().and_then(|c| logs(frame, c, p)) {
                clean.push(weight + logs[0]);
                corrupt.push(weight + logs[1]);
            }
        }
        let noise_variance = log_sum(&corrupt) - log_sum(&clean);
        log_odds()
            + if noise_variance.is_finite() {
                SECOND * noise_variance
            } else {
                0.0
            }
    };
    let unary = of_seen(frame, odds);
    frame.judge(&unary);
}

/// Log odds of each seen point; −∞ for the others.
fn of_seen(frame: &FrameState, odds: impl Fn(usize) -> f64) -> Vec<f64> {
    let seen = |p: usize| is_seen(&frame.y, &frame.noise_variance, p);
    let of = |p: usize| if seen(p) { odds(p) } else { f64::NEG_INFINITY };
    (0..frame.points()).map(of).collect()
}

/// Log density of a point as observed, if clean and if an outlier; `None` without a finite expectation.
fn logs(frame: &FrameState, expected: &LeaveOneOut, p: usize) -> Option<[f64; 2]> {
    let noises = [
        base_of(&frame.noise_variance, p),
        frame.likelihood.outlier_variance[p],
    ];
    let logs = noises.map(|n| log_density(expected, n));
    logs.iter().all(|l| l.is_finite()).then_some(logs)
}

/// The expectation of a point with its own observation of variance `r` divided out (infinite `r`: it had none). `None`
/// where the posterior leaves more than the observation's noise, as mixtures may, or nearly as much: the posterior
/// then is the observation.
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

/// log Σ_s w_s N(off; 0, c_s P + (i_s + noise) I), without the constant.
fn log_density(expected: &LeaveOneOut, noise: f64) -> f64 {
    let logs = SCALES.map(|(w, c, i)| {
        let mut a: Vec<f64> = expected.covariance.iter().map(|v| c * v).collect();
        (0..3).for_each(|k| a[4 * k] += i + noise);
        factorise(&mut a, 3);
        let mut z = expected.off.to_vec();
        forward(&a, 3, &mut z);
        let log_det: f64 = (0..3).map(|k| a[4 * k].ln()).sum();
        f64::ln(w) - 0.5 * z.iter().map(|z| z * z).sum::<f64>() - log_det
    });
    log_sum(&logs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rigid_pairs::{Pair, RigidPairs};
    use crate::restore::rigid::body_lengths::BodyMixture;
    use ndarray::Array2;

    #[test]
    fn without_its_own_observation_a_point_is_expected_where_the_others_say() {
        // x ~ N(m, S) in three coordinates, observed with noise r: dividing the observation out of the posterior gives
        // N(m, S) back.
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
        let farther = off.map(|o| 5.0 * o);
        let near = log_density(&LeaveOneOut { off, covariance }, r);
        assert!(
            near > log_density(
                &LeaveOneOut {
                    off: farther,
                    covariance
                },
                r
            )
        );
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

    /// Squared deviation of a point from its expectation, a coordinate; the expectation itself has variance 1.
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

    #[test]
    fn a_second_look_judges_an_exact_point_by_the_others_also_where_it_was_taken_for_clean() {
        let clean = |n: usize| Assignment {
            weight: 1.0,
            corrupt: vec![false; n],
            noise_variance: 0.0,
        };
        let (mut frame, pose) = chain(&[(9, 21.0), (10, 9.9)]);
        frame.undecided = vec![3];
        frame.corrupt.fill(false);
        let seen = frame.y.clone();
        let rescored = |frame: &mut FrameState, mean: Vec<f64>| {
            frame.undecided = vec![3];
            rescore(frame, &belief(mean, &[0.1; 18]), &[clean(1)]);
            frame.likelihood.corrupt[3]
        };
        let expected_there = rescored(&mut frame, seen);
        let expected_elsewhere = rescored(&mut frame, pose);
        assert!(
            expected_there < 0.8 && expected_elsewhere > 0.98,
            "{expected_there} {expected_elsewhere}"
        );
    }
}

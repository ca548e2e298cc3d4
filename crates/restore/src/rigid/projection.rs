//! Projection of a Gaussian N(m, P) of a pose (D coordinates) onto n rigid distances, by iterated
//! Kalman updates.
//!
//! With g(x) the distances, H their Jacobian and L the lengths (variances V):
//!
//! ```text
//! P' = P + I,   x ← m + P'Hᵀ (H P' Hᵀ + V)⁻¹ (L − g(x) − H (m − x))
//!     until nothing moves, at most ten times
//! ```
//!
//! I (diagonal) is what the posterior underestimates: i for a coordinate that was not observed,
//! 1/(1/i + 1/R) for one observed with noise variance R. The i and the body (L, V) are the most
//! likely ones given the distances of m. [`Uncertainty`] says how much of P's correlations is used.
//! Cost: n² (n/3 + 36) a step and 3 n² D for the variances. Fails (and returns m) where the lengths
//! cannot be met.

use super::body_lengths::{BodyMixture, Lengths};
use super::jacobian::{JacobianRow, jacobian, products, shared_ends, times_covariance};
use super::tuning::projection::*;
use super::uncertainty::Uncertainty;
use crate::numeric::simd;
use crate::numeric::small_linalg::add;
use crate::numeric::small_linalg::{backward, factorize, forward};
use crate::pose::ASF_UNIT_CM;
use crate::prior::rigid_pairs::RigidPairs;
use crate::prior::{EXACT_VARIANCE, Posterior};

/// The body whose lengths are kept.
#[derive(Debug, Clone, Copy)]
pub(crate) enum BodyChoice<'a> {
    /// The most likely one.
    Any,
    /// One with these lengths.
    Known(&'a Lengths),
}

/// Projects a mean (D) with its uncertainty; `noise` holds the variances of the observation (cm²,
/// infinite where missing).
pub(crate) fn project(
    pairs: &RigidPairs,
    bodies: &BodyMixture,
    whose: BodyChoice<'_>,
    mean: &[f64],
    uncertainty: Uncertainty<'_>,
    noise: &[f64],
) -> Posterior {
    let as_it_was = || Posterior {
        mean: mean.to_vec(),
        variance: uncertainty.variances(),
        ..Posterior::default()
    };
    let used: Vec<usize> = (0..pairs.pairs.len())
        .filter(|&k| !pairs.pairs[k].still)
        .collect();
    let sound = mean.iter().all(|v| v.is_finite()) && uncertainty.is_sound();
    if used.is_empty() || bodies.all.is_empty() || !sound {
        return as_it_was();
    }
    let ends: Vec<[usize; 2]> = used.iter().map(|&k| pairs.pairs[k].ends).collect();
    let only = |l: &Lengths| Lengths {
        mean: used.iter().map(|&k| l.mean[k]).collect(),
        variance: used.iter().map(|&k| l.variance[k]).collect(),
    };
    let bodies = match whose {
        BodyChoice::Known(l) => BodyMixture::one(only(l)),
        BodyChoice::Any => bodies.of_others(only),
    };
    let rows = jacobian(&ends, mean);
    let (add, lengths) = choose(&bodies, &rows, uncertainty, noise);
    let extra: Vec<f64> = noise.iter().map(|r| shared(add, *r)).collect();
    let Some((x, step)) = converge(&ends, &lengths, mean, uncertainty, &extra) else {
        return as_it_was();
    };
    // Lengths that cannot all be met, for an outlier that seems clean, are not kept.
    if misfit(&ends, &x, &lengths) >= misfit(&ends, mean, &lengths) {
        return as_it_was();
    }
    Posterior {
        variance: step.variances(uncertainty, &extra, &lengths),
        mean: x,
        ..Posterior::default()
    }
}

/// The mean that agrees with the lengths, and the last update.
fn converge(
    ends: &[[usize; 2]],
    lengths: &Lengths,
    mean: &[f64],
    uncertainty: Uncertainty<'_>,
    extra: &[f64],
) -> Option<(Vec<f64>, Step)> {
    let mut x = mean.to_vec();
    let mut before = f64::INFINITY;
    let mut step = Step::at(jacobian(ends, mean), lengths, uncertainty, extra);
    for count in 0..STEPS {
        let rows = jacobian(ends, &x);
        let off: Vec<f64> = (rows.iter().zip(&lengths.mean))
            .map(|(row, l)| l - row.length)
            .collect();
        if (1..TURNS).contains(&count) {
            step = Step::at(rows, lengths, uncertainty, extra);
        }
        let to = step.target(off, mean, &x);
        let moved: Vec<f64> = to.iter().zip(&x).map(|(t, x)| t - x).collect();
        let most = moved.iter().fold(0.0, |a: f64, m| a.max(m.abs()));
        if !most.is_finite() {
            return None;
        }
        let last = most <= SETTLED || count + 1 == STEPS;
        let shrinks = most <= 0.5 * before;
        before = most;
        let by = if last || count < 2 || shrinks {
            1.0
        } else {
            0.5
        };
        let by = by * (FARTHEST / most).min(1.0);
        x.iter_mut().zip(&moved).for_each(|(x, m)| *x += by * m);
        if last {
            return Some((x, step));
        }
    }
    None
}

/// The linearized lengths at one pose.
struct Step {
    rows: Vec<JacobianRow>,
    /// H P' (n, D).
    times_covariance: Vec<Vec<f64>>,
    /// Cholesky factor of H P' Hᵀ + V (n, n) by rows.
    factor: Vec<f64>,
}

impl Step {
    fn at(
        rows: Vec<JacobianRow>,
        lengths: &Lengths,
        uncertainty: Uncertainty<'_>,
        extra: &[f64],
    ) -> Step {
        let n = rows.len();
        let times_covariance = times_covariance(&rows, uncertainty, extra);
        let mut factor = products(&rows, &times_covariance);
        for k in 0..n {
            factor[k * n + k] += lengths.variance[k];
        }
        factorize(&mut factor, n);
        Step {
            rows,
            times_covariance,
            factor,
        }
    }

    /// The updated mean, from x whose lengths lack `off`.
    fn target(&self, off: Vec<f64>, mean: &[f64], x: &[f64]) -> Vec<f64> {
        let n = self.rows.len();
        let mut z = off;
        for (z, row) in z.iter_mut().zip(&self.rows) {
            *z += row.along(x) - row.along(mean);
        }
        forward(&self.factor, n, &mut z);
        backward(&self.factor, n, &mut z);
        let mut to = mean.to_vec();
        for (row, z) in self.times_covariance.iter().zip(&z) {
            to.iter_mut().zip(row).for_each(|(t, c)| *t += z * c);
        }
        to
    }

    /// Variances of the updated mean: the diagonal of (1 − K H) (P + I) (1 − K H)ᵀ + K V Kᵀ, which
    /// holds for any gain K.
    fn variances(
        mut self,
        uncertainty: Uncertainty<'_>,
        extra: &[f64],
        lengths: &Lengths,
    ) -> Vec<f64> {
        let Uncertainty::Covariance(covariance, _) = uncertainty else {
            return uncertainty.variances();
        };
        let n = self.rows.len();
        let whole = times_covariance(&self.rows, Uncertainty::Covariance(covariance, 1.0), extra);
        let mut spread = products(&self.rows, &whole);
        for k in 0..n {
            spread[k * n + k] += lengths.variance[k];
        }
        // Kᵀ
        simd::dispatch8(
            #[inline(always)]
            || {
                forward_rows(&self.factor, n, &mut self.times_covariance);
                backward_rows(&self.factor, n, &mut self.times_covariance);
            },
        );
        let gain = &self.times_covariance;
        let mut out: Vec<f64> = (covariance.diag().iter().zip(extra))
            .map(|(v, e)| v + e)
            .collect();
        let spread = |k: usize, l: usize| spread[k.max(l) * n + k.min(l)];
        simd::dispatch8(
            #[inline(always)]
            || {
                let mut sum = vec![0.0; out.len()];
                for k in 0..n {
                    sum.fill(0.0);
                    add(&mut sum, -2.0, &whole[k]);
                    for (l, row) in gain.iter().enumerate() {
                        add(&mut sum, spread(k, l), row);
                    }
                    for ((o, s), g) in out.iter_mut().zip(&sum).zip(&gain[k]) {
                        *o += s * g;
                    }
                }
            },
        );
        out.iter_mut().for_each(|v| *v = v.max(0.0));
        out
    }
}

/// Σ (g − L)² / V.
fn misfit(ends: &[[usize; 2]], x: &[f64], lengths: &Lengths) -> f64 {
    let off = jacobian(ends, x).into_iter().map(|row| row.length);
    let terms = off.zip(&lengths.mean).zip(&lengths.variance);
    terms.map(|((g, l), v)| (g - l).powi(2) / v).sum()
}

/// 1 / (1/i + 1/R).
fn shared(i: f64, r: f64) -> f64 {
    if r.is_finite() {
        i * r.max(EXACT_VARIANCE) / (i + r.max(EXACT_VARIANCE))
    } else {
        i
    }
}

/// The most likely i, and the lengths of the bodies that are likely with it.
fn choose(
    bodies: &BodyMixture,
    rows: &[JacobianRow],
    uncertainty: Uncertainty<'_>,
    noise: &[f64],
) -> (f64, Lengths) {
    let n = rows.len();
    let none = vec![0.0; noise.len()];
    let within = products(rows, &times_covariance(rows, uncertainty, &none));
    let mut best: Option<(f64, f64, Vec<f64>)> = None;
    let shared_ends = shared_ends(rows);
    let mut a = within.clone();
    for length_sd in UNSURE {
        let i = length_sd * ASF_UNIT_CM * ASF_UNIT_CM;
        let extra: Vec<f64> = noise.iter().map(|r| shared(i, *r)).collect();
        let mut all = within.clone();
        for (at, p, u) in &shared_ends {
            let sum: f64 = (0..3).map(|c| u[c] * extra[3 * p + c]).sum();
            all[*at] += sum;
        }
        let mut logs = Vec::with_capacity(bodies.all.len());
        // Known bodies share their variances, and so one factorization; the unknown body has
        // another.
        for alike in bodies.all.chunk_by(|a, b| a.1.variance == b.1.variance) {
            a.copy_from_slice(&all);
            for (k, variance) in alike[0].1.variance.iter().enumerate() {
                a[k * n + k] += variance;
            }
            factorize(&mut a, n);
            let log_det: f64 = (0..n).map(|k| a[k * n + k].ln()).sum();
            let far = lengths_off(&a, rows, alike);
            logs.extend((alike.iter().zip(far)).map(|((share, _), f)| share - 0.5 * f - log_det));
        }
        let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum = top + logs.iter().map(|l| (l - top).exp()).sum::<f64>().ln();
        if best.as_ref().is_none_or(|b| sum > b.0) {
            best = Some((sum, i, logs));
        }
    }
    match best {
        Some((_, i, logs)) => (i, bodies.given(&logs)),
        None => (
            UNSURE[0] * ASF_UNIT_CM * ASF_UNIT_CM,
            bodies.all[0].1.clone(),
        ),
    }
}

/// |L⁻¹ (l − g)|² for the lengths l of each body; `a` holds L.
fn lengths_off(a: &[f64], rows: &[JacobianRow], bodies: &[(f64, Lengths)]) -> Vec<f64> {
    if let [(_, one)] = bodies {
        let off = one.mean.iter().zip(rows).map(|(l, r)| l - r.length);
        let mut z: Vec<f64> = off.collect();
        forward(a, rows.len(), &mut z);
        return vec![z.iter().map(|z| z * z).sum()];
    }
    let off = |(k, row): (usize, &JacobianRow)| -> Vec<f64> {
        (bodies.iter())
            .map(|(_, l)| l.mean[k] - row.length)
            .collect()
    };
    let mut z: Vec<Vec<f64>> = rows.iter().enumerate().map(off).collect();
    let mut far = vec![0.0; bodies.len()];
    simd::dispatch8(
        #[inline(always)]
        || {
            forward_rows(a, rows.len(), &mut z);
            for row in &z {
                far.iter_mut().zip(row).for_each(|(f, z)| *f += z * z);
            }
        },
    );
    far
}

/// Z ← L⁻¹ Z by rows of Z.
#[inline(always)]
fn forward_rows(a: &[f64], n: usize, z: &mut [Vec<f64>]) {
    for i in 0..n {
        let (before, rest) = z.split_at_mut(i);
        for (other, l) in before.iter().zip(&a[i * n..]) {
            add(&mut rest[0], -l, other);
        }
        let scale = 1.0 / a[i * n + i];
        rest[0].iter_mut().for_each(|v| *v *= scale);
    }
}

/// Z ← L⁻ᵀ Z by rows of Z.
#[inline(always)]
fn backward_rows(a: &[f64], n: usize, z: &mut [Vec<f64>]) {
    for i in (0..n).rev() {
        let (before, rest) = z.split_at_mut(i);
        let scale = 1.0 / a[i * n + i];
        rest[0].iter_mut().for_each(|v| *v *= scale);
        for (other, l) in before.iter_mut().zip(&a[i * n..]) {
            add(other, -l, &rest[0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::rigid_pairs::Pair;
    use ndarray::{Array2, array};

    fn bar(lengths: Array2<f64>, shares: &[f64]) -> RigidPairs {
        RigidPairs {
            pairs: vec![Pair {
                ends: [0, 1],
                sd: 0.0,
                still: false,
            }],
            bodies: lengths,
            shares: shares.to_vec(),
        }
    }

    fn kept(
        pairs: &RigidPairs,
        mean: &[f64],
        covariance: &Array2<f64>,
        noise: &[f64],
    ) -> Posterior {
        let bodies = BodyMixture::of(pairs);
        let uncertainty = Uncertainty::Covariance(covariance, 1.0);
        project(pairs, &bodies, BodyChoice::Any, mean, uncertainty, noise)
    }

    fn length(x: &[f64]) -> f64 {
        (0..3)
            .map(|c| (x[c] - x[3 + c]).powi(2))
            .sum::<f64>()
            .sqrt()
    }

    #[test]
    fn the_length_is_kept_and_the_surer_end_moves_less() {
        let pairs = bar(array![[10.0]], &[1.0]);
        let mean = [0.0, 0.0, 0.0, 12.0, 3.0, 0.0];
        let none = [f64::INFINITY; 6];
        let alike = Array2::eye(6) * 4.0;
        let b = kept(&pairs, &mean, &alike, &none);
        assert!((length(&b.mean) - 10.0).abs() <= 1e-2, "{:?}", b.mean);
        assert!(b.variance[3] < 4.0 + 0.6 * 31.9 && b.variance.iter().all(|v| *v > 0.0));
        let mut uncertainty = alike.clone();
        (0..3).for_each(|c| uncertainty[[c, c]] = EXACT_VARIANCE);
        let noise: Vec<f64> = (0..6)
            .map(|c| if c < 3 { EXACT_VARIANCE } else { f64::INFINITY })
            .collect();
        let b = kept(&pairs, &mean, &uncertainty, &noise);
        assert!(b.mean[..3].iter().all(|v| v.abs() <= 1e-3));
        assert!((length(&b.mean) - 10.0).abs() <= 1e-2);
        // Variances alone give the same mean as a covariance without its correlations.
        let bodies = BodyMixture::of(&pairs);
        let only = project(
            &pairs,
            &bodies,
            BodyChoice::Any,
            &mean,
            Uncertainty::Variances(&[4.0; 6]),
            &none,
        );
        let same = project(
            &pairs,
            &bodies,
            BodyChoice::Any,
            &mean,
            Uncertainty::Covariance(&alike, 0.0),
            &none,
        );
        assert_eq!(only.mean, same.mean);
        assert_eq!(only.variance, [4.0; 6]);
    }

    /// With all of the covariance in the gain, the variances are those of the conditional Gaussian.
    #[test]
    fn what_the_lengths_tell_is_taken_from_the_variances() {
        let pairs = bar(array![[10.0]], &[1.0]);
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 5 + j * 3 * (i + 1)) as f64).cos());
        let p = b.dot(&b.t()) + Array2::<f64>::eye(6);
        let lengths = &BodyMixture::of(&pairs).all[0].1;
        let (mean, extra) = ([0.0, 0.0, 0.0, 10.0, 0.0, 0.0], [0.1; 6]);
        for together in [1.0, 0.3] {
            let uncertainty = Uncertainty::Covariance(&p, together);
            let step = Step::at(jacobian(&[[0, 1]], &mean), lengths, uncertainty, &extra);
            let noise_variance = step.variances(uncertainty, &extra, lengths);
            let whole = &p + &(Array2::<f64>::eye(6) * 0.1);
            let h = ndarray::Array1::from(vec![-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
            let mut used = &p * together;
            used.diag_mut().assign(&p.diag());
            used.diag_mut().mapv_inplace(|v| v + 0.1);
            let ph = used.dot(&h);
            let k = &ph / (h.dot(&ph) + lengths.variance[0]);
            for c in 0..6 {
                let mut row = -k[c] * &h;
                row[c] += 1.0;
                let want = row.dot(&whole.dot(&row)) + k[c] * k[c] * lengths.variance[0];
                assert!(
                    (noise_variance[c] - want).abs() <= 1e-9,
                    "{c} {} {want}",
                    noise_variance[c]
                );
            }
        }
    }

    #[test]
    fn the_body_that_fits_is_taken() {
        let pairs = bar(array![[10.0], [14.0]], &[0.5, 0.5]);
        for long in [10.0, 14.0] {
            let mean = [0.0, 0.0, 0.0, long + 0.3, 0.0, 0.0];
            let b = kept(&pairs, &mean, &(Array2::eye(6) * 0.05), &[0.05; 6]);
            assert!((length(&b.mean) - long).abs() <= 0.1, "{:?}", b.mean);
        }
    }

    #[test]
    fn a_belief_that_is_no_number_stays() {
        let pairs = bar(array![[10.0]], &[1.0]);
        let one = Array2::eye(6);
        let b = kept(
            &pairs,
            &[f64::NAN, 0.0, 0.0, 1.0, 0.0, 0.0],
            &one,
            &[1.0; 6],
        );
        assert!(b.mean[0].is_nan() && b.mean[3] == 1.0);
        // Both ends at one position: the distance has no direction.
        let b = kept(&pairs, &[0.0; 6], &one, &[1.0; 6]);
        assert!(b.mean.iter().all(|v| v.is_finite()));
    }
}

//! A Gaussian conditioned on some noisy coordinates.
//!
//! For e ~ N(0, S) and r = e_o + noise of variances R: the mean of e is S_:o (S_oo + R)⁻¹ r, its
//! covariance S − S_:o (S_oo + R)⁻¹ S_o:. The systems are of the size of a pose, so a plain
//! Cholesky factorization here costs less than starting LAPACK.

use super::small_linalg::{add, backward, factorize, forward};
use ndarray::{Array2, ArrayView2};

/// The smallest noise variance that a solve uses, cm²: 0.1 mm. No capture is better, and solves
/// stay well conditioned.
#[doc(hidden)]
pub const EXACT_VARIANCE: f64 = 1e-4;

/// What a Gaussian's coordinates are, given noisy ones: the gain S_:o (S_oo + R)⁻¹ and the
/// variances that are left.
#[derive(Debug, Clone, PartialEq)]
pub struct ConditionalGaussian {
    observed: Vec<usize>,
    /// The gain's transpose by rows: one row of D numbers for each observed coordinate.
    gain: Vec<f64>,
    /// L⁻¹ S_o:, by rows of D, where L Lᵀ = S_oo + R.
    whitened: Vec<f64>,
    /// L by rows, lower triangle.
    factor: Vec<f64>,
    /// The variance of each of the D coordinates.
    pub variance: Vec<f64>,
}

impl ConditionalGaussian {
    /// Conditions `covariance` (D, D) on the coordinates whose `noise` variance is finite.
    pub fn new(covariance: ArrayView2<'_, f64>, noise: &[f64]) -> ConditionalGaussian {
        let d = noise.len();
        let observed = seen(noise);
        let n = observed.len();
        let a = factor(covariance, noise, &observed);
        // S_o: by rows, D wide: all triangular solves at once, along the rows.
        let mut rows = Vec::with_capacity(n * d);
        observed
            .iter()
            .for_each(|&i| rows.extend(covariance.row(i)));
        let mut variance: Vec<f64> = covariance.diag().to_vec();
        for i in 0..n {
            let (before, rest) = rows.split_at_mut(i * d);
            let row = &mut rest[..d];
            for (j, other) in before.chunks_exact(d).enumerate() {
                add(row, -a[i * n + j], other);
            }
            let scale = 1.0 / a[i * n + i];
            for (v, left) in row.iter_mut().zip(&mut variance) {
                *v *= scale;
                *left -= *v * *v;
            }
        }
        variance.iter_mut().for_each(|v| *v = v.max(0.0));
        let whitened = rows.clone();
        for i in (0..n).rev() {
            let (before, rest) = rows.split_at_mut(i * d);
            let row = &mut rest[..d];
            let scale = 1.0 / a[i * n + i];
            row.iter_mut().for_each(|v| *v *= scale);
            for (j, other) in before.chunks_exact_mut(d).enumerate() {
                add(other, -a[i * n + j], row);
            }
        }
        ConditionalGaussian {
            observed,
            gain: rows,
            whitened,
            factor: a,
            variance,
        }
    }

    /// The covariance that is left, (D, D): `prior` (the S that was conditioned) less what was
    /// learned.
    pub fn covariance(&self, prior: ArrayView2<'_, f64>) -> Array2<f64> {
        let d = self.variance.len();
        let mut out = prior.to_owned();
        for row in self.whitened.chunks_exact(d) {
            for (i, v) in row.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                let mut target = out.row_mut(i);
                target.iter_mut().zip(row).for_each(|(t, w)| *t -= v * w);
            }
        }
        for (i, v) in self.variance.iter().enumerate() {
            out[[i, i]] = *v;
        }
        out
    }

    /// The log density of the residuals `r` (D; read where observed): log N(r_o; 0, S_oo + R).
    pub fn log_density(&self, r: &[f64]) -> f64 {
        let n = self.observed.len();
        let mut white = vec![0.0; n];
        let mut log = -0.5 * n as f64 * (2.0 * std::f64::consts::PI).ln();
        for i in 0..n {
            let row = &self.factor[i * n..=i * n + i];
            let known: f64 = row[..i].iter().zip(&white).map(|(l, w)| l * w).sum();
            white[i] = (r[self.observed[i]] - known) / row[i];
            log -= 0.5 * white[i] * white[i] + row[i].ln();
        }
        log
    }

    /// The mean of all D coordinates given the residuals `r` (D; read where observed).
    pub fn mean(&self, r: &[f64]) -> Vec<f64> {
        let d = self.variance.len();
        let mut out = vec![0.0; d];
        for (row, &o) in self.gain.chunks_exact(d).zip(&self.observed) {
            add(&mut out, r[o], row);
        }
        out
    }
}

/// The coordinates whose noise is finite.
fn seen(noise: &[f64]) -> Vec<usize> {
    (0..noise.len()).filter(|&i| noise[i].is_finite()).collect()
}

/// L by rows, lower triangle, with L Lᵀ = S_oo + R.
fn factor(covariance: ArrayView2<'_, f64>, noise: &[f64], observed: &[usize]) -> Vec<f64> {
    let n = observed.len();
    let mut a = vec![0.0; n * n];
    for (row, &i) in observed.iter().enumerate() {
        for (column, &j) in observed[..=row].iter().enumerate() {
            a[row * n + column] = covariance[[i, j]];
        }
        a[row * n + row] += noise[i];
    }
    factorize(&mut a, n);
    a
}

/// The mean of N(`mean`, `covariance`) given `y` with `noise`, none of it below [`EXACT_VARIANCE`]:
/// what [`ConditionalGaussian`] says, for one solve in place of many.
pub fn most_probable(
    mut mean: Vec<f64>,
    covariance: ArrayView2<'_, f64>,
    y: &[f64],
    noise: &[f64],
) -> Vec<f64> {
    let noise: Vec<f64> = noise.iter().map(|n| n.max(EXACT_VARIANCE)).collect();
    let observed = seen(&noise);
    let n = observed.len();
    let a = factor(covariance, &noise, &observed);
    let mut z: Vec<f64> = observed.iter().map(|&i| y[i] - mean[i]).collect();
    forward(&a, n, &mut z);
    backward(&a, n, &mut z);
    for (&i, z) in observed.iter().zip(&z) {
        let row = covariance.row(i);
        mean.iter_mut().zip(row).for_each(|(m, c)| *m += z * c);
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn two_coordinates_by_hand() {
        let s = array![[4.0, 2.0], [2.0, 3.0]];
        let c = ConditionalGaussian::new(s.view(), &[1.0, f64::INFINITY]);
        let mean = c.mean(&[5.0, f64::NAN]);
        assert!((mean[0] - 4.0).abs() <= 1e-12 && (mean[1] - 2.0).abs() <= 1e-12);
        let v = &c.variance;
        assert!((v[0] - 0.8).abs() <= 1e-12 && (v[1] - 2.2).abs() <= 1e-12);
        // 3 − 2·2/5 and 2 − 4·2/5; the density of 5 under N(0, 5).
        let left = c.covariance(s.view());
        assert!((left[[0, 1]] - 0.4).abs() <= 1e-12 && left[[0, 1]] == left[[1, 0]]);
        let log = -0.5 * (5.0 + (2.0 * std::f64::consts::PI * 5.0).ln());
        assert!((c.log_density(&[5.0, f64::NAN]) - log).abs() <= 1e-12);
        let noise = [1.0, f64::INFINITY];
        let mean = most_probable(vec![2.0, 7.0], s.view(), &[7.0, f64::NAN], &noise);
        assert!((mean[0] - 6.0).abs() <= 1e-12 && (mean[1] - 9.0).abs() <= 1e-12);
    }

    #[test]
    fn exact_observations_are_met_and_nothing_observed_is_the_prior() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| {
            ((i * i * 7 + j * 3 * (i + 1)) as f64).sin()
        });
        let s = b.dot(&b.t());
        let r = [1.0, -2.0, 0.5, 0.0, 0.0, 0.0];
        let inf = f64::INFINITY;
        let c = ConditionalGaussian::new(s.view(), &[0.0, 0.0, 0.0, inf, inf, inf]);
        let mean = c.mean(&r);
        assert!((0..3).all(|i| (mean[i] - r[i]).abs() <= 1e-6));
        assert!(c.variance[..3].iter().all(|v| *v <= 1e-6));
        let none = ConditionalGaussian::new(s.view(), &[inf; 6]);
        assert!(none.mean(&r).iter().all(|m| *m == 0.0));
        assert_eq!(none.variance[2], s[[2, 2]]);
    }
}

//! A Gaussian conditioned on some noisy coordinates.
//!
//! For e ~ N(0, S) and r = e_o + noise of variances R: the mean of e is S_:o (S_oo + R)⁻¹ r, its covariance
//! S − S_:o (S_oo + R)⁻¹ S_o:. The systems are of the size of a pose, so a plain Cholesky factorisation here costs less
//! than starting LAPACK.

use ndarray::ArrayView2;

/// A factorised conditioning: what was observed, and the Cholesky factor of S_oo + R.
pub struct Conditional<'a> {
    covariance: ArrayView2<'a, f64>,
    observed: Vec<usize>,
    /// Lower triangle by rows, (n, n).
    factor: Vec<f64>,
}

impl<'a> Conditional<'a> {
    /// Conditions `covariance` (D, D) on the coordinates whose `noise` variance is finite.
    pub fn new(covariance: ArrayView2<'a, f64>, noise: &[f64]) -> Conditional<'a> {
        let observed: Vec<usize> = (0..noise.len()).filter(|&i| noise[i].is_finite()).collect();
        let n = observed.len();
        let mut a = vec![0.0; n * n];
        for (row, &i) in observed.iter().enumerate() {
            for (column, &j) in observed[..=row].iter().enumerate() {
                a[row * n + column] = covariance[[i, j]];
            }
            a[row * n + row] += noise[i];
        }
        factorise(&mut a, n);
        Conditional {
            covariance,
            observed,
            factor: a,
        }
    }

    /// The mean of all D coordinates given the residuals `r` (D; read where observed).
    pub fn mean(&self, r: &[f64]) -> Vec<f64> {
        let mut x: Vec<f64> = self.observed.iter().map(|&i| r[i]).collect();
        self.solve_lower(&mut x);
        self.solve_upper(&mut x);
        (0..self.covariance.nrows())
            .map(|i| {
                self.observed
                    .iter()
                    .zip(&x)
                    .map(|(&o, x)| self.covariance[[i, o]] * x)
                    .sum()
            })
            .collect()
    }

    /// The variances of all D coordinates.
    pub fn variance(&self) -> Vec<f64> {
        let mut v = vec![0.0; self.observed.len()];
        (0..self.covariance.nrows())
            .map(|i| {
                v.iter_mut()
                    .zip(&self.observed)
                    .for_each(|(v, &o)| *v = self.covariance[[i, o]]);
                self.solve_lower(&mut v);
                (self.covariance[[i, i]] - v.iter().map(|v| v * v).sum::<f64>()).max(0.0)
            })
            .collect()
    }

    fn solve_lower(&self, x: &mut [f64]) {
        let n = x.len();
        for i in 0..n {
            let row = &self.factor[i * n..i * n + i];
            let sum: f64 = row.iter().zip(&x[..i]).map(|(l, x)| l * x).sum();
            x[i] = (x[i] - sum) / self.factor[i * n + i];
        }
    }

    fn solve_upper(&self, x: &mut [f64]) {
        let n = x.len();
        for i in (0..n).rev() {
            x[i] /= self.factor[i * n + i];
            let xi = x[i];
            for j in 0..i {
                x[j] -= self.factor[i * n + j] * xi;
            }
        }
    }
}

/// Cholesky in place, lower triangle by rows. A pivot that rounding has eaten becomes a small one: the direction is
/// then known exactly, as a duplicate of others.
fn factorise(a: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| a[i * n + k] * a[j * n + k]).sum();
            let rest = a[i * n + j] - sum;
            a[i * n + j] = if i == j {
                rest.max(1e-12 * a[i * n + i].abs()).max(1e-300).sqrt()
            } else {
                rest / a[j * n + j]
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    #[test]
    fn two_coordinates_by_hand() {
        let s = array![[4.0, 2.0], [2.0, 3.0]];
        let c = Conditional::new(s.view(), &[1.0, f64::INFINITY]);
        let mean = c.mean(&[5.0, f64::NAN]);
        assert!((mean[0] - 4.0).abs() <= 1e-12 && (mean[1] - 2.0).abs() <= 1e-12);
        let v = c.variance();
        assert!((v[0] - 0.8).abs() <= 1e-12 && (v[1] - 2.2).abs() <= 1e-12);
    }

    #[test]
    fn exact_observations_are_met_and_nothing_observed_is_the_prior() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3) as f64).sin());
        let s = b.dot(&b.t());
        let r = [1.0, -2.0, 0.5, 0.0, 0.0, 0.0];
        let inf = f64::INFINITY;
        let c = Conditional::new(s.view(), &[0.0, 0.0, 0.0, inf, inf, inf]);
        let mean = c.mean(&r);
        assert!((0..3).all(|i| (mean[i] - r[i]).abs() <= 1e-6));
        assert!(c.variance()[..3].iter().all(|v| *v <= 1e-6));
        let none = Conditional::new(s.view(), &[inf; 6]);
        assert!(none.mean(&r).iter().all(|m| *m == 0.0));
        assert_eq!(none.variance()[2], s[[2, 2]]);
    }
}

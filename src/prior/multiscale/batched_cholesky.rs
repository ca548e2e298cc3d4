//! Cholesky factors at four scales side by side: as many as the levels of an index have.
//!
//! Matrices are (n, n), lower triangle by rows, as those of [`small`](crate::numeric::small_linalg); each number stands there once for
//! each scale.

use crate::numeric::simd;
use std::array::from_fn;

/// A number at four scales.
pub type Four = [f64; 4];

/// L of four matrices.
#[derive(Debug, Clone)]
pub struct BatchedCholesky {
    n: usize,
    lower: Vec<Four>,
    /// 1 over the diagonal.
    inverses: Vec<Four>,
}

impl BatchedCholesky {
    /// Of positive definite matrices. A pivot that rounding has eaten becomes a small one, as in
    /// [`small_linalg::factorise`](crate::numeric::small_linalg::factorise).
    pub fn of(mut lower: Vec<Four>, n: usize) -> BatchedCholesky {
        let mut inverses = vec![[0.0; 4]; n];
        simd::dispatch8(
            #[inline(always)]
            || {
                for i in 0..n {
                    let (above, row) = lower.split_at_mut(i * n);
                    let row = &mut row[..=i];
                    let whole = row[i];
                    for j in 0..i {
                        let by: Four = from_fn(|s| row[j][s] * inverses[j][s]);
                        row[j] = by;
                        for k in j + 1..i {
                            let other = above[k * n + j];
                            (0..4).for_each(|s| row[k][s] -= by[s] * other[s]);
                        }
                        (0..4).for_each(|s| row[i][s] -= by[s] * by[s]);
                    }
                    let least = whole.map(|w| (1e-12 * w.abs()).max(1e-300));
                    row[i] = from_fn(|s| row[i][s].max(least[s]).sqrt());
                    inverses[i] = row[i].map(|pivot| 1.0 / pivot);
                }
            },
        );
        BatchedCholesky { n, lower, inverses }
    }

    /// The diagonal of one of them.
    pub fn pivots(&self, s: usize) -> impl Iterator<Item = f64> {
        (0..self.n).map(move |i| self.lower[i * self.n + i][s])
    }

    /// One of them.
    pub fn one(&self, s: usize) -> Vec<f64> {
        self.lower.iter().map(|l| l[s]).collect()
    }

    /// z ← L⁻¹ z of all.
    pub fn forward(&self, z: &mut [Four]) {
        simd::dispatch8(
            #[inline(always)]
            || {
                for j in 0..self.n {
                    let (done, rest) = z.split_at_mut(j + 1);
                    let by: Four = from_fn(|s| done[j][s] * self.inverses[j][s]);
                    done[j] = by;
                    for (k, z) in rest.iter_mut().enumerate() {
                        let l = self.lower[(j + 1 + k) * self.n + j];
                        (0..4).for_each(|s| z[s] -= by[s] * l[s]);
                    }
                }
            },
        );
    }

    /// z ← L⁻¹ z of one of them.
    pub fn forward_one(&self, s: usize, z: &mut [f64]) {
        for i in 0..self.n {
            let row = &self.lower[i * self.n..i * self.n + i];
            let known: f64 = row.iter().zip(&*z).map(|(l, z)| l[s] * z).sum();
            z[i] = (z[i] - known) * self.inverses[i][s];
        }
    }

    /// z ← L⁻ᵀ z of one of them.
    pub fn backward_one(&self, s: usize, z: &mut [f64]) {
        for i in (0..self.n).rev() {
            z[i] *= self.inverses[i][s];
            let (before, rest) = z.split_at_mut(i);
            let row = &self.lower[i * self.n..i * self.n + i];
            let both = before.iter_mut().zip(row);
            both.for_each(|(z, l)| *z -= rest[0] * l[s]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::small_linalg;

    #[test]
    fn four_factors_are_those_made_one_by_one() {
        let n = 7;
        // B Bᵀ + a little; the last of the four has a duplicate row, which rounding eats.
        let of = |s: usize| -> Vec<f64> {
            let row = |i: usize| if s == 3 && i == 5 { 2 } else { i };
            let b = |i: usize, k: usize| ((row(i) * 5 + k * 3 * (row(i) + s)) as f64).sin();
            let product = |i: usize, j: usize| (0..n).map(|k| b(i, k) * b(j, k)).sum::<f64>();
            let more = |i: usize, j: usize| if i == j && s < 3 { 0.1 } else { 0.0 };
            (0..n * n)
                .map(|at| product(at / n, at % n) + more(at / n, at % n))
                .collect()
        };
        let each: [Vec<f64>; 4] = from_fn(of);
        let lower = (0..n * n).map(|at| from_fn(|s| each[s][at])).collect();
        let factors = BatchedCholesky::of(lower, n);
        let z: Vec<f64> = (0..n).map(|i| 1.0 + (i as f64).cos()).collect();
        let mut fours: Vec<Four> = z.iter().map(|z| [*z; 4]).collect();
        factors.forward(&mut fours);
        for (s, mut want) in each.into_iter().enumerate() {
            small_linalg::factorise(&mut want, n);
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + b.abs());
            // Where a pivot is but rounding's, only that it is small can be said.
            let firm = if s == 3 { 5 } else { n };
            let detail = factors.one(s);
            for i in 0..firm {
                assert!((0..=i).all(|j| near(detail[i * n + j], want[i * n + j])));
            }
            assert!(factors.pivots(s).all(|p| p > 0.0 && p.is_finite()));
            let (mut forth, mut back) = (z.clone(), z.clone());
            small_linalg::forward(&want, n, &mut forth);
            let mut own = z.clone();
            factors.forward_one(s, &mut own);
            for i in 0..firm {
                assert!(near(own[i], forth[i]) && near(fours[i][s], forth[i]));
            }
            if firm == n {
                small_linalg::backward(&want, n, &mut back);
                let mut own = z.clone();
                factors.backward_one(s, &mut own);
                assert!(own.iter().zip(back).all(|(a, b)| near(*a, b)));
            }
        }
    }
}

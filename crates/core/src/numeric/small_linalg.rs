//! Products, a factorization and its solves for vectors and matrices of a pose's size, where
//! calling a library costs more than the work.

use crate::numeric::simd::dispatch8;

/// Σ aᵢ bᵢ, in four strands that go side by side.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (fours, rest) = a.as_chunks::<4>();
    let (others, left) = b.as_chunks::<4>();
    for (x, y) in fours.iter().zip(others) {
        for i in 0..4 {
            sums[i] += x[i] * y[i];
        }
    }
    let tail: f64 = rest.iter().zip(left).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + tail
}

/// `to` += `scale` `from`. Inlined, so that it is as wide as the code around it.
#[inline(always)]
pub fn add(to: &mut [f64], scale: f64, from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += scale * f);
}

/// Columns that are taken from the rest of a matrix at once: each of its numbers is loaded and
/// stored once for so many.
const PANEL: usize = 4;

/// Cholesky in place, (n, n), lower triangle by rows. A pivot that rounding has eaten becomes a
/// small one: the direction is then known exactly, as a duplicate of others.
pub fn factorize(a: &mut [f64], n: usize) {
    let least: Vec<f64> = (0..n).map(|i| 1e-12 * a[i * n + i].abs()).collect();
    let mut panel: [Vec<f64>; PANEL] = std::array::from_fn(|_| vec![0.0; n]);
    dispatch8(
        #[inline(always)]
        || {
            for first in (0..n).step_by(PANEL) {
                let last = (first + PANEL).min(n);
                for k in first..last {
                    let (before, rest) = panel.split_at_mut(k - first);
                    let column = &mut rest[0][k..n];
                    for (i, v) in column.iter_mut().enumerate() {
                        *v = a[(k + i) * n + k];
                    }
                    for other in before {
                        add(column, -other[k], &other[k..n]);
                    }
                    let pivot = column[0].max(least[k]).max(1e-300).sqrt();
                    column[0] = pivot;
                    column[1..].iter_mut().for_each(|v| *v /= pivot);
                    for (i, v) in column.iter().enumerate() {
                        a[(k + i) * n + k] = *v;
                    }
                }
                let [p, q, r, s] = &panel;
                if last - first < PANEL {
                    // Nothing is left.
                    return;
                }
                for i in last..n {
                    let row = &mut a[i * n + last..=i * n + i];
                    let (c, d, e, f) = (p[i], q[i], r[i], s[i]);
                    let columns = p[last..=i].iter().zip(&q[last..=i]);
                    let others = r[last..=i].iter().zip(&s[last..=i]);
                    for ((v, (p, q)), (r, s)) in row.iter_mut().zip(columns).zip(others) {
                        *v -= (c * p + d * q) + (e * r + f * s);
                    }
                }
            }
        },
    );
}

/// z ← L⁻¹ z, with L as [`factorize`] leaves it.
pub fn forward(a: &[f64], n: usize, z: &mut [f64]) {
    dispatch8(
        #[inline(always)]
        || {
            for i in 0..n {
                let known = dot(&a[i * n..i * n + i], &z[..i]);
                z[i] = (z[i] - known) / a[i * n + i];
            }
        },
    );
}

/// z ← L⁻ᵀ z.
pub fn backward(a: &[f64], n: usize, z: &mut [f64]) {
    for i in (0..n).rev() {
        let (before, rest) = z.split_at_mut(i);
        rest[0] /= a[i * n + i];
        add(before, -rest[0], &a[i * n..i * n + i]);
    }
}

/// log Σ exp.
pub fn log_sum(logs: &[f64]) -> f64 {
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY {
        return top;
    }
    top + logs.iter().map(|l| (l - top).exp()).sum::<f64>().ln()
}

/// Σ log of numbers above 0, by products of as many as fit a number: logarithms cost more than
/// products.
pub fn log_product(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut product) = (0.0, 1.0);
    for value in values {
        let next = product * value;
        if (1e-280..1e280).contains(&next) {
            product = next;
        } else {
            sum += f64::ln(product);
            product = value;
        }
    }
    sum + product.ln()
}

/// log Σ exp of what comes one by one.
#[derive(Debug, Clone, Copy)]
pub struct LogSum {
    top: f64,
    /// Σ exp(log − top).
    sum: f64,
}

impl Default for LogSum {
    /// The sum of nothing.
    fn default() -> LogSum {
        LogSum {
            top: f64::NEG_INFINITY,
            sum: 0.0,
        }
    }
}

/// What is e^-40 of a number of double precision is lost beside it.
const LOST: f64 = 40.0;

impl LogSum {
    /// Counts one more.
    pub fn add(&mut self, log: f64) {
        let less = log - self.top;
        if less > 0.0 {
            self.sum = self.sum * (-less).exp() + 1.0;
            self.top = log;
        } else if less > -LOST {
            self.sum += less.exp();
        }
    }

    /// The logarithm of the sum so far; −∞ of nothing.
    pub fn log(&self) -> f64 {
        self.top + self.sum.ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_factors_are_those_of_the_book() {
        let (x, y): (Vec<f64>, Vec<f64>) = (0..7).map(|i| (i as f64, 1.0 - i as f64)).unzip();
        let plain: f64 = x.iter().zip(&y).map(|(a, b)| a * b).sum();
        assert_eq!(dot(&x, &y), plain);
        let mut sum = x.clone();
        add(&mut sum, 2.0, &y);
        assert_eq!(sum[3], -1.0);
        let mut a = [4.0, 0.0, 2.0, 5.0];
        factorize(&mut a, 2);
        assert_eq!([a[0], a[2], a[3]], [2.0, 1.0, 2.0]);
        // Panels of four, what is left of them, and what comes after.
        for n in 1..=11 {
            let entry = |i: usize, j: usize| {
                let both = 1.0 / (1.0 + i.abs_diff(j) as f64);
                both + f64::from(u8::from(i == j))
            };
            let mut l: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
            factorize(&mut l, n);
            for i in 0..n {
                for j in 0..=i {
                    let product: f64 = (0..=j).map(|k| l[i * n + k] * l[j * n + k]).sum();
                    assert!((product - entry(i, j)).abs() < 1e-12, "{n}: {i} {j}");
                }
            }
        }
        // (4 2; 2 5) z = (8, 12)
        let mut z = [8.0, 12.0];
        forward(&a, 2, &mut z);
        assert_eq!(z, [4.0, 4.0]);
        backward(&a, 2, &mut z);
        assert_eq!(z, [1.0, 2.0]);
    }

    #[test]
    fn the_log_of_a_product_is_the_sum_of_logs_however_small_or_large_it_is() {
        let values = [3.0, 1e-300, 2e-308, 0.5, 1e300, 1e300, 1e-160, 1e-160, 7.0];
        let plain: f64 = values.iter().map(|v: &f64| v.ln()).sum();
        assert!((log_product(values) - plain).abs() <= 1e-12 * plain.abs());
        assert_eq!(log_product([]), 0.0);
        assert_eq!(log_product([2.0, 0.0, 3.0]), f64::NEG_INFINITY);
        assert!(log_product([2.0, f64::NAN, 3.0]).is_nan());
    }

    #[test]
    fn logs_add_up_in_any_order_and_of_none_there_is_nothing() {
        let none = f64::NEG_INFINITY;
        let logs = [none, -700.0, 2.0, none, 3.5, -1.0];
        let mut one_by_one = LogSum::default();
        assert_eq!((one_by_one.log(), log_sum(&[none])), (none, none));
        one_by_one.add(none);
        assert_eq!(one_by_one.log(), none);
        logs.iter().for_each(|l| one_by_one.add(*l));
        let plain = (2.0f64.exp() + 3.5f64.exp() + (-1.0f64).exp()).ln();
        assert!((one_by_one.log() - plain).abs() <= 1e-12);
        assert!((log_sum(&logs) - plain).abs() <= 1e-12);
    }
}

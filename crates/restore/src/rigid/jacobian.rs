//! The Jacobian H (n, D) of n rigid distances at a pose of D coordinates, and its products with a
//! covariance.
//!
//! A row of H has six entries: the unit vector u at the first end, −u at the second.

use super::uncertainty::Uncertainty;
use crate::numeric::simd;

/// A row of H.
pub(crate) struct JacobianRow {
    /// The two points.
    pub ends: [usize; 2],
    /// Unit vector from the second point to the first.
    pub u: [f64; 3],
    /// The distance, cm.
    pub length: f64,
}

impl JacobianRow {
    /// H x for this row.
    pub(crate) fn along(&self, x: &[f64]) -> f64 {
        let [i, j] = self.ends;
        (0..3)
            .map(|c| self.u[c] * (x[3 * i + c] - x[3 * j + c]))
            .sum()
    }
}

/// The rows of H for the distances between `ends`, at a pose x (D), cm.
pub(crate) fn jacobian(ends: &[[usize; 2]], x: &[f64]) -> Vec<JacobianRow> {
    let of = |&[i, j]: &[usize; 2]| {
        let v: [f64; 3] = std::array::from_fn(|c| x[3 * i + c] - x[3 * j + c]);
        let length = v.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-6);
        JacobianRow {
            ends: [i, j],
            u: v.map(|v| v / length),
            length,
        }
    };
    ends.iter().map(of).collect()
}

/// H P' (n, D), where P' is the covariance with its correlations scaled, plus `extra` (D) on the
/// diagonal.
pub(crate) fn times_covariance(
    rows: &[JacobianRow],
    uncertainty: Uncertainty<'_>,
    extra: &[f64],
) -> Vec<Vec<f64>> {
    let d = extra.len();
    let mut out = vec![vec![0.0; d]; rows.len()];
    // The covariance of a transformed model may be stored by columns.
    let by_rows = uncertainty
        .together()
        .map(|(c, t)| (c.as_standard_layout(), t));
    let known = (by_rows.as_ref()).and_then(|(c, together)| Some((c.as_slice()?, *together)));
    let alone: Vec<f64> = match uncertainty {
        Uncertainty::Variances(v) => v.iter().zip(extra).map(|(v, e)| v + e).collect(),
        Uncertainty::Covariance(v, together) | Uncertainty::Settled(v, together) => {
            let own = v.diag().into_iter().zip(extra);
            own.map(|(v, e)| (1.0 - together) * v + e).collect()
        }
    };
    simd::dispatch8(
        #[inline(always)]
        || {
            for (row, out) in rows.iter().zip(&mut out) {
                let [i, j] = row.ends;
                if let Some((covariance, together)) = known {
                    let of = |p: usize| &covariance[3 * p * d..3 * (p + 1) * d];
                    add_difference(out, row.u.map(|u| together * u), of(i), of(j));
                }
                for c in 0..3 {
                    out[3 * i + c] += row.u[c] * alone[3 * i + c];
                    out[3 * j + c] -= row.u[c] * alone[3 * j + c];
                }
            }
        },
    );
    out
}

/// `to` += Σ u (a − b), where a and b are three rows each.
#[inline(always)]
fn add_difference(to: &mut [f64], u: [f64; 3], a: &[f64], b: &[f64]) {
    let d = to.len();
    let rows = |all| {
        let all: &[f64] = all;
        [&all[..d], &all[d..2 * d], &all[2 * d..3 * d]]
    };
    let (a, b) = (rows(a), rows(b));
    for k in 0..d {
        let of = |c: usize| u[c] * (a[c][k] - b[c][k]);
        to[k] += of(0) + of(1) + of(2);
    }
}

/// H P' Hᵀ (n, n), lower triangle by rows.
pub(crate) fn products(rows: &[JacobianRow], times_covariance: &[Vec<f64>]) -> Vec<f64> {
    let n = rows.len();
    let mut a = vec![0.0; n * n];
    for k in 0..n {
        for l in 0..=k {
            a[k * n + l] = rows[l].along(&times_covariance[k]);
        }
    }
    a
}

/// The terms of H diag(i) Hᵀ: (index into the lower triangle by rows of n, the point that two
/// distances share, factors of i for its three coordinates).
pub(crate) fn shared_ends(rows: &[JacobianRow]) -> Vec<(usize, usize, [f64; 3])> {
    let n = rows.len();
    let mut out = Vec::new();
    for (k, one) in rows.iter().enumerate() {
        for (l, other) in rows[..=k].iter().enumerate() {
            for (s, p) in one.ends.iter().enumerate() {
                for (t, _) in other.ends.iter().enumerate().filter(|(_, q)| *q == p) {
                    let sign = if s == t { 1.0 } else { -1.0 };
                    let u = std::array::from_fn(|c| sign * one.u[c] * other.u[c]);
                    out.push((k * n + l, *p, u));
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array1, Array2};

    /// Three points: distances from the first to each of the others, and one between these.
    #[test]
    fn products_are_those_of_the_matrices_that_are_not_made() {
        let x = [0.0, 0.0, 0.0, 3.0, 1.0, 0.0, -1.0, 2.0, 2.0];
        let rows = jacobian(&[[0, 1], [2, 0], [1, 2]], &x);
        let h = Array2::from_shape_fn((3, 9), |(k, c)| {
            let [i, j] = rows[k].ends;
            let of = |p: usize| if c / 3 == p { rows[k].u[c % 3] } else { 0.0 };
            of(i) - of(j)
        });
        assert!((rows[1].length - 3.0).abs() <= 1e-12);
        let along = h.dot(&Array1::from(x.to_vec()));
        assert!((rows[0].along(&x) - along[0]).abs() <= 1e-12);
        let b = Array2::from_shape_fn((9, 9), |(i, j)| ((i * 5 + 3 * j * (i + 2)) as f64).sin());
        let c = b.dot(&b.t());
        let extra: Vec<f64> = (0..9).map(|i| 0.1 + 0.05 * i as f64).collect();
        for together in [1.0, 0.25] {
            let mut p = &c * together;
            p.diag_mut().zip_mut_with(&c.diag(), |p, c| *p = *c);
            p.diag_mut()
                .zip_mut_with(&Array1::from(extra.clone()), |p, e| *p += e);
            let want = h.dot(&p);
            let by_columns = c.clone().reversed_axes();
            for covariance in [&c, &by_columns] {
                let noise_variance =
                    times_covariance(&rows, Uncertainty::Covariance(covariance, together), &extra);
                let off = noise_variance.iter().flatten().zip(&want);
                assert!(off.into_iter().all(|(a, b)| (a - b).abs() <= 1e-12));
                let all = products(&rows, &noise_variance);
                let want = want.dot(&h.t());
                assert!(
                    (0..9)
                        .all(|at| at % 3 > at / 3
                            || (all[at] - want[[at / 3, at % 3]]).abs() <= 1e-12)
                );
            }
        }
        let mut all = [0.0; 9];
        for (at, p, u) in shared_ends(&rows) {
            all[at] += (0..3).map(|c| u[c] * extra[3 * p + c]).sum::<f64>();
        }
        let want = (&h * &Array1::from(extra)).dot(&h.t());
        assert!(
            (0..9).all(|at| at % 3 > at / 3 || (all[at] - want[[at / 3, at % 3]]).abs() <= 1e-12)
        );
    }
}

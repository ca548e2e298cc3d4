//! The eigendecomposition of a covariance, C = U diag(λ) Uᵀ, (d, d), cm², with λ falling.
//!
//! The columns of U diag(√λ) are the atoms of a sub-dictionary: a sum of atoms with unit Gaussian
//! coefficients has the covariance C.

use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::simd::{padded, weighted_products};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView1, ArrayView2, Axis};

/// A covariance of d coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EigenCovariance {
    d: usize,
    stride: usize,
    /// U, (d, stride), one eigenvector a column. Single precision is good to 1e-5 cm of a pose.
    vectors: Vec<f32>,
    /// λ, above 0, falling, cm².
    pub values: Vec<f64>,
}

/// The smallest eigenvalue, cm².
pub(crate) const MIN_VARIANCE: f64 = 1e-9;

impl EigenCovariance {
    /// Decomposes a symmetric positive semidefinite matrix (d, d), cm².
    pub(crate) fn of(covariance: ArrayView2<'_, f64>) -> EigenCovariance {
        let d = covariance.nrows();
        // Covariances are finite and symmetric, so that LAPACK does not fail; if it did, the
        // covariance would be next to 0.
        let (values, vectors) = symmetric_eigen(&covariance.to_owned())
            .unwrap_or_else(|| (ndarray::Array1::zeros(d), Array2::eye(d)));
        let values = values.iter().map(|v| v.max(MIN_VARIANCE)).collect();
        EigenCovariance::with(values, |i, k| vectors[[i, k]])
    }

    /// Puts a covariance together from eigenvectors (d, d), one per column, of any length above 0,
    /// and the standard deviation √λ along each (d), cm.
    pub(crate) fn from_parts(
        directions: ArrayView2<'_, f32>,
        deviations: ArrayView1<'_, f32>,
    ) -> EigenCovariance {
        let directions = directions.mapv(f64::from);
        let squared_lengths = (&directions * &directions).sum_axis(Axis(0));
        let scales = squared_lengths.mapv(|n| 1.0 / n.max(MIN_VARIANCE).sqrt());
        let variance = |deviation: &f32| f64::from(*deviation).powi(2).max(MIN_VARIANCE);
        let values = deviations.iter().map(variance).collect();
        EigenCovariance::with(values, |i, k| directions[[i, k]] * scales[k])
    }

    fn with(values: Vec<f64>, vectors: impl Fn(usize, usize) -> f64) -> EigenCovariance {
        let (d, stride) = (values.len(), padded(values.len()));
        let mut order: Vec<usize> = (0..d).collect();
        order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
        let mut rows = vec![0.0; d * stride];
        for (i, row) in rows.chunks_exact_mut(stride.max(1)).enumerate() {
            let sorted = row.iter_mut().zip(&order);
            sorted.for_each(|(r, k)| *r = vectors(i, *k) as f32);
        }
        EigenCovariance {
            d,
            stride,
            vectors: rows,
            values: order.iter().map(|k| values[*k]).collect(),
        }
    }

    /// The covariance of rotated poses; coordinates come in threes, one per point.
    pub(crate) fn rotated(&self, rotation: &DMat3) -> EigenCovariance {
        let mut vectors = vec![0.0; self.vectors.len()];
        for (from, to) in self
            .vectors
            .chunks_exact(3 * self.stride)
            .zip(vectors.chunks_exact_mut(3 * self.stride))
        {
            for k in 0..self.d {
                let of = |axis: usize| f64::from(from[axis * self.stride + k]);
                let rotated = *rotation * DVec3::new(of(0), of(1), of(2));
                for axis in 0..3 {
                    to[axis * self.stride + k] = rotated[axis] as f32;
                }
            }
        }
        EigenCovariance {
            vectors,
            ..self.clone()
        }
    }

    /// The atoms U diag(√λ), (d, d): one per column.
    pub(crate) fn atoms(&self) -> Array2<f64> {
        Array2::from_shape_fn((self.d, self.d), |(i, k)| {
            f64::from(self.row(i)[k]) * self.values[k].sqrt()
        })
    }

    /// The number of coordinates, d.
    pub(crate) fn len(&self) -> usize {
        self.d
    }

    /// U, (d, stride), one eigenvector a column; 0 beyond d.
    pub(crate) fn vectors(&self) -> &[f32] {
        &self.vectors
    }

    /// Row `i` of U, padded with 0.
    pub(crate) fn row(&self, i: usize) -> &[f32] {
        &self.vectors[i * self.stride..(i + 1) * self.stride]
    }

    /// The variance of each coordinate.
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        (0..self.d)
            .map(|i| {
                let terms = self.row(i).iter().zip(&self.values);
                terms.map(|(u, l)| f64::from(u * u) * l).sum()
            })
            .collect()
    }

    /// Adds U diag(`values`) Uᵀ to `out` (d, d), in single precision; missing values count as 0.
    pub(crate) fn add_spread(&self, values: &[f64], out: &mut Array2<f64>) {
        let mut weights: Vec<f32> = values.iter().map(|v| *v as f32).collect();
        weights.resize(padded(values.len()), 0.0);
        let mut products = vec![0.0; self.d * self.d];
        weighted_products(&self.vectors, self.stride, &weights, &mut products);
        for i in 0..self.d {
            for (j, p) in products[i * self.d..=i * self.d + i].iter().enumerate() {
                out[[i, j]] += f64::from(*p);
                if j < i {
                    out[[j, i]] += f64::from(*p);
                }
            }
        }
    }

    /// The matrix C (d, d), cm².
    pub(crate) fn covariance(&self) -> Array2<f64> {
        let atoms = self.atoms();
        atoms.dot(&atoms.t())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array1;

    #[test]
    fn eigenvectors_give_the_covariance_back() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t());
        let basis = EigenCovariance::of(c.view());
        let near = |a: &Array2<f64>| a.iter().zip(&c).all(|(a, b)| (a - b).abs() <= 1e-5);
        assert!(near(&basis.covariance()));
        let mut spread = Array2::zeros((6, 6));
        basis.add_spread(&basis.values, &mut spread);
        assert!(near(&spread));
        let directions = Array2::from_shape_fn((6, 6), |(i, k)| 0.5 * basis.row(i)[k]);
        let deviations: Array1<f32> = basis.values.iter().map(|v| v.sqrt() as f32).collect();
        let again = EigenCovariance::from_parts(directions.view(), deviations.view());
        assert!(basis.values.is_sorted_by(|a, b| a >= b));
        assert!(near(&again.covariance()));
        let diagonal = again.diagonal();
        assert!((0..6).all(|i| (diagonal[i] - c[[i, i]]).abs() <= 1e-5));
    }
}

//! A covariance by its own directions: the sub-dictionary of a block.
//!
//! C = U diag(λ) Uᵀ; the columns of U diag(√λ) are the atoms, whose coefficients are unit Gaussians.

use crate::linalg::symmetric_eigen;
use ndarray::{Array2, ArrayView1, ArrayView2};

/// The directions of a covariance (d, d).
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    d: usize,
    /// U by rows: what each coordinate has of each direction.
    vectors: Vec<f64>,
    /// λ, above 0, cm².
    pub values: Vec<f64>,
}

/// No direction has a smaller variance, cm².
const LEAST: f64 = 1e-9;

impl Basis {
    /// Of a symmetric positive semidefinite matrix.
    pub fn of(covariance: ArrayView2<'_, f64>) -> Basis {
        let d = covariance.nrows();
        // Covariances are finite and symmetric, so LAPACK does not give up; nothing is learnt if it does.
        let (values, vectors) = symmetric_eigen(&covariance.to_owned())
            .unwrap_or_else(|| (ndarray::Array1::zeros(d), Array2::eye(d)));
        Basis {
            d,
            vectors: vectors.iter().copied().collect(),
            values: values.iter().map(|v| v.max(LEAST)).collect(),
        }
    }

    /// From directions (d, d), one a column, of any length above 0, and the deviation √λ along each.
    pub fn from_parts(directions: ArrayView2<'_, f32>, deviations: ArrayView1<'_, f32>) -> Basis {
        let d = directions.nrows();
        let norm = |k: usize| {
            let column = directions.column(k);
            column.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>()
        };
        let scale: Vec<f64> = (0..d).map(|k| 1.0 / norm(k).max(LEAST).sqrt()).collect();
        Basis {
            d,
            vectors: (0..d * d)
                .map(|i| f64::from(directions[[i / d, i % d]]) * scale[i % d])
                .collect(),
            values: (deviations.iter())
                .map(|v| f64::from(*v).powi(2).max(LEAST))
                .collect(),
        }
    }

    /// The atoms U diag(√λ), (d, d): one a column.
    pub fn atoms(&self) -> Array2<f64> {
        Array2::from_shape_fn((self.d, self.d), |(i, k)| {
            self.row(i)[k] * self.values[k].sqrt()
        })
    }

    /// How many coordinates, and directions.
    pub fn len(&self) -> usize {
        self.d
    }

    /// What coordinate `i` has of each direction.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.vectors[i * self.d..(i + 1) * self.d]
    }

    /// The variance of each coordinate.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.d)
            .map(|i| {
                let terms = self.row(i).iter().zip(&self.values);
                terms.map(|(u, l)| u * u * l).sum()
            })
            .collect()
    }

    /// U diag(`values`) Uᵀ.
    pub fn spread(&self, values: &[f64]) -> Array2<f64> {
        let roots: Vec<f64> = values.iter().map(|v| v.max(0.0).sqrt()).collect();
        let mut half = self.vectors.clone();
        for row in half.chunks_exact_mut(self.d.max(1)) {
            row.iter_mut().zip(&roots).for_each(|(v, r)| *v *= r);
        }
        let half = Array2::from_shape_vec((self.d, self.d), half).unwrap_or_default();
        half.dot(&half.t())
    }

    /// The covariance.
    pub fn covariance(&self) -> Array2<f64> {
        self.spread(&self.values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_give_the_covariance_back() {
        let b = Array2::from_shape_fn((6, 6), |(i, j)| ((i * 7 + j * 3 * (i + 1)) as f64).sin());
        let c = b.dot(&b.t());
        let basis = Basis::of(c.view());
        let near = |a: &Array2<f64>| a.iter().zip(&c).all(|(a, b)| (a - b).abs() <= 1e-5);
        assert!(near(&basis.covariance()));
        let directions = Array2::from_shape_fn((6, 6), |(i, k)| 0.5 * basis.row(i)[k] as f32);
        let deviations: ndarray::Array1<f32> =
            basis.values.iter().map(|v| v.sqrt() as f32).collect();
        let again = Basis::from_parts(directions.view(), deviations.view());
        assert!(near(&again.covariance()));
        let diagonal = basis.diagonal();
        assert!((0..6).all(|i| (diagonal[i] - c[[i, i]]).abs() <= 1e-9));
    }
}

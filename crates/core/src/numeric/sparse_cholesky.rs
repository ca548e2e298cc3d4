//! Cholesky factors of large sparse matrices, by faer.

use faer::Side;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use ndarray::{Array2, ArrayView2};

/// The factor of a symmetric positive definite matrix (n, n).
#[derive(Debug, Clone)]
pub struct SparseCholesky {
    factor: Llt<u32, f64>,
    n: usize,
}

impl SparseCholesky {
    /// Factors the matrix of `entries` (row, column, value) of its lower triangle; entries of one
    /// row and column are added. `None` when it is not positive definite, or an entry lies outside.
    pub fn new(n: usize, entries: &[(usize, usize, f64)]) -> Option<SparseCholesky> {
        let inside = |k: usize| u32::try_from(k).ok().filter(|_| k < n);
        let triplets: Option<Vec<Triplet<u32, u32, f64>>> = (entries.iter())
            .map(|(row, column, value)| {
                let (low, high) = (*row.min(column), *row.max(column));
                Some(Triplet::new(inside(high)?, inside(low)?, *value))
            })
            .collect();
        let matrix = SparseColMat::try_new_from_triplets(n, n, &triplets?).ok()?;
        let factor = matrix.sp_cholesky(Side::Lower).ok()?;
        Some(SparseCholesky { factor, n })
    }

    /// Solves A x = b for b (n, m).
    pub fn solve(&self, b: ArrayView2<'_, f64>) -> Array2<f64> {
        let right = faer::Mat::from_fn(self.n, b.ncols(), |i, j| b[[i, j]]);
        let x = self.factor.solve(&right);
        Array2::from_shape_fn((self.n, b.ncols()), |(i, j)| x[(i, j)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_is_solved_and_an_indefinite_matrix_is_told() {
        let n = 50;
        let mut entries: Vec<(usize, usize, f64)> = (0..n).map(|i| (i, i, 2.5)).collect();
        // Above the diagonal means the same as below.
        entries.extend((1..n).map(|i| (i - 1, i, -1.0)));
        let factor = SparseCholesky::new(n, &entries).unwrap();
        let b = Array2::from_shape_fn((n, 2), |(i, j)| (i * (j + 1)) as f64);
        let x = factor.solve(b.view());
        for i in 0..n {
            for j in 0..2 {
                let before = if i > 0 { x[[i - 1, j]] } else { 0.0 };
                let after = if i + 1 < n { x[[i + 1, j]] } else { 0.0 };
                let rest = 2.5 * x[[i, j]] - before - after - b[[i, j]];
                assert!(rest.abs() <= 1e-10, "{rest}");
            }
        }
        assert!(SparseCholesky::new(2, &[(0, 0, 1.0), (1, 1, -1.0)]).is_none());
        assert!(SparseCholesky::new(2, &[(0, 2, 1.0)]).is_none());
    }
}

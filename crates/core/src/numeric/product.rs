//! Products of large matrices on all threads, the same for any number of them.

use super::parallel;
use ndarray::{Array2, ArrayView2, Axis, LinalgScalar, concatenate, s};

/// Rows of one parallel task.
const ROWS: usize = 256;

/// `a` (n, k) times `b` (k, m).
pub fn product<T: LinalgScalar + Send + Sync>(
    a: ArrayView2<'_, T>,
    b: ArrayView2<'_, T>,
) -> Array2<T> {
    let parts = parallel::map_chunks(a.nrows(), ROWS, |rows| a.slice(s![rows, ..]).dot(&b));
    let parts: Vec<_> = parts.iter().map(|p| p.view()).collect();
    if parts.is_empty() {
        Array2::from_elem((0, b.ncols()), T::zero())
    } else {
        // Each part has the columns of `b`.
        concatenate(Axis(0), &parts).unwrap_or_else(|_| a.dot(&b))
    }
}

/// `a`ᵀ `b` (k, m) of `a` (n, k) and `b` (n, m).
pub fn transposed_product(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> Array2<f64> {
    product(a.t(), b)
}

/// `a`ᵀ `a` (k, k) of `a` (n, k).
pub fn gram(a: ArrayView2<'_, f64>) -> Array2<f64> {
    product(a.t(), a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_in_parts_is_the_product() {
        let a = Array2::from_shape_fn((600, 7), |(i, j)| ((i * 3 + j) % 11) as f64);
        let b = Array2::from_shape_fn((7, 5), |(i, j)| (i as f64 - j as f64) / 3.0);
        assert_eq!(product(a.view(), b.view()), a.dot(&b));
        assert_eq!(gram(a.view()), a.t().dot(&a));
        assert_eq!(product(a.slice(s![..0, ..]), b.view()).dim(), (0, 5));
    }
}

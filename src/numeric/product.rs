//! Products of large matrices on rayon's threads, by fixed chunks of rows: the same on any number of threads.

use super::parallel::map_chunks;
use ndarray::{Array2, ArrayView2, concatenate, s};

/// Rows of a chunk: long enough that a chunk's product costs far more than its packing.
const ROWS: usize = 256;

/// A B for A (n, k) and B (k, m): (n, m).
pub fn product(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> Array2<f64> {
    let parts = map_chunks(a.nrows(), ROWS, |rows| a.slice(s![rows, ..]).dot(&b));
    let views: Vec<_> = parts.iter().map(|p| p.view()).collect();
    match views.is_empty() {
        true => Array2::zeros((0, b.ncols())),
        false => concatenate(ndarray::Axis(0), &views).expect("as wide as b"),
    }
}

/// Aᵀ B for A (n, k) and B (n, m): (k, m). The chunks are added in their order.
pub fn transposed_product(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> Array2<f64> {
    let parts = map_chunks(a.nrows(), ROWS, |rows| {
        let b = b.slice(s![rows.clone(), ..]);
        a.slice(s![rows, ..]).t().dot(&b)
    });
    let zero = Array2::zeros((a.ncols(), b.ncols()));
    parts.into_iter().fold(zero, |sum, part| sum + part)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(n: usize, m: usize) -> Array2<f64> {
        Array2::from_shape_fn((n, m), |(i, j)| ((i * 7 + j * 3) as f64 * 0.37).sin())
    }

    #[test]
    fn products_in_chunks_are_products() {
        for n in [0, 1, 255, 256, 257, 700] {
            let (a, b, c) = (matrix(n, 5), matrix(5, 3), matrix(n, 4));
            let error = product(a.view(), b.view()) - a.dot(&b);
            assert!(error.iter().all(|e| e.abs() <= 1e-14));
            let error = transposed_product(a.view(), c.view()) - a.t().dot(&c);
            assert!(error.iter().all(|e| e.abs() <= 1e-14 * n as f64));
        }
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let (a, b) = (matrix(1000, 6), matrix(1000, 4));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap()
                .install(|| transposed_product(a.view(), b.view()))
        };
        assert_eq!(on(1), on(2));
    }
}

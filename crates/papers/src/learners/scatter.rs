//! Scatter matrices of poses and of pairs.

use crate::Result;
use crate::numeric::parallel::map_chunks;
use crate::numeric::product::transposed_product;
use ndarray::{Array2, ArrayView2, Axis};

/// Pairs whose differences are held at one time.
const PAIRS: usize = 512;

/// The differences x_i − x_j of pairs of rows: (pairs, d).
pub(super) fn differences(x: ArrayView2<'_, f64>, pairs: &[[usize; 2]]) -> Array2<f64> {
    let mut out = Array2::zeros((pairs.len(), x.ncols()));
    for (mut row, &[i, j]) in out.rows_mut().into_iter().zip(pairs) {
        row.assign(&(&x.row(i) - &x.row(j)));
    }
    out
}

/// The mean of (x_i − x_j)(x_i − x_j)ᵀ over pairs (equation 13, but for the sum): (d, d). Zero
/// without pairs.
pub(super) fn pair_scatter(x: ArrayView2<'_, f64>, pairs: &[[usize; 2]]) -> Array2<f64> {
    let parts = map_chunks(pairs.len(), PAIRS, |chunk| {
        let apart = differences(x, &pairs[chunk]);
        apart.t().dot(&apart)
    });
    let zero = Array2::zeros((x.ncols(), x.ncols()));
    let sum = parts.into_iter().fold(zero, |sum, part| sum + part);
    sum / pairs.len().max(1) as f64
}

/// The rows less their mean.
pub(super) fn centered(x: ArrayView2<'_, f64>) -> Array2<f64> {
    match x.mean_axis(Axis(0)) {
        Some(mean) => &x - &mean,
        None => x.to_owned(),
    }
}

/// The covariance of all rows, divided by n: (d, d).
pub(super) fn total_scatter(x: ArrayView2<'_, f64>) -> Array2<f64> {
    let about = centered(x);
    transposed_product(about.view(), about.view()) / x.nrows().max(1) as f64
}

/// Adds `ridge` times the mean of the diagonal to the diagonal.
///
/// # Errors
/// [`crate::Error::Unfit`]: a scatter of alike pairs that is 0, which no ridge can mend.
pub(super) fn add_ridge(a: &mut Array2<f64>, ridge: f64) -> Result<()> {
    let mean = a.diag().sum() / a.nrows().max(1) as f64;
    if !(mean > 0.0) {
        return Err("in every pair of label 1 both poses are the same".into());
    }
    a.diag_mut().mapv_inplace(|v| v + ridge * mean);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn scatters_are_means_of_outer_products() {
        let x = array![[1.0, 2.0], [3.0, -1.0], [0.0, 5.0]];
        assert_eq!(
            pair_scatter(x.view(), &[[0, 1]]),
            array![[4.0, -6.0], [-6.0, 9.0]]
        );
        assert_eq!(pair_scatter(x.view(), &[]), Array2::<f64>::zeros((2, 2)));
        // The mean over all ordered pairs is twice the covariance.
        let all: Vec<[usize; 2]> = (0..9).map(|k| [k / 3, k % 3]).collect();
        let error = pair_scatter(x.view(), &all) - total_scatter(x.view()) * 2.0;
        assert!(error.iter().all(|e| e.abs() <= 1e-14));
    }

    #[test]
    fn a_ridge_is_a_share_of_the_mean_diagonal() {
        let mut a = array![[3.0, 1.0], [1.0, 1.0]];
        add_ridge(&mut a, 0.5).unwrap();
        assert_eq!(a, array![[4.0, 1.0], [1.0, 2.0]]);
        assert!(add_ridge(&mut Array2::zeros((2, 2)), 0.5).is_err());
    }
}

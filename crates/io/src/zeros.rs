//! Positions at exactly 0 0 0: some programs write them for missing points, but they may be
//! measurements.

use ndarray::{Array2, ArrayView2, s};

/// How many positions of (frames, 3 P) are at 0 0 0.
///
/// ```
/// use posing_io::zeros::count_zeros;
///
/// let xyz = ndarray::array![[0.0, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]];
/// assert_eq!(count_zeros(xyz.view()), 3); // of four positions
/// ```
pub fn count_zeros(xyz: ArrayView2<'_, f64>) -> usize {
    let count = |p: usize| {
        let point = xyz.slice(s![.., 3 * p..3 * p + 3]);
        let is_zero = |row: &ndarray::ArrayView1<'_, f64>| row.iter().all(|v| *v == 0.0);
        point.rows().into_iter().filter(is_zero).count()
    };
    (0..xyz.ncols() / 3).map(count).sum()
}

/// Makes positions of (frames, 3 P) at 0 0 0 missing ones.
#[doc(hidden)]
pub fn empty_zeros(xyz: &mut Array2<f64>) {
    for mut row in xyz.rows_mut() {
        for p in 0..row.len() / 3 {
            let mut point = row.slice_mut(s![3 * p..3 * p + 3]);
            if point.iter().all(|v| *v == 0.0) {
                point.fill(f64::NAN);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_zeros_are_taken_for_missing() {
        let mut xyz = ndarray::array![
            [0.0, 0.0, -0.0, 0.0, 1.0, 0.0],
            [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]
        ];
        assert_eq!(count_zeros(xyz.view()), 2);
        empty_zeros(&mut xyz);
        assert_eq!(xyz.iter().filter(|v| v.is_nan()).count(), 6);
        assert!(xyz[[0, 3]] == 0.0 && xyz[[0, 0]].is_nan() && xyz[[1, 5]].is_nan());
        assert_eq!(count_zeros(xyz.view()), 0);
    }
}

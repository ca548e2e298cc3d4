//! The axes of noise: it is largest along the camera's line of sight.

use crate::pose::point_at;
use glam::{DMat3, DVec3};
use ndarray::ArrayView2;
use std::ops::Range;

/// Squarings of a matrix until its largest eigenvalue is all that counts.
const SQUARINGS: usize = 12;

/// The axes of the fast noise of points (frames, 3 J): the columns of a rotation, the last along
/// the largest. By third differences, of which the larger half may be motion.
pub(super) fn noise_axes(xyz: ArrayView2<'_, f64>, runs: &[Range<usize>]) -> DMat3 {
    let third = |p: usize, t: usize| {
        let at = |k: usize| point_at(xyz, t + k, p);
        at(3) - 3.0 * at(2) + 3.0 * at(1) - at(0)
    };
    let of_run = |run: &Range<usize>| run.start..run.end.saturating_sub(3).max(run.start);
    let frames = || runs.iter().flat_map(of_run);
    let all = (0..xyz.ncols() / 3).flat_map(|p| frames().map(move |t| third(p, t)));
    let mut all: Vec<DVec3> = all.filter(|d| d.is_finite()).collect();
    let half = all.len() / 2;
    if half == 0 {
        return DMat3::IDENTITY;
    }
    all.select_nth_unstable_by(half, |a, b| {
        a.length_squared().total_cmp(&b.length_squared())
    });
    let outer = |d: &DVec3| DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
    let sum: DMat3 = all[..half].iter().map(outer).sum();
    let depth = largest(sum);
    let (across, up) = depth.any_orthonormal_pair();
    DMat3::from_cols(across, up, depth)
}

/// The unit eigenvector of the largest eigenvalue of a symmetric matrix, none of whose eigenvalues
/// is below 0: any such axis where several are the largest, z for zeros.
fn largest(mut matrix: DMat3) -> DVec3 {
    for _ in 0..SQUARINGS {
        let size = matrix.to_cols_array().into_iter().fold(0.0, f64::max);
        if size <= 0.0 {
            return DVec3::Z;
        }
        matrix *= size.recip();
        matrix = matrix * matrix;
    }
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let longest = columns
        .into_iter()
        .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    longest.unwrap_or(DVec3::Z).normalize_or(DVec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_axis_is_found() {
        let axis = DVec3::new(0.48, -0.6, 0.64);
        let outer = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        let found = largest(DMat3::IDENTITY + 5.0 * outer);
        assert!((found.dot(axis).abs() - 1.0).abs() < 1e-9, "{found}");
        assert_eq!(largest(DMat3::ZERO), DVec3::Z);
        assert!(largest(DMat3::IDENTITY).is_normalized());
    }
}

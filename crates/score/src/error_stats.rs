//! Running sums of errors, coordinate by coordinate.

use ndarray::ArrayView1;
use serde::Serialize;

/// Multiples of the stated standard deviation at which errors are counted, with the share of a
/// Gaussian within.
#[doc(hidden)]
pub const SD_LEVELS: [(f64, f64); 12] = [
    (0.25, 0.197_413),
    (0.5, 0.382_925),
    (0.75, 0.546_745),
    (1.0, 0.682_689),
    (1.25, 0.788_700),
    (1.5, 0.866_386),
    (1.75, 0.919_882),
    (2.0, 0.954_500),
    (2.25, 0.975_551),
    (2.5, 0.987_581),
    (2.75, 0.994_040),
    (3.0, 0.997_300),
];
/// The indices of one and two standard deviations in [`SD_LEVELS`].
#[doc(hidden)]
pub const ONE_AND_TWO_SD: [usize; 2] = [3, 7];

/// Errors of a set of coordinates. Lengths are in the unit of the report; `None` if nothing was
/// compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorStats {
    /// The number of coordinates with a value in the truth and in the result.
    pub coordinates: u64,
    /// The number of coordinates with a value in the truth and none in the result; in none of the
    /// errors.
    pub still_missing: u64,
    /// Mean squared error of a coordinate (unit squared).
    pub mse: Option<f64>,
    /// Square root of `mse`.
    pub rms: Option<f64>,
    /// Mean distance of points whose three coordinates are all in the set.
    pub mean_distance: Option<f64>,
    /// The largest error of a coordinate.
    pub max: Option<f64>,
}

/// The sums behind [`ErrorStats`], in centimeters.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct ErrorSums {
    coordinates: u64,
    missing: u64,
    squares: f64,
    max: f64,
    points: u64,
    distances: f64,
}

impl ErrorSums {
    /// Adds the coordinates of a point for which `member` is true and the truth has a value.
    pub(crate) fn add(&mut self, truth: [f64; 3], result: [f64; 3], member: [bool; 3]) {
        let (mut squared, mut compared) = (0.0, 0);
        for a in 0..3 {
            if !member[a] || truth[a].is_nan() {
                continue;
            }
            if result[a].is_nan() {
                self.missing += 1;
                continue;
            }
            let error = (result[a] - truth[a]).abs();
            squared += error * error;
            compared += 1;
            self.max = self.max.max(error);
        }
        self.coordinates += compared;
        self.squares += squared;
        if compared == 3 {
            self.points += 1;
            self.distances += squared.sqrt();
        }
    }

    /// Adds another sums's sums.
    pub(crate) fn merge(&mut self, other: &ErrorSums) {
        self.coordinates += other.coordinates;
        self.missing += other.missing;
        self.squares += other.squares;
        self.max = self.max.max(other.max);
        self.points += other.points;
        self.distances += other.distances;
    }

    /// Whether the truth has no value in the set.
    pub(crate) fn is_empty(&self) -> bool {
        self.coordinates + self.missing == 0
    }

    /// The errors, with lengths in a unit of `unit` centimeters.
    pub(crate) fn errors(&self, unit: f64) -> ErrorStats {
        let mse = mean(self.squares, self.coordinates).map(|v| v / (unit * unit));
        ErrorStats {
            coordinates: self.coordinates,
            still_missing: self.missing,
            mse,
            rms: mse.map(f64::sqrt),
            mean_distance: mean(self.distances, self.points).map(|v| v / unit),
            max: (self.coordinates > 0).then(|| self.max / unit),
        }
    }
}

/// The mean; `None` without values.
pub(super) fn mean(sum: f64, count: u64) -> Option<f64> {
    (count > 0).then(|| sum / count as f64)
}

/// Point `i` of a frame (3 J).
pub(super) fn point(xyz: ArrayView1<'_, f64>, i: usize) -> [f64; 3] {
    [xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [bool; 3] = [true; 3];

    #[test]
    fn errors_of_one_point() {
        let mut t = ErrorSums::default();
        t.add([0.0; 3], [2.0, 3.0, 6.0], ALL);
        let e = t.errors(1.0);
        assert_eq!((e.coordinates, e.still_missing), (3, 0));
        assert_eq!((e.mean_distance, e.max), (Some(7.0), Some(6.0)));
        assert!((e.mse.unwrap() - 49.0 / 3.0).abs() <= 1e-12);
        let half = t.errors(2.0);
        assert!((half.mse.unwrap() - 49.0 / 12.0).abs() <= 1e-12);
        assert_eq!((half.mean_distance, half.max), (Some(3.5), Some(3.0)));
    }

    #[test]
    fn missing_values_are_counted_or_left_out() {
        let nan = f64::NAN;
        let mut t = ErrorSums::default();
        t.add([nan, 1.0, 2.0], [1.0, nan, 4.0], ALL);
        let e = t.errors(1.0);
        assert_eq!((e.coordinates, e.still_missing), (1, 1));
        assert_eq!((e.mse, e.mean_distance), (Some(4.0), None));
        let empty = ErrorSums::default().errors(1.0);
        assert_eq!((empty.mse, empty.rms, empty.max), (None, None, None));
    }

    #[test]
    fn merging_is_adding_both() {
        let (a, b) = ([1.0, 2.0, 3.0], [2.0, 2.5, 3.0]);
        let (mut whole, mut left, mut right) = (
            ErrorSums::default(),
            ErrorSums::default(),
            ErrorSums::default(),
        );
        whole.add([0.0; 3], a, ALL);
        whole.add([0.0; 3], b, [true, false, true]);
        left.add([0.0; 3], a, ALL);
        right.add([0.0; 3], b, [true, false, true]);
        left.merge(&right);
        assert_eq!(left, whole);
    }
}

//! Positions at exactly 0 0 0 where a point is elsewhere in other frames: hardly ever measured, so
//! nothing is estimated from them.

use super::Poses;
use ndarray::{Array2, ArrayView2};
use std::borrow::Cow;

/// Zeros that count as missing where something is estimated. A point that is at the origin in every
/// frame, as the root of poses in body space, is there on purpose and has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Zeros {
    /// Frames and points, in order.
    indices: Vec<(usize, usize)>,
}

impl Zeros {
    /// Those of positions (frames, 3 P).
    pub fn of(xyz: ArrayView2<'_, f64>) -> Zeros {
        let is_zero = |t: usize, p: usize| (0..3).all(|c| xyz[[t, 3 * p + c]] == 0.0);
        let is_seen = |t: usize, p: usize| (0..3).all(|c| xyz[[t, 3 * p + c]].is_finite());
        let mut indices = Vec::new();
        for p in 0..xyz.ncols() / 3 {
            let own: Vec<usize> = (0..xyz.nrows()).filter(|t| is_zero(*t, p)).collect();
            let moves = || (0..xyz.nrows()).any(|t| is_seen(t, p) && !is_zero(t, p));
            if !own.is_empty() && moves() {
                indices.extend(own.into_iter().map(|t| (t, p)));
            }
        }
        indices.sort_unstable();
        Zeros { indices }
    }

    /// Whether the position of a point in a frame is one.
    pub fn contains(&self, frame: usize, point: usize) -> bool {
        self.indices.binary_search(&(frame, point)).is_ok()
    }

    /// Sets their three coordinates.
    pub fn set(&self, xyz: &mut Array2<f64>, value: f64) {
        for (t, p) in &self.indices {
            (0..3).for_each(|c| xyz[[*t, 3 * p + c]] = value);
        }
    }

    /// Poses in which they are missing.
    pub fn emptied(poses: &Poses) -> Cow<'_, Poses> {
        let zeros = Zeros::of(poses.xyz.view());
        let mut poses = Cow::Borrowed(poses);
        if !zeros.indices.is_empty() {
            zeros.set(&mut poses.to_mut().xyz, f64::NAN);
        }
        poses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn zeros_are_those_of_points_that_are_elsewhere_too() {
        let gap = f64::NAN;
        let xyz = array![
            [0.0, 0.0, 0.0, 0.0, -0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, gap, gap, gap],
        ];
        let zeros = Zeros::of(xyz.view());
        assert_eq!(zeros.indices, [(0, 1)]);
        assert!(zeros.contains(0, 1) && !zeros.contains(0, 0) && !zeros.contains(1, 1));
        let poses = Poses {
            xyz,
            ..Poses::default()
        };
        let emptied = Zeros::emptied(&poses);
        assert_eq!(emptied.xyz.iter().filter(|v| v.is_nan()).count(), 6);
        assert!(matches!(Zeros::emptied(&emptied), Cow::Borrowed(_)));
    }
}

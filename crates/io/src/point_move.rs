//! Positions that belong to another point than that in whose columns they stand.

use ndarray::{Array2, Ix2, SliceInfo, SliceInfoElem, s};
use std::ops::Range;

/// Frames of a point that are another's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PointMove {
    /// The point in whose columns they stand.
    pub from: usize,
    /// The point whose they are; `None`: no point's, so that the first is missing there.
    pub to: Option<usize>,
    /// The frames.
    pub frames: Range<usize>,
}

impl PointMove {
    /// Makes some moves at once in `xyz` (frames, 3 P); what is left without others is NaN.
    #[doc(hidden)]
    pub fn make_all(moves: &[PointMove], xyz: &mut Array2<f64>) {
        PointMove::make_all_of(moves, xyz, 3);
    }

    /// [`PointMove::make_all`] in values of which each point has so many (frames, width P).
    pub(crate) fn make_all_of(moves: &[PointMove], values: &mut Array2<f64>, width: usize) {
        let was = values.clone();
        for step in moves {
            values
                .slice_mut(step.cells(step.from, width))
                .fill(f64::NAN);
        }
        for step in moves {
            if let Some(to) = step.to {
                values
                    .slice_mut(step.cells(to, width))
                    .assign(&was.slice(step.cells(step.from, width)));
            }
        }
    }

    fn cells(&self, point: usize, width: usize) -> SliceInfo<[SliceInfoElem; 2], Ix2, Ix2> {
        s![self.frames.clone(), width * point..width * (point + 1)]
    }
}

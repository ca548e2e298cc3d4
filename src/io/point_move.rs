//! Positions that belong to another point than that in whose place they stand.

use ndarray::{Array2, Ix2, SliceInfo, SliceInfoElem, s};
use std::ops::Range;

/// Frames of a point that are another's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PointMove {
    /// The point in whose place they stand.
    pub from: usize,
    /// The point whose they are; `None`: no point's, so that the first is missing there.
    pub to: Option<usize>,
    /// The frames.
    pub frames: Range<usize>,
}

impl PointMove {
    /// Makes some moves at once in `xyz` (frames, 3 P); what is left without others is NaN.
    pub(crate) fn make_all(moves: &[PointMove], xyz: &mut Array2<f64>) {
        let was = xyz.clone();
        for step in moves {
            xyz.slice_mut(step.cells(step.from)).fill(f64::NAN);
        }
        for step in moves {
            if let Some(to) = step.to {
                xyz.slice_mut(step.cells(to))
                    .assign(&was.slice(step.cells(step.from)));
            }
        }
    }

    fn cells(&self, point: usize) -> SliceInfo<[SliceInfoElem; 2], Ix2, Ix2> {
        s![self.frames.clone(), 3 * point..3 * point + 3]
    }
}

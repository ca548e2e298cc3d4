//! Positions that belong to another point than that in whose place they stand.

use ndarray::Array2;
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
    /// Makes some moves at once, in `values` of `width` columns a point; where a point is left
    /// without others, they are `empty`.
    pub(crate) fn make_all<T: Clone>(
        moves: &[PointMove],
        values: &mut Array2<T>,
        width: usize,
        empty: &T,
    ) {
        let cells = |m: &PointMove| {
            m.frames
                .clone()
                .flat_map(|t| (0..width).map(move |c| (t, c)))
        };
        let old: Vec<Vec<T>> = moves
            .iter()
            .map(|m| {
                cells(m)
                    .map(|(t, c)| values[[t, width * m.from + c]].clone())
                    .collect()
            })
            .collect();
        for step in moves {
            cells(step).for_each(|(t, c)| values[[t, width * step.from + c]] = empty.clone());
        }
        for (step, old) in moves.iter().zip(old) {
            let Some(to) = step.to else { continue };
            for ((t, c), old) in cells(step).zip(old) {
                values[[t, width * to + c]] = old;
            }
        }
    }
}

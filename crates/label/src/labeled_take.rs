//! A take as its labels are put right: labels first, then the tracks without one.

use super::label_model::LabelModel;
use super::templates::Templates;
use ndarray::ArrayView2;
use std::ops::Range;

/// A take whose labels are to be put right.
#[derive(Clone, Copy)]
pub(crate) struct LabeledTake<'a> {
    /// The tracks' names (N): labels first, then those that have none.
    pub names: &'a [String],
    /// How many are labels.
    pub labels: usize,
    /// (frames, 3 N), cm, without frames that repeat the one before; NaN is missing.
    pub xyz: ArrayView2<'a, f64>,
    /// Ranges of consecutive frames.
    pub runs: &'a [Range<usize>],
    /// Frames a second.
    pub rate: f64,
    /// The person whose labels these are, and labeled takes to compare them with.
    pub person: &'a str,
    pub like: &'a Templates,
    /// The body that they are on.
    pub body: Option<&'a dyn LabelModel>,
}

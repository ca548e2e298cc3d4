//! What tells where the labels of a person are: the markers on a body.

use crate::Result;
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

/// The points of a frame, named.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedFrame {
    /// The label of each point.
    pub labels: Vec<Option<usize>>,
    /// How badly they fit; comparable between the frames of a take.
    pub cost: f64,
}

/// A model of where the labels of a person are.
pub trait LabelModel: Send + Sync {
    /// The labels (L).
    fn labels(&self) -> &[String];

    /// Whether a label is one of several that the model cannot tell apart.
    fn is_one_of_several(&self, label: usize) -> bool;

    /// Whether a track of this name has a label already, one of these or of others.
    fn is_label(&self, name: &str) -> bool;

    /// Whether labels are fitted by those that are known beside them in a frame, and so better by
    /// more of them; else a body is, by some frames.
    fn is_of_neighbors(&self) -> bool {
        false
    }

    /// Names the points of frames, each by itself; cm, y up.
    ///
    /// # Errors
    /// Errors of the model.
    fn name_frames(&self, frames: &[Vec<DVec3>]) -> Result<Vec<NamedFrame>>;

    /// Fits the model to frames of a take, of whose labels some are known in some frames
    /// (frames, 3 L; cm, y up; NaN is missing).
    ///
    /// # Errors
    /// Errors of the model.
    fn fit(&self, known: ArrayView2<'_, f64>) -> Result<FittedLabels>;
}

/// A model that is fitted to a take.
#[derive(Debug, Clone)]
pub struct FittedLabels {
    /// Where each label is in every frame (frames, 3 L), cm.
    pub places: Array2<f64>,
    /// How little is known of where each label is on the body, cm: large of those that are known in
    /// no frame.
    pub sd: Vec<f64>,
    /// How far each label may be from its position, of how far markers on a body may be: less than
    /// 1 where the positions are exact.
    pub reach: Vec<f64>,
    /// How far that is from where such labels are mostly, standard deviations.
    pub deviations: Vec<f64>,
}

//! How labels are put right.

use super::label_model::LabelModel;
use super::templates::Templates;
use crate::error::OptionNames;
use crate::pose::Segment;
use std::sync::Arc;

/// How labels are put right.
#[derive(Clone)]
pub struct LabelSettings {
    /// Segments of points whose labels stay.
    pub keep: Vec<Segment>,
    /// Whether positions of a label that are no label's are taken out.
    pub take_out: bool,
    /// Labeled takes to compare with.
    pub like: Arc<Templates>,
    /// Whether labels come from these takes, which are right where both differ and the body does
    /// not object.
    pub named_by_like: bool,
    /// The body that the labels are on, which decides where nothing else does.
    pub body: Option<Arc<dyn LabelModel>>,
    /// Pairs of points that are exchanged in every frame, in takes that have both.
    pub exchange: Vec<[String; 2]>,
    /// What reports call options.
    pub option_names: OptionNames,
}

impl Default for LabelSettings {
    fn default() -> LabelSettings {
        LabelSettings {
            keep: Vec::new(),
            take_out: true,
            like: Arc::default(),
            named_by_like: false,
            body: None,
            exchange: Vec::new(),
            option_names: OptionNames::default(),
        }
    }
}

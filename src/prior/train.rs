//! Training any prior by its kind's name.

use super::training::TrainingPoses;
use crate::io::Model;
use crate::{Error, Result};

/// The kinds of model that can be trained, with what each is.
pub const KINDS: &[(&str, &str)] = &[];

/// What is trained from, and how.
#[derive(Debug, Clone, Copy)]
pub struct Training<'a> {
    /// The poses, in the model's space.
    pub poses: &'a TrainingPoses,
    /// Whether each pose was placed (world space), or rows were used as they are.
    pub world: bool,
    /// The seed of all draws.
    pub seed: u64,
}

/// Trains a model of a kind; `report` hears what is being done.
pub fn train(kind: &str, _training: &Training<'_>, _report: &mut dyn FnMut(&str)) -> Result<Model> {
    let known: Vec<&str> = KINDS.iter().map(|(name, _)| *name).collect();
    Err(Error::usage(format!(
        "--kind {kind}: expected one of {}",
        known.join(", ")
    )))
}

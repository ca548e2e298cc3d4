//! Which model names tracks as in labeled takes: the body, where enough of their labels are on it.

use super::body_labels::BodyModel;
use super::marker_sets::MarkerSet;
use crate::Result;
use crate::label::LabelModel;
use crate::pose::Poses;

/// The model that names tracks as in labeled takes of people: their body, where `set` (`None`: the
/// built-in set that knows most) knows at least eight, and half, of the labels; else the labels by
/// themselves.
///
/// # Errors
/// [`crate::Error::Usage`]: too few labels.
pub fn naming_model(takes: &[&Poses], set: Option<&MarkerSet>) -> Result<Box<dyn LabelModel>> {
    let pairs: Vec<_> = takes.iter().map(|take| (*take, None)).collect();
    let learned = MarkerSet::learn("like", &pairs, set)?;
    Ok(Box::new(BodyModel::new(&learned)?))
}

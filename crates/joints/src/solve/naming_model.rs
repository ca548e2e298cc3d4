//! Which model names tracks as in labeled takes: the body, where enough of their labels are on it.

use super::body_labels::BodyModel;
use super::marker_sets::MarkerSet;
use super::tuning::FEWEST_MARKERS;
use crate::Result;
use crate::label::LabelModel;
use crate::pose::Poses;
use std::sync::Arc;

/// The body that the labels of some points are on, by `set` (`None`: the built-in one that knows
/// most); `None` where it knows few.
pub fn body_of(points: &[String], set: Option<&MarkerSet>) -> Option<Arc<dyn LabelModel>> {
    let set = set.or_else(|| MarkerSet::of(points))?;
    let known = set.markers(points).len();
    let body = (known >= FEWEST_MARKERS).then(|| BodyModel::new(set).ok());
    body.flatten()
        .map(|body| Arc::new(body) as Arc<dyn LabelModel>)
}

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

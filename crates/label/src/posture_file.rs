//! Postures of labels as a part of a marker set's file (JSON).

use super::posture_model::PostureModel;
use glam::DVec3;
use ndarray::Array2;
use serde::{Deserialize, Serialize};

/// Labels, where they are in some postures, and how they move against each other.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PosturesInFile {
    labels: Vec<String>,
    /// By posture and label, cm; none where it is not seen.
    postures: Vec<Vec<Option<[f64; 3]>>>,
    /// By both labels: how much their distance changes, variance, cm².
    looseness: Vec<Vec<f64>>,
    /// How differently each label lies on people, cm.
    spreads: Vec<f64>,
}

/// Digits that say all there is.
fn round(v: f64) -> f64 {
    (v * 1e4).round() / 1e4
}

impl From<&PostureModel> for PosturesInFile {
    fn from(model: &PostureModel) -> PosturesInFile {
        let at = |p: &DVec3| p.is_finite().then(|| p.to_array().map(round));
        let row = |row: ndarray::ArrayView1<'_, f64>| row.iter().map(|v| round(*v)).collect();
        PosturesInFile {
            labels: model.labels.clone(),
            postures: model
                .postures
                .iter()
                .map(|p| p.iter().map(at).collect())
                .collect(),
            looseness: model.looseness.rows().into_iter().map(row).collect(),
            spreads: model.spreads.iter().map(|v| round(*v)).collect(),
        }
    }
}

impl PosturesInFile {
    /// How many labels there are.
    pub fn count(&self) -> usize {
        self.labels.len()
    }

    /// The model; `None` where the numbers of its parts do not fit each other.
    pub fn model(self) -> Option<PostureModel> {
        let count = self.labels.len();
        let is_whole = self.postures.iter().all(|p| p.len() == count)
            && self.looseness.iter().all(|row| row.len() == count)
            && self.looseness.iter().flatten().all(|v| *v > 0.0)
            && self.spreads.iter().all(|v| *v >= 0.0);
        let is_right = (self.looseness.len(), self.spreads.len()) == (count, count);
        if !is_whole || !is_right || self.postures.is_empty() || count < 4 {
            return None;
        }
        let at = |p: Option<[f64; 3]>| p.map_or(DVec3::NAN, DVec3::from_array);
        let looseness = self.looseness.concat();
        Some(PostureModel {
            labels: self.labels,
            postures: self
                .postures
                .into_iter()
                .map(|p| p.into_iter().map(at).collect())
                .collect(),
            looseness: Array2::from_shape_vec((count, count), looseness).ok()?,
            spreads: self.spreads,
        })
    }
}

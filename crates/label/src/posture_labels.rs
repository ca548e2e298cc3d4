//! Tracks named by postures of labeled takes.

use super::label_model::{FittedLabels, LabelModel, NamedFrame};
use super::posture_fit::fit;
use super::posture_model::PostureModel;
use super::posture_search::named_frames;
use super::unlabeled::own_name;
use crate::Result;
use glam::DVec3;
use ndarray::ArrayView2;

impl LabelModel for PostureModel {
    fn labels(&self) -> &[String] {
        &self.labels
    }

    fn is_one_of_several(&self, _: usize) -> bool {
        false
    }

    fn is_label(&self, name: &str) -> bool {
        let own = own_name(name);
        self.labels.iter().any(|l| l == own)
    }

    fn is_of_neighbors(&self) -> bool {
        true
    }

    fn name_frames(&self, frames: &[Vec<DVec3>]) -> Result<Vec<NamedFrame>> {
        Ok(named_frames(self, frames))
    }

    fn fit(&self, known: ArrayView2<'_, f64>) -> Result<FittedLabels> {
        Ok(fit(self, known))
    }
}

//! Priors that keep the training poses themselves and answer from those that resemble the
//! observation.

mod exemplar_weights;
pub(crate) mod nlm;

use crate::Result;
use crate::io::Model;
use crate::prior::training_set::{TrainOptions, TrainingSet};
use crate::prior::tuning::{Grid, PriorFamily, TunedPrior, Tuning, tune};
use crate::prior::{OpenOptions, model_arrays};
use ndarray::ArrayView2;

/// A kind of prior whose model is the array `poses` (n, D), cm, of its training poses.
pub struct ExemplarKind {
    /// The name in flags and model files.
    pub name: &'static str,
    /// The settings that are tried on held-out poses.
    pub grid: fn() -> Grid,
    /// The prior of some poses (n, D) at any inflation.
    pub prior: fn(ArrayView2<'_, f32>) -> PriorFamily,
    /// A last change of the tuning.
    pub adjust: fn(&mut Tuning),
}

impl ExemplarKind {
    /// Makes a model of the poses and tunes it.
    ///
    /// # Errors
    /// Data: no poses to learn from.
    pub fn train(
        &self,
        poses: &TrainingSet,
        options: &TrainOptions,
        report: &mut dyn FnMut(&str),
    ) -> Result<Model> {
        let mut model = poses.model(self.name)?;
        let learn = |kept: &TrainingSet| Ok((self.prior)(kept.xyz.view()));
        let mut tuning = tune(poses, options, &(self.grid)(), &learn, report)?;
        (self.adjust)(&mut tuning);
        tuning.write(&mut model);
        model.insert("poses", poses.xyz.clone());
        Ok(model)
    }

    /// Opens a model of the kind; `source` names it in messages.
    ///
    /// # Errors
    /// Data: arrays that are missing, of the wrong shape or not finite.
    pub fn open(&self, model: &Model, options: &OpenOptions, source: &str) -> Result<TunedPrior> {
        let poses = model_arrays::poses(model, "poses", source)?;
        TunedPrior::open(model, options, source, &(self.prior)(poses.view()))
    }
}

//! Models of what poses look like: one trait, one file a model.
//!
//! A prior answers one question: given numbers for some coordinates of a pose, each with the variance of its noise
//! (0 exact, infinite missing), which pose is it, and how sure is that? Dense noise, outliers and gaps are all
//! variances, so denoising and completing are the same question.

pub mod builtin;
pub mod conditional;
pub mod sparse;
pub mod training;

use crate::Result;
use crate::io::Model;
use crate::pose::PoseMap;
use crate::{Error, Place};
use ndarray::ArrayView2;

pub use sparse::{Choice, SparsePrior};

/// The variance that stands for "exact", cm²: a tenth of a millimetre. No capture is better, and solves stay sound.
pub const EXACT: f64 = 1e-4;

/// What a prior makes of an observation, to the point that the placement needs (the paper's P1a).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fit {
    /// The pose in the span of the chosen atoms (or the like), 3 J numbers.
    pub pose: Vec<f64>,
    /// What was chosen: the atoms' indices.
    pub support: Vec<u32>,
    /// Σ (yᵢ − poseᵢ)² / (noise variance + model variance) over the observed: the objective (7).
    pub objective: f64,
}

/// The answer: a pose and how sure it is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Posterior {
    /// 3 J numbers, cm.
    pub mean: Vec<f64>,
    /// The variance of each, cm².
    pub variance: Vec<f64>,
}

/// A model of what poses look like in the model's space.
pub trait Prior: Send + Sync {
    /// Numbers a pose: 3 J.
    fn width(&self) -> usize;
    /// The variance of what the model leaves unexplained in each coordinate, cm².
    fn variance(&self) -> &[f64];
    /// The closest pose of the model to an observation. With `before`, never worse than that choice refitted.
    fn fit(&self, y: &[f64], noise: &[f64], before: Option<&Fit>) -> Fit;
    /// The pose to answer with, once placed and fitted.
    fn posterior(&self, y: &[f64], noise: &[f64], fit: &Fit) -> Posterior;
    /// A few poses, far apart, that headings are found with: (k, 3 J).
    fn typical(&self) -> ArrayView2<'_, f64>;
    /// The same model of poses that went through `map`.
    fn mapped(&self, map: &PoseMap) -> Box<dyn Prior>;
}

/// Opens the prior that a model file holds; `source` is for messages.
pub fn open(model: &Model, choice: &Choice, source: &str) -> Result<Box<dyn Prior>> {
    match model.meta.kind.as_str() {
        "sparse" => Ok(Box::new(SparsePrior::from_model(model, choice, source)?)),
        other => {
            let what =
                format!("is a model of kind \"{other}\", expected one of poses (kind sparse)");
            Err(Error::data(Place::file(source), what))
        }
    }
}

//! The state of K-SVD training, from which it can resume.

use super::Dictionary;
use ndarray::Array2;
use serde::{Deserialize, Serialize};

/// Statistics of one iteration. Errors are per coordinate, in the poses' unit, with the dictionary
/// after the iteration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IterationStats {
    /// The iteration, counted from 1; 0 is the start.
    pub iteration: usize,
    /// Mean squared error of the training poses, by the codes that are kept.
    pub mse: f64,
    /// Its root.
    pub rms: f64,
    /// RMS of a fresh coding of the training poses. At least `rms`, and equal to it unless old
    /// codes were kept.
    pub fresh_rms: f64,
    /// RMS of the validation poses, if there are any.
    pub validation_rms: Option<f64>,
    /// The number of unused atoms that were replaced.
    pub unused: usize,
    /// The number of atoms replaced because they were too close to a more used one.
    pub coherent: usize,
    /// The mean number of atoms per pose.
    pub mean_sparsity: f64,
}

/// The state of training. Training from a saved and restored state gives the same bytes as without
/// interruption.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingState {
    /// The atoms.
    pub dictionary: Dictionary,
    /// The atoms of each training pose's code (m, k), [`UNUSED`](super::UNUSED) where there are
    /// fewer than k.
    pub support: Array2<u32>,
    /// Their coefficients (m, k).
    pub coefficients: Array2<f32>,
    /// The statistics of each iteration; the first is of the initial atoms.
    pub history: Vec<IterationStats>,
}

impl TrainingState {
    /// The number of iterations done.
    pub fn iteration(&self) -> usize {
        self.history.last().map_or(0, |r| r.iteration)
    }
}

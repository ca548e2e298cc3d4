//! How far learning has come: all that it needs to go on.

use super::Dictionary;
use ndarray::Array2;
use serde::{Deserialize, Serialize};

/// What an iteration has come to. Errors are a coordinate, in the poses' unit, of the dictionary after the iteration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IterationStats {
    /// The iteration, counted from 1; 0 is the start.
    pub iteration: usize,
    /// Mean squared error of the training poses, by the codes that are kept.
    pub mse: f64,
    /// Its root.
    pub rms: f64,
    /// RMS of the training poses freshly coded, as anyone does who has only the dictionary: at least `rms`, and equal to it
    /// unless old codes were kept.
    pub fresh_rms: f64,
    /// RMS of the validation poses, if there are any.
    pub validation_rms: Option<f64>,
    /// How many atoms no pose used, and a pose replaced.
    pub unused: usize,
    /// How many atoms were too close to a better used one, and a pose replaced.
    pub coherent: usize,
    /// The mean number of atoms a pose.
    pub mean_sparsity: f64,
}

/// All that learning needs to go on: from a state saved and restored it gives the same bytes as without a stop.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingState {
    /// The atoms.
    pub dictionary: Dictionary,
    /// The atoms of each training pose's code (m, k), [`UNUSED`](super::UNUSED) where there are fewer than k.
    pub support: Array2<u32>,
    /// Their coefficients (m, k).
    pub coefficients: Array2<f32>,
    /// One report an iteration; the first is of the start.
    pub history: Vec<IterationStats>,
}

impl TrainingState {
    /// How many iterations have been done.
    pub fn iteration(&self) -> usize {
        self.history.last().map_or(0, |r| r.iteration)
    }
}

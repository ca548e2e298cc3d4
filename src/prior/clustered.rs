//! Clustered Gaussians (the paper's CG): k-means into 20 clusters, a Gaussian each; the most likely one answers alone.

use super::Choice;
use super::em::{clusters, weights};
use super::gaussian::RIDGE;
use super::gaussians::{self, Answer, Parts, Style};
use super::train::Training;
use super::training::TrainingPoses;
use super::tuning::Tasked;
use crate::Result;
use crate::io::Model;
use ndarray::{Array2, ArrayView2};

/// The paper's number.
const CLUSTERS: usize = 20;
/// Poses a cluster has at least on average: with fewer training poses there are fewer clusters.
const LEAST: usize = 20;

const STYLE: Style = Style {
    answer: Answer::Best,
    estimates_rest: true,
};

/// Trains the kind `clustered`.
pub fn train(training: &Training<'_>, report: &mut dyn FnMut(&str)) -> Result<Model> {
    let learn = |poses: &TrainingPoses| learn(poses.xyz.view(), training.seed);
    gaussians::train("clustered", STYLE, training, &learn, report)
}

/// Opens a model of the kind.
pub fn open(model: &Model, choice: &Choice, source: &str) -> Result<Tasked> {
    gaussians::open(model, choice, source, STYLE)
}

fn learn(xyz: ArrayView2<'_, f32>, seed: u64) -> Result<Parts> {
    let moments = clusters(xyz, CLUSTERS, LEAST, seed)?;
    let mut means = Array2::zeros((moments.len(), xyz.ncols()));
    let weights = weights(&moments);
    let mut covariances = Vec::new();
    for (m, mut row) in moments.into_iter().zip(means.rows_mut()) {
        row.assign(&m.mean);
        let mut covariance = m.covariance;
        covariance.diag_mut().mapv_inplace(|v| v + RIDGE);
        covariances.push(covariance);
    }
    Ok(Parts::of_covariances(weights, means, &covariances))
}

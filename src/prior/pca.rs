//! Principal components: poses in the subspace that keeps 90% of the energy.
//!
//! ```text
//! x = m + U c + e,   c ~ N(0, Λ / λ),   e ~ N(0, σ² I)
//! ```
//!
//! U (D, q) and Λ are the leading eigenvectors and eigenvalues of the covariance, σ² the mean of the other eigenvalues
//! (Tipping and Bishop 1999). As published, the answer lies in the subspace: m + U c, with c given what is observed; e is
//! noise of the observed, and stays its mean. The stated variance has σ² in it.

use super::Choice;
use super::em::moments_of;
use super::gaussians::{self, Answer, Parts, Style, roots};
use super::train::Training;
use super::training::TrainingPoses;
use super::tuning::Tasked;
use crate::Result;
use crate::io::Model;
use ndarray::{Array2, ArrayView2, Axis, s};

/// The share of the eigenvalues' sum that is kept.
const ENERGY: f64 = 0.9;

const STYLE: Style = Style {
    answer: Answer::Average,
    estimates_rest: false,
};

/// Trains the kind `pca`.
pub fn train(training: &Training<'_>, report: &mut dyn FnMut(&str)) -> Result<Model> {
    let learn = |poses: &TrainingPoses| Ok(learn(poses.xyz.view()));
    gaussians::train("pca", STYLE, training, &learn, report)
}

/// Opens a model of the kind.
pub fn open(model: &Model, choice: &Choice, source: &str) -> Result<Tasked> {
    gaussians::open(model, choice, source, STYLE)
}

fn learn(xyz: ArrayView2<'_, f32>) -> Parts {
    let moments = moments_of(xyz, &vec![0; xyz.nrows()], 1).remove(0);
    let roots = roots(&moments.covariance);
    let energies: Vec<f64> = roots.rows().into_iter().map(|r| r.dot(&r)).collect();
    let (kept, left) = cut(&energies);
    Parts {
        weights: vec![1.0],
        means: moments.mean.insert_axis(Axis(0)),
        factors: roots.slice(s![..kept, ..]).to_owned(),
        rest: Array2::from_elem((1, xyz.ncols()), left),
    }
}

/// How many of the falling eigenvalues are kept, at least one, and the mean of those that are not.
fn cut(energies: &[f64]) -> (usize, f64) {
    let total: f64 = energies.iter().sum();
    let (mut kept, mut sum) = (0, 0.0);
    while kept < energies.len() && (kept == 0 || sum < ENERGY * total) {
        sum += energies[kept];
        kept += 1;
    }
    let left = energies[kept..].iter().sum::<f64>();
    (kept, left / (energies.len() - kept).max(1) as f64)
}

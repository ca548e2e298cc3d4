//! Training any prior by its kind's name.

use super::exemplar::{local_pca, nearest_neighbor, nlm};
use super::gaussian::{clustered, mfa, mixture, pca, single};
use super::representative_poses::representative_poses;
use super::rigid_pairs::RigidPairs;
use super::training_set::TrainingSet;
use super::tuning::HoldBack;
use super::{OpenOptions, Prior, SparseCodingPrior, gplvm, multiscale, sparse_coding};
use crate::io::Model;
use crate::io::model::BodyMeta;
use crate::sparse::Ksvd;
use crate::{Error, Place, Result};

/// The kinds of model that can be trained, with what each is.
pub const KINDS: &[(&str, &str)] = &[
    (
        "multiscale",
        "multi-scale mixture of Gaussians over the body and its parts",
    ),
    (
        "sparse",
        "sparse code: 3 of 1,000 atoms of a K-SVD dictionary",
    ),
    ("nearest", "nearest training pose"),
    (
        "nlm",
        "non-local means: distance-weighted average of all training poses",
    ),
    ("nlm-linear", "non-local means with local linear regression"),
    (
        "lpca",
        "local PCA: Gaussian of the 100 nearest training poses",
    ),
    (
        "sik",
        "style-based IK: scaled Gaussian process latent variable model",
    ),
    ("pca", "principal components that keep 90% of the energy"),
    ("gaussian", "a single Gaussian"),
    (
        "clustered",
        "a Gaussian for each of 20 clusters; the most likely one is used",
    ),
    ("mfa", "mixture of 20 factor analyzers"),
    ("mixture", "mixture of 20 Gaussians with shrunk covariances"),
];

/// The kind that is trained where none is named.
pub const DEFAULT: &str = "multiscale";

/// Atoms of a dictionary, where there are as many poses.
const ATOMS: usize = 1000;

/// What is trained from, and how.
#[derive(Debug, Clone, Copy)]
pub struct Training<'a> {
    /// The poses, in the model's space.
    pub poses: &'a TrainingSet,
    /// Whether each pose was placed (world space), or rows were used as they are.
    pub world: bool,
    /// The seed of all draws.
    pub seed: u64,
    /// Which of the poses are held back to tune on.
    pub hold_back: HoldBack,
}

impl Training<'_> {
    /// A model of a kind with what all kinds have: points, space, bones, the number of poses, and `typical` ones.
    pub fn model(&self, kind: &str) -> Result<Model> {
        let space = if self.world { "world" } else { "body" };
        let mut model = Model::new(kind, &self.poses.points, space);
        model.meta.body = self.poses.body.as_ref().map(BodyMeta::from);
        let frames = self.poses.xyz.nrows();
        model.meta.details.insert("frames".into(), frames.into());
        let typical = representative_poses(self.poses.xyz.view())?;
        model.insert("typical", typical);
        RigidPairs::learn(self.poses.xyz.view(), &self.poses.takes).write(&mut model);
        Ok(model)
    }
}

/// Trains a model of a kind; `report` hears what is being done.
pub fn train(kind: &str, training: &Training<'_>, report: &mut dyn FnMut(&str)) -> Result<Model> {
    match kind {
        "multiscale" | "blocks" => {
            multiscale::model(training, &multiscale::TrainSettings::default(), report)
        }
        "sparse" => sparse(training, report),
        "pca" => pca::train(training, report),
        "gaussian" => single::train(training, report),
        "clustered" => clustered::train(training, report),
        "mfa" => mfa::train(training, report),
        "mixture" => mixture::train(training, report),
        "nearest" => nearest_neighbor::train(training, report),
        "nlm" | "nlm-linear" => nlm::train(kind, training, report),
        "lpca" => local_pca::train(training, report),
        "sik" => gplvm::train(training, report),
        // One line a kind, in the order of `KINDS`.
        _ => Err(unknown(kind)),
    }
}

fn unknown(kind: &str) -> Error {
    let known: Vec<&str> = KINDS.iter().map(|(name, _)| *name).collect();
    Error::usage(format!(
        "--kind {kind}: expected one of {}",
        known.join(", ")
    ))
}

/// `ksvd-train -n 1000`, or as many atoms as there are poses.
fn sparse(training: &Training<'_>, report: &mut dyn FnMut(&str)) -> Result<Model> {
    let xyz = training.poses.xyz.view();
    let ksvd = Ksvd {
        atoms: ATOMS.min(xyz.nrows()),
        seed: training.seed,
        ..Ksvd::default()
    };
    sparse_coding::train(training.poses, &ksvd, training.world, &mut |state| {
        if let Some(last) = state.history.last() {
            report(&format!(
                "iteration {}: RMS {:.3} cm",
                last.iteration, last.fresh_rms
            ));
        }
        Ok(())
    })
}

/// Opens the prior that a model file holds; `source` is for messages.
pub fn open(model: &Model, options: &OpenOptions, source: &str) -> Result<Box<dyn Prior>> {
    match model.meta.kind.as_str() {
        "multiscale" | "blocks" => Ok(Box::new(multiscale::MultiscaleMixture::from_model(
            model, source,
        )?)),
        "sparse" => Ok(Box::new(SparseCodingPrior::from_model(
            model, options, source,
        )?)),
        "pca" => Ok(Box::new(pca::open(model, options, source)?)),
        "gaussian" => Ok(Box::new(single::open(model, options, source)?)),
        "clustered" => Ok(Box::new(clustered::open(model, options, source)?)),
        "mfa" => Ok(Box::new(mfa::open(model, options, source)?)),
        "mixture" => Ok(Box::new(mixture::open(model, options, source)?)),
        "nearest" => Ok(Box::new(nearest_neighbor::NearestNeighborPrior::open(
            model, options, source,
        )?)),
        "nlm" | "nlm-linear" => Ok(Box::new(nlm::NlmPrior::open(model, options, source)?)),
        "lpca" => Ok(Box::new(local_pca::LocalPcaPrior::open(
            model, options, source,
        )?)),
        "sik" => Ok(Box::new(gplvm::GplvmPrior::open(model, options, source)?)),
        // One line a kind, in the order of `KINDS`.
        other => {
            let kinds: Vec<&str> = KINDS.iter().map(|(kind, _)| *kind).collect();
            let what = format!(
                "is a model of kind \"{other}\", expected one of poses (kind {})",
                kinds.join(", ")
            );
            Err(Error::data(Place::file(source), what))
        }
    }
}

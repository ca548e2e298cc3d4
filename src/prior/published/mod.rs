//! Pose models that the default is compared with in papers: the feature `published`.

pub(crate) mod box_tree;
pub mod gaussian;
pub(crate) mod gplvm;
pub(crate) mod local_pca;
pub(crate) mod nearest_neighbor;

use super::training_set::{TrainOptions, TrainingSet};
use super::{OpenOptions, Prior};
use crate::Result;
use crate::io::Model;
use gaussian::{clustered, mfa, mixture, pca, single};

/// A kind of published prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// `nearest`: nearest training pose.
    Nearest,
    /// `lpca`: local PCA: Gaussian of the 100 nearest training poses.
    LocalPca,
    /// `sik`: style-based IK: scaled Gaussian process latent variable model.
    Gplvm,
    /// `pca`: principal components that keep 90% of the energy.
    Pca,
    /// `gaussian`: a single Gaussian.
    Gaussian,
    /// `clustered`: a Gaussian for each of 20 clusters, the most likely one is used.
    Clustered,
    /// `mfa`: mixture of 20 factor analyzers.
    FactorAnalyzers,
    /// `mixture`: mixture of 20 Gaussians with shrunk covariances.
    Mixture,
}

impl Kind {
    /// All kinds.
    pub(crate) const ALL: [Kind; 8] = [
        Kind::Nearest,
        Kind::LocalPca,
        Kind::Gplvm,
        Kind::Pca,
        Kind::Gaussian,
        Kind::Clustered,
        Kind::FactorAnalyzers,
        Kind::Mixture,
    ];

    /// The name in flags and model files, and one line on what the model is.
    pub(super) fn text(self) -> (&'static str, &'static str) {
        match self {
            Kind::Nearest => ("nearest", "nearest training pose"),
            Kind::LocalPca => (
                "lpca",
                "local PCA: Gaussian of the 100 nearest training poses",
            ),
            Kind::Gplvm => (
                "sik",
                "style-based IK: scaled Gaussian process latent variable model",
            ),
            Kind::Pca => ("pca", "principal components that keep 90% of the energy"),
            Kind::Gaussian => ("gaussian", "a single Gaussian"),
            Kind::Clustered => (
                "clustered",
                "a Gaussian for each of 20 clusters; the most likely one is used",
            ),
            Kind::FactorAnalyzers => ("mfa", "mixture of 20 factor analyzers"),
            Kind::Mixture => ("mixture", "mixture of 20 Gaussians with shrunk covariances"),
        }
    }

    pub(super) fn train(
        self,
        poses: &TrainingSet,
        options: &TrainOptions,
        report: &mut dyn FnMut(&str),
    ) -> Result<Model> {
        match self {
            Kind::Nearest => nearest_neighbor::KIND.train(poses, options, report),
            Kind::LocalPca => local_pca::KIND.train(poses, options, report),
            Kind::Gplvm => gplvm::train(poses, options, report),
            Kind::Pca => pca::KIND.train(poses, options, report),
            Kind::Gaussian => single::KIND.train(poses, options, report),
            Kind::Clustered => clustered::KIND.train(poses, options, report),
            Kind::FactorAnalyzers => mfa::KIND.train(poses, options, report),
            Kind::Mixture => mixture::KIND.train(poses, options, report),
        }
    }

    pub(super) fn open(
        self,
        model: &Model,
        options: &OpenOptions,
        source: &str,
    ) -> Result<Box<dyn Prior>> {
        Ok(match self {
            Kind::Nearest => Box::new(nearest_neighbor::KIND.open(model, options, source)?),
            Kind::LocalPca => Box::new(local_pca::KIND.open(model, options, source)?),
            Kind::Gplvm => Box::new(gplvm::GplvmPrior::open(model, options, source)?),
            Kind::Pca => Box::new(pca::KIND.open(model, options, source)?),
            Kind::Gaussian => Box::new(single::KIND.open(model, options, source)?),
            Kind::Clustered => Box::new(clustered::KIND.open(model, options, source)?),
            Kind::FactorAnalyzers => Box::new(mfa::KIND.open(model, options, source)?),
            Kind::Mixture => Box::new(mixture::KIND.open(model, options, source)?),
        })
    }
}

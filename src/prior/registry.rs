//! The kinds of prior: their names, how each is trained, and how each is opened.

use super::exemplar::{local_pca, nearest_neighbor, nlm};
use super::gaussian::{clustered, mfa, mixture, pca, single};
use super::training_set::{TrainOptions, TrainingSet};
use super::{OpenOptions, Prior, SparseCodingPrior, gplvm, multiscale, sparse_coding};
use crate::io::Model;
use crate::sparse::Ksvd;
use crate::{Error, Place, Result};
use std::fmt;
use std::str::FromStr;

/// Atoms of a dictionary that [`Kind::Sparse`] trains, if there are as many poses.
const ATOMS: usize = 1000;

/// A kind of prior. Its name ([`Display`](fmt::Display), [`FromStr`]) is that of flags and of model files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Kind {
    /// `multiscale`: multi-scale mixture of Gaussians over the body and its parts.
    #[default]
    Multiscale,
    /// `sparse`: sparse code: 3 of 1,000 atoms of a K-SVD dictionary.
    Sparse,
    /// `nearest`: nearest training pose.
    Nearest,
    /// `nlm`: non-local means: distance-weighted average of all training poses.
    Nlm,
    /// `nlm-linear`: non-local means with local linear regression.
    NlmLinear,
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
    /// All kinds, the default first.
    pub const ALL: [Kind; 12] = [
        Kind::Multiscale,
        Kind::Sparse,
        Kind::Nearest,
        Kind::Nlm,
        Kind::NlmLinear,
        Kind::LocalPca,
        Kind::Gplvm,
        Kind::Pca,
        Kind::Gaussian,
        Kind::Clustered,
        Kind::FactorAnalyzers,
        Kind::Mixture,
    ];

    /// The name in flags and model files.
    pub fn name(self) -> &'static str {
        self.text().0
    }

    /// One line on what the model is.
    pub fn description(self) -> &'static str {
        self.text().1
    }

    fn text(self) -> (&'static str, &'static str) {
        match self {
            Kind::Multiscale => (
                "multiscale",
                "multi-scale mixture of Gaussians over the body and its parts",
            ),
            Kind::Sparse => (
                "sparse",
                "sparse code: 3 of 1,000 atoms of a K-SVD dictionary",
            ),
            Kind::Nearest => ("nearest", "nearest training pose"),
            Kind::Nlm => (
                "nlm",
                "non-local means: distance-weighted average of all training poses",
            ),
            Kind::NlmLinear => ("nlm-linear", "non-local means with local linear regression"),
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

    /// Trains a model of this kind.
    ///
    /// ```
    /// use ndarray::Array2;
    /// use posing::pose::{Observation, Poses, Space};
    /// use posing::prior::{self, Kind, OpenOptions, TrainOptions, TrainingSet, Want};
    ///
    /// // Two points whose heights move together.
    /// let poses = Poses {
    ///     points: ["head", "hand"].map(String::from).to_vec(),
    ///     xyz: Array2::from_shape_fn((60, 6), |(t, c)| match c % 3 {
    ///         1 => 10.0 * (0.1 * t as f64).sin() + c as f64,
    ///         _ => (0.3 * (t * (c + 1)) as f64).cos(),
    ///     }),
    ///     time: None,
    ///     take: None,
    /// };
    /// let poses = TrainingSet::from_poses(&poses, Space::Body, "heights")?;
    /// let model = Kind::Gaussian.train(&poses, &TrainOptions::default())?;
    /// let prior = prior::open(&model, &OpenOptions::default(), "the model")?;
    ///
    /// // The second point is missing.
    /// let gap = f64::INFINITY;
    /// let (y, variance) = ([0.0, 11.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, gap, gap, gap]);
    /// let found = prior.posterior(&Observation::new(&y, &variance)?, Want::Variances);
    /// assert!((found.mean[4] - 14.0).abs() < 1.0);
    /// assert!(found.variance[4] < 1.0);
    /// # Ok::<(), posing::Error>(())
    /// ```
    ///
    /// # Errors
    /// Data: no poses to learn from, or poses that the kind cannot learn from.
    pub fn train(self, poses: &TrainingSet, options: &TrainOptions) -> Result<Model> {
        self.train_with_progress(poses, options, &mut |_| {})
    }

    /// As [`Kind::train`]; `report` is called with what is being done.
    ///
    /// # Errors
    /// As [`Kind::train`].
    pub fn train_with_progress(
        self,
        poses: &TrainingSet,
        options: &TrainOptions,
        report: &mut dyn FnMut(&str),
    ) -> Result<Model> {
        match self {
            Kind::Multiscale => {
                let settings = multiscale::TrainSettings::default();
                multiscale::model(poses, options, &settings, report)
            }
            Kind::Sparse => {
                let ksvd = Ksvd {
                    atoms: ATOMS.min(poses.xyz.nrows()),
                    seed: options.seed,
                    ..Ksvd::default()
                };
                sparse_coding::train(poses, &ksvd, &mut |state| {
                    if let Some(last) = state.history.last() {
                        let (iteration, rms) = (last.iteration, last.fresh_rms);
                        report(&format!("iteration {iteration}: RMS {rms:.3} cm"));
                    }
                    Ok(())
                })
            }
            Kind::Nearest => nearest_neighbor::train(poses, options, report),
            Kind::Nlm | Kind::NlmLinear => nlm::train(self.name(), poses, options, report),
            Kind::LocalPca => local_pca::train(poses, options, report),
            Kind::Gplvm => gplvm::train(poses, options, report),
            Kind::Pca => pca::KIND.train(poses, options, report),
            Kind::Gaussian => single::KIND.train(poses, options, report),
            Kind::Clustered => clustered::KIND.train(poses, options, report),
            Kind::FactorAnalyzers => mfa::KIND.train(poses, options, report),
            Kind::Mixture => mixture::KIND.train(poses, options, report),
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kind {
    type Err = Error;

    /// `blocks`, the former name of `multiscale`, is still read.
    fn from_str(name: &str) -> Result<Kind> {
        if name == "blocks" {
            return Ok(Kind::Multiscale);
        }
        let found = Kind::ALL.into_iter().find(|k| k.name() == name);
        found.ok_or_else(|| Error::usage(format!("--kind {name}: expected one of {}", names())))
    }
}

fn names() -> String {
    Kind::ALL.map(Kind::name).join(", ")
}

/// Opens the prior of a model; `source` names the model in messages.
///
/// # Errors
/// Data: a model that is none of poses, or whose arrays are missing, of the wrong shape or not finite.
pub fn open(model: &Model, options: &OpenOptions, source: &str) -> Result<Box<dyn Prior>> {
    let name = model.meta.kind.as_str();
    let Ok(kind) = name.parse::<Kind>() else {
        let what = format!(
            "is a model of kind \"{name}\", expected one of poses (kind {})",
            names()
        );
        return Err(Error::data(Place::file(source), what));
    };
    Ok(match kind {
        Kind::Multiscale => Box::new(multiscale::MultiscaleMixture::from_model(model, source)?),
        Kind::Sparse => Box::new(SparseCodingPrior::from_model(model, options, source)?),
        Kind::Nearest => Box::new(nearest_neighbor::NearestNeighborPrior::open(
            model, options, source,
        )?),
        Kind::Nlm | Kind::NlmLinear => Box::new(nlm::NlmPrior::open(model, options, source)?),
        Kind::LocalPca => Box::new(local_pca::LocalPcaPrior::open(model, options, source)?),
        Kind::Gplvm => Box::new(gplvm::GplvmPrior::open(model, options, source)?),
        Kind::Pca => Box::new(pca::KIND.open(model, options, source)?),
        Kind::Gaussian => Box::new(single::KIND.open(model, options, source)?),
        Kind::Clustered => Box::new(clustered::KIND.open(model, options, source)?),
        Kind::FactorAnalyzers => Box::new(mfa::KIND.open(model, options, source)?),
        Kind::Mixture => Box::new(mixture::KIND.open(model, options, source)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for kind in Kind::ALL {
            assert_eq!(kind.to_string().parse::<Kind>().unwrap(), kind);
        }
        assert_eq!("blocks".parse::<Kind>().unwrap(), Kind::default());
        let e = "walrus".parse::<Kind>().unwrap_err().to_string();
        assert!(e.contains("walrus") && e.contains("nlm-linear"), "{e}");
    }
}

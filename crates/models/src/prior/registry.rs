//! The kinds of prior: their names, how each is trained, and how each is opened.

use super::exemplar::nlm;
use super::training_set::{TrainOptions, TrainingSet};
use super::{OpenOptions, Prior, SparseCodingPrior, multiscale, sparse_coding};
use crate::io::Model;
use crate::sparse::Ksvd;
use crate::{Error, Place, Result};
use std::fmt;
use std::hash::{Hash, Hasher};
use std::str::FromStr;
use std::sync::{PoisonError, RwLock};

/// Atoms of a dictionary that [`Kind::Sparse`] trains, if there are as many poses.
const ATOMS: usize = 1000;

/// A kind of prior. Its name ([`Display`](fmt::Display), [`FromStr`]) is that of flags and of model
/// files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Kind {
    /// `multiscale`: multi-scale mixture of Gaussians over the body and its parts.
    #[default]
    Multiscale,
    /// `sparse`: sparse code: 3 of 1,000 atoms of a K-SVD dictionary.
    Sparse,
    /// `nlm`: non-local means: distance-weighted average of all training poses.
    Nlm,
    /// `nlm-linear`: non-local means with local linear regression.
    NlmLinear,
    /// A kind that [`register`] has made known.
    Registered(&'static KindEntry),
}

/// What the registry knows of a kind.
#[derive(Debug)]
pub struct KindEntry {
    /// The name in flags and model files, which tells it from all others.
    pub name: &'static str,
    /// One line on what the model is.
    pub description: &'static str,
    /// Trains a model of this name; the last argument is called with what is being done.
    // An alias would hide the arguments in the documentation.
    #[expect(clippy::type_complexity)]
    pub train: fn(&TrainingSet, &TrainOptions, &mut dyn FnMut(&str)) -> Result<Model>,
    /// Opens a model of this name; the last argument names the model in messages.
    pub open: fn(&Model, &OpenOptions, &str) -> Result<Box<dyn Prior>>,
}

impl PartialEq for KindEntry {
    fn eq(&self, other: &KindEntry) -> bool {
        self.name == other.name
    }
}

impl Eq for KindEntry {}

impl Hash for KindEntry {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.name.hash(state);
    }
}

static MULTISCALE: KindEntry = KindEntry {
    name: "multiscale",
    description: "multi-scale mixture of Gaussians over the body and its parts",
    train: |poses, options, report| {
        let settings = multiscale::TrainSettings::default();
        multiscale::model(poses, options, &settings, report)
    },
    open: |model, _, source| {
        let prior = multiscale::MultiscaleMixture::from_model(model, source)?;
        Ok(Box::new(prior))
    },
};

static SPARSE: KindEntry = KindEntry {
    name: "sparse",
    description: "sparse code: 3 of 1,000 atoms of a K-SVD dictionary",
    train: |poses, options, report| {
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
    },
    open: |model, options, source| {
        let prior = SparseCodingPrior::from_model(model, options, source)?;
        Ok(Box::new(prior))
    },
};

static NLM: KindEntry = KindEntry {
    name: nlm::KIND.name,
    description: "non-local means: distance-weighted average of all training poses",
    train: |poses, options, report| nlm::KIND.train(poses, options, report),
    open: |model, options, source| Ok(Box::new(nlm::KIND.open(model, options, source)?)),
};

static NLM_LINEAR: KindEntry = KindEntry {
    name: nlm::LINEAR_KIND.name,
    description: "non-local means with local linear regression",
    train: |poses, options, report| nlm::LINEAR_KIND.train(poses, options, report),
    open: |model, options, source| Ok(Box::new(nlm::LINEAR_KIND.open(model, options, source)?)),
};

/// The kinds of other rooms, in the order in which they were registered.
static REGISTERED: RwLock<Vec<&'static KindEntry>> = RwLock::new(Vec::new());

/// Makes kinds of another crate known to the whole process: to [`Kind::all`], to the names that are
/// read, and to [`open`]. A name that is known already keeps what it means, so that a second call
/// changes nothing.
///
/// ```
/// use posing_models::prior::{self, Kind, KindEntry};
///
/// static SMOOTH: KindEntry = KindEntry {
///     name: "smooth",
///     description: "non-local means under a name of its own",
///     train: |poses, options, report| {
///         let mut model = Kind::Nlm.train_with_progress(poses, options, report)?;
///         model.meta.kind = "smooth".into();
///         Ok(model)
///     },
///     open: |model, options, source| {
///         let mut model = model.clone();
///         model.meta.kind = "nlm".into();
///         prior::open(&model, options, source)
///     },
/// };
///
/// assert!("smooth".parse::<Kind>().is_err());
/// prior::register(std::slice::from_ref(&SMOOTH));
/// assert_eq!("smooth".parse::<Kind>()?, Kind::Registered(&SMOOTH));
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn register(kinds: &'static [KindEntry]) {
    let mut known = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    for kind in kinds {
        let own = Kind::OWN.into_iter().map(Kind::entry);
        if own.chain(known.iter().copied()).all(|k| k != kind) {
            known.push(kind);
        }
    }
}

/// The most points for which a covariance of all coordinates is learned without being asked for.
const MOST_POINTS: usize = 250;

impl Kind {
    /// The kind that is best for poses of so many points: the cost of [`Kind::Multiscale`] is the
    /// cube of their number.
    pub fn for_points(points: usize) -> Kind {
        if points <= MOST_POINTS {
            Kind::Multiscale
        } else {
            Kind::Nlm
        }
    }

    /// The kinds that are always there.
    const OWN: [Kind; 4] = [Kind::Multiscale, Kind::Sparse, Kind::Nlm, Kind::NlmLinear];

    /// All kinds that are known, the default first; those that were registered last.
    pub fn all() -> Vec<Kind> {
        let known = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
        let registered = known.iter().copied().map(Kind::Registered);
        Kind::OWN.into_iter().chain(registered).collect()
    }

    fn entry(self) -> &'static KindEntry {
        match self {
            Kind::Multiscale => &MULTISCALE,
            Kind::Sparse => &SPARSE,
            Kind::Nlm => &NLM,
            Kind::NlmLinear => &NLM_LINEAR,
            Kind::Registered(entry) => entry,
        }
    }

    /// The name in flags and model files.
    pub fn name(self) -> &'static str {
        self.entry().name
    }

    /// One line on what the model is.
    pub fn description(self) -> &'static str {
        self.entry().description
    }

    /// Trains a model of this kind.
    ///
    /// ```
    /// use ndarray::Array2;
    /// use posing_core::pose::{Observation, Poses, Space};
    /// use posing_models::prior::{self, Kind, OpenOptions, TrainOptions, TrainingSet, Want};
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
    /// let model = Kind::Multiscale.train(&poses, &TrainOptions::default())?;
    /// let prior = prior::open(&model, &OpenOptions::default(), "the model")?;
    ///
    /// // The second point is missing.
    /// let gap = f64::INFINITY;
    /// let (y, variance) = ([0.0, 11.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, gap, gap, gap]);
    /// let found = prior.posterior(&Observation::new(&y, &variance)?, Want::Variances);
    /// assert!((found.mean[4] - 14.0).abs() < 1.0);
    /// assert!(found.variance[4] < 1.0);
    /// # Ok::<(), posing_core::Error>(())
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
        (self.entry().train)(poses, options, report)
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
        let found = Kind::all().into_iter().find(|k| k.name() == name);
        found.ok_or_else(|| {
            Error::usage(format!(
                "the option `kind {name}`: expected one of {}",
                names()
            ))
        })
    }
}

/// The names of all kinds; where those of papers are not registered, how to get them.
fn names() -> String {
    let names: Vec<&str> = Kind::all().into_iter().map(Kind::name).collect();
    let names = names.join(", ");
    let has_none = REGISTERED.read().map_or(true, |known| known.is_empty());
    if has_none {
        return names + "; more come with the feature `papers`, which cargo install builds";
    }
    names
}

/// Opens the prior of a model; `source` names the model in messages.
///
/// ```
/// use posing_core::pose::Observation;
/// use posing_models::prior::{OpenOptions, Want, builtin_model, open};
///
/// let model = builtin_model()?;
/// let prior = open(&model, &OpenOptions::default(), "built in")?;
/// // Nothing is seen of the 69 coordinates: the posterior is the prior.
/// let seen = Observation::new(&[f64::NAN; 69], &[f64::INFINITY; 69])?;
/// let posterior = prior.posterior(&seen, Want::Variances);
/// assert_eq!(posterior.mean.len(), 69);
/// assert!(posterior.variance.iter().all(|variance| *variance >= 0.0));
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// Data: a model that is none of poses, or whose arrays are missing, of the wrong shape or not
/// finite.
pub fn open(model: &Model, options: &OpenOptions, source: &str) -> Result<Box<dyn Prior>> {
    let name = model.meta.kind.as_str();
    let Ok(kind) = name.parse::<Kind>() else {
        let what = format!(
            "is a model of kind \"{name}\", expected one of poses (kind {})",
            names()
        );
        return Err(Error::data(Place::file(source), what));
    };
    (kind.entry().open)(model, options, source)
}

#[cfg(test)]
mod tests {
    use super::super::kind_checks;
    use super::*;

    #[test]
    fn names_are_read_back() {
        for kind in Kind::OWN {
            assert_eq!(kind.to_string().parse::<Kind>().unwrap(), kind);
        }
        assert_eq!("blocks".parse::<Kind>().unwrap(), Kind::default());
        let e = "walrus".parse::<Kind>().unwrap_err().to_string();
        assert!(e.contains("walrus") && e.contains("nlm-linear"), "{e}");
    }

    #[test]
    fn files_batches_and_threads_change_no_bit() {
        kind_checks::files_batches_and_threads_change_no_bit(&Kind::OWN);
    }

    #[test]
    fn rotated_poses_have_rotated_posteriors() {
        // A sparse code weighs each axis of the space by a variance of its own.
        let kinds = [Kind::Multiscale, Kind::Nlm, Kind::NlmLinear];
        kind_checks::rotated_poses_have_rotated_posteriors(&kinds);
    }

    #[test]
    fn a_damaged_array_is_an_error_that_names_it() {
        kind_checks::a_damaged_array_is_an_error_that_names_it(&Kind::OWN);
    }
}

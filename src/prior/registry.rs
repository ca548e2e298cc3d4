//! The kinds of prior: their names, how each is trained, and how each is opened.

use super::exemplar::nlm;
#[cfg(feature = "published")]
use super::published;
use super::training_set::{TrainOptions, TrainingSet};
use super::{OpenOptions, Prior, SparseCodingPrior, multiscale, sparse_coding};
use crate::io::Model;
use crate::sparse::Ksvd;
use crate::{Error, Place, Result};
use std::fmt;
use std::str::FromStr;

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
    /// A model that papers compare with.
    #[cfg(feature = "published")]
    Published(published::Kind),
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

    /// All kinds, the default first.
    pub fn all() -> Vec<Kind> {
        let own = [Kind::Multiscale, Kind::Sparse, Kind::Nlm, Kind::NlmLinear];
        #[cfg(feature = "published")]
        let own = own
            .into_iter()
            .chain(published::Kind::ALL.map(Kind::Published));
        own.into_iter().collect()
    }

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
            Kind::Nlm => (
                "nlm",
                "non-local means: distance-weighted average of all training poses",
            ),
            Kind::NlmLinear => ("nlm-linear", "non-local means with local linear regression"),
            #[cfg(feature = "published")]
            Kind::Published(kind) => kind.text(),
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
    /// let model = Kind::Multiscale.train(&poses, &TrainOptions::default())?;
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
            Kind::Nlm => nlm::KIND.train(poses, options, report),
            Kind::NlmLinear => nlm::LINEAR_KIND.train(poses, options, report),
            #[cfg(feature = "published")]
            Kind::Published(kind) => kind.train(poses, options, report),
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
        let found = Kind::all().into_iter().find(|k| k.name() == name);
        found.ok_or_else(|| {
            Error::usage(format!(
                "the option `kind {name}`: expected one of {}",
                names()
            ))
        })
    }
}

fn names() -> String {
    let names: Vec<&str> = Kind::all().into_iter().map(Kind::name).collect();
    names.join(", ")
}

/// Opens the prior of a model; `source` names the model in messages.
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
    Ok(match kind {
        Kind::Multiscale => Box::new(multiscale::MultiscaleMixture::from_model(model, source)?),
        Kind::Sparse => Box::new(SparseCodingPrior::from_model(model, options, source)?),
        Kind::Nlm => Box::new(nlm::KIND.open(model, options, source)?),
        Kind::NlmLinear => Box::new(nlm::LINEAR_KIND.open(model, options, source)?),
        #[cfg(feature = "published")]
        Kind::Published(kind) => kind.open(model, options, source)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::PoseTransform;
    use crate::pose::rotation::from_rotation_vector;
    use crate::prior::testdata::PriorExt;
    use glam::DVec3;
    use ndarray::{Array2, s};

    #[test]
    fn names_are_read_back() {
        for kind in Kind::all() {
            assert_eq!(kind.to_string().parse::<Kind>().unwrap(), kind);
        }
        assert_eq!("blocks".parse::<Kind>().unwrap(), Kind::default());
        let e = "walrus".parse::<Kind>().unwrap_err().to_string();
        assert!(e.contains("walrus") && e.contains("nlm-linear"), "{e}");
    }

    /// Three points on closed curves, in three takes.
    fn poses() -> TrainingSet {
        TrainingSet {
            points: ["a", "b", "c"].map(String::from).to_vec(),
            xyz: Array2::from_shape_fn((120, 9), |(t, c)| {
                let phase = t as f32 * 0.11;
                20.0 * (phase + c as f32).sin() + 5.0 * (2.3 * phase + (c * c) as f32).cos()
            }),
            takes: vec![0..50, 50..80, 80..120],
            body: None,
            anchor: None,
            up: None,
            incomplete: 0,
            unplaced: 0,
        }
    }

    fn trained(kind: Kind) -> Model {
        kind.train(&poses(), &TrainOptions::default()).unwrap()
    }

    fn opened(model: &Model) -> Box<dyn Prior> {
        open(model, &OpenOptions::default(), "m").unwrap()
    }

    /// Observations with noise and gaps, and one of nothing.
    fn observed() -> (Array2<f64>, Array2<f64>) {
        let mut noise = Array2::from_elem((40, 9), 1.0);
        noise.slice_mut(s![10..20, 3..6]).fill(f64::INFINITY);
        noise.slice_mut(s![25.., 1]).fill(0.1);
        noise.row_mut(39).fill(f64::INFINITY);
        (poses().xyz.slice(s![..40, ..]).mapv(f64::from) + 0.4, noise)
    }

    #[test]
    fn files_batches_and_threads_change_no_bit() {
        let (y, noise) = observed();
        for kind in Kind::all() {
            let pool = |n| {
                rayon::ThreadPoolBuilder::new()
                    .num_threads(n)
                    .build()
                    .unwrap()
            };
            let model = pool(1).install(|| trained(kind));
            let bytes = model.to_bytes().unwrap();
            let again = pool(3).install(|| trained(kind)).to_bytes().unwrap();
            assert!(bytes == again, "{kind}");
            let prior = opened(&model);
            let read = opened(&Model::from_bytes(bytes, "m").unwrap());
            let all = pool(3).install(|| read.full_rows(y.view(), noise.view()));
            for (i, posterior) in all.iter().enumerate() {
                let alone = prior.full(&y.row(i).to_vec(), &noise.row(i).to_vec());
                assert_eq!(*posterior, alone, "{kind}");
                assert!(
                    alone
                        .mean
                        .iter()
                        .chain(&alone.covariance)
                        .all(|v| v.is_finite())
                );
            }
            let none = Array2::zeros((0, 9));
            assert!(prior.full_rows(none.view(), none.view()).is_empty());
        }
    }

    #[test]
    fn rotated_poses_have_rotated_posteriors() {
        let map = PoseTransform::Rotate(from_rotation_vector(DVec3::new(0.4, -1.0, 0.2)));
        let (y, noise) = observed();
        let rotated = map.apply_rows(y.view());
        for kind in Kind::all() {
            // These weigh each axis of the space by a variance of its own.
            if matches!(kind, Kind::Published(published::Kind::Gplvm) | Kind::Sparse) {
                continue;
            }
            let prior = opened(&trained(kind));
            let mapped = prior.mapped(&map);
            // Whole points are missing, and those seen have equal noise.
            for i in [5, 15] {
                let (here, there) = (y.row(i).to_vec(), rotated.row(i).to_vec());
                let noise = noise.row(i).to_vec();
                let (here, there) = (prior.full(&here, &noise), mapped.full(&there, &noise));
                let mut mean = vec![0.0; 9];
                map.apply(&here.mean, &mut mean);
                let near = |a: f64, b: f64| (a - b).abs() <= 1e-2;
                assert!(
                    mean.iter().zip(&there.mean).all(|(a, b)| near(*a, *b)),
                    "{kind}"
                );
                let covariance = map.apply_covariance(here.covariance.view());
                let mut both = covariance.iter().zip(&there.covariance);
                assert!(both.all(|(a, b)| near(*a, *b)), "{kind}");
            }
        }
    }

    #[test]
    fn a_damaged_array_is_an_error_that_names_it() {
        for kind in Kind::all() {
            let model = trained(kind);
            for (name, _) in model
                .arrays()
                .filter(|(name, _)| !name.starts_with("rigid"))
            {
                let mut broken = model.clone();
                let mut array = model.get(name).unwrap().into_owned();
                array[[0, 0]] = f32::NAN;
                broken.insert(name, array);
                let Err(e) = open(&broken, &OpenOptions::default(), "m") else {
                    panic!("{kind}: {name}")
                };
                assert!(e.to_string().starts_with(&format!("m: {name}")), "{e}");
            }
        }
    }
}

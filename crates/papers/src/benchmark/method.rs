//! The methods that are compared: where a model comes from and how it restores poses.

use super::dataset::Dataset;
use super::leakage::Provenance;
use super::splits::Split;
use super::task::{DamagedPoses, SPARSE_MEAN_VARIANCE, Task};
use crate::numeric::parallel;
use crate::prior::{
    self, HoldBack, Kind, OpenOptions, Posterior, Prior, TrainOptions, TrainingSet, Want,
};
use crate::prior::{posterior_rows, sparse_coding};
use crate::restore::{OutlierMode, RigidModel};
use crate::sparse::{Ksvd, SelectionRule};
use crate::{Error, Place, Result};
use ndarray::{Array2, s};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Instant;

/// The suffix of a method's name that turns on outlier detection and rigid distances.
pub(crate) const TREATED: &str = "+treated";
/// Largest default number of atoms of a K-SVD dictionary. Fewer training poses have a quarter of
/// their number.
const MAX_ATOMS: usize = 1000;
/// Poses restored at a time; fixed, so that the number of threads changes nothing.
const BATCH: usize = 100;

/// A trained model read from a file.
#[derive(Clone)]
pub struct PretrainedModel {
    /// The file's name, for messages.
    pub source: String,
    /// The SHA-256 of the file, part of the keys of cached results.
    pub digest: String,
    /// The opened model.
    pub prior: Arc<dyn Prior>,
    /// The names of the model's points.
    pub points: Vec<String>,
    /// The tuning record in the model's details.
    pub tuning: Option<Value>,
    /// What the file contains of its training poses.
    pub provenance: Provenance,
}

/// Where a model comes from.
#[derive(Clone)]
pub enum ModelSource {
    /// Trained on the training part: a kind of `prior-train`, or `sparse`, a K-SVD dictionary of
    /// this many atoms.
    Kind {
        /// The kind.
        kind: Kind,
        /// The number of atoms of a `sparse` model; `None` for the default.
        atoms: Option<usize>,
    },
    /// Read from a file.
    Pretrained(PretrainedModel),
}

/// A method: one row of the tables.
#[derive(Clone)]
pub struct Method {
    /// The name, as typed after `--models`.
    pub name: String,
    /// Where the model comes from.
    pub source: ModelSource,
    /// How a sparse model is used.
    pub choice: OpenOptions,
    /// Whether outliers are detected and rigid distances kept.
    pub treated: bool,
}

impl Method {
    /// The names of the default methods: every known kind of model, and Lai et al.'s methods.
    pub fn default_names() -> Vec<String> {
        let mut names: Vec<String> = Kind::all().iter().map(Kind::to_string).collect();
        names.retain(|n| n != "sparse");
        // Only the default model also runs with outlier detection; the others run as published.
        names.extend(["multiscale+treated", "sparse", "ksvd", "ksvd-omp"].map(String::from));
        names
    }

    /// Parses a name: `KIND`, `sparse`, `ksvd` (as published, with optimized OMP) or `ksvd-omp` (as
    /// published). The last three may have `:n=ATOMS` and `:k=SPARSITY`; any name may end in
    /// `+treated`.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown name.
    pub fn parse(name: &str) -> Result<Method> {
        let treated = name.ends_with(TREATED);
        let mut parts = name.strip_suffix(TREATED).unwrap_or(name).split(':');
        let kind = parts.next().unwrap_or_default();
        let mut choice = OpenOptions::default();
        match kind {
            "ksvd" => choice.published = true,
            "ksvd-omp" => (choice.published, choice.rule) = (true, SelectionRule::Omp),
            _ => {}
        }
        let is_sparse = ["sparse", "ksvd", "ksvd-omp"].contains(&kind);
        let kind = if is_sparse { "sparse" } else { kind };
        let kind: Kind = kind.parse().map_err(|_| {
            let known = Method::default_names().join(", ");
            Error::usage(format!(
                "the option `models {name}`: expected one of {known} (or a file after -m)"
            ))
        })?;
        let mut atoms = None;
        for part in parts {
            let number = |text: &str| {
                text.parse::<usize>()
                    .ok()
                    .filter(|n| (1..=1_000_000).contains(n))
            };
            match part
                .split_once('=')
                .map(|(key, value)| (key, number(value)))
            {
                Some(("n", Some(n))) if is_sparse => atoms = Some(n),
                Some(("k", Some(k))) if is_sparse && k <= 1000 => choice.sparsity = Some(k),
                _ => {
                    return Err(Error::usage(format!(
                        "the option `models {name}`: \"{part}\" is neither n=ATOMS nor k=SPARSITY \
                         (1 to 1000) of a sparse model"
                    )));
                }
            }
        }
        Ok(Method {
            name: name.into(),
            source: ModelSource::Kind { kind, atoms },
            choice,
            treated,
        })
    }

    /// Identifies how the model is made; methods with equal recipes share one model.
    pub(crate) fn recipe(&self) -> String {
        match &self.source {
            ModelSource::Kind { kind, atoms } => format!("{kind} {atoms:?}"),
            ModelSource::Pretrained(pretrained) => format!("file {}", pretrained.digest),
        }
    }

    /// Checks that a pretrained model has the dataset's points and was not trained from any of its
    /// takes.
    ///
    /// # Errors
    /// [`Error::Data`] that names the model and the take.
    pub(crate) fn check_provenance(&self, dataset: &Dataset) -> Result<()> {
        let ModelSource::Pretrained(pretrained) = &self.source else {
            return Ok(());
        };
        let fail = |what: String| Err(Error::data(Place::file(&pretrained.source), what));
        if pretrained.points != dataset.points {
            return fail("is a model whose points differ from the tables'".into());
        }
        let known = pretrained.provenance.takes(dataset);
        if let Some(first) = known.first() {
            let more = match known.len() - 1 {
                0 => String::new(),
                n => format!(" and {n} more of these takes"),
            };
            return fail(format!(
                "was trained on take {}{more}; a model cannot be tested on its training data; \
                 leave these takes out",
                dataset.takes[*first].name
            ));
        }
        Ok(())
    }
}

/// A model for a split and seed, opened once for each method that shares it.
pub(crate) struct TrainedModel {
    /// The opened model of each method, in the methods' order.
    pub priors: Vec<Arc<dyn Prior>>,
    /// Seconds that training took; `None` for a pretrained model.
    pub seconds: Option<f64>,
    /// The tuning record. A tuned model assumes a noise of its own where the variance is unknown;
    /// any other must be given one.
    tuning: Option<Value>,
}

impl TrainedModel {
    /// Trains the model of some methods with equal recipes, or takes the pretrained one.
    ///
    /// # Errors
    /// As [`Kind::train`] and [`prior::open`].
    pub fn train(
        methods: &[&Method],
        poses: &TrainingSet,
        split: Split,
        seed: u64,
    ) -> Result<TrainedModel> {
        let began = Instant::now();
        let model = match &methods[0].source {
            ModelSource::Pretrained(pretrained) => {
                return Ok(TrainedModel {
                    priors: vec![pretrained.prior.clone(); methods.len()],
                    seconds: None,
                    tuning: pretrained.tuning.clone(),
                });
            }
            ModelSource::Kind {
                kind: Kind::Sparse,
                atoms,
            } => {
                let atoms = atoms.unwrap_or(MAX_ATOMS.min(poses.xyz.nrows().div_ceil(4)));
                let ksvd = Ksvd {
                    atoms,
                    seed,
                    ..Ksvd::default()
                };
                sparse_coding::train(poses, &ksvd, &mut |_| Ok(()))?
            }
            ModelSource::Kind { kind, .. } => {
                // Poses for tuning are held back as the test poses are.
                let hold_back = match split {
                    Split::Frames => HoldBack::Frames,
                    Split::Takes | Split::Subjects => HoldBack::Takes,
                };
                kind.train(poses, &TrainOptions { seed, hold_back })?
            }
        };
        let seconds = Some(began.elapsed().as_secs_f64());
        let open = |m: &&Method| prior::open(&model, &m.choice, &m.name).map(Arc::from);
        Ok(TrainedModel {
            priors: methods.iter().map(open).collect::<Result<_>>()?,
            seconds,
            tuning: model.meta.details.get("tuning").cloned(),
        })
    }

    /// Restores with the opened model of a method; `rigid` are the rigid distances of a treated
    /// method.
    pub(crate) fn restorer<'r>(
        &self,
        prior: &'r dyn Prior,
        rigid: Option<&'r RigidModel>,
    ) -> Restorer<'r> {
        Restorer {
            prior,
            rigid,
            needs_variance: rigid.is_none() && self.tuning.is_none(),
        }
    }

    /// The tuning of one task: the chosen setting and the curve.
    pub(crate) fn tuning_of(&self, task: Task) -> Option<Value> {
        let all = self.tuning.as_ref()?;
        let curve = all.get("curve").and_then(Value::as_array);
        let own = |tried: &&Value| tried.get("task").and_then(Value::as_str) == Some(task.name());
        let curve: Vec<Value> = curve.into_iter().flatten().filter(own).cloned().collect();
        let chosen = all.get("chosen").and_then(|c| c.get(task.name()));
        Some(json!({"chosen": chosen, "curve": curve}))
    }
}

/// A trained model in the form that one method uses.
pub struct Restorer<'r> {
    prior: &'r dyn Prior,
    rigid: Option<&'r RigidModel>,
    /// Whether the model needs a noise variance under sparse noise, because it was not tuned to
    /// one.
    needs_variance: bool,
}

impl Restorer<'_> {
    /// The posteriors of damaged poses, and the seconds that restoring took on one thread.
    pub(crate) fn restore(&self, task: Task, damaged: &DamagedPoses) -> (Vec<Posterior>, f64) {
        let extra = match task {
            Task::Sparse if self.needs_variance => SPARSE_MEAN_VARIANCE,
            _ => 0.0,
        };
        let parts = parallel::map_chunks(damaged.y.nrows(), BATCH, |range| {
            let part = |a: &Array2<f64>| a.slice(s![range.clone(), ..]).to_owned();
            // The value of a missing coordinate is never read; zero keeps NaN out of sums.
            let y = part(&damaged.y).mapv(|v| if v.is_nan() { 0.0 } else { v });
            let variance = part(&damaged.variance) + extra;
            let began = Instant::now();
            let posteriors = parallel::single_threaded(|| match self.rigid {
                Some(rigid) => {
                    // All poses of a task have the same variances.
                    let mode = OutlierMode::for_noise(&variance.row(0).to_vec());
                    let restored = rigid.restore(self.prior, y.view(), variance.view(), mode);
                    restored.into_iter().map(|r| r.posterior).collect()
                }
                None => posterior_rows(self.prior, y.view(), variance.view(), Want::Variances),
            });
            (posteriors, began.elapsed().as_secs_f64())
        });
        let seconds = parts.iter().map(|p| p.1).sum();
        (parts.into_iter().flat_map(|p| p.0).collect(), seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::*;

    #[test]
    fn names_are_parsed() {
        let name = |n: &str| Method::parse(n).unwrap();
        assert!(!name("sparse").choice.published);
        assert!(name("ksvd").choice.published && name("ksvd").choice.rule == SelectionRule::Oomp);
        assert!(name("ksvd-omp+treated").treated);
        assert_eq!(name("ksvd-omp").choice.rule, SelectionRule::Omp);
        let m = name("ksvd:n=500:k=7");
        assert_eq!(
            (m.choice.sparsity, m.recipe()),
            (Some(7), "sparse Some(500)".into())
        );
        assert_eq!(name("ksvd").recipe(), name("sparse").recipe());
        for bad in [
            "",
            "magic",
            "sparse:n=0",
            "sparse:x=1",
            "sparse:n",
            "ksvd:k=2000",
            "magic:n=5",
        ] {
            let e = Method::parse(bad)
                .err()
                .map(|e| e.to_string())
                .unwrap_or_default();
            assert!(e.contains("the option `models "), "{bad}: {e}");
        }
    }

    #[test]
    fn methods_with_equal_recipes_share_a_model() {
        let data = takes(&[("01_01", 60), ("01_02", 60)]);
        let rows: Vec<usize> = (0..120).collect();
        let poses = data.training(&rows).unwrap();
        let [sparse, ksvd] = ["sparse:n=20", "ksvd:n=20"].map(|n| Method::parse(n).unwrap());
        let model = TrainedModel::train(&[&sparse, &ksvd], &poses, Split::Takes, 1).unwrap();
        assert!(model.priors.len() == 2 && model.seconds.is_some());
        let restorer = model.restorer(&*model.priors[0], None);
        let mut damaged = DamagedPoses::undamaged(&data, &rows);
        damaged.variance.fill(1.0);
        let (answers, _) = restorer.restore(Task::Dense, &damaged);
        assert_eq!(answers.len(), 120);
        // A batch gives the same posteriors as single poses.
        let one = crate::pose::Observation {
            values: &damaged.y.row(101).to_vec(),
            variance: &[1.0; 69],
        };
        assert_eq!(
            answers[101],
            restorer.prior.posterior(&one, Want::Variances)
        );
    }
}

//! What is compared: a model, how it comes about, and how it is asked.

use super::dataset::Dataset;
use super::leakage::Provenance;
use super::splits::Split;
use super::task::{DamagedPoses, Task};
use crate::numeric::parallel;
use crate::prior::registry::{KINDS, Training, train};
use crate::prior::tuning::HoldBack;
use crate::prior::{self, OpenOptions, Posterior, Prior, Want, posterior_rows};
use crate::prior::{sparse_coding, training_set::TrainingSet};
use crate::restore::{OutlierMode, RigidModel};
use crate::sparse::{Ksvd, SelectionRule};
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, s};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Instant;

/// The ending of a method's name that asks for outliers to be found and rigid distances to be kept.
pub const TREATED: &str = "+treated";
/// K-SVD here: at most so many atoms, and no more than a quarter of the poses, so that few poses are learnt from too.
const ATOMS: usize = 1000;
/// Poses are restored so many at a time: fixed, so that the threads change nothing.
const BATCH: usize = 100;

/// A model that somebody has trained.
#[derive(Clone)]
pub struct PretrainedModel {
    /// The file's name, for messages.
    pub source: String,
    /// The SHA-256 of the file: tells its cells from those of any other.
    pub digest: String,
    /// It.
    pub prior: Arc<dyn Prior>,
    /// Its points.
    pub points: Vec<String>,
    /// What its details say of its tuning.
    pub tuning: Option<Value>,
    /// What is known of its training.
    pub past: Provenance,
}

/// How a model comes about.
#[derive(Clone)]
pub enum ModelSource {
    /// Trained on the training part: a kind of `prior-train`, or `sparse`, a K-SVD dictionary of this many atoms.
    Kind {
        /// The kind's name.
        kind: String,
        /// For `sparse`: how many atoms; `None` for as many as is usual here.
        atoms: Option<usize>,
    },
    /// PretrainedModel.
    Pretrained(PretrainedModel),
}

/// A row of the tables.
#[derive(Clone)]
pub struct Method {
    /// Its name.
    pub name: String,
    /// Where its model comes from.
    pub source: ModelSource,
    /// How a sparse model is used.
    pub choice: OpenOptions,
    /// Whether outliers are found and rigid distances kept.
    pub treated: bool,
}

impl Method {
    /// The methods that are run where none are named: every kind there is, and the paper's.
    pub fn usual() -> Vec<String> {
        let mut names: Vec<String> = KINDS.iter().map(|(name, _)| name.to_string()).collect();
        names.retain(|n| n != "sparse");
        // The default model answers treated; the others stand without what this project adds.
        names.extend(["multiscale+treated", "sparse", "ksvd", "ksvd-omp"].map(String::from));
        names
    }

    /// A method of a name: `KIND`, or `sparse`, `ksvd` (as published, with optimised OMP) or `ksvd-omp` (as published),
    /// these three with `:n=ATOMS` and `:k=SPARSITY` where wanted; any with `+treated`.
    ///
    /// # Errors
    /// [`Error::Usage`] for a name that is none.
    pub fn parse(name: &str) -> Result<Method> {
        // The default model's kind was called `blocks` before.
        let former = name.strip_prefix("blocks");
        let name = &match former.filter(|rest| rest.is_empty() || *rest == TREATED) {
            Some(rest) => format!("multiscale{rest}"),
            None => name.to_string(),
        };
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
        if !is_sparse && !KINDS.iter().any(|(k, _)| *k == kind) {
            let known = Method::usual().join(", ");
            return Err(Error::usage(format!(
                "--models {name}: expected one of {known} (or a file after -m)"
            )));
        }
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
                        "--models {name}: \"{part}\" is neither n=ATOMS nor k=SPARSITY (1 to 1000) of a sparse model"
                    )));
                }
            }
        }
        Ok(Method {
            name: name.into(),
            source: ModelSource::Kind {
                kind: if is_sparse { "sparse" } else { kind }.into(),
                atoms,
            },
            choice,
            treated,
        })
    }

    /// Tells the model's making apart: methods with the same one share it.
    pub fn recipe(&self) -> String {
        match &self.source {
            ModelSource::Kind { kind, atoms } => format!("{kind} {atoms:?}"),
            ModelSource::Pretrained(given) => format!("file {}", given.digest),
        }
    }

    /// Makes sure that a given model is of the data's points and was not trained from any of its takes.
    ///
    /// # Errors
    /// A line that names the model and the take.
    pub fn admit(&self, data: &Dataset) -> Result<()> {
        let ModelSource::Pretrained(given) = &self.source else {
            return Ok(());
        };
        let fail = |what: String| Err(Error::data(Place::file(&given.source), what));
        if given.points != data.points {
            return fail("is a model of other points than the tables'".into());
        }
        let known = given.past.takes(data);
        if let Some(first) = known.first() {
            let more = match known.len() - 1 {
                0 => String::new(),
                n => format!(" and {n} more of these takes"),
            };
            return fail(format!(
                "was trained from take {}{more}: it cannot be tested on what it was trained from; leave them out",
                data.takes[*first].name
            ));
        }
        Ok(())
    }
}

/// A model ready to be asked, in each way that is wanted.
pub struct TrainedModel {
    /// One a method, in the order they were given.
    pub priors: Vec<Arc<dyn Prior>>,
    /// Seconds that training took; `None` for a given model.
    pub seconds: Option<f64>,
    /// What the model's details say of its tuning. A tuned model reckons with a noise of its own where none is told; any
    /// other must be told one.
    pub tuning: Option<Value>,
}

impl TrainedModel {
    /// The part of the tuning that is a task's: what was chosen, and the curve.
    pub fn tuning_of(&self, task: Task) -> Option<Value> {
        let all = self.tuning.as_ref()?;
        let curve = all.get("curve").and_then(Value::as_array);
        let own = |tried: &&Value| tried.get("task").and_then(Value::as_str) == Some(task.name());
        let curve: Vec<Value> = curve.into_iter().flatten().filter(own).cloned().collect();
        let chosen = all.get("chosen").and_then(|c| c.get(task.name()));
        Some(json!({"chosen": chosen, "curve": curve}))
    }
}

/// Makes the model that some methods share (their recipe is the same).
///
/// # Errors
/// As training and opening.
pub fn make(
    methods: &[&Method],
    poses: &TrainingSet,
    split: Split,
    seed: u64,
) -> Result<TrainedModel> {
    let began = Instant::now();
    let (kind, atoms) = match methods.first().map(|m| &m.source) {
        Some(ModelSource::Kind { kind, atoms }) => (kind, *atoms),
        Some(ModelSource::Pretrained(given)) => {
            return Ok(TrainedModel {
                priors: methods.iter().map(|_| given.prior.clone()).collect(),
                seconds: None,
                tuning: given.tuning.clone(),
            });
        }
        None => {
            return Ok(TrainedModel {
                priors: Vec::new(),
                seconds: None,
                tuning: None,
            });
        }
    };
    let model = if kind == "sparse" {
        let atoms = atoms.unwrap_or(ATOMS.min(poses.xyz.nrows().div_ceil(4)));
        let ksvd = Ksvd {
            atoms,
            seed,
            ..Ksvd::default()
        };
        sparse_coding::train(poses, &ksvd, false, &mut |_| Ok(()))?
    } else {
        let training = Training {
            poses,
            world: false,
            seed,
            // What is held back to tune on is parted from the rest as the test poses are.
            hold_back: match split {
                Split::Frames => HoldBack::Frames,
                Split::Takes | Split::Subjects => HoldBack::Takes,
            },
        };
        train(kind, &training, &mut |_| {})?
    };
    let seconds = Some(began.elapsed().as_secs_f64());
    let open = |m: &&Method| prior::open(&model, &m.choice, &m.name).map(Arc::from);
    let priors = methods.iter().map(open).collect::<Result<_>>()?;
    let tuning = model.meta.details.get("tuning").cloned();
    Ok(TrainedModel {
        priors,
        seconds,
        tuning,
    })
}

/// What a method has besides its prior to find outliers and keep rigid distances.
pub struct Treatment(RigidModel);

impl Treatment {
    /// Learns what the treatment needs from the training poses.
    pub fn learn(poses: &TrainingSet) -> Treatment {
        Treatment(RigidModel::learn(poses.xyz.view(), &poses.takes))
    }

    /// Restores poses: told is what a plain method would be told, and the same of all of them.
    fn answer(
        &self,
        prior: &dyn Prior,
        y: ArrayView2<'_, f64>,
        variance: ArrayView2<'_, f64>,
    ) -> Vec<Posterior> {
        let seek = variance
            .rows()
            .into_iter()
            .next()
            .map(|r| OutlierMode::for_noise(&r.to_vec()));
        let answers = self
            .0
            .restore(prior, y, variance, seek.unwrap_or(OutlierMode::Ignore));
        answers.into_iter().map(|a| a.posterior).collect()
    }
}

/// Restores damaged poses; the answers, and the seconds they took on one thread.
pub fn restore(
    prior: &dyn Prior,
    treatment: Option<&Treatment>,
    damaged: &DamagedPoses,
) -> (Vec<Posterior>, f64) {
    let parts = parallel::map_chunks(damaged.y.nrows(), BATCH, |range| {
        let part = |a: &Array2<f64>| a.slice(s![range.clone(), ..]).to_owned();
        // A number that is missing is read nowhere, but nothing should hang on that.
        let y = part(&damaged.y).mapv(|v| if v.is_nan() { 0.0 } else { v });
        let variance = part(&damaged.variance);
        let began = Instant::now();
        let answers = parallel::single_threaded(|| match treatment {
            Some(treatment) => treatment.answer(prior, y.view(), variance.view()),
            None => posterior_rows(prior, y.view(), variance.view(), Want::Variances),
        });
        (answers, began.elapsed().as_secs_f64())
    });
    let seconds = parts.iter().map(|p| p.1).sum();
    (parts.into_iter().flat_map(|p| p.0).collect(), seconds)
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::*;

    #[test]
    fn names_are_read() {
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
            assert!(e.contains("--models"), "{bad}: {e}");
        }
    }

    #[test]
    fn methods_of_one_recipe_share_their_model() {
        let data = takes(&[("01_01", 60), ("01_02", 60)]);
        let rows: Vec<usize> = (0..120).collect();
        let poses = data.training(&rows).unwrap();
        let methods = ["sparse:n=20", "ksvd:n=20"].map(|n| Method::parse(n).unwrap());
        let all: Vec<&Method> = methods.iter().collect();
        let ready = make(&all, &poses, Split::Takes, 1).unwrap();
        assert!(ready.priors.len() == 2 && ready.seconds.is_some());
        let damaged = DamagedPoses {
            y: data.rows(&rows),
            variance: Array2::from_elem((120, 69), 1.0),
        };
        let (answers, _) = restore(&*ready.priors[0], None, &damaged);
        assert_eq!(answers.len(), 120);
        // Many at once answer as one by one.
        let one = crate::pose::Observation {
            values: &damaged.y.row(101).to_vec(),
            variance: &[1.0; 69],
        };
        let one = ready.priors[0].posterior(&one, Want::Variances);
        assert_eq!(answers[101], one);
    }
}

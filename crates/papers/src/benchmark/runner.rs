//! Runs all cases in parallel. Results of an earlier run that are handed in are used again.

use super::dataset::Dataset;
use super::examples::{ExampleKind, ExamplePoses};
use super::leakage::{DuplicateTake, find_duplicates};
use super::method::{Method, ModelSource, Restorer, TrainedModel};
use super::result::{BenchmarkResult, Case, Measurement, measure, varying_coordinates};
use super::settings::Settings;
use super::splits::{Partition, Split};
use super::task::{PoseDamage, Task};
use crate::pose::ASF_UNIT_CM;
use crate::prior::{provenance::hex, training_set::TrainingSet};
use crate::restore::RigidModel;
use crate::{Error, Place, Result};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// What happens during a run.
#[derive(Debug)]
pub enum Event<'a> {
    /// Training of a model begins.
    Training {
        /// The method's name.
        model: &'a str,
        /// The split.
        split: Split,
        /// The seed.
        seed: u64,
    },
    /// A case is finished.
    Result {
        /// The key of case, dataset and settings, to be stored with the result.
        key: &'a str,
        /// The result.
        result: &'a BenchmarkResult,
    },
}

/// Called for each event of a run; an error ends the run.
pub(crate) type Observer<'a> = dyn FnMut(&Event<'_>) -> Result<()> + Send + 'a;

/// Results by the keys of their cases.
pub type Results = BTreeMap<String, BenchmarkResult>;

/// A dataset with settings that can be run on it.
pub struct Benchmark<'a> {
    /// The poses.
    pub dataset: &'a Dataset,
    /// The settings, with the splits that are run.
    pub settings: Settings,
    /// Takes that share poses; they stay on one side of a split.
    pub duplicates: Vec<DuplicateTake>,
    /// Splits that the dataset does not allow, each with the reason.
    pub skipped_splits: Vec<String>,
    /// The poses that the report draws, if examples are asked for.
    pub example_poses: Option<ExamplePoses>,
    dataset_digest: String,
}

impl<'a> Benchmark<'a> {
    /// Checks that the settings can be run on the dataset and that no pretrained model was trained
    /// from its takes. Settings without splits are given all splits that the dataset allows.
    ///
    /// # Errors
    /// [`Error::Usage`] as [`Settings::check`], if the dataset is too small for a split, or if a
    /// point that completion observes does not exist; [`Error::Data`] if a pretrained model has
    /// other points or was trained from a take of the dataset.
    pub fn new(dataset: &'a Dataset, mut settings: Settings) -> Result<Benchmark<'a>> {
        settings.check()?;
        let duplicates = find_duplicates(dataset);
        let mut skipped_splits = Vec::new();
        if settings.splits.is_empty() {
            for split in Split::ALL {
                match split.impossible(dataset, &duplicates) {
                    Some(why) => skipped_splits.push(format!("the split {} {why}", split.name())),
                    None => settings.splits.push(split),
                }
            }
        }
        if settings.splits.is_empty() {
            let why = skipped_splits.join("; ");
            return Err(Error::usage(format!("nothing to run: {why}")));
        }
        for method in &settings.methods {
            method.check_provenance(dataset)?;
        }
        let mut observe = settings.observe.iter();
        let unknown = observe.find(|n| !dataset.points.contains(n));
        if let (Some(name), true) = (unknown, settings.tasks.contains(&Task::Complete)) {
            let what = format!("the option `observe`: the takes have no point \"{name}\"");
            return Err(Error::usage(what));
        }
        let example_split = ExamplePoses::split(&settings.splits).filter(|_| settings.examples);
        let mut example_poses = None;
        for &split in &settings.splits {
            let first = Partition::draw(dataset, &duplicates, split, settings.first_seed)?;
            if example_split == Some(split) {
                example_poses = Some(ExamplePoses::choose(dataset, &first));
            }
        }
        Ok(Benchmark {
            dataset,
            dataset_digest: dataset.digest(),
            settings,
            duplicates,
            skipped_splits,
            example_poses,
        })
    }

    /// All cases, in the order of the tables.
    pub fn cases(&self) -> Vec<Case> {
        let mut all = Vec::new();
        for &split in &self.settings.splits {
            for &base in &self.settings.base {
                for task in self.settings.tasks_at(base) {
                    for method in &self.settings.methods {
                        let seeds = self.settings.seeds();
                        all.extend(seeds.map(|s| Case::new(&method.name, split, s, task, base)));
                    }
                }
            }
        }
        all
    }

    /// Those of the cases that have no result.
    pub fn missing(&self, cases: &[Case], results: &Results) -> Vec<Case> {
        let missing = cases.iter().filter(|c| !self.is_cached(results, c));
        missing.cloned().collect()
    }

    /// Runs all cases without a cached result. Returns the results of all, in the order of
    /// [`Benchmark::cases`].
    ///
    /// # Errors
    /// Errors of [`Benchmark::run_cases`].
    pub fn run(&self, cache: Results, observer: &mut Observer<'_>) -> Result<Vec<BenchmarkResult>> {
        let results = self.run_cases(&self.cases(), cache, observer)?;
        self.in_order(results)
    }

    /// The results of all cases, in the order of [`Benchmark::cases`].
    ///
    /// # Errors
    /// [`Error::Usage`] if a case has no result.
    pub fn in_order(&self, mut results: Results) -> Result<Vec<BenchmarkResult>> {
        let take = |case: Case| {
            let result = results.remove(&self.key(&case));
            result.ok_or_else(|| Error::usage(format!("no result of {}", case.describe())))
        };
        self.cases().into_iter().map(take).collect()
    }

    /// Runs some cases, those without a cached result. Returns the cache with their results.
    ///
    /// Each model is trained once for all tasks, models in parallel, splits and seeds one after
    /// another. The numbers do not depend on the number of threads; run times do.
    ///
    /// # Errors
    /// As training and the observer; [`Error::Data`] if a method returns a number that is not
    /// finite.
    pub fn run_cases(
        &self,
        cases: &[Case],
        cache: Results,
        observer: &mut Observer<'_>,
    ) -> Result<Results> {
        let mut results = cache;
        let observer = Mutex::new(observer);
        for &split in &self.settings.splits {
            for seed in self.settings.seeds() {
                let pending = self.pending(cases, &results, split, seed);
                if pending.is_empty() {
                    continue;
                }
                let partition = Partition::draw(self.dataset, &self.duplicates, split, seed)?;
                let training = self.dataset.training(&partition.train)?;
                let part = TrainingPart {
                    benchmark: self,
                    varying: varying_coordinates(training.xyz.view()),
                    training,
                    partition,
                    observer: &observer,
                };
                let jobs = pending.par_iter().map(|jobs| part.train_and_measure(jobs));
                let done: Vec<Result<Results>> = jobs.collect();
                for finished in done {
                    results.extend(finished?);
                }
            }
        }
        Ok(results)
    }

    /// Those of the cases of a split and seed that have no result, by method, and the methods by
    /// the model they share.
    fn pending(
        &self,
        cases: &[Case],
        results: &Results,
        split: Split,
        seed: u64,
    ) -> Vec<Vec<Job<'_>>> {
        let mut cases = self.missing(cases, results);
        cases.retain(|c| c.split == split && c.seed == seed);
        let mut jobs: Vec<(String, Vec<Job<'_>>)> = Vec::new();
        for method in &self.settings.methods {
            let own = cases.iter().filter(|c| c.model == method.name);
            let own: Vec<Case> = own.cloned().collect();
            if own.is_empty() {
                continue;
            }
            let recipe = method.recipe();
            match jobs.iter_mut().find(|(r, _)| *r == recipe) {
                Some((_, methods)) => methods.push((method, own)),
                None => jobs.push((recipe, vec![(method, own)])),
            }
        }
        jobs.into_iter().map(|(_, methods)| methods).collect()
    }

    /// The method of a case.
    pub(super) fn method_of(&self, case: &Case) -> Option<&Method> {
        let mut methods = self.settings.methods.iter();
        methods.find(|m| m.name == case.model)
    }

    /// Whether a case has a result. One whose content does not fit its key does not count: files
    /// can be changed.
    fn is_cached(&self, results: &Results, case: &Case) -> bool {
        let result = results.get(&self.key(case));
        result.is_some_and(|r| {
            let lacks_examples = self.has_examples(case) && r.examples.is_none();
            r.case == *case && r.is_sound(self.dataset.points.len()) && !lacks_examples
        })
    }

    /// Whether the examples of a case are drawn.
    fn has_examples(&self, case: &Case) -> bool {
        let poses = self.example_poses.as_ref();
        poses.is_some_and(|p| p.split == case.split && p.seed == case.seed)
            && self.base_of(case) == self.settings.base[0]
    }

    /// The base noise of a case, cm.
    fn base_of(&self, case: &Case) -> f64 {
        let mut base = self.settings.base.iter().copied();
        let own = base.find(|b| b / ASF_UNIT_CM == case.base_asf);
        own.unwrap_or(0.0)
    }

    /// Whether a result is of this dataset and these settings. Its split and seed may be others.
    pub(crate) fn is_own(&self, key: &str, result: &BenchmarkResult) -> bool {
        key == self.key(&result.case)
    }

    /// The key of a case with this dataset and these settings.
    fn key(&self, case: &Case) -> String {
        let recipe = self
            .method_of(case)
            .map(|m| format!("{} {:?} {}", m.recipe(), m.choice, m.treated));
        let content = (
            env!("CARGO_PKG_VERSION"),
            &self.dataset_digest,
            case,
            recipe,
            self.settings.frames,
            &self.settings.observe,
        );
        hex(&Sha256::digest(format!("{content:?}").as_bytes()))
    }
}

/// A method and its pending cases.
type Job<'a> = (&'a Method, Vec<Case>);

/// The training part of a split, shared by all models.
struct TrainingPart<'a, 'o, 'f> {
    benchmark: &'a Benchmark<'a>,
    partition: Partition,
    training: TrainingSet,
    /// Coordinates that differ between training poses.
    varying: Vec<bool>,
    observer: &'a Mutex<&'o mut Observer<'f>>,
}

impl TrainingPart<'_, '_, '_> {
    /// Trains the model that some methods share and runs their cases.
    fn train_and_measure(&self, jobs: &[Job<'_>]) -> Result<Results> {
        let mut results = Results::new();
        let Some((first, _)) = jobs.first() else {
            return Ok(results);
        };
        let (split, seed) = (self.partition.split, self.partition.seed);
        if !matches!(first.source, ModelSource::Pretrained(_)) {
            let model = &first.name;
            self.notify(&Event::Training { model, split, seed })?;
        }
        let methods: Vec<&Method> = jobs.iter().map(|(method, _)| *method).collect();
        let model = TrainedModel::train(&methods, &self.training, split, seed)?;
        let treated = jobs.iter().any(|(method, _)| method.treated);
        let rigid =
            treated.then(|| RigidModel::learn(self.training.xyz.view(), &self.training.takes));
        for ((method, cases), prior) in jobs.iter().zip(&model.priors) {
            let restorer = model.restorer(&**prior, rigid.as_ref().filter(|_| method.treated));
            for case in cases {
                let result = self.run_case(&model, &restorer, case)?;
                let key = self.benchmark.key(case);
                self.notify(&Event::Result {
                    key: &key,
                    result: &result,
                })?;
                results.insert(key, result);
            }
        }
        Ok(results)
    }

    fn run_case(
        &self,
        model: &TrainedModel,
        restorer: &Restorer<'_>,
        case: &Case,
    ) -> Result<BenchmarkResult> {
        let test_rows = self.partition.some_test(self.benchmark.settings.frames);
        let (test, seconds) = self.measure(restorer, &test_rows, case)?;
        let mut training = None;
        if model.seconds.is_some() {
            let rows = self.partition.some_train(test_rows.len());
            // Only the mean is used: one unit a frame would fill the file.
            training = Some(Measurement {
                units: Vec::new(),
                ..self.measure(restorer, &rows, case)?.0
            });
        }
        let poses = self.benchmark.example_poses.as_ref();
        let poses = poses.filter(|_| self.benchmark.has_examples(case));
        let examples = poses.map(|poses| self.examples(poses, restorer, case.task));
        Ok(BenchmarkResult {
            case: case.clone(),
            training_frames: model.seconds.map(|_| self.training.xyz.nrows()),
            tuning: model.tuning_of(case.task),
            examples: examples.transpose()?,
            seconds_per_pose: seconds / test.frames.max(1) as f64,
            test,
            training,
            seconds_training: model.seconds,
        })
    }

    /// Damages poses, restores them and compares them with the truth. Returns also the seconds of
    /// restoring.
    fn measure(
        &self,
        restorer: &Restorer<'_>,
        rows: &[usize],
        case: &Case,
    ) -> Result<(Measurement, f64)> {
        let (dataset, settings) = (self.benchmark.dataset, &self.benchmark.settings);
        let (split, task) = (case.split, case.task);
        let damage = PoseDamage {
            task,
            observe: &settings.observe,
            base: self.benchmark.base_of(case),
            seed: case.seed,
            split,
        };
        let damaged = damage.apply(dataset, rows)?;
        let (estimates, seconds) = restorer.restore(task, &damaged);
        match measure(dataset, (split, task), &damaged, &estimates, &self.varying) {
            Some(measurement) => Ok((measurement, seconds)),
            None => {
                let what = format!("{} returns a number that is not finite", case.describe());
                Err(Error::data(Place::file(&case.model), what))
            }
        }
    }

    /// The restored example poses of a task, by the name of their kind.
    fn examples(
        &self,
        poses: &ExamplePoses,
        restorer: &Restorer<'_>,
        task: Task,
    ) -> Result<BTreeMap<String, Vec<Vec<f64>>>> {
        let mut all = BTreeMap::new();
        for kind in ExampleKind::of(task) {
            let observe = &self.benchmark.settings.observe;
            let damaged = poses.damaged(self.benchmark.dataset, observe, kind)?;
            let (estimates, _) = restorer.restore(task, &damaged);
            let rounded = |v: &f64| (v * 100.0).round() / 100.0;
            let estimates = estimates.iter();
            let estimates: Vec<Vec<f64>> = estimates
                .map(|e| e.mean.iter().map(rounded).collect())
                .collect();
            if estimates.iter().flatten().all(|v| v.is_finite()) {
                all.insert(kind.name().into(), estimates);
            }
        }
        Ok(all)
    }

    fn notify(&self, event: &Event<'_>) -> Result<()> {
        (self.observer.lock().unwrap_or_else(PoisonError::into_inner))(event)
    }
}

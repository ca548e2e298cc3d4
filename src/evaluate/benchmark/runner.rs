//! Runs all cases in parallel. Results of an earlier run that are handed in are used again.

use super::config::Settings;
use super::dataset::Dataset;
use super::examples::{self, ExamplePoses, ExampleSet, MethodExamples};
use super::leakage::{DuplicateTake, find_duplicates};
use super::method::{Method, ModelSource, TrainedModel, restore, train};
use super::result::{BenchmarkResult, Case, Measurement, measure, varying_coordinates};
use super::splits::{Partition, Split};
use super::task::{DamagedPoses, PoseDamage, SPARSE_MEAN_VARIANCE, Task};
use crate::prior::Prior;
use crate::prior::{provenance::hex, training_set::TrainingSet};
use crate::restore::RigidModel;
use crate::{Error, Place, Result};
use ndarray::Array2;
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
    /// The examples of a method are finished.
    Examples {
        /// The key of method, dataset and settings, to be stored with the examples.
        key: &'a str,
        /// The examples.
        examples: &'a MethodExamples,
    },
}

/// Called for each event of a run; an error ends the run.
pub type Observer<'a> = dyn FnMut(&Event<'_>) -> Result<()> + Send + 'a;

/// Results of an earlier run, by their keys.
#[derive(Debug, Clone, Default)]
pub struct CachedResults {
    /// Results of cases.
    pub results: BTreeMap<String, BenchmarkResult>,
    /// Examples of methods.
    pub examples: BTreeMap<String, MethodExamples>,
}

/// A dataset with settings that can be run on it.
pub struct Benchmark<'a> {
    dataset: &'a Dataset,
    settings: Settings,
    duplicates: Vec<DuplicateTake>,
    skipped_splits: Vec<String>,
}

impl<'a> Benchmark<'a> {
    /// Checks that the settings can be run on the dataset and that no pretrained model was trained from its takes.
    /// Settings without splits are given all splits that the dataset allows.
    ///
    /// # Errors
    /// [`Error::Usage`] as [`Settings::check`] and [`Partition::draw`], or if a point that completion observes does not
    /// exist; [`Error::Data`] as [`Method::check_provenance`].
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
        let unknown = settings
            .observe
            .iter()
            .find(|n| !dataset.points.contains(n));
        if let (Some(name), true) = (unknown, settings.tasks.contains(&Task::Complete)) {
            let what = format!("--observe: the takes have no point \"{name}\"");
            return Err(Error::usage(what));
        }
        for &split in &settings.splits {
            Partition::draw(dataset, &duplicates, split, settings.first_seed)?;
        }
        Ok(Benchmark {
            dataset,
            settings,
            duplicates,
            skipped_splits,
        })
    }

    /// The settings, with the splits that are run.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Takes that share poses; they stay on one side of a split.
    pub fn duplicates(&self) -> &[DuplicateTake] {
        &self.duplicates
    }

    /// Splits that the dataset does not allow, each with the reason.
    pub fn skipped_splits(&self) -> &[String] {
        &self.skipped_splits
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

    /// The number of cases without a cached result.
    pub fn remaining(&self, cache: &CachedResults) -> usize {
        let digest = self.dataset.digest();
        let cases = self.cases();
        let missing = |case: &&Case| self.cached(cache, case, &digest).is_none();
        cases.iter().filter(missing).count()
    }

    /// Runs all cases without a cached result. Returns the results of all, in the order of [`Benchmark::cases`], and the
    /// examples.
    ///
    /// Each model is trained once for all tasks, models in parallel, splits and seeds one after another. The numbers do
    /// not depend on the number of threads; run times do.
    ///
    /// # Errors
    /// As training and the observer; [`Error::Data`] if a method returns a number that is not finite.
    pub fn run(
        &self,
        cache: &CachedResults,
        observer: &mut Observer<'_>,
    ) -> Result<(Vec<BenchmarkResult>, ExampleSet)> {
        let run = Run {
            benchmark: self,
            cache,
            digest: self.dataset.digest(),
            finished: Mutex::default(),
            observer: Mutex::new(observer),
        };
        let mut example_poses = None;
        for &split in &self.settings.splits {
            for seed in self.settings.seeds() {
                let has_examples =
                    self.example_split() == Some(split) && seed == self.settings.first_seed;
                let jobs = run.pending_jobs(split, seed, has_examples);
                if jobs.is_empty() && !has_examples {
                    continue;
                }
                let partition = Partition::draw(self.dataset, &self.duplicates, split, seed)?;
                if has_examples {
                    example_poses = Some(ExamplePoses::choose(self.dataset, &partition));
                }
                if jobs.is_empty() {
                    continue;
                }
                let training = self.dataset.training(partition.train())?;
                let part = TrainingPart {
                    varying: varying_coordinates(training.xyz.view()),
                    training,
                    partition,
                    example_poses: example_poses.as_ref(),
                };
                let done: Vec<Result<()>> = jobs
                    .par_iter()
                    .map(|job| run.train_and_measure(&part, job))
                    .collect();
                done.into_iter().collect::<Result<()>>()?;
            }
        }
        run.collect(example_poses)
    }

    /// The split whose examples are kept; `None` if no examples are asked for.
    fn example_split(&self) -> Option<Split> {
        let splits = &self.settings.splits;
        self.settings
            .examples
            .then(|| examples::split(splits))
            .flatten()
    }

    /// A cached result. One whose content does not fit its key is not used: files can be changed.
    fn cached<'c>(
        &self,
        cache: &'c CachedResults,
        case: &Case,
        dataset_digest: &str,
    ) -> Option<&'c BenchmarkResult> {
        let result = cache.results.get(&self.key(case, dataset_digest))?;
        let is_sound = result.case == *case && result.is_sound(self.dataset.points.len());
        is_sound.then_some(result)
    }

    /// The key of a case with this dataset and these settings.
    fn key(&self, case: &Case, dataset_digest: &str) -> String {
        let method = self.settings.methods.iter().find(|m| m.name == case.model);
        let recipe = method.map(|m| format!("{} {:?} {}", m.recipe(), m.choice, m.treated));
        let content = (
            env!("CARGO_PKG_VERSION"),
            dataset_digest,
            case,
            recipe,
            self.settings.frames,
            &self.settings.observe,
        );
        hex(&Sha256::digest(format!("{content:?}").as_bytes()))
    }

    /// The key of a method's examples with this dataset and these settings.
    fn example_key(&self, method: &Method, split: Split, dataset_digest: &str) -> String {
        let recipe = format!("{} {:?} {}", method.recipe(), method.choice, method.treated);
        let content = (
            (env!("CARGO_PKG_VERSION"), "example", dataset_digest),
            (&method.name, recipe, split, self.settings.first_seed),
            (&self.settings.observe, &self.settings.tasks),
        );
        hex(&Sha256::digest(format!("{content:?}").as_bytes()))
    }
}

/// One call of [`Benchmark::run`].
struct Run<'b, 'o, 'f> {
    benchmark: &'b Benchmark<'b>,
    cache: &'b CachedResults,
    /// The digest of the dataset.
    digest: String,
    finished: Mutex<CachedResults>,
    observer: Mutex<&'o mut Observer<'f>>,
}

/// The training part of a split, shared by all models.
struct TrainingPart<'a> {
    partition: Partition,
    training: TrainingSet,
    /// Coordinates that differ between training poses.
    varying: Vec<bool>,
    /// The example poses, once their split has come.
    example_poses: Option<&'a ExamplePoses>,
}

/// The pending cases of a method.
struct MethodJob<'a> {
    method: &'a Method,
    /// Base noise (cm) and case.
    cases: Vec<(f64, Case)>,
    /// Whether the method's examples are pending.
    examples: bool,
}

/// A trained model in the form that one method uses.
struct Restorer<'a> {
    prior: &'a dyn Prior,
    rigid: Option<&'a RigidModel>,
    /// Whether the model needs a noise variance under sparse noise, because it was not tuned to one.
    needs_variance: bool,
}

impl Restorer<'_> {
    /// The variance added to that of each coordinate, cm².
    fn extra_variance(&self, task: Task) -> f64 {
        match task {
            Task::Sparse if self.needs_variance => SPARSE_MEAN_VARIANCE,
            _ => 0.0,
        }
    }
}

impl Run<'_, '_, '_> {
    /// The pending cases of a split and seed, grouped by the model they share.
    fn pending_jobs(&self, split: Split, seed: u64, has_examples: bool) -> Vec<Vec<MethodJob<'_>>> {
        let settings = &self.benchmark.settings;
        let shown = examples::shown_methods(&settings.methods);
        let mut jobs: Vec<(String, Vec<MethodJob<'_>>)> = Vec::new();
        for method in &settings.methods {
            let mut cases = Vec::new();
            for &base in &settings.base {
                for task in settings.tasks_at(base) {
                    let case = Case::new(&method.name, split, seed, task, base);
                    if self
                        .benchmark
                        .cached(self.cache, &case, &self.digest)
                        .is_none()
                    {
                        cases.push((base, case));
                    }
                }
            }
            let key = || self.benchmark.example_key(method, split, &self.digest);
            let examples = has_examples
                && shown.contains(&method.name.as_str())
                && !self.cache.examples.contains_key(&key());
            if cases.is_empty() && !examples {
                continue;
            }
            let recipe = method.recipe();
            let job = MethodJob {
                method,
                cases,
                examples,
            };
            match jobs.iter_mut().find(|(r, _)| *r == recipe) {
                Some((_, methods)) => methods.push(job),
                None => jobs.push((recipe, vec![job])),
            }
        }
        jobs.into_iter().map(|(_, methods)| methods).collect()
    }

    /// Trains the model that some methods share and runs their cases.
    fn train_and_measure(&self, part: &TrainingPart<'_>, jobs: &[MethodJob<'_>]) -> Result<()> {
        let methods: Vec<&Method> = jobs.iter().map(|j| j.method).collect();
        let Some(first) = methods.first() else {
            return Ok(());
        };
        let (split, seed) = (part.partition.split(), part.partition.seed());
        if !matches!(first.source, ModelSource::Pretrained(_)) {
            let model = &first.name;
            self.notify(&Event::Training { model, split, seed })?;
        }
        let model = train(&methods, &part.training, split, seed)?;
        let rigid = methods.iter().any(|m| m.treated);
        let rigid =
            rigid.then(|| RigidModel::learn(part.training.xyz.view(), &part.training.takes));
        for (job, prior) in jobs.iter().zip(&model.priors) {
            let rigid = rigid.as_ref().filter(|_| job.method.treated);
            let restorer = Restorer {
                prior: &**prior,
                rigid,
                needs_variance: rigid.is_none() && model.tuning.is_none(),
            };
            if let Some(poses) = part.example_poses.filter(|_| job.examples) {
                self.restore_examples(poses, job.method, &restorer)?;
            }
            for (base, case) in &job.cases {
                self.run_case(part, &model, &restorer, *base, case)?;
            }
        }
        Ok(())
    }

    fn restore_examples(
        &self,
        poses: &ExamplePoses,
        method: &Method,
        restorer: &Restorer<'_>,
    ) -> Result<()> {
        let examples = poses.restored(
            self.benchmark.dataset,
            &self.benchmark.settings,
            &method.name,
            &|task| restorer.extra_variance(task),
            &|damaged| restore(restorer.prior, restorer.rigid, damaged).0,
        )?;
        let key = self
            .benchmark
            .example_key(method, poses.split, &self.digest);
        self.notify(&Event::Examples {
            key: &key,
            examples: &examples,
        })?;
        self.finished().examples.insert(key, examples);
        Ok(())
    }

    fn run_case(
        &self,
        part: &TrainingPart<'_>,
        model: &TrainedModel,
        restorer: &Restorer<'_>,
        base: f64,
        case: &Case,
    ) -> Result<()> {
        let test_rows = part.partition.some_test(self.benchmark.settings.frames);
        let (test, seconds) = self.measure(part, restorer, &test_rows, base, case)?;
        let is_trained = model.seconds.is_some();
        let training = match is_trained {
            false => None,
            true => {
                let rows = part.partition.some_train(test_rows.len());
                let training = self.measure(part, restorer, &rows, base, case)?.0;
                // Only the mean is used: one unit a frame would fill the file.
                Some(Measurement {
                    units: Vec::new(),
                    ..training
                })
            }
        };
        let result = BenchmarkResult {
            case: case.clone(),
            training_frames: is_trained.then(|| part.training.xyz.nrows()),
            tuning: model.tuning_of(case.task),
            seconds_per_pose: seconds / test.frames.max(1) as f64,
            test,
            training,
            seconds_training: model.seconds,
        };
        let key = self.benchmark.key(case, &self.digest);
        self.notify(&Event::Result {
            key: &key,
            result: &result,
        })?;
        self.finished().results.insert(key, result);
        Ok(())
    }

    /// Damages poses, restores them and compares them with the truth. Returns also the seconds of restoring.
    fn measure(
        &self,
        part: &TrainingPart<'_>,
        restorer: &Restorer<'_>,
        rows: &[usize],
        base: f64,
        case: &Case,
    ) -> Result<(Measurement, f64)> {
        let dataset = self.benchmark.dataset;
        let truth: Array2<f64> = dataset.rows(rows);
        let damage = PoseDamage {
            task: case.task,
            points: &dataset.points,
            observe: &self.benchmark.settings.observe,
            base,
            seed: case.seed,
            split: case.split,
        };
        let mut damaged: DamagedPoses = damage.apply(&truth, rows)?;
        damaged.variance += restorer.extra_variance(case.task);
        let (estimates, seconds) = restore(restorer.prior, restorer.rigid, &damaged);
        let (split, task) = (case.split, case.task);
        let truth = truth.view();
        let varying = &part.varying;
        match measure(
            dataset,
            (split, task),
            rows,
            truth,
            &damaged,
            &estimates,
            varying,
        ) {
            Some(measurement) => Ok((measurement, seconds)),
            None => {
                let what = format!(
                    "returns a number that is not finite (task {}, split {}, seed {})",
                    task.name(),
                    split.name(),
                    case.seed
                );
                Err(Error::data(Place::file(&case.model), what))
            }
        }
    }

    fn notify(&self, event: &Event<'_>) -> Result<()> {
        (self.observer.lock().unwrap_or_else(PoisonError::into_inner))(event)
    }

    fn finished(&self) -> std::sync::MutexGuard<'_, CachedResults> {
        self.finished.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// New and cached results together.
    fn collect(self, poses: Option<ExamplePoses>) -> Result<(Vec<BenchmarkResult>, ExampleSet)> {
        let (benchmark, digest) = (self.benchmark, &self.digest);
        let finished = self
            .finished
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let find = |case: Case| {
            let new = finished.results.get(&benchmark.key(&case, digest));
            let found = new.or_else(|| benchmark.cached(self.cache, &case, digest));
            found
                .cloned()
                .ok_or_else(|| Error::usage(format!("a case of {} was not run", case.model)))
        };
        let results = benchmark
            .cases()
            .into_iter()
            .map(find)
            .collect::<Result<_>>()?;
        let mut methods = Vec::new();
        if let Some(poses) = &poses {
            for method in &benchmark.settings.methods {
                let key = benchmark.example_key(method, poses.split, digest);
                let new = finished.examples.get(&key);
                let found = new.or_else(|| self.cache.examples.get(&key));
                methods.extend(found.filter(|e| e.model == method.name).cloned());
            }
        }
        Ok((results, ExampleSet { poses, methods }))
    }
}

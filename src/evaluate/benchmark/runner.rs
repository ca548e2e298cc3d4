//! Runs all cases in parallel; finished ones that are handed in are not run again.

use super::config::Settings;
use super::dataset::Dataset;
use super::examples::{self, ExamplePoses, ExampleSet, MethodExamples};
use super::leakage::{DuplicateTake, duplicate_takes};
use super::method::{Method, ModelSource, Treatment, make, restore};
use super::result::{BenchmarkResult, Case, Measurement, measure, varies};
use super::splits::{Partition, Split};
use super::task::{DamagedPoses, PoseDamage, SPARSE_MEAN, Task};
use crate::pose::ASF_UNIT_CM;
use crate::prior::Prior;
use crate::prior::{provenance::hex, training_set::TrainingSet};
use crate::{Error, Place, Result};
use ndarray::Array2;
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// What a run tells of itself.
#[derive(Debug)]
pub enum Event<'a> {
    /// A model is being trained.
    Training {
        /// The method's name.
        model: &'a str,
        /// The split.
        split: Split,
        /// The seed.
        seed: u64,
    },
    /// A cell is done: to be kept under its key, so that another run need not do it.
    Result {
        /// Tells the cell, the data and the settings.
        key: &'a str,
        /// It.
        cell: &'a BenchmarkResult,
    },
    /// A method's examples are done: to be kept like a cell.
    Examples {
        /// Tells them, the data and the settings.
        key: &'a str,
        /// They.
        example: &'a MethodExamples,
    },
}

/// Hears of a run; an error ends it.
pub type Observer<'a> = dyn FnMut(&Event<'_>) -> Result<()> + Send + 'a;

/// Dataset and settings that fit together.
pub struct Benchmark<'a> {
    dataset: &'a Dataset,
    settings: Settings,
    twins: Vec<DuplicateTake>,
    left_out: Vec<String>,
}

impl<'a> Benchmark<'a> {
    /// Checks that the settings can be run on the data, and that no given model was trained from them. Without splits,
    /// all are run that the data allow.
    ///
    /// # Errors
    /// As [`Settings::check`], [`Method::admit`] and [`Partition::draw`]; a joint that completion is to see and that is
    /// not there.
    pub fn new(data: &'a Dataset, mut settings: Settings) -> Result<Benchmark<'a>> {
        settings.check()?;
        let twins = duplicate_takes(data);
        let mut left_out = Vec::new();
        if settings.splits.is_empty() {
            for split in Split::ALL {
                match split.impossible(data, &twins) {
                    Some(why) => left_out.push(format!("the split {} {why}", split.name())),
                    None => settings.splits.push(split),
                }
            }
        }
        if settings.splits.is_empty() {
            let why = left_out.join("; ");
            return Err(Error::usage(format!("nothing is left to be run: {why}")));
        }
        for method in &settings.methods {
            method.admit(data)?;
        }
        if let Some(name) = settings.observe.iter().find(|n| !data.points.contains(n))
            && settings.tasks.contains(&Task::Complete)
        {
            let what = format!("observe: the takes have no point \"{name}\"; name some they have");
            return Err(Error::usage(what));
        }
        let bench = Benchmark {
            dataset: data,
            settings,
            twins,
            left_out,
        };
        for &split in &bench.settings.splits {
            Partition::draw(data, &bench.twins, split, bench.settings.first_seed)?;
            for &task in &bench.settings.tasks {
                let none = Array2::zeros((0, data.xyz.ncols()));
                bench.damage(split, 0, task, 0.0).apply(&none, &[])?;
            }
        }
        Ok(bench)
    }

    /// The settings, with the splits that are run.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Takes that are one, and so are kept on one side.
    pub fn duplicates(&self) -> &[DuplicateTake] {
        &self.twins
    }

    /// What is left out, each with the reason: splits that the data do not allow.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// The split whose examples are kept, and of which methods.
    fn example_methods(&self) -> (Option<Split>, Vec<&str>) {
        match self.settings.examples {
            true => (
                examples::split(&self.settings.splits),
                examples::drawn(&self.settings.methods),
            ),
            false => (None, Vec::new()),
        }
    }

    /// Runs all cells but those in `finished`; the answer has all, in the order of [`Benchmark::cells`], and the examples.
    ///
    /// Splits and seeds come one after another, models beside each other: each is trained once for all tasks. The numbers
    /// do not depend on the threads (times do).
    ///
    /// # Errors
    /// As training; an answer that is not finite; what the observer says.
    pub fn run(
        &self,
        finished: &CachedResults,
        observer: &mut Observer<'_>,
    ) -> Result<(Vec<BenchmarkResult>, ExampleSet)> {
        let digest = self.dataset.digest();
        let known = |id: &Case| self.cached(finished, id, &digest);
        let (example_split, shown) = self.example_methods();
        let lacks_examples = |method: &Method, split: Split, seed: u64| {
            example_split == Some(split)
                && seed == self.settings.first_seed
                && shown.contains(&method.name.as_str())
                && !(finished.examples).contains_key(&self.example_key(method, split, &digest))
        };
        let fresh = Mutex::new(CachedResults::default());
        let observer = Mutex::new(observer);
        let notify =
            |event: &Event<'_>| (observer.lock().unwrap_or_else(PoisonError::into_inner))(event);
        let mut example_poses = None;
        for &split in &self.settings.splits {
            for seed in self.settings.seeds() {
                let wanted =
                    self.pending_jobs(split, seed, &|id| known(id).is_none(), &lacks_examples);
                let chooses_examples =
                    example_split == Some(split) && seed == self.settings.first_seed;
                if wanted.is_empty() && !chooses_examples {
                    continue;
                }
                let partition = Partition::draw(self.dataset, &self.twins, split, seed)?;
                if chooses_examples {
                    example_poses = Some(ExamplePoses::choose(self.dataset, &partition));
                }
                if wanted.is_empty() {
                    continue;
                }
                let poses = self.dataset.training(partition.train())?;
                let varies = varies(poses.xyz.view());
                let jobs = wanted.into_iter().map(|methods| TrainingJob {
                    partition: &partition,
                    poses: &poses,
                    varies: &varies,
                    example_poses: example_poses.as_ref(),
                    methods,
                });
                let jobs: Vec<TrainingJob<'_>> = jobs.collect();
                let done: Vec<Result<()>> = jobs
                    .par_iter()
                    .map(|job| {
                        self.run_job(job, &notify, &mut |made| {
                            let fresh = || fresh.lock().unwrap_or_else(PoisonError::into_inner);
                            match made {
                                JobOutput::Result(cell) => {
                                    let key = self.key(&cell.case, &digest);
                                    notify(&Event::Result {
                                        key: &key,
                                        cell: &cell,
                                    })?;
                                    fresh().cells.insert(key, *cell);
                                }
                                JobOutput::Examples(method, example) => {
                                    let key = self.example_key(method, split, &digest);
                                    notify(&Event::Examples {
                                        key: &key,
                                        example: &example,
                                    })?;
                                    fresh().examples.insert(key, example);
                                }
                            }
                            Ok(())
                        })
                    })
                    .collect();
                done.into_iter().collect::<Result<Vec<()>>>()?;
            }
        }
        let fresh = fresh.into_inner().unwrap_or_else(PoisonError::into_inner);
        let find = |id: Case| {
            let key = self.key(&id, &digest);
            let found = fresh.cells.get(&key).or_else(|| known(&id));
            found
                .cloned()
                .ok_or_else(|| Error::usage(format!("the cell of {} was not run", id.model)))
        };
        let cells = self.cases().into_iter().map(find).collect::<Result<_>>()?;
        let example = |method: &Method| {
            let key = self.example_key(method, example_split?, &digest);
            let found = fresh.examples.get(&key);
            let found = found.or_else(|| finished.examples.get(&key));
            found.filter(|e| e.model == method.name).cloned()
        };
        let all = match example_poses {
            Some(_) => self.settings.methods.iter().filter_map(example).collect(),
            None => Vec::new(),
        };
        Ok((
            cells,
            ExampleSet {
                poses: example_poses,
                methods: all,
            },
        ))
    }
}

/// Frames to restore, with what is known of them.
struct Frames<'a> {
    rows: &'a [usize],
    truth: Array2<f64>,
    damaged: DamagedPoses,
}

/// The cells of one model under one partition.
struct TrainingJob<'a> {
    partition: &'a Partition,
    poses: &'a TrainingSet,
    varies: &'a [bool],
    /// The poses to look at, where this is their split and seed.
    example_poses: Option<&'a ExamplePoses>,
    /// Methods that share the model.
    methods: Vec<MethodJob<'a>>,
}

/// What a job makes.
enum JobOutput<'a> {
    Result(Box<BenchmarkResult>),
    Examples(&'a Method, MethodExamples),
}

/// What is wanted of a method.
struct MethodJob<'a> {
    method: &'a Method,
    /// Its cells: base noise (cm), and what the cell is.
    cells: Vec<(f64, Case)>,
    /// Whether its examples are.
    example: bool,
}

impl Benchmark<'_> {
    /// The cells of a split and a seed that are wanted, by the model they share.
    fn pending_jobs(
        &self,
        split: Split,
        seed: u64,
        want: &dyn Fn(&Case) -> bool,
        lacks_examples: &dyn Fn(&Method, Split, u64) -> bool,
    ) -> Vec<Vec<MethodJob<'_>>> {
        let mut jobs: Vec<(String, Vec<MethodJob<'_>>)> = Vec::new();
        for method in &self.settings.methods {
            let mut cells = Vec::new();
            for &base in &self.settings.base {
                for task in self.settings.tasks_at(base) {
                    let id = Case::of(&method.name, split, seed, task, base);
                    if want(&id) {
                        cells.push((base, id));
                    }
                }
            }
            let example = lacks_examples(method, split, seed);
            if cells.is_empty() && !example {
                continue;
            }
            let recipe = method.recipe();
            let wanted = MethodJob {
                method,
                cells,
                example,
            };
            match jobs.iter_mut().find(|(r, _)| *r == recipe) {
                Some((_, methods)) => methods.push(wanted),
                None => jobs.push((recipe, vec![wanted])),
            }
        }
        jobs.into_iter().map(|(_, methods)| methods).collect()
    }

    /// Trains a model and measures its cells.
    fn run_job(
        &self,
        job: &TrainingJob<'_>,
        notify: &(dyn Fn(&Event<'_>) -> Result<()> + Sync),
        done: &mut dyn FnMut(JobOutput<'_>) -> Result<()>,
    ) -> Result<()> {
        let methods: Vec<&Method> = job.methods.iter().map(|w| w.method).collect();
        let Some(first) = methods.first() else {
            return Ok(());
        };
        let (split, seed) = (job.partition.split(), job.partition.seed());
        let given = matches!(first.source, ModelSource::Pretrained(_));
        if !given {
            let model = &first.name;
            notify(&Event::Training { model, split, seed })?;
        }
        let ready = make(&methods, job.poses, split, seed)?;
        let treatment = methods
            .iter()
            .any(|m| m.treated)
            .then(|| Treatment::learn(job.poses));
        let tested = job.partition.some_test(self.settings.frames);
        let learnt = job.partition.some_train(tested.len());
        for (wanted, prior) in job.methods.iter().zip(&ready.priors) {
            let method = wanted.method;
            let treatment = treatment.as_ref().filter(|_| method.treated);
            let noise_unknown = treatment.is_none() && ready.tuning.is_none();
            let extra_variance = |task: Task| match task {
                Task::Sparse if noise_unknown => SPARSE_MEAN,
                _ => 0.0,
            };
            if let Some(example_poses) = job.example_poses.filter(|_| wanted.example) {
                let answer = |damaged: &DamagedPoses| restore(&**prior, treatment, damaged).0;
                let (data, settings) = (self.dataset, &self.settings);
                let example = example_poses.restored(
                    data,
                    settings,
                    &method.name,
                    &extra_variance,
                    &answer,
                )?;
                done(JobOutput::Examples(method, example))?;
            }
            for (base, id) in &wanted.cells {
                let extra_variance = extra_variance(id.task);
                let test = self.frames(&tested, job.partition, id, *base, extra_variance)?;
                let (test, seconds) =
                    self.restore_and_measure(&**prior, treatment, &test, job, id)?;
                let training = match given {
                    true => None,
                    false => {
                        let frames =
                            self.frames(&learnt, job.partition, id, *base, extra_variance)?;
                        let measured = self
                            .restore_and_measure(&**prior, treatment, &frames, job, id)?
                            .0;
                        // Only its mean is of use: a unit a frame would fill the file.
                        Some(Measurement {
                            units: Vec::new(),
                            ..measured
                        })
                    }
                };
                done(JobOutput::Result(Box::new(BenchmarkResult {
                    case: id.clone(),
                    training_frames: (!given).then(|| job.poses.xyz.nrows()),
                    tuning: ready.tuning_of(id.task),
                    seconds_per_pose: seconds / test.frames.max(1) as f64,
                    test,
                    training,
                    seconds_training: ready.seconds,
                })))?;
            }
        }
        Ok(())
    }

    fn damage(&self, split: Split, seed: u64, task: Task, base: f64) -> PoseDamage<'_> {
        PoseDamage {
            task,
            points: &self.dataset.points,
            observe: &self.settings.observe,
            base,
            seed,
            split,
        }
    }

    /// Damages frames for a cell; `more` is added to the variance that is told.
    fn frames<'r>(
        &self,
        rows: &'r [usize],
        part: &Partition,
        id: &Case,
        base: f64,
        extra_variance: f64,
    ) -> Result<Frames<'r>> {
        let truth = self.dataset.rows(rows);
        let damage = self.damage(part.split(), part.seed(), id.task, base);
        let mut damaged = damage.apply(&truth, rows)?;
        damaged.variance += extra_variance;
        Ok(Frames {
            rows,
            damaged,
            truth,
        })
    }

    /// Restores frames and compares them with the truth.
    fn restore_and_measure(
        &self,
        prior: &dyn Prior,
        treatment: Option<&Treatment>,
        frames: &Frames<'_>,
        job: &TrainingJob<'_>,
        id: &Case,
    ) -> Result<(Measurement, f64)> {
        let (answers, seconds) = restore(prior, treatment, &frames.damaged);
        let measured = measure(
            self.dataset,
            (id.split, id.task),
            frames.rows,
            frames.truth.view(),
            &frames.damaged,
            &answers,
            job.varies,
        );
        match measured {
            Some(measured) => Ok((measured, seconds)),
            None => {
                let (task, split) = (id.task.name(), id.split.name());
                let what = format!(
                    "answers a number that is not finite (task {task}, split {split}, seed {})",
                    id.seed
                );
                Err(Error::data(Place::file(&id.model), what))
            }
        }
    }
}

/// What is finished, by its keys.
#[derive(Debug, Clone, Default)]
pub struct CachedResults {
    /// Cells.
    pub cells: BTreeMap<String, BenchmarkResult>,
    /// ExampleSet.
    pub examples: BTreeMap<String, MethodExamples>,
}

impl Benchmark<'_> {
    /// All cells in the order of the tables.
    pub fn cases(&self) -> Vec<Case> {
        let mut all = Vec::new();
        for &split in &self.settings.splits {
            for &base in &self.settings.base {
                for task in self.settings.tasks_at(base) {
                    for method in &self.settings.methods {
                        let seeds = self.settings.seeds();
                        all.extend(seeds.map(|s| Case::of(&method.name, split, s, task, base)));
                    }
                }
            }
        }
        all
    }

    /// How many cells are not among the finished ones.
    pub fn remaining(&self, finished: &CachedResults) -> usize {
        let digest = self.dataset.digest();
        let cells = self.cases();
        let missing = |id: &&Case| self.cached(finished, id, &digest).is_none();
        cells.iter().filter(missing).count()
    }

    /// A finished cell; one that was read from a file is what its key says, or it is not used.
    fn cached<'f>(
        &self,
        finished: &'f CachedResults,
        id: &Case,
        dataset_digest: &str,
    ) -> Option<&'f BenchmarkResult> {
        let cell = finished.cells.get(&self.key(id, dataset_digest))?;
        (cell.case == *id && cell.is_sound(self.dataset.points.len())).then_some(cell)
    }

    /// Tells a cell of these data and settings from any other.
    pub fn key(&self, id: &Case, dataset_digest: &str) -> String {
        let method = self.settings.methods.iter().find(|m| m.name == id.model);
        let recipe = method.map(|m| format!("{} {:?} {}", m.recipe(), m.choice, m.treated));
        let told = (
            env!("CARGO_PKG_VERSION"),
            dataset_digest,
            id,
            recipe,
            self.settings.frames,
            &self.settings.observe,
        );
        hex(&Sha256::digest(format!("{told:?}").as_bytes()))
    }

    /// Tells a method's examples of these data and settings from any other.
    fn example_key(&self, method: &Method, split: Split, dataset_digest: &str) -> String {
        let recipe = format!("{} {:?} {}", method.recipe(), method.choice, method.treated);
        let told = (
            (env!("CARGO_PKG_VERSION"), "example", dataset_digest),
            (&method.name, recipe, split, self.settings.first_seed),
            (&self.settings.observe, &self.settings.tasks),
        );
        hex(&Sha256::digest(format!("{told:?}").as_bytes()))
    }
}

impl Case {
    /// A cell; the base noise in centimetres.
    pub fn of(model: &str, split: Split, seed: u64, task: Task, base: f64) -> Case {
        Case {
            model: model.into(),
            split,
            seed,
            task,
            base_asf: base / ASF_UNIT_CM,
        }
    }
}

//! All cells, in parallel, resumable: what is done already is not done again.

use super::cell::{Cell, Id, Measured, measure, varies};
use super::data::Data;
use super::examples::{self, Example, Examples, Scenes};
use super::leaks::{Twin, twins};
use super::methods::{Method, Source, Treatment, make, restore};
use super::settings::Settings;
use super::splits::{Partition, Split};
use super::tasks::{Damage, Damaged, SPARSE_MEAN, Task};
use crate::pose::ASF_UNIT_CM;
use crate::prior::Prior;
use crate::prior::training::{TrainingPoses, hex};
use crate::{Error, Place, Result};
use ndarray::Array2;
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// What is finished, by its keys.
#[derive(Debug, Clone, Default)]
pub struct Finished {
    /// Cells.
    pub cells: BTreeMap<String, Cell>,
    /// Examples.
    pub examples: BTreeMap<String, Example>,
}

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
    Done {
        /// Tells the cell, the data and the settings.
        key: &'a str,
        /// It.
        cell: &'a Cell,
    },
    /// A method's examples are done: to be kept like a cell.
    Shown {
        /// Tells them, the data and the settings.
        key: &'a str,
        /// They.
        example: &'a Example,
    },
}

/// Hears of a run; an error ends it.
pub type Observer<'a> = dyn FnMut(&Event<'_>) -> Result<()> + Send + 'a;

/// Data and settings that fit together.
pub struct Bench<'a> {
    data: &'a Data,
    settings: Settings,
    twins: Vec<Twin>,
    left_out: Vec<String>,
}

/// Frames to restore, with what is known of them.
struct Frames<'a> {
    rows: &'a [usize],
    truth: Array2<f64>,
    damaged: Damaged,
}

/// The cells of one model under one partition.
struct Job<'a> {
    partition: &'a Partition,
    poses: &'a TrainingPoses,
    varies: &'a [bool],
    /// The poses to look at, where this is their split and seed.
    scenes: Option<&'a Scenes>,
    /// Methods that share the model.
    methods: Vec<Wanted<'a>>,
}

/// What a job makes.
enum Made<'a> {
    Cell(Box<Cell>),
    Example(&'a Method, Example),
}

/// What is wanted of a method.
struct Wanted<'a> {
    method: &'a Method,
    /// Its cells: base noise (cm), and what the cell is.
    cells: Vec<(f64, Id)>,
    /// Whether its examples are.
    example: bool,
}

impl<'a> Bench<'a> {
    /// Checks that the settings can be run on the data, and that no given model was trained from them. Without splits,
    /// all are run that the data allow.
    ///
    /// # Errors
    /// As [`Settings::check`], [`Method::admit`] and [`Partition::draw`]; a joint that completion is to see and that is
    /// not there.
    pub fn new(data: &'a Data, mut settings: Settings) -> Result<Bench<'a>> {
        settings.check()?;
        let twins = twins(data);
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
        let bench = Bench {
            data,
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
    pub fn twins(&self) -> &[Twin] {
        &self.twins
    }

    /// What is left out, each with the reason: splits that the data do not allow.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// All cells in the order of the tables.
    pub fn cells(&self) -> Vec<Id> {
        let mut all = Vec::new();
        for &split in &self.settings.splits {
            for &base in &self.settings.base {
                for task in self.settings.tasks_at(base) {
                    for method in &self.settings.methods {
                        let seeds = self.settings.seeds();
                        all.extend(seeds.map(|s| Id::of(&method.name, split, s, task, base)));
                    }
                }
            }
        }
        all
    }

    /// How many cells are not among the finished ones.
    pub fn missing(&self, finished: &Finished) -> usize {
        let digest = self.data.digest();
        let cells = self.cells();
        let missing = |id: &&Id| self.known(finished, id, &digest).is_none();
        cells.iter().filter(missing).count()
    }

    /// A finished cell; one that was read from a file is what its key says, or it is not used.
    fn known<'f>(&self, finished: &'f Finished, id: &Id, data_digest: &str) -> Option<&'f Cell> {
        let cell = finished.cells.get(&self.key(id, data_digest))?;
        (cell.id == *id && cell.is_sound()).then_some(cell)
    }

    /// Tells a cell of these data and settings from any other.
    pub fn key(&self, id: &Id, data_digest: &str) -> String {
        let method = self.settings.methods.iter().find(|m| m.name == id.model);
        let recipe = method.map(|m| format!("{} {:?} {}", m.recipe(), m.choice, m.treated));
        let told = (
            env!("CARGO_PKG_VERSION"),
            data_digest,
            id,
            recipe,
            self.settings.frames,
            &self.settings.observe,
        );
        hex(&Sha256::digest(format!("{told:?}").as_bytes()))
    }

    /// Tells a method's examples of these data and settings from any other.
    fn example_key(&self, method: &Method, split: Split, data_digest: &str) -> String {
        let recipe = format!("{} {:?} {}", method.recipe(), method.choice, method.treated);
        let told = (
            (env!("CARGO_PKG_VERSION"), "example", data_digest),
            (&method.name, recipe, split, self.settings.first_seed),
            (&self.settings.observe, &self.settings.tasks),
        );
        hex(&Sha256::digest(format!("{told:?}").as_bytes()))
    }

    /// The split whose examples are kept, and of which methods.
    fn shown(&self) -> (Option<Split>, Vec<&str>) {
        match self.settings.examples {
            true => (
                examples::split(&self.settings.splits),
                examples::drawn(&self.settings.methods),
            ),
            false => (None, Vec::new()),
        }
    }

    /// Runs all cells but those in `finished`; the answer has all, in the order of [`Bench::cells`], and the examples.
    ///
    /// Splits and seeds come one after another, models beside each other: each is trained once for all tasks. The numbers
    /// do not depend on the threads (times do).
    ///
    /// # Errors
    /// As training; an answer that is not finite; what the observer says.
    pub fn run(
        &self,
        finished: &Finished,
        tell: &mut Observer<'_>,
    ) -> Result<(Vec<Cell>, Examples)> {
        let digest = self.data.digest();
        let known = |id: &Id| self.known(finished, id, &digest);
        let (shown_split, shown) = self.shown();
        let unshown = |method: &Method, split: Split, seed: u64| {
            shown_split == Some(split)
                && seed == self.settings.first_seed
                && shown.contains(&method.name.as_str())
                && !(finished.examples).contains_key(&self.example_key(method, split, &digest))
        };
        let fresh = Mutex::new(Finished::default());
        let tell = Mutex::new(tell);
        let hear = |event: &Event<'_>| (tell.lock().unwrap_or_else(PoisonError::into_inner))(event);
        let mut scenes = None;
        for &split in &self.settings.splits {
            for seed in self.settings.seeds() {
                let wanted = self.wanted(split, seed, &|id| known(id).is_none(), &unshown);
                let to_show = shown_split == Some(split) && seed == self.settings.first_seed;
                if wanted.is_empty() && !to_show {
                    continue;
                }
                let partition = Partition::draw(self.data, &self.twins, split, seed)?;
                if to_show {
                    scenes = Some(Scenes::choose(self.data, &partition));
                }
                if wanted.is_empty() {
                    continue;
                }
                let poses = self.data.training(partition.train())?;
                let varies = varies(poses.xyz.view());
                let jobs = wanted.into_iter().map(|methods| Job {
                    partition: &partition,
                    poses: &poses,
                    varies: &varies,
                    scenes: scenes.as_ref(),
                    methods,
                });
                let jobs: Vec<Job<'_>> = jobs.collect();
                let done: Vec<Result<()>> = jobs
                    .par_iter()
                    .map(|job| {
                        self.job(job, &hear, &mut |made| {
                            let fresh = || fresh.lock().unwrap_or_else(PoisonError::into_inner);
                            match made {
                                Made::Cell(cell) => {
                                    let key = self.key(&cell.id, &digest);
                                    hear(&Event::Done {
                                        key: &key,
                                        cell: &cell,
                                    })?;
                                    fresh().cells.insert(key, *cell);
                                }
                                Made::Example(method, example) => {
                                    let key = self.example_key(method, split, &digest);
                                    hear(&Event::Shown {
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
        let find = |id: Id| {
            let key = self.key(&id, &digest);
            let found = fresh.cells.get(&key).or_else(|| known(&id));
            found
                .cloned()
                .ok_or_else(|| Error::usage(format!("the cell of {} was not run", id.model)))
        };
        let cells = self.cells().into_iter().map(find).collect::<Result<_>>()?;
        let example = |method: &Method| {
            let key = self.example_key(method, shown_split?, &digest);
            let found = fresh.examples.get(&key);
            let found = found.or_else(|| finished.examples.get(&key));
            found.filter(|e| e.model == method.name).cloned()
        };
        let all = match scenes {
            Some(_) => self.settings.methods.iter().filter_map(example).collect(),
            None => Vec::new(),
        };
        Ok((cells, Examples { scenes, all }))
    }

    /// The cells of a split and a seed that are wanted, by the model they share.
    fn wanted(
        &self,
        split: Split,
        seed: u64,
        want: &dyn Fn(&Id) -> bool,
        unshown: &dyn Fn(&Method, Split, u64) -> bool,
    ) -> Vec<Vec<Wanted<'_>>> {
        let mut jobs: Vec<(String, Vec<Wanted<'_>>)> = Vec::new();
        for method in &self.settings.methods {
            let mut cells = Vec::new();
            for &base in &self.settings.base {
                for task in self.settings.tasks_at(base) {
                    let id = Id::of(&method.name, split, seed, task, base);
                    if want(&id) {
                        cells.push((base, id));
                    }
                }
            }
            let example = unshown(method, split, seed);
            if cells.is_empty() && !example {
                continue;
            }
            let recipe = method.recipe();
            let wanted = Wanted {
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
    fn job(
        &self,
        job: &Job<'_>,
        hear: &(dyn Fn(&Event<'_>) -> Result<()> + Sync),
        done: &mut dyn FnMut(Made<'_>) -> Result<()>,
    ) -> Result<()> {
        let methods: Vec<&Method> = job.methods.iter().map(|w| w.method).collect();
        let Some(first) = methods.first() else {
            return Ok(());
        };
        let (split, seed) = (job.partition.split(), job.partition.seed());
        let given = matches!(first.source, Source::Given(_));
        if !given {
            let model = &first.name;
            hear(&Event::Training { model, split, seed })?;
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
            let untold = treatment.is_none() && ready.tuning.is_none();
            let more = |task: Task| match task {
                Task::Sparse if untold => SPARSE_MEAN,
                _ => 0.0,
            };
            if let Some(scenes) = job.scenes.filter(|_| wanted.example) {
                let answer = |damaged: &Damaged| restore(&**prior, treatment, damaged).0;
                let (data, settings) = (self.data, &self.settings);
                let example = scenes.restored(data, settings, &method.name, &more, &answer)?;
                done(Made::Example(method, example))?;
            }
            for (base, id) in &wanted.cells {
                let more = more(id.task);
                let test = self.frames(&tested, job.partition, id, *base, more)?;
                let (test, seconds) = self.ask(&**prior, treatment, &test, job, id)?;
                let training = match given {
                    true => None,
                    false => {
                        let frames = self.frames(&learnt, job.partition, id, *base, more)?;
                        let measured = self.ask(&**prior, treatment, &frames, job, id)?.0;
                        // Only its mean is of use: a unit a frame would fill the file.
                        Some(Measured {
                            units: Vec::new(),
                            ..measured
                        })
                    }
                };
                done(Made::Cell(Box::new(Cell {
                    id: id.clone(),
                    learnt_from: (!given).then(|| job.poses.xyz.nrows()),
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

    fn damage(&self, split: Split, seed: u64, task: Task, base: f64) -> Damage<'_> {
        Damage {
            task,
            points: &self.data.points,
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
        id: &Id,
        base: f64,
        more: f64,
    ) -> Result<Frames<'r>> {
        let truth = self.data.rows(rows);
        let damage = self.damage(part.split(), part.seed(), id.task, base);
        let mut damaged = damage.apply(&truth, rows)?;
        damaged.told += more;
        Ok(Frames {
            rows,
            damaged,
            truth,
        })
    }

    /// Restores frames and compares them with the truth.
    fn ask(
        &self,
        prior: &dyn Prior,
        treatment: Option<&Treatment>,
        frames: &Frames<'_>,
        job: &Job<'_>,
        id: &Id,
    ) -> Result<(Measured, f64)> {
        let (beliefs, seconds) = restore(prior, treatment, &frames.damaged);
        let measured = measure(
            self.data,
            (id.split, id.task),
            frames.rows,
            frames.truth.view(),
            &frames.damaged,
            &beliefs,
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

impl Id {
    /// A cell; the base noise in centimetres.
    pub fn of(model: &str, split: Split, seed: u64, task: Task, base: f64) -> Id {
        Id {
            model: model.into(),
            split,
            seed,
            task,
            base_asf: base / ASF_UNIT_CM,
        }
    }
}

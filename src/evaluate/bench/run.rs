//! All cells, in parallel, resumable: what is done already is not done again.

use super::cell::{Cell, Id, Measured, measure, varies};
use super::data::Data;
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

/// Finished cells by their keys.
pub type Finished = BTreeMap<String, Cell>;

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
    /// Methods that share the model.
    methods: Vec<Wanted<'a>>,
}

/// A method with its cells: base noise (cm), and what the cell is.
type Wanted<'a> = (&'a Method, Vec<(f64, Id)>);

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
        settings.methods.retain(|m| {
            let known = !m.treated || Treatment::EXISTS;
            if !known {
                left_out.push(format!(
                    "{} needs a treatment of outliers, and there is none yet",
                    m.name
                ));
            }
            known
        });
        if settings.methods.is_empty() || settings.splits.is_empty() {
            let why = left_out.join("; ");
            return Err(Error::usage(format!("nothing is left to be run: {why}")));
        }
        for method in &settings.methods {
            method.admit(data)?;
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

    /// What is left out, each with the reason: splits that the data do not allow, methods that cannot be run.
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
        let missing = |id: &&Id| !finished.contains_key(&self.key(id, &digest));
        cells.iter().filter(missing).count()
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

    /// Runs all cells but those in `finished`; the answer has all, in the order of [`Bench::cells`].
    ///
    /// Splits and seeds come one after another, models beside each other: each is trained once for all tasks. The numbers
    /// do not depend on the threads (times do).
    ///
    /// # Errors
    /// As training; an answer that is not finite; what the observer says.
    pub fn run(&self, finished: &Finished, tell: &mut Observer<'_>) -> Result<Vec<Cell>> {
        let digest = self.data.digest();
        let known = |id: &Id| finished.get(&self.key(id, &digest));
        let fresh = Mutex::new(Finished::new());
        let tell = Mutex::new(tell);
        let hear = |event: &Event<'_>| (tell.lock().unwrap_or_else(PoisonError::into_inner))(event);
        for &split in &self.settings.splits {
            for seed in self.settings.seeds() {
                let wanted = self.wanted(split, seed, &|id| known(id).is_none());
                if wanted.is_empty() {
                    continue;
                }
                let partition = Partition::draw(self.data, &self.twins, split, seed)?;
                let poses = self.data.training(partition.train())?;
                let varies = varies(poses.xyz.view());
                let jobs = wanted.into_iter().map(|methods| Job {
                    partition: &partition,
                    poses: &poses,
                    varies: &varies,
                    methods,
                });
                let jobs: Vec<Job<'_>> = jobs.collect();
                let done: Vec<Result<()>> = jobs
                    .par_iter()
                    .map(|job| {
                        self.job(job, &hear, &mut |cell| {
                            let key = self.key(&cell.id, &digest);
                            hear(&Event::Done {
                                key: &key,
                                cell: &cell,
                            })?;
                            let mut fresh = fresh.lock().unwrap_or_else(PoisonError::into_inner);
                            fresh.insert(key, cell);
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
            let found = fresh.get(&key).or_else(|| finished.get(&key));
            // A cell read from a file is what its key says, or it is not used.
            found
                .filter(|c| c.id == id)
                .cloned()
                .ok_or_else(|| Error::usage(format!("the cell of {} was not run", id.model)))
        };
        self.cells().into_iter().map(find).collect()
    }

    /// The cells of a split and a seed that are wanted, by the model they share.
    fn wanted(&self, split: Split, seed: u64, want: &dyn Fn(&Id) -> bool) -> Vec<Vec<Wanted<'_>>> {
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
            if cells.is_empty() {
                continue;
            }
            let recipe = method.recipe();
            match jobs.iter_mut().find(|(r, _)| *r == recipe) {
                Some((_, methods)) => methods.push((method, cells)),
                None => jobs.push((recipe, vec![(method, cells)])),
            }
        }
        jobs.into_iter().map(|(_, methods)| methods).collect()
    }

    /// Trains a model and measures its cells.
    fn job(
        &self,
        job: &Job<'_>,
        hear: &(dyn Fn(&Event<'_>) -> Result<()> + Sync),
        done: &mut dyn FnMut(Cell) -> Result<()>,
    ) -> Result<()> {
        let methods: Vec<&Method> = job.methods.iter().map(|(m, _)| *m).collect();
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
        for ((method, cells), prior) in job.methods.iter().zip(&ready.priors) {
            let treatment = treatment.as_ref().filter(|_| method.treated);
            for (base, id) in cells {
                let untold = treatment.is_none() && ready.tuning.is_none();
                let more = match id.task {
                    Task::Sparse if untold => SPARSE_MEAN,
                    _ => 0.0,
                };
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
                done(Cell {
                    id: id.clone(),
                    learnt_from: (!given).then(|| job.poses.xyz.nrows()),
                    tuning: ready.tuning_of(id.task),
                    seconds_per_pose: seconds / test.frames.max(1) as f64,
                    test,
                    training,
                    seconds_training: ready.seconds,
                })?;
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

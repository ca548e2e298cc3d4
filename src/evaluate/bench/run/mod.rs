//! All cells, in parallel, resumable: what is done already is not done again.

mod job;
mod keys;

use super::cell::{Cell, Id, varies};
use super::data::Data;
use super::examples::{self, Example, Examples, Scenes};
use super::leaks::{Twin, twins};
use super::methods::Method;
use super::settings::Settings;
use super::splits::{Partition, Split};
use super::tasks::Task;
use crate::{Error, Result};
use job::{Job, Made};
use ndarray::Array2;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

pub use keys::Finished;

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
}

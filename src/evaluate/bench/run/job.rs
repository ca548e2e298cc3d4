//! The cells of one model under one partition: it is trained once, and restores what each cell damages.

use super::super::cell::{Cell, Id, Measured, measure};
use super::super::examples::{Example, Scenes};
use super::super::methods::{Method, Source, Treatment, make, restore};
use super::super::splits::{Partition, Split};
use super::super::tasks::{Damage, Damaged, SPARSE_MEAN, Task};
use super::{Bench, Event};
use crate::prior::Prior;
use crate::prior::training_set::TrainingSet;
use crate::{Error, Place, Result};
use ndarray::Array2;

/// Frames to restore, with what is known of them.
struct Frames<'a> {
    rows: &'a [usize],
    truth: Array2<f64>,
    damaged: Damaged,
}

/// The cells of one model under one partition.
pub struct Job<'a> {
    pub partition: &'a Partition,
    pub poses: &'a TrainingSet,
    pub varies: &'a [bool],
    /// The poses to look at, where this is their split and seed.
    pub scenes: Option<&'a Scenes>,
    /// Methods that share the model.
    pub methods: Vec<Wanted<'a>>,
}

/// What a job makes.
pub enum Made<'a> {
    Cell(Box<Cell>),
    Example(&'a Method, Example),
}

/// What is wanted of a method.
pub struct Wanted<'a> {
    pub method: &'a Method,
    /// Its cells: base noise (cm), and what the cell is.
    pub cells: Vec<(f64, Id)>,
    /// Whether its examples are.
    pub example: bool,
}

impl Bench<'_> {
    /// The cells of a split and a seed that are wanted, by the model they share.
    pub(super) fn wanted(
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
    pub(super) fn job(
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

    pub(super) fn damage(&self, split: Split, seed: u64, task: Task, base: f64) -> Damage<'_> {
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

//! The weight between a prior and what is observed (the paper's lambda), found on poses held back from the training.
//!
//! A prior's covariance is multiplied by an **inflation** (1 / lambda in the paper's (1)), and where the noise is not told
//! an equal noise of every coordinate is assumed. Both are searched task by task on a grid, as the paper says, on a part
//! of the *training* poses that the prior under test did not learn from; test poses are never seen. The whole curve is
//! kept ([`Tuning::curve`]) and goes into the model ([`Tuning::write`]).
//!
//! A prior opened from a file ([`Tasked`]) chooses between its settings by what an observation looks like
//! ([`Task::of`]); [`Choice::task`](super::Choice::task) fixes the choice.

use super::train::Training;
use super::training::TrainingPoses;
use super::{Belief, EXACT, Fit, Posterior, Prior};
use crate::io::Model;
use crate::pose::{ASF_UNIT_CM, PoseMap, joints};
use crate::{Error, Place, Result, par};
use ndarray::{Array2, ArrayView2, Axis};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// The paper's unit of variance, cm²: its "standard" noise.
pub const ASF2: f64 = ASF_UNIT_CM * ASF_UNIT_CM;
/// Noise of a variance from here on in every coordinate is dense noise, (0.3 asf)².
const DENSE_FROM: f64 = 0.09 * ASF2;
/// The share of the training poses that is held back.
const SHARE: f64 = 0.2;
/// At most so many held-back poses are restored for a setting; half as many where each has its own noise.
const MOST_TESTED: usize = 600;
/// Stretches that takes are cut into where there are too few to hold back whole ones.
const STRETCHES: usize = 20;
/// The share of points that sparse noise hits (section 4.2).
const HIT: f64 = 0.2;

/// What is asked of a prior: the tests of the paper's section 4.2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Noise of known variance on every coordinate.
    Dense,
    /// Noise on a few points; which, is not known.
    Sparse,
    /// Some coordinates are missing, the others without noise.
    Complete,
    /// Noise on a few points that were found: every coordinate's noise is told, and used as it is.
    Treated,
}

impl Task {
    /// All of them.
    pub const ALL: [Task; 4] = [Task::Dense, Task::Sparse, Task::Complete, Task::Treated];

    /// `dense`, `sparse`, `complete`, `treated`.
    pub fn name(self) -> &'static str {
        match self {
            Task::Dense => "dense",
            Task::Sparse => "sparse",
            Task::Complete => "complete",
            Task::Treated => "treated",
        }
    }

    /// What an observation of this noise (cm², infinite missing) looks like: any coordinate missing is a completion; all
    /// noises from (0.3 asf)² on are dense noise; else the noise is taken for sparse, at unknown points.
    pub fn of(noise: &[f64]) -> Task {
        if noise.iter().any(|n| !n.is_finite()) {
            Task::Complete
        } else if noise.iter().all(|n| *n >= DENSE_FROM) {
            Task::Dense
        } else {
            Task::Sparse
        }
    }
}

/// What is tuned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// What the prior's covariance is multiplied by: 1 / lambda. A kind without a covariance takes it for its own width.
    pub inflation: f64,
    /// The least noise assumed of an observed coordinate, cm²: told noise below it counts as this much.
    pub noise: f64,
}

impl Setting {
    /// The noise that is reckoned with where `told` is told.
    pub fn noise_of(&self, told: f64) -> f64 {
        told.max(self.noise)
    }
}

/// The setting of each task.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tuned {
    /// Of [`Task::Dense`].
    pub dense: Setting,
    /// Of [`Task::Sparse`].
    pub sparse: Setting,
    /// Of [`Task::Complete`].
    pub complete: Setting,
    /// Of [`Task::Treated`].
    pub treated: Setting,
}

impl Default for Tuned {
    /// What is used where nothing could be held back.
    fn default() -> Self {
        let at = |noise: f64| Setting {
            inflation: 1.0,
            noise: noise * ASF2,
        };
        Tuned {
            dense: at(0.0),
            sparse: at(0.1),
            complete: at(1e-3),
            treated: at(0.0),
        }
    }
}

impl Tuned {
    /// The setting of a task.
    pub fn get(&self, task: Task) -> Setting {
        match task {
            Task::Dense => self.dense,
            Task::Sparse => self.sparse,
            Task::Complete => self.complete,
            Task::Treated => self.treated,
        }
    }

    fn set(&mut self, task: Task, setting: Setting) {
        match task {
            Task::Dense => self.dense = setting,
            Task::Sparse => self.sparse = setting,
            Task::Complete => self.complete = setting,
            Task::Treated => self.treated = setting,
        }
    }

    /// The settings that [`Tuning::write`] left in a model; the default ones where there are none.
    ///
    /// # Errors
    /// Data: settings that cannot be read, or are out of range.
    pub fn read(model: &Model, source: &str) -> Result<Tuned> {
        let Some(found) = model
            .meta
            .details
            .get("tuning")
            .and_then(|t| t.get("chosen"))
        else {
            return Ok(Tuned::default());
        };
        let place = || Place::file(source).part("meta");
        let tuned: Tuned = serde_json::from_value(found.clone())
            .map_err(|e| Error::data(place(), format!("its tuning cannot be read: {e}")))?;
        let sound = |s: Setting| {
            s.inflation > 0.0 && s.inflation.is_finite() && s.noise >= 0.0 && s.noise.is_finite()
        };
        if !Task::ALL.into_iter().all(|t| sound(tuned.get(t))) {
            let what = "its tuning is out of range: an inflation is above 0, a noise at least 0";
            return Err(Error::data(place(), what));
        }
        Ok(tuned)
    }
}

/// Which training poses are held back to tune on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HoldBack {
    /// About a fifth of the poses, as whole takes; as contiguous stretches of time where the takes are too few. For
    /// motion not seen before.
    #[default]
    Takes,
    /// A fifth of the frames at random (the paper's split). For frames between those learnt from.
    Frames,
}

/// The settings that are tried: every inflation with every noise of the task.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Above 0.
    pub inflation: Vec<f64>,
    /// Noise assumed under sparse noise, cm².
    pub sparse: Vec<f64>,
    /// Noise assumed of the observed coordinates in completion, cm².
    pub complete: Vec<f64>,
}

impl Default for Grid {
    fn default() -> Self {
        let asf = |v: &[f64]| v.iter().map(|v| v * ASF2).collect();
        Grid {
            inflation: vec![0.5, 1.0, 2.5, 4.0, 6.0, 12.0, 24.0],
            sparse: asf(&[0.05, 0.1, 0.2, 0.4, 0.8]),
            complete: asf(&[1e-4, 1e-3, 1e-2, 1e-1]),
        }
    }
}

impl Grid {
    fn settings(&self, task: Task) -> Vec<Setting> {
        let told = [0.0];
        let noises = match task {
            Task::Sparse => &self.sparse[..],
            Task::Complete => &self.complete[..],
            Task::Dense | Task::Treated => &told[..],
        };
        let with = |&inflation: &f64| noises.iter().map(move |&noise| (inflation, noise));
        let all = self.inflation.iter().flat_map(with);
        all.map(|(inflation, noise)| Setting { inflation, noise })
            .collect()
    }
}

/// A setting that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tried {
    /// On which task.
    pub task: Task,
    /// See [`Setting`].
    pub inflation: f64,
    /// See [`Setting`], cm².
    pub noise: f64,
    /// Mean squared error a coordinate of the held-back poses, cm².
    pub mse: f64,
}

/// What the search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tuning {
    /// The best setting of each task.
    pub chosen: Tuned,
    /// How the poses were held back.
    pub held_back: HoldBack,
    /// Poses the priors under test learnt from.
    pub learnt_from: usize,
    /// Poses they were tested on; 0: too few poses to hold any back, and the settings are the default ones.
    pub tested: usize,
    /// Everything that was tried, task by task.
    pub curve: Vec<Tried>,
}

impl Tuning {
    /// Stores it in a model, under `tuning`.
    pub fn write(&self, model: &mut Model) {
        let json = serde_json::to_value(self).unwrap_or_default();
        model.meta.details.insert("tuning".into(), json);
    }

    /// The tuning a model was made with, for reports.
    pub fn read(model: &Model) -> Option<Tuning> {
        serde_json::from_value(model.meta.details.get("tuning")?.clone()).ok()
    }
}

/// A prior that was learnt once and is used at any setting's *inflation* (its noise is [`Tuning`]'s own affair).
pub type Learnt<'a> = Box<dyn Fn(Setting) -> Box<dyn Prior> + 'a>;

/// Searches the grid: `learn` is given the poses kept, and what it learnt is tried on those held back.
///
/// The damage is the same for every setting. Ties go to the setting named first.
pub fn tune<'a>(
    training: &Training<'_>,
    grid: &Grid,
    learn: &dyn Fn(&TrainingPoses) -> Result<Learnt<'a>>,
    report: &mut dyn FnMut(&str),
) -> Result<Tuning> {
    let (kept, held) = hold_back(training.poses, training.hold_back, training.seed);
    let mut tuning = Tuning {
        chosen: Tuned::default(),
        held_back: training.hold_back,
        learnt_from: kept.xyz.nrows(),
        tested: held.nrows(),
        curve: Vec::new(),
    };
    if tuning.tested == 0 {
        return Ok(tuning);
    }
    report("learns from a part, to tune on the rest");
    let learnt = learn(&kept)?;
    for task in Task::ALL {
        report(&format!("tunes for the task {}", task.name()));
        let (truth, y, told) = damaged(&held, &kept.points, task, training.seed);
        let mut best = f64::INFINITY;
        let mut prior: Option<(f64, Box<dyn Prior>)> = None;
        for setting in grid.settings(task) {
            if prior.as_ref().is_none_or(|(i, _)| *i != setting.inflation) {
                prior = Some((setting.inflation, learnt(setting)));
            }
            let Some((_, prior)) = &prior else { continue };
            let noise = told.mapv(|n| setting.noise_of(n));
            let rest = prior.means(y.view(), noise.view()) - &truth;
            let mse = rest.iter().map(|r| r * r).sum::<f64>() / rest.len() as f64;
            tuning.curve.push(Tried {
                task,
                inflation: setting.inflation,
                noise: setting.noise,
                mse,
            });
            if mse < best {
                best = mse;
                tuning.chosen.set(task, setting);
            }
        }
    }
    Ok(tuning)
}

/// The poses kept, and some of those held back, evenly spaced.
fn hold_back(poses: &TrainingPoses, how: HoldBack, seed: u64) -> (TrainingPoses, Array2<f64>) {
    let n = poses.xyz.nrows();
    let mut held = vec![false; n];
    let mut generator = par::generator(seed, 1);
    match how {
        HoldBack::Takes => {
            let mut parts = poses.takes.clone();
            let wanted = (SHARE * n as f64) as usize;
            // Whole takes, where that leaves at least half of the poses to learn from.
            if parts.len() < 5 || parts.iter().any(|p| p.len() > n / 2) {
                parts = stretches(&poses.takes, n.div_ceil(STRETCHES));
            }
            parts.shuffle(&mut generator);
            let mut count = 0;
            for part in parts {
                if count >= wanted {
                    break;
                }
                if count + part.len() <= n / 2 {
                    count += part.len();
                    held[part].fill(true);
                }
            }
        }
        HoldBack::Frames => held
            .iter_mut()
            .for_each(|h| *h = generator.random::<f64>() < SHARE),
    }
    let rows = |which: bool| -> Vec<usize> { (0..n).filter(|&i| held[i] == which).collect() };
    let (kept, tested) = (rows(false), rows(true));
    let mut before = vec![0; n + 1];
    for i in 0..n {
        before[i + 1] = before[i] + usize::from(!held[i]);
    }
    let takes = poses.takes.iter().map(|t| before[t.start]..before[t.end]);
    let part = TrainingPoses {
        xyz: poses.xyz.select(Axis(0), &kept),
        takes: takes.filter(|t| !t.is_empty()).collect(),
        points: poses.points.clone(),
        body: poses.body.clone(),
        anchor: poses.anchor.clone(),
        ..*poses
    };
    let step = tested.len().div_ceil(MOST_TESTED).max(1);
    let some: Vec<usize> = tested.into_iter().step_by(step).collect();
    (part, poses.xyz.select(Axis(0), &some).mapv(f64::from))
}

/// Takes cut into stretches of at most `length` frames.
fn stretches(takes: &[Range<usize>], length: usize) -> Vec<Range<usize>> {
    let length = length.max(1);
    let cut = |t: &Range<usize>| {
        let t = t.clone();
        let starts = t.clone().step_by(length);
        starts.map(move |s| s..(s + length).min(t.end))
    };
    takes.iter().flat_map(cut).collect()
}

/// Poses, the same damaged for a task, and the noise that is told: (m, 3 J) each.
fn damaged(
    held: &Array2<f64>,
    points: &[String],
    task: Task,
    seed: u64,
) -> (Array2<f64>, Array2<f64>, Array2<f64>) {
    let mut generator = par::generator(seed, 2 + task as u64);
    // Noise that differs from frame to frame costs a factorisation each.
    let step = if task == Task::Treated { 2 } else { 1 };
    let truth = held.slice(ndarray::s![..;step, ..]).to_owned();
    let mut y = truth.clone();
    let mut told = Array2::zeros(truth.dim());
    let hidden = hidden(points, seed);
    for (mut y, mut told) in y.rows_mut().into_iter().zip(told.rows_mut()) {
        for p in 0..points.len() {
            let hit = match task {
                Task::Dense => true,
                Task::Sparse | Task::Treated => generator.random::<f64>() < HIT,
                Task::Complete => false,
            };
            for c in 3 * p..3 * p + 3 {
                if hit {
                    y[c] += ASF_UNIT_CM * generator.sample::<f64, _>(StandardNormal);
                }
                told[c] = match task {
                    Task::Dense => ASF2,
                    Task::Sparse => 0.0,
                    Task::Complete if hidden[p] => f64::INFINITY,
                    Task::Complete => 0.0,
                    Task::Treated if hit => ASF2,
                    Task::Treated => EXACT,
                };
            }
        }
    }
    (truth, y, told)
}

/// The points that completion does not see: all but the paper's six, or three in four where those are not there.
fn hidden(points: &[String], seed: u64) -> Vec<bool> {
    let six = |name: &String| joints::PAPER_SIX.contains(&name.as_str());
    if points.iter().filter(|p| six(p)).count() == joints::PAPER_SIX.len() {
        return points.iter().map(|p| !six(p)).collect();
    }
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(&mut par::generator(seed, 6));
    let mut hidden = vec![true; points.len()];
    let seen = points.len().div_ceil(4);
    order.iter().take(seen).for_each(|&p| hidden[p] = false);
    hidden
}

/// A prior at each task's setting: the one that an observation is answered with is chosen by how it looks.
#[derive(Clone)]
pub struct Tasked {
    tuned: Tuned,
    fixed: Option<Task>,
    /// In the order of [`Task::ALL`]; those of one inflation are one.
    priors: [Arc<dyn Prior>; 4],
}

impl Tasked {
    /// From what was learnt, and the settings; `fixed` is the task whatever an observation looks like.
    pub fn new(tuned: Tuned, fixed: Option<Task>, learnt: &Learnt<'_>) -> Tasked {
        Tasked {
            tuned,
            fixed,
            priors: shared(tuned, &|i| learnt(tuned.get(Task::ALL[i]))),
        }
    }

    fn task(&self, noise: &[f64]) -> Task {
        self.fixed.unwrap_or_else(|| Task::of(noise))
    }

    fn prior(&self, task: Task) -> &dyn Prior {
        &*self.priors[task as usize]
    }

    /// The prior that answers an observation, and the noise it reckons with.
    fn at(&self, noise: &[f64]) -> (&dyn Prior, Vec<f64>) {
        let task = self.task(noise);
        let setting = self.tuned.get(task);
        let noise = noise.iter().map(|n| setting.noise_of(*n)).collect();
        (self.prior(task), noise)
    }

    /// Runs of rows of the same task, answered together.
    fn by_runs<T>(
        &self,
        y: ArrayView2<'_, f64>,
        noise: ArrayView2<'_, f64>,
        mut answer: impl FnMut(&dyn Prior, ArrayView2<'_, f64>, ArrayView2<'_, f64>) -> T,
    ) -> Vec<T> {
        let tasks: Vec<Task> = noise
            .rows()
            .into_iter()
            .map(|r| self.task(&r.to_vec()))
            .collect();
        let (mut out, mut start) = (Vec::new(), 0);
        for run in tasks.chunk_by(|a, b| a == b) {
            let rows = ndarray::s![start..start + run.len(), ..];
            let setting = self.tuned.get(run[0]);
            let assumed = noise.slice(rows).mapv(|n| setting.noise_of(n));
            out.push(answer(self.prior(run[0]), y.slice(rows), assumed.view()));
            start += run.len();
        }
        out
    }
}

/// One prior for each different inflation.
fn shared(tuned: Tuned, make: &dyn Fn(usize) -> Box<dyn Prior>) -> [Arc<dyn Prior>; 4] {
    let mut made: Vec<Arc<dyn Prior>> = Vec::with_capacity(4);
    let inflation = |i: usize| tuned.get(Task::ALL[i]).inflation;
    for i in 0..4 {
        let same = (0..i).find(|&j| inflation(j) == inflation(i));
        let prior = same.map_or_else(|| Arc::from(make(i)), |j| made[j].clone());
        made.push(prior);
    }
    std::array::from_fn(|i| made[i].clone())
}

impl Prior for Tasked {
    fn width(&self) -> usize {
        self.priors[0].width()
    }

    fn variance(&self) -> &[f64] {
        self.prior(self.fixed.unwrap_or(Task::Sparse)).variance()
    }

    fn believe(&self, y: &[f64], noise: &[f64]) -> Belief {
        let (prior, noise) = self.at(noise);
        prior.believe(y, &noise)
    }

    fn mean(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        let (prior, noise) = self.at(noise);
        prior.mean(y, &noise)
    }

    fn evidence(&self, y: &[f64], noise: &[f64]) -> f64 {
        let (prior, noise) = self.at(noise);
        prior.evidence(y, &noise)
    }

    fn believe_all(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Vec<Belief> {
        let runs = self.by_runs(y, noise, |prior, y, noise| prior.believe_all(y, noise));
        runs.into_iter().flatten().collect()
    }

    fn means(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = Array2::zeros(y.dim());
        let mut start = 0;
        for run in self.by_runs(y, noise, |prior, y, noise| prior.means(y, noise)) {
            let rows = start..start + run.nrows();
            start = rows.end;
            out.slice_mut(ndarray::s![rows, ..]).assign(&run);
        }
        out
    }

    fn posteriors(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Vec<Posterior> {
        let runs = self.by_runs(y, noise, |prior, y, noise| prior.posteriors(y, noise));
        runs.into_iter().flatten().collect()
    }

    fn fit(&self, y: &[f64], noise: &[f64], before: Option<&Fit>) -> Fit {
        let (prior, noise) = self.at(noise);
        prior.fit(y, &noise, before)
    }

    fn posterior(&self, y: &[f64], noise: &[f64], fit: &Fit) -> Posterior {
        let (prior, noise) = self.at(noise);
        prior.posterior(y, &noise, fit)
    }

    fn as_told(&self) -> Option<&dyn Prior> {
        Some(self.prior(Task::Treated))
    }

    fn typical(&self) -> ArrayView2<'_, f64> {
        self.priors[0].typical()
    }

    fn mapped(&self, map: &PoseMap) -> Box<dyn Prior> {
        Box::new(Tasked {
            tuned: self.tuned,
            fixed: self.fixed,
            priors: shared(self.tuned, &|i| self.priors[i].mapped(map)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses(takes: usize, frames: usize) -> TrainingPoses {
        let n = takes * frames;
        TrainingPoses {
            points: ["a", "b", "c"].map(String::from).to_vec(),
            xyz: Array2::from_shape_fn((n, 9), |(t, c)| 20.0 * ((t * (c + 1)) as f32 * 0.1).sin()),
            takes: (0..takes).map(|t| t * frames..(t + 1) * frames).collect(),
            body: None,
            anchor: None,
            incomplete: 0,
            unplaced: 0,
        }
    }

    #[test]
    fn observations_are_known_by_their_noise() {
        let inf = f64::INFINITY;
        assert_eq!(Task::of(&[0.0, inf]), Task::Complete);
        assert_eq!(Task::of(&[ASF2, ASF2]), Task::Dense);
        assert_eq!(Task::of(&[0.0, ASF2]), Task::Sparse);
        assert_eq!(Task::of(&[0.0, 0.0]), Task::Sparse);
    }

    #[test]
    fn whole_takes_are_held_back_and_stretches_of_one() {
        for (takes, frames, part) in [(10, 50, 50), (1, 500, 25)] {
            let all = poses(takes, frames);
            let (kept, held) = hold_back(&all, HoldBack::Takes, 3);
            assert_eq!(kept.xyz.nrows() + held.nrows(), takes * frames);
            assert_eq!(held.nrows() % part, 0);
            assert!(held.nrows() * 4 >= takes * frames / 2 && held.nrows() * 2 <= takes * frames);
            assert_eq!(kept.takes.last().unwrap().end, kept.xyz.nrows());
        }
        let (kept, held) = hold_back(&poses(2, 200), HoldBack::Frames, 3);
        assert!(held.nrows() >= 50 && held.nrows() <= 110 && kept.takes.len() == 2);
        assert_eq!(hold_back(&poses(1, 1), HoldBack::Takes, 0).1.nrows(), 0);
    }
}

//! A tuned prior in use.

use super::{PriorFamily, Task, TaskSettings};
use crate::pose::PoseTransform;
use crate::prior::{Belief, Fit, Posterior, Prior};
use ndarray::{Array2, ArrayView2};
use std::sync::Arc;

/// A prior at each task's setting: the one that an observation is answered with is chosen by how it looks.
#[derive(Clone)]
pub struct TunedPrior {
    tuned: TaskSettings,
    fixed: Option<Task>,
    /// In the order of [`Task::ALL`]; those of one inflation are one.
    priors: [Arc<dyn Prior>; 4],
}

impl TunedPrior {
    /// From what was learnt, and the settings; `fixed` is the task whatever an observation looks like.
    pub fn new(tuned: TaskSettings, fixed: Option<Task>, learnt: &PriorFamily<'_>) -> TunedPrior {
        TunedPrior {
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
fn shared(tuned: TaskSettings, make: &dyn Fn(usize) -> Box<dyn Prior>) -> [Arc<dyn Prior>; 4] {
    let mut made: Vec<Arc<dyn Prior>> = Vec::with_capacity(4);
    let inflation = |i: usize| tuned.get(Task::ALL[i]).inflation;
    for i in 0..4 {
        let same = (0..i).find(|&j| inflation(j) == inflation(i));
        let prior = same.map_or_else(|| Arc::from(make(i)), |j| made[j].clone());
        made.push(prior);
    }
    std::array::from_fn(|i| made[i].clone())
}

impl Prior for TunedPrior {
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

    fn fit_often(&self, y: &[f64], noise: &[f64], before: Option<&Fit>) -> Fit {
        let (prior, noise) = self.at(noise);
        prior.fit_often(y, &noise, before)
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

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        Box::new(TunedPrior {
            tuned: self.tuned,
            fixed: self.fixed,
            priors: shared(self.tuned, &|i| self.priors[i].mapped(map)),
        })
    }
}

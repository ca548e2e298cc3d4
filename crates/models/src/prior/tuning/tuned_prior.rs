//! A prior that uses the setting of each observation's task.

use super::{PriorFamily, Task, TaskSettings};
use crate::Result;
use crate::io::Model;
use crate::pose::{Observation, PoseTransform};
use crate::prior::model_arrays;
use crate::prior::{OpenOptions, Posterior, Prior, Reconstruction, Want};
use ndarray::{Array2, ArrayView2};
use std::sync::Arc;

/// A prior at each task's setting; the task of an observation is found from its variances
/// ([`Task::of`]).
#[doc(hidden)]
#[derive(Clone)]
pub struct TunedPrior {
    tuned: TaskSettings,
    fixed: Option<Task>,
    /// In the order of [`Task::ALL`]; tasks with the same inflation share one prior.
    priors: [Arc<dyn Prior>; 4],
    /// (k, 3 J), cm.
    representative_poses: Array2<f64>,
}

impl TunedPrior {
    /// What was learned, at the settings that training left in the model; `source` names it in
    /// messages.
    ///
    /// # Errors
    /// Data: settings or representative poses that cannot be read.
    pub fn open(
        model: &Model,
        options: &OpenOptions,
        source: &str,
        learned: &PriorFamily,
    ) -> Result<TunedPrior> {
        let tuned = TaskSettings::read(model, source)?;
        let at = |i: usize| learned(tuned.get(Task::ALL[i]).inflation);
        Ok(TunedPrior {
            tuned,
            fixed: options.task,
            priors: shared(tuned, &at),
            representative_poses: model_arrays::poses(model, "typical", source)?.mapv(f64::from),
        })
    }

    fn task(&self, noise: &[f64]) -> Task {
        self.fixed.unwrap_or_else(|| Task::of(noise))
    }

    fn prior(&self, task: Task) -> &dyn Prior {
        &*self.priors[task as usize]
    }

    /// The variances (3 J) that a task's setting assumes.
    fn assumed(&self, task: Task, variance: &[f64]) -> Vec<f64> {
        let setting = self.tuned.get(task);
        variance.iter().map(|n| setting.noise_of(*n)).collect()
    }

    /// Calls the prior of the observation's task, with the variances that its setting assumes.
    fn at_task<T>(
        &self,
        observation: &Observation<'_>,
        method: impl FnOnce(&dyn Prior, &Observation<'_>) -> T,
    ) -> T {
        let task = self.task(observation.variance);
        let observation = Observation {
            values: observation.values,
            variance: &self.assumed(task, observation.variance),
        };
        method(self.prior(task), &observation)
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
    fn residual_variance(&self) -> &[f64] {
        self.prior(self.fixed.unwrap_or(Task::Sparse))
            .residual_variance()
    }

    fn posterior(&self, observation: &Observation<'_>, want: Want) -> Posterior {
        self.at_task(observation, |prior, observation| {
            prior.posterior(observation, want)
        })
    }

    /// Runs of observations of one task are passed on together.
    fn posterior_batch(&self, batch: &[(Observation<'_>, Want)]) -> Vec<Posterior> {
        let assumed = batch.iter().map(|(o, _)| {
            let task = self.task(o.variance);
            (task, self.assumed(task, o.variance))
        });
        let assumed: Vec<(Task, Vec<f64>)> = assumed.collect();
        let (mut out, mut rest) = (Vec::with_capacity(batch.len()), batch);
        for run in assumed.chunk_by(|a, b| a.0 == b.0) {
            let (own, others) = rest.split_at(run.len());
            let own = own.iter().zip(run).map(|((o, want), (_, variance))| {
                let values = o.values;
                (Observation { values, variance }, *want)
            });
            out.extend(
                self.prior(run[0].0)
                    .posterior_batch(&own.collect::<Vec<_>>()),
            );
            rest = others;
        }
        out
    }

    fn reconstruct(
        &self,
        observation: &Observation<'_>,
        previous: Option<&Reconstruction>,
    ) -> Reconstruction {
        self.at_task(observation, |prior, observation| {
            prior.reconstruct(observation, previous)
        })
    }

    fn posterior_given(
        &self,
        observation: &Observation<'_>,
        reconstruction: &Reconstruction,
        want: Want,
    ) -> Posterior {
        self.at_task(observation, |prior, observation| {
            prior.posterior_given(observation, reconstruction, want)
        })
    }

    fn untuned(&self) -> Option<&dyn Prior> {
        Some(self.prior(Task::Treated))
    }

    fn representative_poses(&self) -> ArrayView2<'_, f64> {
        self.representative_poses.view()
    }

    fn mapped(&self, map: &PoseTransform) -> Box<dyn Prior> {
        Box::new(TunedPrior {
            tuned: self.tuned,
            fixed: self.fixed,
            priors: shared(self.tuned, &|i| self.priors[i].mapped(map)),
            representative_poses: map.apply_rows(self.representative_poses.view()),
        })
    }
}

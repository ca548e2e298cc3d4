//! The weight between a prior and what is observed (Lai et al.'s lambda), found on poses held back
//! from the training.
//!
//! A prior's covariance is multiplied by an **inflation** (1 / lambda in Lai et al.'s (1)), and
//! where the noise is unknown an equal noise of every coordinate is assumed. Both are searched task
//! by task on a grid, as Lai et al. do, and beyond its edges where that is better, on a part of
//! the *training* poses that the prior under test did not learn from; test poses are never seen.
//! The whole curve is kept ([`Tuning::curve`]) and goes into the model (`Tuning::write`).
//!
//! A prior opened from a file (`TunedPrior`) chooses between its settings by what an observation
//! looks like (`Task::of`); [`OpenOptions::task`](super::OpenOptions::task) fixes the choice.

mod holdout;
mod search;
mod tuned_prior;

use super::Prior;
use crate::io::Model;
use crate::pose::ASF_UNIT_CM;
use crate::{Error, Place, Result};
use serde::{Deserialize, Serialize};

pub use super::training_set::HoldBack;
#[doc(hidden)]
pub use search::{Grid, tune};
#[doc(hidden)]
pub use tuned_prior::TunedPrior;

/// Lai et al.'s unit of variance, cm²: its "standard" noise.
#[doc(hidden)]
pub const ASF2: f64 = ASF_UNIT_CM * ASF_UNIT_CM;
/// Noise of a variance from here on in every coordinate is dense noise, (0.3 asf)².
const DENSE_FROM: f64 = 0.09 * ASF2;

/// What is asked of a prior, and so which of its tuned settings it uses. The first three are the
/// tests of Lai et al., section 4.2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Noise of known variance on every coordinate.
    Dense,
    /// Noise on a few points; which, is not known.
    Sparse,
    /// Some coordinates are missing, the others without noise.
    Complete,
    /// Noise on a few known points: the stated variance of each coordinate is used as it is.
    Treated,
}

names!(Task {
    Dense = "dense",
    Sparse = "sparse",
    Complete = "complete",
    Treated = "treated",
});

impl Task {
    /// What an observation of this noise (cm², infinite missing) looks like: any coordinate missing
    /// is a completion; all noises from (0.3 asf)² on are dense noise; else the noise is taken
    /// for sparse, at unknown points.
    #[doc(hidden)]
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

/// The tuned parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// What the prior's covariance is multiplied by: 1 / lambda. A kind without a covariance takes
    /// it for its own width.
    pub inflation: f64,
    /// The smallest variance assumed of an observed coordinate, cm²; smaller stated variances are
    /// raised to it.
    pub noise: f64,
}

impl Setting {
    /// The variance that is assumed if `stated` is stated, cm².
    pub(crate) fn noise_of(&self, stated: f64) -> f64 {
        stated.max(self.noise)
    }
}

/// The setting of each task.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TaskSettings {
    /// The setting of [`Task::Dense`].
    pub dense: Setting,
    /// The setting of [`Task::Sparse`].
    pub sparse: Setting,
    /// The setting of [`Task::Complete`].
    pub complete: Setting,
    /// The setting of [`Task::Treated`].
    pub treated: Setting,
}

impl Default for TaskSettings {
    /// What is used where nothing could be held back.
    fn default() -> Self {
        let at = |noise: f64| Setting {
            inflation: 1.0,
            noise: noise * ASF2,
        };
        TaskSettings {
            dense: at(0.0),
            sparse: at(0.1),
            complete: at(1e-3),
            treated: at(0.0),
        }
    }
}

impl TaskSettings {
    /// The setting of a task.
    pub(crate) fn get(&self, task: Task) -> Setting {
        match task {
            Task::Dense => self.dense,
            Task::Sparse => self.sparse,
            Task::Complete => self.complete,
            Task::Treated => self.treated,
        }
    }

    #[doc(hidden)]
    pub fn set(&mut self, task: Task, setting: Setting) {
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
    pub(crate) fn read(model: &Model, source: &str) -> Result<TaskSettings> {
        let Some(found) = model
            .meta
            .details
            .get("tuning")
            .and_then(|t| t.get("chosen"))
        else {
            return Ok(TaskSettings::default());
        };
        let place = || Place::file(source).part("meta");
        let tuned: TaskSettings = serde_json::from_value(found.clone())
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

/// A setting that was tried, and its error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// On which task.
    pub task: Task,
    /// See [`Setting`].
    pub inflation: f64,
    /// See [`Setting`], cm².
    pub noise: f64,
    /// Mean squared error a coordinate of the held-back poses, cm².
    pub mse: f64,
}

/// The result of the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tuning {
    /// The best setting of each task.
    pub chosen: TaskSettings,
    /// How the poses were held back.
    pub held_back: HoldBack,
    /// Poses the priors under test learned from.
    pub learnt_from: usize,
    /// Poses they were tested on; 0: too few poses to hold any back, and the settings are the
    /// default ones.
    pub tested: usize,
    /// Everything that was tried, task by task.
    pub curve: Vec<Trial>,
}

impl Tuning {
    /// Stores it in a model, under `tuning`.
    #[doc(hidden)]
    pub fn write(&self, model: &mut Model) {
        let json = serde_json::to_value(self).unwrap_or_default();
        model.meta.details.insert("tuning".into(), json);
    }

    /// The tuning a model was made with, for reports.
    pub fn read(model: &Model) -> Option<Tuning> {
        serde_json::from_value(model.meta.details.get("tuning")?.clone()).ok()
    }
}

/// What was learned once, as a prior at any inflation.
#[doc(hidden)]
pub type PriorFamily = Box<dyn Fn(f64) -> Box<dyn Prior>>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn observations_are_known_by_their_noise() {
        let inf = f64::INFINITY;
        assert_eq!(Task::of(&[0.0, inf]), Task::Complete);
        assert_eq!(Task::of(&[ASF2, ASF2]), Task::Dense);
        assert_eq!(Task::of(&[0.0, ASF2]), Task::Sparse);
        assert_eq!(Task::of(&[0.0, 0.0]), Task::Sparse);
    }
}

//! The settings of a benchmark.

use super::method::Method;
use super::splits::Split;
use super::task::Task;
use crate::pose::{ASF_UNIT_CM, joints};
use crate::{Error, Result};

/// Largest number of seeds of a run.
const MAX_SEEDS: u64 = 10_000;
/// Largest base noise, asf. More would be a task of its own.
const MAX_BASE: f64 = 10.0;

/// The settings of a run; [`Settings::check`] has the limits.
#[derive(Clone)]
pub struct Settings {
    /// The methods: the rows of the tables.
    pub methods: Vec<Method>,
    /// The tasks: the columns.
    pub tasks: Vec<Task>,
    /// The splits; empty for all that the dataset allows.
    pub splits: Vec<Split>,
    /// The number of seeds, 1 to 10,000.
    pub seeds: u64,
    /// The first seed.
    pub first_seed: u64,
    /// Largest number of test frames of a split, and of training frames for the training error; at
    /// least 1.
    pub frames: usize,
    /// Standard deviations of the base noise on clean coordinates, cm, 0 to 10 asf.
    pub base: Vec<f64>,
    /// The points that completion observes.
    pub observe: Vec<String>,
    /// Whether example poses are restored, too (see `examples`).
    pub examples: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            methods: Vec::new(),
            tasks: Task::ALL.to_vec(),
            splits: Vec::new(),
            seeds: 5,
            first_seed: 0,
            frames: 800,
            base: vec![0.0],
            observe: joints::PAPER_SIX.map(String::from).to_vec(),
            examples: false,
        }
    }
}

impl Settings {
    /// Checks the limits, and that no name occurs twice.
    ///
    /// # Errors
    /// [`Error::Usage`] with the limit.
    pub fn check(&self) -> Result<()> {
        let usage = |what: String| Err(Error::usage(what));
        if !(1..=MAX_SEEDS).contains(&self.seeds) {
            return usage(format!(
                "the option `seeds {}`: expected 1 to {MAX_SEEDS}",
                self.seeds
            ));
        }
        if self.first_seed.checked_add(self.seeds).is_none() {
            return usage(format!("the option `seed {}`: too large", self.first_seed));
        }
        if self.frames == 0 {
            return usage("the option `frames 0`: expected at least 1".into());
        }
        let most = MAX_BASE * ASF_UNIT_CM;
        if let Some(bad) = self.base.iter().find(|b| !(0.0..=most).contains(*b)) {
            return usage(format!("the option `base {bad}`: expected 0 to {most} cm"));
        }
        if self.methods.is_empty() {
            return usage("no model given; use the option `models` or -m".into());
        }
        if self.tasks.is_empty() || self.base.is_empty() {
            return usage("at least one task and one base noise are needed".into());
        }
        let names = |what: &str, names: Vec<String>| {
            let twice = (1..names.len()).find(|&i| names[..i].contains(&names[i]));
            match twice {
                Some(i) => usage(format!("the option `{what}`: {} is given twice", names[i])),
                None => Ok(()),
            }
        };
        names(
            "models",
            self.methods.iter().map(|m| m.name.clone()).collect(),
        )?;
        names(
            "tasks",
            self.tasks.iter().map(|t| t.name().into()).collect(),
        )?;
        names(
            "splits",
            self.splits.iter().map(|s| s.name().into()).collect(),
        )?;
        names("base", self.base.iter().map(f64::to_string).collect())
    }

    /// The seeds.
    pub(crate) fn seeds(&self) -> impl Iterator<Item = u64> + use<> {
        self.first_seed..self.first_seed + self.seeds
    }

    /// The tasks that are run with a base noise. Dense noise leaves no coordinate clean, so it runs
    /// with the first only.
    pub(crate) fn tasks_at(&self, base: f64) -> Vec<Task> {
        let first = self.base.first() == Some(&base);
        let tasks = self.tasks.iter().copied();
        tasks.filter(|t| first || *t != Task::Dense).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_named() {
        let good = || Settings {
            methods: vec![Method::parse("sparse").unwrap()],
            ..Settings::default()
        };
        good().check().unwrap();
        let says = |change: &dyn Fn(&mut Settings), part: &str| {
            let mut settings = good();
            change(&mut settings);
            let e = settings.check().unwrap_err();
            assert!(e.to_string().contains(part) && e.exit_code() == 2, "{e}");
        };
        says(&|s| s.seeds = 0, "the option `seeds 0`");
        says(&|s| s.first_seed = u64::MAX, "the option `seed ");
        says(&|s| s.frames = 0, "the option `frames 0`");
        says(&|s| s.base = vec![f64::NAN], "the option `base NaN`");
        says(&|s| s.base = vec![0.0, 0.0], "twice");
        says(&|s| s.methods.clear(), "no model");
        says(&|s| s.tasks.clear(), "at least one");
        says(&|s| s.splits = vec![Split::Takes; 2], "twice");
        let mut two = good();
        two.base = vec![0.0, 1.0];
        assert_eq!((two.tasks_at(0.0).len(), two.tasks_at(1.0).len()), (3, 2));
    }
}

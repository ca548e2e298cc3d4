//! The settings of a benchmark, and the TOML file that holds them.

use super::method::Method;
use super::splits::Split;
use super::task::Task;
use crate::pose::{ASF_UNIT_CM, joints};
use crate::{Error, Place, Result};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Largest number of seeds of a run.
const MAX_SEEDS: u64 = 10_000;
/// Largest base noise, asf. More would be a task of its own.
const MAX_BASE: f64 = 10.0;

/// A length in a TOML file: `"0.05asf"`, or a number of centimetres.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Length {
    /// A length with or without a unit.
    Text(String),
    /// Centimetres.
    Number(f64),
}

/// The content of the TOML file; every key may be absent.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Tables of poses, relative to the file's folder.
    pub tables: Option<Vec<String>>,
    /// Methods by name.
    pub models: Option<Vec<String>>,
    /// Trained models, relative to the file's folder.
    pub model_files: Option<Vec<String>>,
    /// dense, sparse, complete.
    pub tasks: Option<Vec<String>>,
    /// frames, takes, subjects.
    pub splits: Option<Vec<String>>,
    /// The number of seeds.
    pub seeds: Option<u64>,
    /// The first seed.
    pub seed: Option<u64>,
    /// Test frames a split, at most.
    pub frames: Option<usize>,
    /// Base noise on clean coordinates.
    pub base: Option<Vec<Length>>,
    /// The points that completion observes.
    pub observe: Option<Vec<String>>,
    /// The folder for results, relative to the file's folder.
    pub output: Option<String>,
    /// The subject of a take, where the take's name does not begin with it.
    pub subjects: BTreeMap<String, String>,
}

impl Config {
    /// Parses the text; `name` names the file in messages.
    ///
    /// # Errors
    /// [`Error::Data`] with file and line, also for an unknown key.
    pub fn parse(text: &str, name: &str) -> Result<Config> {
        toml::from_str(text).map_err(|e| {
            let at = e.span().map_or(0, |s| s.start.min(text.len()));
            let line = 1 + text.as_bytes()[..at]
                .iter()
                .filter(|b| **b == b'\n')
                .count();
            let what: Vec<&str> = e.message().lines().collect();
            Error::data(Place::line(name, line as u64), what.join(" "))
        })
    }
}

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
    /// Largest number of test frames of a split, and of training frames for the training error; at least 1.
    pub frames: usize,
    /// Standard deviations of the base noise on clean coordinates, cm, 0 to 10 asf.
    pub base: Vec<f64>,
    /// The points that completion observes.
    pub observe: Vec<String>,
    /// Whether example poses are restored, too (see [`super::examples`]).
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
            return usage(format!("--seeds {}: expected 1 to {MAX_SEEDS}", self.seeds));
        }
        if self.first_seed.checked_add(self.seeds).is_none() {
            return usage(format!("--seed {}: too large", self.first_seed));
        }
        if self.frames == 0 {
            return usage("--frames 0: expected at least 1".into());
        }
        let most = MAX_BASE * ASF_UNIT_CM;
        if let Some(bad) = self.base.iter().find(|b| !(0.0..=most).contains(*b)) {
            return usage(format!("--base {bad}: expected 0 to {most} cm"));
        }
        if self.methods.is_empty() {
            return usage("no model given; use --models or -m".into());
        }
        if self.tasks.is_empty() || self.base.is_empty() {
            return usage("at least one task and one base noise are needed".into());
        }
        let names = |what: &str, names: Vec<String>| {
            let twice = (1..names.len()).find(|&i| names[..i].contains(&names[i]));
            match twice {
                Some(i) => usage(format!("--{what}: {} is given twice", names[i])),
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
    pub fn seeds(&self) -> impl Iterator<Item = u64> + use<> {
        self.first_seed..self.first_seed + self.seeds
    }

    /// The tasks that are run with a base noise. Dense noise leaves no coordinate clean, so it runs with the first only.
    pub fn tasks_at(&self, base: f64) -> Vec<Task> {
        let first = self.base.first() == Some(&base);
        let tasks = self.tasks.iter().copied();
        tasks.filter(|t| first || *t != Task::Dense).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_parsed() {
        let text = "tables = [\"01.csv\"]\nmodels = [\"sparse\", \"ksvd:n=500\"]\nseeds = 3\nbase = [0, \"0.05asf\"]\n[subjects]\nwalk = \"anna\"\n";
        let config = Config::parse(text, "x.toml").unwrap();
        assert_eq!(config.seeds, Some(3));
        let base = [Length::Number(0.0), Length::Text("0.05asf".into())];
        assert_eq!(config.base, Some(base.to_vec()));
        assert_eq!(config.subjects["walk"], "anna");
        assert_eq!(Config::parse("", "x").unwrap(), Config::default());
    }

    #[test]
    fn unknown_keys_and_wrong_values_are_refused_with_file_and_line() {
        for (text, line, part) in [
            ("seeds = 3\nsplit = [\"takes\"]\n", 2, "split"),
            ("\n\nseeds = \"x\"\n", 3, "u64"),
            ("seeds = 1\nseeds = 2\n", 2, "duplicate"),
            ("seeds = \n", 1, ""),
            ("[more]\nx = 1", 1, "more"),
        ] {
            let e = Config::parse(text, "x.toml").unwrap_err();
            let said = e.to_string();
            assert!(said.starts_with(&format!("x.toml:{line}: ")), "{said}");
            assert!(said.contains(part) && said.lines().count() == 1, "{said}");
            assert_eq!(e.exit_code(), 1);
        }
    }

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
        says(&|s| s.seeds = 0, "--seeds 0");
        says(&|s| s.first_seed = u64::MAX, "--seed");
        says(&|s| s.frames = 0, "--frames 0");
        says(&|s| s.base = vec![f64::NAN], "--base NaN");
        says(&|s| s.base = vec![0.0, 0.0], "twice");
        says(&|s| s.methods.clear(), "no model");
        says(&|s| s.tasks.clear(), "at least one");
        says(&|s| s.splits = vec![Split::Takes; 2], "twice");
        let mut two = good();
        two.base = vec![0.0, 1.0];
        assert_eq!((two.tasks_at(0.0).len(), two.tasks_at(1.0).len()), (3, 2));
    }
}

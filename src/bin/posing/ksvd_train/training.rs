//! `ksvd-train` around the library: its flags, the log, the checkpoint, the progress bar.

use ndarray::ArrayView2;
use posing::cli::args::{Space, parse_positive};
use posing::cli::choice::{choice, value_name};
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::{input, messages};
use posing::io::input::ContentKind;
use posing::io::{Input, Model, Table, TableOptions};
use posing::prior::provenance::digest;
use posing::prior::{TrainingSet, sparse_coding};
use posing::sparse::{
    Dictionary, Encoder, GrowthSearch, IterationStats, Ksvd, SelectionRule, TrainingState,
    random_atoms,
};
use posing::{Error, Place, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The flags of the training.
#[derive(Debug, Clone, clap::Args)]
pub struct KsvdArgs {
    /// Number of atoms, at most the number of poses
    #[arg(
        short = 'n',
        long = "atoms",
        value_name = "ATOMS",
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    pub atoms: Option<u32>,
    /// Choose the number of atoms: grow the dictionary until the training RMS of a coordinate, in
    /// cm, is at most this (Lai et al.'s search: delta 2, growth 1.5)
    #[arg(long, value_name = "RMS", value_parser = parse_positive)]
    pub error: Option<f64>,
    /// Largest number of atoms per pose, 1 to 1000
    #[arg(
        long,
        value_name = "K",
        default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..=1000)
    )]
    pub sparsity: u32,
    /// Number of iterations
    #[arg(long, value_name = "N", default_value_t = 30)]
    pub iterations: u32,
    /// Initial atoms: a dictionary, or a table whose rows are scaled to unit norm (default: random
    /// poses)
    #[arg(long, value_name = "DICT.npz|TABLE")]
    pub init: Option<PathBuf>,
    /// Validation table; its error is reported after each iteration
    #[arg(long, value_name = "FILE")]
    pub valid: Option<PathBuf>,
    /// Save the state to FILE after each iteration, and resume from FILE if it exists
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<OutputPath>,
    /// Write one line of JSON per iteration
    #[arg(long, value_name = "FILE")]
    pub log: Option<OutputPath>,
    /// Space in which poses are learned
    #[arg(long, value_parser = choice::<Space>(), default_value = "world")]
    pub space: Space,
    /// For a dictionary: rule that selects the next atom
    #[arg(long, value_parser = choice::<SelectionRule>(), default_value = "oomp")]
    pub pursuit: SelectionRule,
    /// Replace an atom whose coherence with a more used one exceeds C by the pose with the largest
    /// error (default: off)
    #[arg(long, value_name = "C", value_parser = parse_positive)]
    pub coherence: Option<f64>,
}

impl KsvdArgs {
    /// The parameters of K-SVD.
    pub fn ksvd(&self, seed: u64) -> Ksvd {
        let defaults = Ksvd::default();
        Ksvd {
            atoms: self.atoms.map_or(defaults.atoms, |n| n as usize),
            seed,
            iterations: self.iterations as usize,
            sparsity: self.sparsity as usize,
            rule: self.pursuit,
            coherence: self.coherence,
            target: self.error,
            ..defaults
        }
    }

    /// The dictionary of `--init`: a model's atoms, or a table's poses.
    ///
    /// # Errors
    /// Data: the points or the space differ from those of the training poses. Usage: `-n`
    /// contradicts the number of atoms.
    pub fn initial(&self, poses: &TrainingSet) -> Result<Option<Dictionary>> {
        let Some(path) = &self.init else {
            return Ok(None);
        };
        let input = input::open(path)?;
        let name = input.name.clone();
        let dictionary = if input.kind() == ContentKind::Npz {
            let model = Model::read(input)?;
            if model.meta.points != poses.points || model.meta.space != value_name(self.space) {
                let what = "is a dictionary whose points or space differ from the training poses'";
                return Err(Error::data(Place::file(&name), what));
            }
            sparse_coding::dictionary(&model, &name)?
        } else {
            let table = Table::read(input, &TableOptions::default())?;
            Dictionary::from_rows(poses.comparable(&table.poses, &name)?.xyz.view())?
        };
        match self.atoms {
            Some(n) if n as usize != dictionary.len() => Err(Error::usage(format!(
                "-n {n} contradicts --init, which has {} atoms",
                dictionary.len()
            ))),
            _ => Ok(Some(dictionary)),
        }
    }

    /// The atoms to start from: those given, those of the size search, or random poses.
    ///
    /// # Errors
    /// As [`GrowthSearch::start`] and [`random_atoms`].
    pub fn start(
        &self,
        ksvd: &Ksvd,
        poses: ArrayView2<'_, f32>,
        init: Option<Dictionary>,
    ) -> Result<Dictionary> {
        let dictionary = match (init, self.error) {
            (Some(init), _) => init,
            (None, None) => random_atoms(poses, ksvd.atoms, ksvd.seed)?,
            (None, Some(error)) => {
                let search = GrowthSearch {
                    error,
                    seed: ksvd.seed,
                    omp: ksvd.omp(),
                    ..GrowthSearch::default()
                };
                let found = search.start(poses, &mut |t| {
                    messages::debug(&format!("{} atoms: RMS {:.4} cm", t.atoms, t.rms));
                })?;
                messages::info(&format!("starting from {} atoms", found.dictionary.len()));
                found.dictionary
            }
        };
        let search = Encoder::new(&dictionary, ksvd.omp())?.strategy(poses.nrows());
        messages::debug(&format!("{} atoms, search {search}", dictionary.len()));
        Ok(dictionary)
    }

    /// The flags that change numbers, for the model's history.
    pub fn history(
        &self,
        seed: u64,
        init: Option<&Dictionary>,
        poses: &TrainingSet,
    ) -> Vec<(&'static str, String)> {
        let mut flags = vec![
            ("sparsity", self.sparsity.to_string()),
            ("iterations", self.iterations.to_string()),
            ("pursuit", value_name(self.pursuit)),
            ("space", value_name(self.space)),
            ("seed", seed.to_string()),
        ];
        flags.extend(self.atoms.map(|n| ("atoms", n.to_string())));
        flags.extend(self.error.map(|e| ("error", e.to_string())));
        flags.extend(self.coherence.map(|c| ("coherence", c.to_string())));
        flags.extend(init.map(|d| ("init", digest(&poses.points, d.atoms()))));
        flags
    }
}

/// A training run with its checkpoint and log.
pub struct TrainingRun<'a> {
    /// The parameters.
    pub ksvd: &'a Ksvd,
    /// (m, D).
    pub poses: ArrayView2<'a, f32>,
    /// (v, D).
    pub validation: Option<ArrayView2<'a, f32>>,
    /// Identifies poses and flags: a checkpoint of another run is refused.
    pub digest: String,
    /// The number of atoms, if known before training.
    pub atoms: Option<usize>,
    /// The file of the checkpoint.
    pub checkpoint: Option<&'a Path>,
    /// The file that gets a line of JSON per iteration.
    pub log: Option<&'a Path>,
}

impl TrainingRun<'_> {
    /// Trains from the checkpoint if there is one, else from the dictionary that `start` returns.
    pub fn train(&self, start: impl FnOnce() -> Result<Dictionary>) -> Result<TrainingState> {
        let resumed = self.resume()?;
        let mut log = self.open_log(resumed.as_ref().map(TrainingState::iteration))?;
        let bar = Progress::new("ksvd-train", self.ksvd.iterations as u64);
        let began = Instant::now();
        let mut observe = |state: &TrainingState| -> Result<()> {
            let Some(report) = state.history.last() else {
                return Ok(());
            };
            bar.set(report.iteration as u64);
            bar.set_message(format!("RMS {:.3} cm", report.fresh_rms));
            messages::debug(&format!(
                "iteration {}: RMS {:.4} cm",
                report.iteration, report.fresh_rms
            ));
            if let Some((file, path)) = &mut log {
                write_log(file, path, report, began.elapsed().as_secs_f64())?;
            }
            self.save(state)
        };
        match resumed {
            Some(mut state) => {
                messages::info(&format!(
                    "resuming from iteration {} of the checkpoint",
                    state.iteration()
                ));
                self.ksvd
                    .run(&mut state, self.poses, self.validation, &mut observe)?;
                Ok(state)
            }
            None => self
                .ksvd
                .train_from(start()?, self.poses, self.validation, &mut observe),
        }
    }

    /// Removes the checkpoint of a finished run.
    pub fn finish(&self) -> Result<()> {
        match self.checkpoint.filter(|p| p.exists()) {
            Some(path) => std::fs::remove_file(path).map_err(|e| Error::io(path, e)),
            None => Ok(()),
        }
    }

    /// A new run starts its log afresh. One that goes on after iteration `resumed` keeps the lines
    /// up to that one: the run that was stopped may have logged one more.
    fn open_log(&self, resumed: Option<usize>) -> Result<Option<(std::fs::File, PathBuf)>> {
        let Some(path) = self.log else {
            return Ok(None);
        };
        let fail = |e| Error::io(path, e);
        let kept = match resumed.filter(|_| path.is_file()) {
            Some(last) => lines_up_to(&std::fs::read_to_string(path).map_err(fail)?, last),
            None => String::new(),
        };
        let mut file = std::fs::File::create(path).map_err(fail)?;
        file.write_all(kept.as_bytes()).map_err(fail)?;
        Ok(Some((file, path.to_path_buf())))
    }

    /// The state after an iteration is its dictionary and history: its codes are those of coding
    /// anew.
    fn save(&self, state: &TrainingState) -> Result<()> {
        let Some(path) = self.checkpoint else {
            return Ok(());
        };
        let mut model = Model::new("checkpoint", &["checkpoint".to_string()], "body");
        let json = |e: serde_json::Error| Error::data(Place::file("checkpoint"), e.to_string());
        model
            .meta
            .details
            .insert("digest".into(), self.digest.clone().into());
        model.meta.details.insert(
            "history".into(),
            serde_json::to_value(&state.history).map_err(json)?,
        );
        model.insert("atoms", state.dictionary.atoms().to_owned());
        model.save(path)
    }

    fn resume(&self) -> Result<Option<TrainingState>> {
        let Some(path) = self.checkpoint.filter(|p| p.exists()) else {
            return Ok(None);
        };
        let name = path.display().to_string();
        let fail = |what: &str| Error::data(Place::file(&name), what);
        let model = Model::read(Input::open(path)?)?;
        let details = &model.meta.details;
        if model.meta.kind != "checkpoint" {
            return Err(fail("is not a checkpoint of ksvd-train"));
        }
        if details.get("digest").and_then(|d| d.as_str()) != Some(&self.digest) {
            return Err(fail(
                "is the checkpoint of a run with other poses or flags; remove it to start again",
            ));
        }
        let history: Vec<IterationStats> = details
            .get("history")
            .and_then(|h| serde_json::from_value(h.clone()).ok())
            .ok_or_else(|| fail("has no history; remove it to start again"))?;
        let damaged = |what: &str| fail(&format!("is damaged ({what}); remove it to start again"));
        let atoms = model.array("atoms", "checkpoint");
        let dictionary = (atoms.and_then(|a| Dictionary::from_rows(a.view())))
            .map_err(|e| damaged(&e.to_string()))?;
        let agrees = self.atoms.is_none_or(|n| n == dictionary.len());
        if !agrees || dictionary.width() != self.poses.ncols() {
            return Err(damaged("its atoms do not match this run"));
        }
        let codes = Encoder::new(&dictionary, self.ksvd.omp())?.encode(self.poses)?;
        Ok(Some(TrainingState {
            dictionary,
            support: codes.atoms,
            coefficients: codes.coefficients,
            history,
        }))
    }
}

/// The lines of a log up to an iteration.
fn lines_up_to(log: &str, last: usize) -> String {
    let iteration = |line: &str| {
        let line: serde_json::Value = serde_json::from_str(line).ok()?;
        line.get("iteration")?.as_u64()
    };
    let kept = log
        .lines()
        .filter(|line| iteration(line).is_some_and(|i| i <= last as u64));
    kept.map(|line| format!("{line}\n")).collect()
}

fn write_log(
    file: &mut std::fs::File,
    path: &Path,
    report: &IterationStats,
    seconds: f64,
) -> Result<()> {
    #[derive(serde::Serialize)]
    struct Line<'a> {
        #[serde(flatten)]
        report: &'a IterationStats,
        seconds: f64,
    }
    let mut line = serde_json::to_string(&Line { report, seconds }).unwrap_or_default();
    line.push('\n');
    file.write_all(line.as_bytes())
        .map_err(|e| Error::io(path, e))
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_log_ends_with_the_iteration_of_the_checkpoint() {
        let log = "{\"iteration\":1,\"rms\":2.0}\n{\"iteration\":2}\n{\"iteration\":3}\n{\"iter";
        let kept = super::lines_up_to(log, 2);
        assert_eq!(kept, "{\"iteration\":1,\"rms\":2.0}\n{\"iteration\":2}\n");
    }
}

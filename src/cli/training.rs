//! What `ksvd-train` does around the library: the log, the checkpoint, the bar.

use super::progress::Progress;
use super::{input, messages};
use crate::io::{Input, Model};
use crate::pose::Space;
use crate::prior::{Kind, TrainingSet, multiscale};
use crate::sparse::{Dictionary, Encoder, IterationStats, Ksvd, TrainingState};
use crate::{Error, Place, Result};
use ndarray::ArrayView2;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A training run: what it learns from, and where it leaves its traces.
pub struct Run<'a> {
    /// The parameters.
    pub ksvd: &'a Ksvd,
    /// (m, D).
    pub poses: ArrayView2<'a, f32>,
    /// (v, D).
    pub validation: Option<ArrayView2<'a, f32>>,
    /// Says which run a checkpoint belongs to.
    pub digest: String,
    /// How many atoms are asked for, where a number is.
    pub atoms: Option<usize>,
    /// Where the state is kept.
    pub checkpoint: Option<&'a Path>,
    /// Where each iteration leaves a line of JSON.
    pub log: Option<&'a Path>,
}

impl Run<'_> {
    /// Trains, from the checkpoint if there is one, else from what `start` gives.
    pub fn train(&self, start: impl FnOnce() -> Result<Dictionary>) -> Result<TrainingState> {
        let resumed = self.resume()?;
        let mut log = self.open_log(resumed.is_some())?;
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

    fn open_log(&self, append: bool) -> Result<Option<(std::fs::File, PathBuf)>> {
        let Some(path) = self.log else {
            return Ok(None);
        };
        let mut options = std::fs::OpenOptions::new();
        options.create(true);
        // A resumed run goes on with its log; a new one starts it afresh.
        if append {
            options.append(true)
        } else {
            options.write(true).truncate(true)
        };
        let file = options.open(path).map_err(|e| Error::io(path, e))?;
        Ok(Some((file, path.to_path_buf())))
    }

    /// The state after an iteration is its dictionary and history: its codes are those of coding anew.
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
        let asked = self.atoms.is_none_or(|n| n == dictionary.len());
        if !asked || dictionary.width() != self.poses.ncols() {
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

/// Reads the poses of a file in the flags of a table, ready for learning.
pub fn ready(
    flags: &super::args::InputArgs,
    files: Vec<PathBuf>,
    world: bool,
    like: Option<&TrainingSet>,
) -> Result<TrainingSet> {
    let flags = super::args::InputArgs {
        files,
        ..flags.clone()
    };
    let table = input::read_table(&flags, false, false)?;
    let ready = match like {
        Some(like) => like.comparable(&table.poses, &table.name)?,
        None => {
            let space = if world { Space::World } else { Space::Body };
            TrainingSet::from_poses(&table.poses, space, &table.name)?
        }
    };
    for (count, why) in [
        (ready.incomplete, "skipped: missing points"),
        (
            ready.unplaced,
            "skipped: cannot be placed in the model's space",
        ),
    ] {
        if count > 0 {
            messages::info(&format!("{count} of {} frames {why}", table.poses.frames()));
        }
    }
    Ok(ready)
}

/// The size of a multi-scale mixture.
#[derive(Debug, Clone, clap::Args)]
pub struct MultiscaleArgs {
    /// For multiscale: comma-separated number of clusters of each level, increasing (default: 1,5,20,80,300)
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        help_heading = "Size"
    )]
    pub cells: Option<Vec<usize>>,
    /// For multiscale: largest number of training poses kept as components of their own (default: 80000)
    #[arg(long, value_name = "N", help_heading = "Size")]
    pub leaves: Option<usize>,
}

impl MultiscaleArgs {
    /// The settings of a mixture of another size than the default, where one is asked for.
    ///
    /// # Errors
    /// When the flags are given for another kind of model.
    pub fn settings(&self, kind: Kind) -> Result<Option<multiscale::TrainSettings>> {
        if self.cells.is_none() && self.leaves.is_none() {
            return Ok(None);
        }
        if kind != Kind::Multiscale {
            let what = "--cells and --leaves are for --kind multiscale";
            return Err(Error::usage(what));
        }
        let mut settings = multiscale::TrainSettings::default();
        if let Some(cells) = &self.cells {
            settings.clusters.clone_from(cells);
        }
        if let Some(leaves) = self.leaves {
            settings.max_exemplars = leaves;
        }
        Ok(Some(settings))
    }
}

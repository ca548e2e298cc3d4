//! `evaluate takes` around the library: its flags, its model, its files.

use super::{rows_of, sources, write};
use clap::Args;
use posing::Result;
use posing::cli::args::TimedTableArgs;
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::{input, messages};
use posing::evaluate::restoration::{GapLength, TakesSettings, TestTakes, TestedModel};
use posing::pose::units::parse_length;
use serde_json::json;
use std::path::PathBuf;

/// Test how well takes are restored: gaps and noise, beside PCHIP, linear, a Gaussian and a
/// Butterworth filter
///
/// Cuts gaps into copies of stretches of the takes (at most 12.5 s), fills them, and compares
/// with what was cut out. Adds noise to a stretch of each take and removes it. Each subject
/// is restored by a model trained here on all other subjects, unless -m or --self is given.
/// Tables are in world space, with times.
///
/// Prints the RMS error in gaps beside that of the rivals (* marks the lowest), its ratio to
/// the best of them with a 95% interval (bootstrap over gaps), the share of coordinates
/// within one and two of the stated standard deviations, and the error left of noise.
#[derive(Debug, Clone, Args)]
pub struct EvaluateTakesArgs {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Model to test, which must not have been trained on these takes (default: for each subject,
    /// one trained here on all other subjects; a take's subject is its name up to the first _)
    #[arg(short, long, value_name = "MODEL.npz", help_heading = "Model")]
    model: Option<PathBuf>,
    /// Test without a model: takes restored by their own frames alone
    #[arg(long = "self", conflicts_with = "model", help_heading = "Model")]
    take_alone: bool,
    /// Comma-separated lengths of gaps, in seconds; end: lost a second before a stretch ends
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        value_parser = gap_length,
        default_value = "0.1,0.3,0.6,1,2"
    )]
    lengths: Vec<GapLength>,
    /// Comma-separated numbers of points in a gap
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "1,3,8"
    )]
    points: Vec<usize>,
    /// Number of gaps for each length and number of points
    #[arg(long, value_name = "N", default_value_t = 20)]
    gaps: usize,
    /// Comma-separated standard deviations of noise on every coordinate, in cm or with a unit; the
    /// largest is also put on a fifth of the points
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        value_parser = parse_length,
        default_value = "0,0.1,0.3,1,5"
    )]
    noise: Vec<f64>,
    /// Seed of all random draws
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Also write takes.csv and report.html into DIR
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<OutputPath>,
    #[command(flatten)]
    json: JsonArgs,
}

fn gap_length(text: &str) -> std::result::Result<GapLength, String> {
    match text.trim() {
        "end" => Ok(GapLength::ToTheEnd),
        text => posing::cli::args::parse_positive(text).map(GapLength::Seconds),
    }
}

impl EvaluateTakesArgs {
    /// Tests how well takes are restored, and prints tables.
    ///
    /// # Errors
    /// As [`TestTakes::test`]; also if a file cannot be read or written.
    pub fn work(&self) -> Result<()> {
        self.json.prepare_report();
        let tables = self.tables.input();
        input::check_single_stdin_with(&tables, &self.model)?;
        let takes = TestTakes::new(&sources(&tables, &tables.files)?)?;
        for take in &takes.untimed {
            messages::info(&format!(
                "take {take} is left out: its times give no frame rate"
            ));
        }
        let model = self.model.as_deref().map(input::open_model).transpose()?;
        let tested = match &model {
            Some(model) => TestedModel::Given(model),
            None if self.take_alone => TestedModel::TakeAlone,
            None => TestedModel::OthersOnly,
        };
        let described = match (&self.model, self.take_alone) {
            (Some(path), _) => path.display().to_string(),
            (None, true) => "no model, by their own frames alone".into(),
            (None, false) => "models of the other subjects".into(),
        };
        let settings = TakesSettings {
            lengths: self.lengths.clone(),
            points: self.points.clone(),
            gaps: self.gaps,
            noise: self.noise.clone(),
            seed: self.seed,
        };
        let bar = Progress::new("evaluate takes", Progress::SHARES);
        let report = takes.test(tested, &settings, &mut |what, share| {
            bar.set_share(what, share);
        })?;
        drop(bar);
        if let Some(folder) = &self.output {
            write(
                folder,
                &[
                    ("takes.csv", report.csv()),
                    ("report.html", report.html(&described)),
                ],
            )?;
        }
        self.json.write_report(
            None,
            || report.text(),
            json!({ "rows": rows_of(&report.csv()) }),
        )
    }
}

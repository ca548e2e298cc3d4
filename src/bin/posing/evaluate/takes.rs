//! `evaluate takes` around the library: its flags, its model, its files.

use super::benchmark::{sources, write};
use super::rows_of;
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

/// Flags of `evaluate takes`.
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

/// Tests how well takes are restored, and prints tables.
///
/// # Errors
/// As [`TestTakes::test`]; also if a file cannot be read or written.
pub fn evaluate_takes(args: &EvaluateTakesArgs) -> Result<()> {
    args.json.prepare_report();
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, &args.model)?;
    let takes = TestTakes::new(&sources(&tables, &tables.files)?)?;
    for take in &takes.untimed {
        messages::info(&format!(
            "take {take} is left out: its times give no frame rate"
        ));
    }
    let model = args.model.as_deref().map(input::open_model).transpose()?;
    let tested = match &model {
        Some(model) => TestedModel::Given(model),
        None if args.take_alone => TestedModel::TakeAlone,
        None => TestedModel::OthersOnly,
    };
    let described = match (&args.model, args.take_alone) {
        (Some(path), _) => path.display().to_string(),
        (None, true) => "no model, by their own frames alone".into(),
        (None, false) => "models of the other subjects".into(),
    };
    let settings = TakesSettings {
        lengths: args.lengths.clone(),
        points: args.points.clone(),
        gaps: args.gaps,
        noise: args.noise.clone(),
        seed: args.seed,
    };
    let bar = Progress::new("evaluate takes", Progress::SHARES);
    let report = takes.test(tested, &settings, &mut |what, share| {
        bar.set_share(what, share);
    })?;
    drop(bar);
    if let Some(folder) = &args.output {
        write(
            folder,
            &[
                ("takes.csv", report.csv()),
                ("report.html", report.html(&described)),
            ],
        )?;
    }
    args.json.write_report(
        None,
        || report.text(),
        json!({ "rows": rows_of(&report.csv()) }),
    )
}

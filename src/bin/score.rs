//! Compares poses with the truth.

use clap::Parser;
use posing::cli::aligned_tables::AlignedTables;
use posing::cli::args::{CommonArgs, InputArgs, Units, Up, parse_rate};
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages, run};
use posing::evaluate::{RunDetector, ScoreAccumulator, ScoredFrame};
use posing::pose::Poses;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare poses with the truth
///
/// Prints, in total and for each point, the number of coordinates, their mean squared error (MSE) and its root (RMS), the
/// mean distance of a point and the largest error of a coordinate; then the errors and variation of bone lengths, and
/// accelerations (jitter raises them above the truth's). The frames must be the same; points are matched by name.
/// Coordinates missing in TRUTH are left out; those missing in RESULT are counted as still missing. Memory is constant;
/// the first 1024 frames of a take give its rate.
#[derive(Parser)]
#[command(
    name = "score",
    version,
    after_help = "Examples:\n  posing score truth.csv denoised.csv\n  posing score --damaged gaps.csv truth.csv completed.csv\n  posing denoise noisy.csv | posing score --units asf --json truth.csv -"
)]
struct Args {
    /// True poses, CSV or NPY; - for standard input
    #[arg(value_name = "TRUTH")]
    truth: PathBuf,
    /// Poses to score, CSV or NPY; - for standard input
    #[arg(value_name = "RESULT")]
    result: PathBuf,
    /// The table that RESULT was restored from: adds the errors where it was missing (by gap length), observed and changed
    #[arg(long, value_name = "TABLE")]
    damaged: Option<PathBuf>,
    /// Unit of the printed errors; the paper uses asf. Tables are in centimetres
    #[arg(long, value_enum, value_name = "UNIT", default_value = "cm")]
    units: Units,
    /// Print one JSON object with all digits
    #[arg(long)]
    json: bool,
    /// Frames per second, for tables without times
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
    /// Point names for an NPY array: 23 (the CMU joints) or a comma-separated list
    #[arg(long, value_name = "LIST", help_heading = "Input")]
    joints: Option<String>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    let files = [Some(&args.truth), Some(&args.result), args.damaged.as_ref()];
    let inputs: Vec<InputArgs> = files
        .into_iter()
        .flatten()
        .map(|f| table(args, f))
        .collect();
    let mut tables = AlignedTables::open(&inputs)?;
    for (name, count) in tables.left_out().filter(|(_, count)| *count > 0) {
        let truth = args.truth.display();
        let noun = if count == 1 { "point" } else { "points" };
        messages::info(&format!(
            "{name}: ignored {count} {noun} that {truth} does not have"
        ));
    }
    let mut runs = RunDetector::default();
    let mut scores = ScoreAccumulator::new(tables.points(), args.damaged.is_some());
    let rate = |take: &Poses| inputs[0].rate(take);
    tables.for_each_with_rate(rate, |step, rate| {
        scores.add(&ScoredFrame {
            truth: &step.xyz[0],
            result: &step.xyz[1],
            damaged: step.xyz.get(2).map(Vec::as_slice),
            starts_run: runs.starts(step.time, &step.take, rate),
            rate,
        });
    })?;
    if scores.frames() == 0 {
        let place = Place::file(args.truth.display().to_string());
        return Err(Error::data(place, "has no frames to compare"));
    }
    let report = scores.finish(args.units.name(), args.units.centimetres());
    let mut out = report.to_string();
    if args.json {
        out = serde_json::to_string(&report).map_err(|e| Error::usage(e.to_string()))? + "\n";
    }
    write_bytes(args.output.as_deref(), out.as_bytes(), false)?;
    Ok(Outcome::Done)
}

/// How one file is read.
fn table(args: &Args, file: &Path) -> InputArgs {
    InputArgs {
        files: vec![file.to_path_buf()],
        fps: args.fps,
        joints: args.joints.clone(),
        units: Units::Cm,
        up: Up::Y,
    }
}

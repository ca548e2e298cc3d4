//! Compares poses with the truth.

use clap::Parser;
use posing::cli::aligned_tables::AlignedTables;
use posing::cli::args::{CommonArgs, InputArgs, Units, Up, parse_rate};
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages, run};
use posing::evaluate::score::{RunDetector, ScoreSums, ScoredFrame};
use posing::evaluate::score_report::text;
use posing::pose::Poses;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare poses with the truth
///
/// Prints the mean squared error of a coordinate (MSE), its root (RMS), the mean distance of a point, the largest error
/// of a coordinate, and over how many coordinates; all in all and by point, then how far bone lengths differ and vary,
/// and the accelerations (a trembling result has more than the truth). Frames must be the same; points are matched by
/// name. Coordinates that TRUTH lacks do not count; those that RESULT lacks are counted as still missing. Tables are read
/// in step in constant memory; a take's rate is told by its first 1024 frames.
#[derive(Parser)]
#[command(
    name = "score",
    version,
    after_help = "Examples:\n  posing score truth.csv denoised.csv\n  posing score --damaged gaps.csv truth.csv completed.csv\n  posing denoise noisy.csv | posing score --units asf --json truth.csv -"
)]
struct Args {
    /// The true poses, CSV or NPY; - for standard input
    #[arg(value_name = "TRUTH")]
    truth: PathBuf,
    /// The poses to judge, CSV or NPY; - for standard input
    #[arg(value_name = "RESULT")]
    result: PathBuf,
    /// What RESULT was made from: judge what was missing there (by the length of the gap), observed, and changed
    #[arg(long, value_name = "TABLE")]
    damaged: Option<PathBuf>,
    /// The unit of what is printed (tables are in centimetres); the paper's figures are in asf
    #[arg(long, value_enum, value_name = "UNIT", default_value = "cm")]
    units: Units,
    /// Print one JSON object, with all digits
    #[arg(long)]
    json: bool,
    /// Frames a second, where no table has a time
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
    /// The points' names of an array without any: 23 (CMU's) or a list with commas
    #[arg(long, value_name = "LIST", help_heading = "Input")]
    joints: Option<String>,
    /// Write to FILE (complete or not at all) in place of standard output
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
        messages::info(&format!(
            "{name}: left out {count} of its points, which {truth} has not"
        ));
    }
    let mut runs = RunDetector::default();
    let mut scores = ScoreSums::new(tables.points(), args.damaged.is_some());
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
        return Err(Error::data(place, "has no frames, nothing can be compared"));
    }
    let report = scores.finish(args.units.name(), args.units.centimetres());
    let mut out = text(&report);
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

//! Puts the labels of takes right.

use clap::Parser;
use posing::clean::write_labeled;
use posing::cli::args::CommonArgs;
use posing::cli::batch::{BatchJob, EXTENSIONS, batch, each};
use posing::cli::label_args::LikeArgs;
use posing::cli::read_args::ReadArgs;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::io::MotionFile;
use posing::label::{LabelSettings, check_labels};
use posing::pose::Segment;
use posing::{Error, Result};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Put labels right: markers that changed places, pieces without a label, reflections
///
/// Reads takes of markers or points (C3D, TRC, Motive CSV, Qualisys TSV, NPZ, pose tables) and
/// writes each in its own format. Markers that changed places are put back, pieces of tracks
/// without a label (*68, Unlabeled 3) joined to the labels that they are, and stretches of a label
/// away from its marker taken out. No position changes: each moves to its label, or leaves it, with
/// its residual, its cameras and its digits. How tracks go on and what distances within the body
/// say decides; of a swap of most of a take, the mirror image of the body. What is not sure stays
/// as it was, and is told. Several people (Ann:LFHD, Ben:LFHD) are looked at one by one.
///
/// Beside each result, RESULT.json has every change with the evidence for it and the positions that
/// were taken out, and, where something changed or is not sure, RESULT.html plays the take before
/// and after. Exit code 3: something is not sure.
#[derive(Parser)]
#[command(
    name = "label",
    version,
    after_help = "Examples:\n  posing label gait.c3d -o labeled.c3d\n  posing label captures/ -o \
                  labeled/ --up y || echo something is not sure\n  posing label --dry-run walk.csv"
)]
pub struct Args {
    /// Takes, and folders that are searched for them
    #[arg(value_name = "TAKE", required = true)]
    inputs: Vec<PathBuf>,
    /// Write the result of one take to OUT, results of several into the folder DIR
    #[arg(
        short,
        long,
        value_name = "OUT|DIR",
        required_unless_present = "dry_run",
        help_heading = "Output"
    )]
    output: Option<PathBuf>,
    /// Say what would be changed, and write nothing
    #[arg(long, conflicts_with = "output", help_heading = "Output")]
    dry_run: bool,
    /// Write what is changed to standard output as JSON, a line for each take
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
    /// Keep the label of a point in a stretch, in seconds as the file has them: LFHD:1.2-1.9 (may
    /// be given again, of one take)
    #[arg(
        long,
        value_name = "NAME:FROM-TO",
        value_parser = Segment::parse,
        help_heading = "Method"
    )]
    keep_labels: Vec<Segment>,
    #[command(flatten)]
    like: LikeArgs,
    #[command(flatten)]
    common: CommonArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    // A dry run has places for results as well, and writes none.
    let output = args.output.as_deref().or(Some(Path::new("-")));
    let kept: Vec<&Path> = args.like.like.iter().map(|path| path.as_path()).collect();
    let jobs = batch(&args.inputs, output, &EXTENSIONS, None, &kept)?;
    if jobs.len() > 1 && !args.keep_labels.is_empty() {
        let what = "--keep-labels is for a stretch of one take; give that file alone";
        return Err(Error::usage(what));
    }
    let settings = LabelSettings {
        keep: args.keep_labels.clone(),
        like: args.like.templates(&args.read)?,
        ..LabelSettings::default()
    };
    each(&jobs, |one| label(args, &settings, one))
}

fn label(args: &Args, settings: &LabelSettings, job: &BatchJob) -> Result<Outcome> {
    let file = MotionFile::open_by(&job.input, &args.read.rules()?)?;
    let report = check_labels(&file, settings)?;
    let name = job.input.display().to_string();
    match args.json {
        true => {
            let line = json!({"file": name, "labels": report});
            write_bytes(None, format!("{line}\n").as_bytes(), false)?;
        }
        false => {
            let lines = report.lines();
            lines.for_each(|line| messages::info(&format!("{name}: {line}")));
        }
    }
    if let Some(path) = job.output.as_deref().filter(|_| !args.dry_run) {
        let note = write_labeled(&job.input, path, &file, &report)?;
        note.iter()
            .for_each(|note| messages::info(&format!("{name}: {note}")));
    }
    Ok(match report.unsure.is_empty() {
        true => Outcome::Done,
        false => Outcome::Findings,
    })
}

//! Puts the labels of takes right.

use clap::Parser;
use posing::cli::args::CommonArgs;
use posing::cli::batch::{BatchJob, EXTENSIONS, batch, each};
use posing::cli::read_args::ReadArgs;
use posing::cli::{Outcome, messages};
use posing::io::MotionFile;
use posing::label::{LabelSettings, check_labels};
use posing::{Error, Result};
use std::path::{Path, PathBuf};

/// Put labels right: markers that changed places, pieces without a label, reflections
///
/// Reads takes of markers or points (C3D, TRC, Motive CSV, Qualisys TSV, NPZ, pose tables) and
/// writes each in its own format. Markers that changed places are put back, pieces of tracks
/// without a label (*68, Unlabeled 3) joined to the labels that they are, and stretches of a label
/// away from its marker taken out. No position changes: each moves to its label, or leaves it, with
/// its residual, its cameras and its digits. How tracks go on and what distances within the body
/// say decides; of a swap of most of a take, the mirror image of the body. What is not sure stays
/// as it was, and is told. Exit code 3: something is not sure.
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
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    common: CommonArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    // A dry run has places for results as well, and writes none.
    let output = args.output.as_deref().or(Some(Path::new("-")));
    let jobs = batch(&args.inputs, output, &EXTENSIONS, None, &[])?;
    each(&jobs, |one| label(args, one))
}

fn label(args: &Args, job: &BatchJob) -> Result<Outcome> {
    let file = MotionFile::open_by(&job.input, &args.read.rules()?)?;
    let report = check_labels(&file, &LabelSettings::default())?;
    let name = job.input.display();
    let changes = report.changes.iter().map(|c| &c.what);
    let unsure = report.unsure.iter().map(|u| &u.what);
    for line in changes.chain(unsure).chain(&report.unchecked) {
        messages::info(&format!("{name}: {line}"));
    }
    if let Some(path) = job.output.as_deref().filter(|_| !args.dry_run) {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        }
        file.write_moved(path, &report.moves)?;
    }
    Ok(match report.unsure.is_empty() {
        true => Outcome::Done,
        false => Outcome::Findings,
    })
}

//! Fills in what a capture did not see.

use clap::Parser;
use posing::Result;
use posing::cli::args::parse_positive;
use posing::cli::motion_library::open_library;
use posing::cli::paths::OutputPath;
use posing::cli::restoring::{RestoringArgs, Task, restore};
use posing::io::parse_point_names;
use posing::restore::Complete;
use std::path::{Path, PathBuf};

/// Fill gaps and missing points
///
/// Fills empty cells. Measured values are not changed. In a take (a table with times, or with
/// --fps) a gap is learned from the points that are seen, by the take's own frames, a pose model's
/// training poses and time; what is filled joins the measured path at both ends and keeps distances
/// that are rigid in the take, such as bone lengths. Without times, a pose model fills each frame
/// by itself. Frames of a take in which too little is seen to place a body are filled for up to a
/// second, or up to --max-gap; others keep empty cells and are counted. Where a third of a second
/// is seen on both sides, such a gap is filled with motion like that of the nearest stretches of
/// the take and of the library of --prior, if gaps simulated there say that this helps; else by a
/// path of each point. The method is then motion, and --report tells the error expected, as a share
/// of that of a cubic that meets both ends, and the nearest takes.
///
/// Outliers are ignored: points of a take that jump off their path and back, or that break rigid
/// distances. They keep their values; --status marks them as rejected.
///
/// Measured values count as exact, unless the table has columns NAME.sd, their standard deviations,
/// as `denoise --status` writes them: then these enter what is filled and how sure that is.
#[derive(Parser)]
#[command(
    name = "complete",
    version,
    after_help = "Examples:\n  posing complete walk.csv > whole.csv\n  posing complete --status \
                  --max-gap 0.5 -o whole.csv walk.csv\n  posing complete --observe \
                  lclavicle,rclavicle,lwrist,rwrist,lfoot,rfoot walk.csv > from-six.csv"
)]
pub struct Args {
    /// Comma-separated points to use; all others count as missing
    #[arg(long, value_name = "LIST")]
    observe: Option<String>,
    /// Longest gap to fill, in seconds (default: no limit)
    #[arg(long, value_name = "SECONDS", value_parser = parse_positive)]
    max_gap: Option<f64>,
    /// Library of motion, by prior-train --motion: gaps of a whole body are filled from its takes
    /// too, where simulated gaps say that this helps
    #[arg(
        long,
        value_name = "MOTION.npz",
        conflicts_with = "per_frame",
        help_heading = "Model"
    )]
    prior: Option<PathBuf>,
    /// Also replace outliers by their estimate
    #[arg(long)]
    overwrite_observed: bool,
    /// Write a list of all gaps to FILE: where each is, how it was filled, how sure that is. The
    /// object of --json if FILE ends in .json
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    report: Option<OutputPath>,
    #[command(flatten)]
    restoring: RestoringArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let observe = args.observe.as_deref().map(parse_point_names).transpose()?;
    let options = Complete {
        max_gap: args.max_gap,
        overwrite_outliers: args.overwrite_observed,
        observe,
        fps: args.restoring.input.fps,
        per_frame: args.restoring.per_frame,
    };
    let task = Task::Complete {
        options,
        report: args.report.as_deref().map(Path::to_path_buf),
        motion: args.prior.as_deref().map(open_library).transpose()?,
    };
    restore(&args.restoring, &task)
}

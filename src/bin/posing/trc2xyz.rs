//! Turns a TRC file into a table of points.

use clap::Parser;
use posing::Result;
use posing::cli::marker_files::MarkerFileArgs;
use posing::io::trc;

/// Convert a TRC file to a pose table
///
/// Reads the TRC files of Motion Analysis, OpenSim and Pose2Sim. Writes a pose table in
/// centimeters, y up: one row per frame, three columns per marker, empty where the file has an
/// empty cell or NaN. Zeros stay: a position of exactly 0 0 0, which some programs write for a
/// missing one, is reported. Rate and unit are the file's (DataRate, Units), `time` is its
/// Time column; the up axis is not in the file, so --up is needed: y for OpenSim's, often z for
/// others. Columns beyond the named markers are *35 and so on by their number, without a label, if
/// they hold a value.
#[derive(Parser)]
#[command(
    name = "trc2xyz",
    version,
    after_help = "Examples:\
        \n  posing trc2xyz --up y gait.trc > gait.csv\
        \n  posing trc2xyz --up y gait.trc | posing complete --self | posing xyz2trc -o filled.trc"
)]
pub struct Args {
    #[command(flatten)]
    file: MarkerFileArgs,
}

pub fn work(args: &Args) -> Result<()> {
    args.file.convert(trc::read, false)
}

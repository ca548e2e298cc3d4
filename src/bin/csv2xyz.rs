//! Turns a table of markers of another program into a pose table.

use clap::{Parser, ValueEnum};
use posing::cli::marker_files::MarkerFileArgs;
use posing::cli::run;
use posing::io::{MotivePoints, marker_csv};
use std::process::ExitCode;

/// Convert a Motive CSV or Qualisys TSV file to a pose table
///
/// Knows the file by its first line. Writes a pose table in centimetres, y up: one row per frame, three columns per marker,
/// empty where the file has an empty cell, NaN or null. Zeros stay: a position of exactly 0 0 0, which some programs write
/// for a missing one, is reported. Neither file says which axis is up, so --up is needed: Motive's default is y, QTM's z. A
/// Motive file states its unit; for Qualisys files, give --units (QTM exports millimetres). From Motive come the measured
/// markers or, without any, the expected ones or the bones: --points chooses. Rotations are not converted.
#[derive(Parser)]
#[command(
    name = "csv2xyz",
    version,
    after_help = "Examples:\n  posing csv2xyz --up y motive.csv > walk.csv\n  posing csv2xyz --units mm --up z qualisys.tsv > walk.csv\n  posing csv2xyz --up y motive.csv | posing complete --self | posing xyz2c3d -o filled.c3d"
)]
struct Args {
    /// Points of a Motive file [default: the first of these that it has]
    #[arg(long, value_enum, value_name = "KIND")]
    points: Option<Points>,
    #[command(flatten)]
    file: MarkerFileArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Points {
    /// Measured markers
    Markers,
    /// Where the markers of rigid bodies and skeletons are expected, also when they are hidden
    Expected,
    /// Bones and rigid bodies
    Bones,
}

fn main() -> ExitCode {
    run(|args: Args| {
        let points = args.points.map(|points| match points {
            Points::Markers => MotivePoints::Markers,
            Points::Expected => MotivePoints::Expected,
            Points::Bones => MotivePoints::Bones,
        });
        let read = |input, keep_whole| marker_csv::read(input, points, keep_whole);
        args.file.convert(read, false)
    })
}

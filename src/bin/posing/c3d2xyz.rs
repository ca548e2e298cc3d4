//! Turns a C3D file into a table of points.

use clap::Parser;
use posing::Result;
use posing::cli::marker_files::MarkerFileArgs;
use posing::io::C3d;

/// Convert a C3D file to a pose table
///
/// Writes a pose table in centimeters, y up: one row per frame, three columns per point, empty
/// where the point is missing (a fourth word below zero, whatever its value); zeros stay. Intel,
/// DEC and SGI files of integers and of reals are read. Rate, unit and up axis are the file's
/// (POINT:RATE or the header's, POINT:UNITS, POINT:Y_SCREEN), or asked for by their flags. `time`
/// counts from frame 1: the first frame's number is kept. A label that comes again gets _2, a
/// missing one is none: *17 by its number. Angles, forces, moments and powers are no positions and
/// left out, or columns of their own. Analog channels are not converted; `xyz2c3d --into` keeps
/// them.
#[derive(Parser)]
#[command(
    name = "c3d2xyz",
    version,
    after_help = "Examples:\n  posing c3d2xyz gait.c3d > gait.csv\n  posing c3d2xyz --units mm \
                  --up z old.c3d -o old.csv\n  posing c3d2xyz gait.c3d | posing complete --self | \
                  posing xyz2c3d --into gait.c3d -o filled.c3d"
)]
pub struct Args {
    /// Write angles, forces, moments and powers too, as in the file: NAME.rx .ry .rz, NAME.fx .fy
    /// .fz, NAME.mx .my .mz, NAME.p
    #[arg(long)]
    model_outputs: bool,
    #[command(flatten)]
    file: MarkerFileArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let read = |input, keep_whole| Ok(C3d::read(input, keep_whole)?.take);
    args.file.convert(read, args.model_outputs)
}

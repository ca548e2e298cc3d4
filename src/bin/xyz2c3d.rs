//! Turns a pose table into a C3D file, or puts its points into one that there is.

use clap::Parser;
use posing::cli::args::{CommonArgs, InputArgs, parse_rate, value_name};
use posing::cli::ik::report_time_jumps;
use posing::cli::input::{check_single_stdin, open, or_stdin, read_table};
use posing::cli::marker_files::MarkerUnitArgs;
use posing::cli::one_take::{first_frame_number, one_take};
use posing::cli::run;
use posing::cli::streams::write_bytes;
use posing::cli::units::{TableUnits, Units, Up};
use posing::io::C3d;
use posing::io::c3d::NewC3d;
use posing::pose::Poses;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Convert a pose table to a C3D file
///
/// Writes points alone: Intel reals, millimetres, z up. With --into, the points of an existing file are replaced and all
/// else stays as it is, byte for byte: analog channels, events, force plates, parameters, the first frame's number. A point
/// whose coordinates do not change keeps its residual and cameras; one that was filled or changed gets a residual of 0, as
/// the format has it for points that were not measured, and an empty one -1.
#[derive(Parser)]
#[command(
    name = "xyz2c3d",
    version,
    after_help = "Examples:\n  posing xyz2c3d -o walk.c3d walk.csv\n  posing c3d2xyz gait.c3d | posing complete --self | posing xyz2c3d --into gait.c3d -o filled.c3d"
)]
struct Args {
    /// Pose tables, CSV or NPY; - or nothing: standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// C3D file whose points are replaced; frames and names must be the table's
    #[arg(long, value_name = "ORIGINAL.c3d")]
    into: Option<PathBuf>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    units: MarkerUnitArgs,
    /// Take to write, if the table has several
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Frames per second, for a table without times
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    /// Point names for an NPY array: 23 (the CMU joints) or a comma-separated list
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<()> {
    args.common.apply()?;
    let files = or_stdin(&args.files);
    check_single_stdin(files.iter().chain(&args.into))?;
    let input = InputArgs::plain(args.files.clone(), args.fps, &args.joints);
    let table = read_table(&input, false, false)?;
    let poses = one_take(table.poses, args.take.as_deref(), &table.name)?;
    let bytes = match &args.into {
        Some(original) => into(args, poses, original, &table.name)?,
        None => new(args, poses, &input, &table.name)?,
    };
    write_bytes(args.output.as_deref(), &bytes, true)
}

/// The original with the points of the poses.
fn into(args: &Args, poses: Poses, original: &Path, table: &str) -> Result<Vec<u8>> {
    let original = C3d::read(open(original)?, true)?;
    let units = args.units.table_units(&original.take)?;
    let mut xyz = original.take.xyz.clone();
    let bad = |what: String| Error::data(Place::file(table), what);
    if poses.frames() != xyz.nrows() {
        return Err(bad(format!(
            "has {} frames, {} has {}",
            poses.frames(),
            original.take.name,
            xyz.nrows()
        )));
    }
    let points = &original.take.points;
    if let Some(unknown) = poses.points.iter().find(|p| !points.contains(p)) {
        return Err(bad(format!(
            "has a point \"{unknown}\", which {} does not have",
            original.take.name
        )));
    }
    for (i, point) in points.iter().enumerate() {
        // A point that the table does not have stays as it is.
        let Some(from) = poses.points.iter().position(|p| p == point) else {
            continue;
        };
        for t in 0..poses.frames() {
            let mut place = [0, 1, 2].map(|c| poses.xyz[[t, 3 * from + c]]);
            units.write(&mut place);
            (0..3).for_each(|c| xyz[[t, 3 * i + c]] = place[c]);
        }
    }
    original.with_points(xyz.view())
}

/// A file of the poses alone.
fn new(args: &Args, mut poses: Poses, input: &InputArgs, table: &str) -> Result<Vec<u8>> {
    let units = TableUnits {
        unit: args.units.units.unwrap_or(Units::Mm),
        up: args.units.up.unwrap_or(Up::Z),
    };
    let rate = match input.rate(&poses)? {
        Some(rate) => rate,
        None if poses.frames() == 1 => 1.0,
        None => {
            let what = "has no times, and C3D files need a rate; give it with --fps";
            return Err(Error::data(Place::file(table), what));
        }
    };
    report_time_jumps(&poses, table, "a C3D file");
    let number = first_frame_number(&poses, Some(rate));
    for mut row in poses.xyz.rows_mut() {
        if let Some(row) = row.as_slice_mut() {
            units.write(row);
        }
    }
    let up = format!("+{}", value_name(units.up).to_uppercase());
    let right = if units.up == Up::X { "+Y" } else { "+X" };
    NewC3d {
        points: &poses.points,
        rate,
        first_frame: u32::try_from(number).unwrap_or(1),
        units: &value_name(units.unit),
        screen: [right, &up],
    }
    .bytes(poses.xyz.view())
}

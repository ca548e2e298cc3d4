//! Turns a pose table into a C3D file, or puts its points into one that there is.

use clap::Parser;
use posing::Result;
use posing::cli::input::open;
use posing::cli::marker_files::MarkerUnitArgs;
use posing::cli::messages;
use posing::cli::one_take_args::{OneTake, OneTakeArgs};
use posing::io::C3d;
use posing::pose::units::{LengthUnit, Units, UpAxis};
use std::path::{Path, PathBuf};

/// Convert a pose table to a C3D file
///
/// Writes points alone: Intel reals, millimeters, z up. With --into, the points of an existing file
/// are replaced and all else stays as it is, byte for byte: analog channels, events, force plates,
/// parameters, the first frame's number. A point whose coordinates do not change keeps its residual
/// and cameras; one that was filled or changed gets a residual of 0, as the format has it for
/// points that were not measured, and an empty one -1.
#[derive(Parser)]
#[command(
    name = "xyz2c3d",
    version,
    after_help = "Examples:\n  posing xyz2c3d -o walk.c3d walk.csv\n  posing c3d2xyz gait.c3d | \
                  posing complete --self | posing xyz2c3d --into gait.c3d -o filled.c3d",
    mut_arg("units", |units| units.help(
        "Unit of length of the file [default: mm, or what ORIGINAL says]"
    )),
    mut_arg("up", |up| up.help(
        "Axis of the file that points up [default: z, or what ORIGINAL says]"
    )),
    mut_arg("left_handed", |left| left.help(
        "Axes of the file are left-handed, as Unity's and Unreal's: one is reflected"
    ))
)]
pub struct Args {
    /// C3D file whose points are replaced; frames and names must be the table's
    #[arg(long, value_name = "ORIGINAL.c3d")]
    into: Option<PathBuf>,
    #[command(flatten)]
    units: MarkerUnitArgs,
    #[command(flatten)]
    out: OneTakeArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let one = args.out.read(args.into.as_ref())?;
    let bytes = match &args.into {
        Some(original) => into(args, one, original)?,
        None => new(args, one)?,
    };
    args.out.write(&bytes, true)
}

/// The original with the points of the poses.
fn into(args: &Args, one: OneTake, original: &Path) -> Result<Vec<u8>> {
    let OneTake { poses, table, .. } = one;
    let original = C3d::read(open(original)?, true)?;
    let said = |n: &String| messages::info(&format!("{}: {n}", original.take.name));
    original.take.notes.iter().for_each(said);
    let units = args.units.table_units(&original.take)?;
    original.with_poses(&poses, units, &table)
}

/// A file of the poses alone.
fn new(args: &Args, one: OneTake) -> Result<Vec<u8>> {
    let units = Units {
        unit: args.units.units.unwrap_or(LengthUnit::Mm),
        up: args.units.axes.or(UpAxis::Z),
    };
    args.out.new_take(one, units, "C3D")?.c3d()
}

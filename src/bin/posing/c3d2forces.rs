//! Turns the force plates of a C3D file into a table of forces.

use clap::Parser;
use posing::cli::input::open;
use posing::cli::marker_files::MarkerUnitArgs;
use posing::cli::messages;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::gait::Forces;
use posing::io::input::take_name;
use posing::io::motion_folder::unpacked;
use posing::io::{C3d, TableFormat};
use posing::{Error, Result};
use std::path::{Path, PathBuf};

/// Convert the force plates of a C3D file to a table, or to OpenSim's loads
///
/// Writes a row per sample of the analog channels: `time`, as c3d2xyz counts, then of each plate n,
/// in the laboratory's axes with y up, FPn.fx .fy .fz, the force on the foot, N; FPn.px .py .pz,
/// the center of pressure on the plate's surface, cm; FPn.mx .my .mz, the moment about the middle
/// of that surface, and FPn.tx .ty .tz, the free moment about the center of pressure, N m. Below
/// 10 N along the vertical, center and free moment are empty. No baseline is taken off. Plates of
/// types 1 to 4 are read. A moment's unit is that of its channel, else force times POINT:UNITS.
/// With --left-handed each plate's own z points down; its own axes may be right- or left-handed, as
/// the order of its corners tells.
///
/// FILE.mot and FILE.sto get OpenSim's external loads: ground_force_n_vx vy vz, N,
/// ground_force_n_px py pz, m, ground_torque_n_x y z, N m. Below 10 N force and torque are 0 and
/// the point stays where it was.
#[derive(Parser)]
#[command(
    name = "c3d2forces",
    version,
    after_help = "Examples:\n  posing c3d2forces walk.c3d -o forces.csv\n  posing c3d2forces \
                  walk.c3d -o loads.mot   for OpenSim"
)]
pub struct Args {
    /// The file; - or nothing: standard input
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    #[command(flatten)]
    units: MarkerUnitArgs,
    /// Accept a file that ends early: the whole frames before that are kept
    #[arg(long)]
    keep_whole: bool,
    /// Write to FILE instead of standard output: CSV, or by its name .mot or .sto
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
}

pub fn work(args: &Args) -> Result<()> {
    let output = args.output.as_deref();
    let is_storage = output.is_some_and(|path| {
        let ending = unpacked(path).extension().map(|e| e.to_ascii_lowercase());
        ending.is_some_and(|e| e == "mot" || e == "sto")
    });
    if output.is_some_and(|path| TableFormat::of_path(path) != TableFormat::Csv) {
        return Err(Error::usage("forces are written as .csv, .mot or .sto"));
    }
    let path = args.file.as_deref().unwrap_or(Path::new("-"));
    let file = C3d::read(open(path)?, args.keep_whole)?;
    // A unit that differs from the file's is told.
    let units = args.units.table_units(&file.take)?;
    let forces = Forces::from_c3d(&file, Some(units.unit), Some(units.up))?;
    let said = |n: &String| messages::info(&format!("{}: {n}", file.take.name));
    file.take.notes.iter().for_each(said);
    let bytes = if is_storage {
        forces.to_mot(&take_name(path))
    } else {
        forces.to_csv()
    };
    write_bytes(output, &bytes, false)
}

//! Turns a pose table into a TRC file.

use clap::Parser;
use posing::Result;
use posing::cli::args::UpArgs;
use posing::cli::choice::choice;
use posing::cli::one_take_args::OneTakeArgs;
use posing::pose::units::{LengthUnit, Units, UpAxis};

/// Convert a pose table to a TRC file
///
/// Writes a tab-separated TRC file for OpenSim and others: millimeters, y up, the table's times,
/// frames numbered from the first, every number as the shortest text that reads back. A missing
/// point is three empty cells. TRC files state their unit, not their up axis; OpenSim takes y for
/// up.
#[derive(Parser)]
#[command(
    name = "xyz2trc",
    version,
    after_help = "Examples:\
        \n  posing xyz2trc -o walk.trc walk.csv\
        \n  posing trc2xyz --up y gait.trc | posing complete --self | posing xyz2trc -o filled.trc"
)]
#[command(mut_arg("up", |up| up.help("Axis of the file written that points up [default: y]")))]
#[command(mut_arg("left_handed", |left| left.help(
    "Axes of the file written are left-handed, as Unity's and Unreal's: one is reflected"
)))]
pub struct Args {
    /// Unit of length of the file
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT", default_value = "mm")]
    units: LengthUnit,
    #[command(flatten)]
    axes: UpArgs,
    #[command(flatten)]
    out: OneTakeArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let one = args.out.read(None)?;
    let units = Units {
        unit: args.units,
        up: args.axes.or(UpAxis::Y),
    };
    let take = args.out.new_take(one, units, "TRC")?;
    args.out.write(&take.trc()?, false)
}

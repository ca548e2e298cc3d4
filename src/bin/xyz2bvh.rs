//! Turns a pose table into a BVH file.

use clap::Parser;
use glam::DMat3;
use posing::cli::args::{CommonArgs, InputArgs, Units, Up, parse_rate};
use posing::cli::ik::{report_time_jumps, solve};
use posing::cli::input::{check_single_stdin, open, read_table};
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages, run};
use posing::io::bvh::{self, Target};
use posing::pose::rotation::{Axis, parse_order};

use posing::restore::ik::correspondence::match_points;
use posing::restore::ik::skeleton_estimation::estimate_skeleton;
use posing::restore::take::one_take;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Turn a pose table into a BVH file
///
/// Carries each pose to the skeleton's bone lengths, solves for its joints' angles and writes them as BVH: joint NAME
/// stands at the start of bone NAME and turns it, and the last bone of a chain ends in an End Site. How well the
/// joints fit is told on standard error. Bones that the table does not show stay at rest.
#[derive(Parser)]
#[command(
    name = "xyz2bvh",
    version,
    after_help = "Examples:\n  posing xyz2bvh -o walk.bvh walk.csv\n  posing xyz2bvh --skeleton 07.asf --order ZXY -o walk.bvh walk.csv\n  posing bvh2xyz old.bvh | posing denoise | posing xyz2bvh --skeleton old.bvh -o new.bvh"
)]
struct Args {
    /// Pose tables, CSV or NPY; - or none: standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The skeleton to solve for, ASF or BVH (its hierarchy, offsets and channels are kept) [default: measured from
    /// the table, whose points then have CMU's names]
    #[arg(long, value_name = "SUBJECT.asf|FILE.bvh")]
    skeleton: Option<PathBuf>,
    /// Write to FILE (complete or not at all) in place of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The order of the rotation channels, the last turning first [default: ZYX, or that of the skeleton's BVH]
    #[arg(long, value_name = "ORDER", value_parser = order)]
    order: Option<[Axis; 3]>,
    /// Keep to the limits of the skeleton's joints (captured motion often exceeds them)
    #[arg(long)]
    limits: bool,
    /// The take to write, where the table holds several
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Frames a second, where the table has no time
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    /// The points' names of an array without any: 23 (CMU's) or a list with commas
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// The unit of length of the BVH written (and of the one given as skeleton)
    #[arg(long, value_enum, value_name = "UNIT", default_value = "cm")]
    units: Units,
    /// The axis that points up in the BVH written (and in the one given as skeleton)
    #[arg(long, value_enum, value_name = "AXIS", default_value = "y")]
    up: Up,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn order(text: &str) -> std::result::Result<[Axis; 3], String> {
    parse_order(text).ok_or_else(|| "expected the three axes in some order, such as ZYX".into())
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    let stdin = PathBuf::from("-");
    let files = if args.files.is_empty() {
        std::slice::from_ref(&stdin)
    } else {
        &args.files
    };
    check_single_stdin(files.iter().chain(&args.skeleton))?;
    // The skeleton's faults are told before a long table is read.
    let given = args
        .skeleton
        .as_ref()
        .map(|p| target(args, p))
        .transpose()?;
    let input = InputArgs {
        files: args.files.clone(),
        fps: args.fps,
        joints: args.joints.clone(),
        units: Units::Cm,
        up: Up::Y,
    };
    let table = read_table(&input, false, false)?;
    let poses = one_take(table.poses, args.take.as_deref(), &table.name)?;
    let Some(rate) = input.rate(&poses)? else {
        let what = format!("{}: has no rate; give it with --fps", table.name);
        return Err(Error::usage(what));
    };
    report_time_jumps(&poses, &table.name, "a BVH");
    let target = match given {
        Some(target) => target,
        None => Target::Bones(estimate_skeleton(&poses)?),
    };
    let matched = match_points(&poses, &target.joints(&poses.points));
    if matched.joints.is_empty() {
        let what = "no point has the name of a joint of the skeleton";
        return Err(Error::data(Place::file(table.name), what));
    }
    let fitted = solve(target.skeleton(), &matched, args.limits, &table.name)?;
    let order = args.order.unwrap_or([Axis::Z, Axis::Y, Axis::X]);
    let bvh = target.motion(fitted.values.view(), order, turn(args.up), 1.0 / rate)?;
    let text = bvh::render(&bvh, args.units.centimetres());
    write_bytes(args.output.as_deref(), &text, false)?;
    Ok(Outcome::Done)
}

/// Carries the BVH's axes to ours.
fn turn(up: Up) -> DMat3 {
    DMat3::from_cols_array_2d(&[[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(|e| up.to_y(e)))
}

fn target(args: &Args, path: &Path) -> Result<Target> {
    let unit = args.units.centimetres();
    let (target, notes) = Target::read(open(path)?, unit, turn(args.up))?;
    notes.iter().for_each(|n| messages::info(n));
    if matches!(target, Target::Template(..)) && args.order.is_some() {
        let what = "--order: a BVH given as skeleton keeps the order of its channels";
        return Err(Error::usage(what));
    }
    Ok(target)
}

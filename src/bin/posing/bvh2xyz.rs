//! Turns a BVH file into a table of joint positions.

use clap::Parser;
use posing::cli::args::{OutputArgs, UpArgs, parse_rate};
use posing::cli::choice::{choice, value_name};
use posing::cli::input::open;
use posing::cli::messages;
use posing::cli::streams::write_table;
use posing::io::bvh::{BvhPoints, BvhSkeleton};
use posing::io::input::take_name;
use posing::io::{Bvh, Table};
use posing::pose::units::{LengthUnit, Units, UpAxis};
use posing::{Error, Place, Result};
use std::path::PathBuf;
use std::sync::Arc;

/// Convert a BVH file to a pose table
///
/// Writes a pose table in centimeters, y up: one row per frame, three columns per joint, End Sites
/// as NAME_end. A joint is the start of its bone, unless --ends is given; denoise, complete and
/// xyz2bvh tell which. Position channels replace the OFFSET. BVH files state no unit and no up
/// axis; the default is centimeters, y up.
#[derive(Parser)]
#[command(
    name = "bvh2xyz",
    version,
    after_help = "Examples:\n  posing bvh2xyz walk.bvh > walk.csv\n  posing bvh2xyz walk.bvh | \
                  posing complete > whole.csv\n  posing \
                  bvh2xyz --units m --up z from-blender.bvh | posing plot -o walk.html"
)]
pub struct Args {
    /// BVH file; - or nothing: standard input
    #[arg(value_name = "FILE.bvh")]
    file: Option<PathBuf>,
    /// Write the end of each bone under the bone's name, the inverse of xyz2bvh: the mean start of
    /// its child joints and End Sites; for the root, its own joint
    #[arg(long)]
    ends: bool,
    /// Unit of length of the file [default: cm]
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT")]
    units: Option<LengthUnit>,
    #[command(flatten)]
    axes: UpArgs,
    /// Frames per second, if the file's Frame Time is outside 0.0001 to 10 s
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    /// Accept a file whose last frame is cut off; that frame is dropped
    #[arg(long)]
    keep_whole: bool,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let path = args.file.clone().unwrap_or_else(|| PathBuf::from("-"));
    let input = open(&path)?;
    let name = input.name.clone();
    let unit = args.units.unwrap_or(LengthUnit::Cm);
    let bvh = Bvh::read(input, unit.centimeters(), args.keep_whole)?;
    bvh.notes.iter().for_each(|n| messages::info(n));
    if args.units.is_none() || args.axes.up.is_none() {
        messages::info(&format!(
            "{name}: assuming {} and {} up; use --units and --up to change this",
            value_name(unit),
            value_name(args.axes.up.unwrap_or(UpAxis::Y))
        ));
    }
    let rate = rate(args, &bvh, &name)?;
    let skeleton = BvhSkeleton::new(&bvh.joints, args.axes.or(UpAxis::Y).rotation(), true)?;
    let points = if args.ends {
        BvhPoints::Ends
    } else {
        BvhPoints::Origins
    };
    let mut poses = bvh.positions(&skeleton, points, rate);
    let take: Arc<str> = take_name(&path).into();
    poses.take = Some(vec![take; poses.frames()]);
    let table = Table::from_poses(poses);
    write_table(
        &args.out,
        [Units::CM_Y; 2],
        &table,
        table.poses.xyz.view(),
        &[],
        |_| Vec::new(),
    )?;
    Ok(())
}

/// Frames a second: the file's Frame Time, or `--fps` where that is none of a motion.
fn rate(args: &Args, bvh: &Bvh, name: &str) -> Result<f64> {
    match (bvh.rate(), args.fps) {
        (Some(rate), Some(fps)) if (fps - rate).abs() > 1e-4 * rate => Err(Error::usage(format!(
            "--fps {fps} contradicts the file's Frame Time ({rate} frames per second); leave \
             --fps out"
        ))),
        (_, fps) => (bvh.rate_or(fps)).map_err(|e| e.at(Place::file(name))),
    }
}

//! Turns a BVH file into a table of joint positions.

use clap::Parser;
use glam::DMat3;
use posing::cli::args::{CommonArgs, OutputArgs, Units, Up, parse_rate};
use posing::cli::input::open;
use posing::cli::streams::create_table;
use posing::cli::{Outcome, messages, run};
use posing::io::bvh::{self, Bvh, BvhPoints, BvhSkeleton};
use posing::io::{Columns, Row};
use posing::pose::kinematics::Posture;
use posing::pose::poses::round_rate;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Convert a BVH file to a pose table
///
/// Writes a pose table in centimetres, y up: one row per frame, three columns per joint, End Sites as NAME_end. A joint
/// is the start of its bone; the built-in model and xyz2bvh expect the end: use --ends for them. Position channels
/// replace the OFFSET. BVH files state no unit and no up axis; the default is centimetres, y up.
#[derive(Parser)]
#[command(
    name = "bvh2xyz",
    version,
    after_help = "Examples:\n  posing bvh2xyz walk.bvh > walk.csv\n  posing bvh2xyz --ends walk.bvh | posing denoise | posing xyz2bvh --skeleton walk.bvh -o clean.bvh\n  posing bvh2xyz --units m --up z from-blender.bvh | posing plot -o walk.html"
)]
struct Args {
    /// BVH file; - or nothing: standard input
    #[arg(value_name = "FILE.bvh")]
    file: Option<PathBuf>,
    /// Write the end of each bone under the bone's name, the inverse of xyz2bvh: the mean start of its child joints and End
    /// Sites; for the root, its own joint
    #[arg(long)]
    ends: bool,
    /// Unit of length of the file [default: cm]
    #[arg(long, value_enum, value_name = "UNIT")]
    units: Option<Units>,
    /// Axis of the file that points up [default: y]
    #[arg(long, value_enum, value_name = "AXIS")]
    up: Option<Up>,
    /// Frames per second, if the file's Frame Time is zero
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    /// Accept a file whose last frame is cut off; that frame is dropped
    #[arg(long)]
    keep_whole: bool,
    #[command(flatten)]
    out: OutputArgs,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    let path = args.file.clone().unwrap_or_else(|| PathBuf::from("-"));
    let input = open(&path)?;
    let name = input.name.clone();
    let unit = args.units.unwrap_or(Units::Cm);
    let up = args.up.unwrap_or(Up::Y);
    let loaded = bvh::read(input, unit.centimetres(), args.keep_whole)?;
    loaded.notes.iter().for_each(|n| messages::info(n));
    if args.units.is_none() || args.up.is_none() {
        let axis = match up {
            Up::X => "x",
            Up::Y => "y",
            Up::Z => "z",
        };
        messages::info(&format!(
            "{name}: taken as {}, {axis} up, as is the custom; --units and --up say otherwise",
            unit.name()
        ));
    }
    let rate = rate(args, &loaded.bvh, &name)?;
    let turn =
        DMat3::from_cols_array_2d(&[[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(|e| up.to_y(e)));
    let rig = BvhSkeleton::new(&loaded.bvh.joints, turn, true)?;
    write(args, &path, &loaded.bvh, &rig, rate)?;
    Ok(Outcome::Done)
}

/// Frames a second: the exact rate that the Frame Time, often cut to six decimals, stands for.
fn rate(args: &Args, bvh: &Bvh, name: &str) -> Result<f64> {
    let step = bvh.frame_time;
    match args.fps {
        _ if step > 0.0 && (1.0 / step).is_finite() => {
            let rate = round_rate(1.0 / step);
            match args.fps {
                Some(fps) if (fps - rate).abs() > 1e-4 * rate => Err(Error::usage(format!(
                    "--fps {fps} contradicts the file's Frame Time, {rate} frames a second"
                ))),
                _ => Ok(rate),
            }
        }
        Some(fps) => Ok(fps),
        // A single frame has no rate to be wrong about.
        None if bvh.motion.nrows() <= 1 => Ok(1.0),
        None => {
            let what = format!("Frame Time is {step}; give the rate with --fps");
            Err(Error::data(Place::file(name), what))
        }
    }
}

fn write(args: &Args, path: &Path, bvh: &Bvh, rig: &BvhSkeleton, rate: f64) -> Result<()> {
    let points = rig.points(if args.ends {
        BvhPoints::Ends
    } else {
        BvhPoints::Origins
    });
    let names = points.iter().map(|(name, _)| name.clone()).collect();
    let mut sink = create_table(&args.out, &Columns::for_points(names, true, true), &[])?;
    let take = path
        .file_stem()
        .unwrap_or(path.as_os_str())
        .to_string_lossy();
    let mut row = Row {
        take: Some(Arc::from(&*take)),
        ..Row::default()
    };
    let (mut posture, mut q) = (Posture::default(), vec![0.0; rig.skeleton.dof_count()]);
    for (i, frame) in bvh.motion.rows().into_iter().enumerate() {
        rig.values(frame.as_slice().unwrap_or(&frame.to_vec()), &mut q);
        rig.skeleton.posture_into(&q, &mut posture);
        row.time = Some(i as f64 / rate);
        row.xyz.clear();
        row.xyz.extend(
            points
                .iter()
                .flat_map(|&(_, bone)| posture.ends[bone].to_array()),
        );
        sink.write(&row, &row.xyz, &[])?;
    }
    sink.finish()
}

//! Turns a pose table into a BVH file.

use clap::Parser;
use glam::DMat3;
use posing::cli::flags::{Common, TableIn, Units, Up, parse_rate};
use posing::cli::streams::{one_stdin, open, read_table, write_bytes};
use posing::cli::{Outcome, run, say};
use posing::io::bvh::{self, Bvh, Converter, Loaded, Rig};
use posing::io::{Input, asf};
use posing::pose::kinematics::Posture;
use posing::pose::rotation::{Axis, parse_order};
use posing::pose::{Poses, Skeleton};
use posing::restore::fit::{Fit, FitSettings, fit};
use posing::restore::ik::Settings;
use posing::restore::measured::measure;
use posing::restore::report::{Matched, match_names};
use posing::restore::take::one_take;
use posing::{Error, Place, Result};
use std::io::Cursor;
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
    common: Common,
}

/// Where the bones come from.
enum Frame {
    Bones(Skeleton),
    Template(Box<(Loaded, Rig)>),
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
    let files = if args.files.is_empty() { std::slice::from_ref(&stdin) } else { &args.files };
    one_stdin(files.iter().chain(&args.skeleton))?;
    // The skeleton's faults are told before a long table is read.
    let given = args.skeleton.as_ref().map(|path| skeleton(args, path)).transpose()?;
    let input = TableIn {
        files: args.files.clone(),
        fps: args.fps,
        joints: args.joints.clone(),
        units: Units::Cm,
        up: Up::Y,
    };
    let table = read_table(&input, false, false)?;
    let poses = one_take(table.poses, args.take.as_deref(), &table.name)?;
    let Some(rate) = input.rate(&poses)? else {
        return Err(Error::usage(format!("{}: has no rate; give it with --fps", table.name)));
    };
    let gaps = poses.runs().len().saturating_sub(1);
    if gaps > 0 {
        say::note(&format!("{}: the time jumps {gaps} times; BVH has no time, so those frames follow at once", table.name));
    }
    let frame = match given {
        Some(frame) => frame,
        None => Frame::Bones(measure(&poses)?),
    };
    let matched = matched(&frame, &poses);
    if matched.joints.is_empty() {
        let what = "no point has the name of a joint of the skeleton";
        return Err(Error::data(Place::file(table.name), what));
    }
    matched.notes(&table.name).iter().for_each(|n| say::note(n));
    let settings = FitSettings {
        solve: Settings {
            limits: args.limits,
            ..Settings::default()
        },
        ..FitSettings::default()
    };
    let skeleton = match &frame {
        Frame::Bones(skeleton) => skeleton,
        Frame::Template(template) => &template.1.skeleton,
    };
    let fitted = fit(skeleton, &matched.joints, matched.xyz.view(), &settings, &mut |_| {})?;
    fitted.notes(&matched.names).iter().for_each(|n| say::note(n));
    let bvh = motion(args, &frame, &fitted, 1.0 / rate)?;
    write_bytes(args.output.as_deref(), &bvh::render(&bvh, args.units.centimetres()), false)?;
    Ok(Outcome::Done)
}

/// Carries the BVH's axes to ours.
fn turn(up: Up) -> DMat3 {
    DMat3::from_cols_array_2d(&[[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(|e| up.to_y(e)))
}

/// Reads either kind, told apart by content.
fn skeleton(args: &Args, path: &Path) -> Result<Frame> {
    let input = open(path)?;
    let name = input.name.clone();
    let bytes = input.read_all(2 << 30)?;
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(100)]);
    let is_bvh = start.trim_start_matches('\u{feff}').trim_start().to_ascii_uppercase().starts_with("HIERARCHY");
    let input = Input::new(name, Cursor::new(bytes))?;
    if !is_bvh {
        return Ok(Frame::Bones(asf::read(input, None)?.skeleton));
    }
    if args.order.is_some() {
        return Err(Error::usage("--order: a BVH given as skeleton keeps the order of its channels"));
    }
    let loaded = bvh::read(input, args.units.centimetres(), true)?;
    loaded.notes.iter().for_each(|n| say::note(n));
    let rig = Rig::new(&loaded.bvh.joints, turn(args.up), false)?;
    Ok(Frame::Template(Box::new((loaded, rig))))
}

/// The table's points that the skeleton knows.
fn matched(frame: &Frame, poses: &Poses) -> Matched {
    match frame {
        Frame::Bones(skeleton) => match_names(poses, |name| skeleton.find(name)),
        Frame::Template(template) => {
            let rig = &template.1;
            let points = rig.points(rig.points_among(&poses.points));
            match_names(poses, |name| points.iter().find(|p| p.0 == name).map(|p| p.1))
        }
    }
}

/// The fitted take in the file's joints.
fn motion(args: &Args, frame: &Frame, fitted: &Fit, frame_time: f64) -> Result<Bvh> {
    let mut values = Vec::new();
    let rows = fitted.values.rows().into_iter().map(|row| row.to_vec());
    let joints = match frame {
        Frame::Template(template) => {
            let (loaded, rig) = &**template;
            rows.for_each(|q| values.extend(rig.frame(&q)));
            loaded.bvh.joints.clone()
        }
        Frame::Bones(skeleton) => {
            let order = args.order.unwrap_or([Axis::Z, Axis::Y, Axis::X]);
            let mut converter = Converter::new(skeleton, order, turn(args.up).transpose());
            let mut posture = Posture::default();
            for q in rows {
                skeleton.posture_into(&q, &mut posture);
                converter.frame(&posture, &mut values);
            }
            converter.joints().to_vec()
        }
    };
    let shape = (fitted.values.nrows(), Bvh::channels(&joints));
    let motion = ndarray::Array2::from_shape_vec(shape, values).map_err(|e| Error::usage(e.to_string()))?;
    Ok(Bvh {
        joints,
        frame_time,
        motion,
    })
}

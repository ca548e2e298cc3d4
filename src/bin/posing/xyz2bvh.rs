//! Turns a pose table into a BVH file.

use clap::Parser;
use posing::cli::args::{BvhUnitArgs, InputArgs, parse_rate};
use posing::cli::ik::{JointArgs, fit, name_bone_ends, read_skeleton, report_time_jumps};
use posing::cli::input::{check_single_stdin, open, or_stdin, read_table};
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::io::bvh::LARGEST_FILE;
use posing::io::{Bvh, Input, SkeletonFile};
use posing::pose::rotation::{Axis, parse_order};

use posing::ik::solve_missing_channels;
use posing::pose::one_take;
use posing::{Error, Place, Result};
use serde_json::json;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Convert a pose table to a BVH file
///
/// Finds the rotations that are most probable given the points: what these leave open, such as the
/// twist of a limb, is as it mostly is in people. Without --skeleton the bones are measured from
/// the table. Of CMU's names a point is the end of the bone of the same name, or its start where
/// names and lengths say so, as in the tables of bvh2xyz; joint NAME of the file is the start of
/// bone NAME and rotates it. Of other names that a map knows (SMPL, OpenPose, HALPE, COCO,
/// Human3.6M, MediaPipe, Mixamo and others) the joints stand at the points, and the rest pose is a
/// T-pose. The last bone of a chain ends in an End Site. Bones without a point keep their rest
/// pose. Points with a standard deviation (NAME.sd, as denoise --status writes it) weigh less.
///
/// Standard error reports the mean and largest distance between points and joints, and the largest
/// turn of a bone in a frame. Exit code 3: the mean over the points that drive the skeleton (not
/// eyes, ears, heels and fingers) is over 5% of the leg or over 2 cm, or most of its joints have no
/// points; over 25% or 10 cm is an error.
///
/// Position channels of a BVH skeleton take the place of its OFFSETs, also below the root: where
/// they hold one value in that file, that is the bone; where they vary, they are solved for.
#[derive(Parser)]
#[command(
    name = "xyz2bvh",
    version,
    after_help = "Examples:\
        \n  posing xyz2bvh -o walk.bvh walk.csv\
        \n  posing xyz2bvh --skeleton 07.asf --order ZXY -o walk.bvh walk.csv\
        \n  posing xyz2bvh --map mediapipe -o walk.bvh keypoints.csv\
        \n  posing csv2xyz --units cm --up y a.csv | posing xyz2bvh --skeleton rig.bvh -o a.bvh\
        \n  posing bvh2xyz old.bvh | posing complete | posing xyz2bvh --into old.bvh -o whole.bvh"
)]
pub struct Args {
    /// Pose tables, CSV, NPY or NPZ; - or nothing: standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Skeleton to fit, ASF, BVH or FBX; a BVH file's hierarchy, offsets and channels are kept
    /// [default: measured from the table, whose names a map must know]
    #[arg(long, value_name = "SUBJECT.asf|FILE.bvh")]
    skeleton: Option<PathBuf>,
    /// BVH file whose missing values (the word nan) are filled from the table, which has its
    /// joints, as bvh2xyz writes them, and its frames; every other byte of it stays
    #[arg(
        long,
        value_name = "ORIGINAL.bvh",
        conflicts_with_all = ["skeleton", "order", "map", "rotations"]
    )]
    into: Option<PathBuf>,
    #[command(flatten)]
    joints_of: JointArgs,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    output: Option<OutputPath>,
    /// Order of the rotation channels; the last is applied first [default: ZYX, or that of the BVH
    /// skeleton]
    #[arg(long, value_name = "ORDER", value_parser = order)]
    order: Option<[Axis; 3]>,
    #[command(flatten)]
    units: BvhUnitArgs,
    /// Take to write, if the table has several
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Frames per second, for a table without times
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    #[command(flatten)]
    json: JsonArgs,
    /// Go on with a body that is smaller or larger than people are, or that the skeleton does not
    /// fit
    #[arg(long)]
    force: bool,
}

fn order(text: &str) -> std::result::Result<[Axis; 3], String> {
    parse_order(text).ok_or_else(|| "expected the three axes in some order, such as ZYX".into())
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare(args.output.as_deref())?;
    let files = or_stdin(&args.files);
    check_single_stdin(files.iter().chain(&args.skeleton).chain(&args.into))?;
    if let Some(original) = &args.into {
        return fill(args, original).map(Outcome::from);
    }
    // First: an error in the skeleton should not wait for a long table to be read.
    let given = args
        .skeleton
        .as_ref()
        .map(|p| skeleton_file(args, p))
        .transpose()?;
    let input = InputArgs::plain(args.files.clone(), args.fps);
    let table = read_table(&input, false, true)?;
    let name = table.name.clone();
    let (mut poses, sd) = table.one_take(args.take.as_deref())?;
    // A single frame has no rate of its own: it keeps that of the file it goes back to.
    let of_file = |file: &SkeletonFile| match file {
        SkeletonFile::Bvh(template) if poses.frames() == 1 => template.rate(),
        _ => None,
    };
    let Some(rate) = (input.rate(&poses)?).or_else(|| given.as_ref().and_then(of_file)) else {
        let what = format!("{}: has no frame rate; give it with --fps", name);
        return Err(Error::usage(what));
    };
    let is_bvh = matches!(given, Some(SkeletonFile::Bvh(_)));
    if let (true, Some(file)) = (is_bvh && poses.frames() > 1, &args.skeleton) {
        messages::info(&format!(
            "if the table came from {0}: `posing clean {0}` cleans it in its own rotations, which \
             come nearer than those solved from points",
            file.display()
        ));
    }
    name_bone_ends(&mut poses, &name, args.force, is_bvh)?;
    report_time_jumps(&poses, &name, "a BVH");
    let axis = args.joints_of.check_axis(&poses, &name)?;
    let order = args.order.unwrap_or([Axis::Z, Axis::Y, Axis::X]);
    let skeleton = args.joints_of.skeleton(given, &mut poses, sd, order)?;
    let no_joint = "no point has the name of a joint of the skeleton";
    let (fitted, report) = fit(&skeleton.fit(), &poses, &name, no_joint, args.force)?;
    let bvh = fitted.to_bvh_with(order, args.units.rotation(), rate)?;
    let text = bvh.to_bytes(args.units.centimeters());
    write_bytes(args.output.as_deref(), &text, false)?;
    args.json.write(&report)?;
    Ok(match axis {
        Outcome::Findings => axis,
        _ => report.outcome,
    })
}

/// The original with its missing values.
fn fill(args: &Args, original: &Path) -> Result<()> {
    let unit = args.units.centimeters();
    let bytes = open(original)?.read_all(LARGEST_FILE)?;
    let input = Input::new(original.display().to_string(), Cursor::new(bytes.clone()))?;
    let bvh = Bvh::read(input, unit, false)?;
    let table = read_table(
        &InputArgs::plain(args.files.clone(), args.fps),
        false,
        false,
    )?;
    let poses = one_take(table.poses, args.take.as_deref(), &table.name)?;
    let bad = |e: Error| match e {
        Error::Usage(what) => Error::data(Place::file(&table.name), what),
        other => other,
    };
    let motion = solve_missing_channels(&bvh, &poses, args.units.rotation()).map_err(bad)?;
    let filled = bvh.with_motion(&bytes, motion.view(), unit)?;
    let missing = bvh.missing();
    let left = missing.iter().filter(|at| motion[**at].is_nan()).count();
    messages::info(&format!(
        "filled {} of {} missing values",
        missing.len() - left,
        missing.len()
    ));
    write_bytes(args.output.as_deref(), &filled, false)?;
    args.json
        .write(json!({ "missing": missing.len(), "left_missing": left }))
}

fn skeleton_file(args: &Args, path: &Path) -> Result<SkeletonFile> {
    let file = read_skeleton(path, args.units.centimeters(), args.units.rotation())?;
    if matches!(file, SkeletonFile::Bvh(_)) && args.order.is_some() {
        let what = "--order cannot be used with a BVH skeleton, which keeps its own order";
        return Err(Error::usage(what));
    }
    Ok(file)
}

//! Turns a pose table into a simple body that viewers play.

use clap::Parser;
use posing::cli::Outcome;
use posing::cli::args::BvhUnitArgs;
use posing::cli::ik::{JointArgs, fit, name_bone_ends, read_skeleton};
use posing::cli::json_report::JsonArgs;
use posing::cli::one_take_args::OneTakeArgs;
use posing::io::NewTake;
use posing::io::{SkeletonFile, SkinnedMesh};
use posing::pose::rotation::Axis;
use posing::pose::units::Units;
use posing::{Error, Result};
use std::path::PathBuf;

/// Convert a pose table to binary glTF: a body that viewers play
///
/// Fits a skeleton as xyz2bvh does, with the same exit codes, and writes it with its motion and a
/// simple skinned body, so that viewers and browsers show a person. Widths go by the length of the
/// legs; a skeleton whose names no map knows has a tube around each bone. Bones lie along their own
/// y axis, as Blender draws them. Lengths are meters, y points up. For a body of a person's shape,
/// see body-synth; for FBX, see posing-formats(7).
#[derive(Parser)]
#[command(
    name = "xyz2glb",
    version,
    after_help = "Examples:\
        \n  posing xyz2glb -o walk.glb walk.csv\
        \n  posing complete walk.csv | posing xyz2glb --skeleton 07.asf -o walk.glb\
        \n  posing bvh2xyz walk.bvh | posing xyz2glb --skeleton walk.bvh -o walk.glb",
    mut_arg("units", |units| units.help("Unit of length of a BVH skeleton")),
    mut_arg("up", |up| up.help("Axis of a BVH skeleton that points up [default: y]")),
    mut_arg("left_handed", |left| left.help(
        "Axes of a BVH skeleton are left-handed, as Unity's and Unreal's: one is reflected"
    ))
)]
pub struct Args {
    /// Skeleton to fit, ASF, BVH or FBX [default: measured from the table, whose names a map must
    /// know]
    #[arg(long, value_name = "SUBJECT.asf|FILE.bvh")]
    skeleton: Option<PathBuf>,
    #[command(flatten)]
    joints: JointArgs,
    /// Go on with a body that is smaller or larger than people are, or that the skeleton does not
    /// fit
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    units: BvhUnitArgs,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    take: OneTakeArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare(args.take.output.as_deref())?;
    let one = args.take.read(args.skeleton.as_ref())?;
    let (unit, rotation) = (args.units.centimeters(), args.units.rotation());
    let given = args
        .skeleton
        .as_deref()
        .map(|p| read_skeleton(p, unit, rotation));
    let given = given.transpose()?;
    let (table, sd) = (one.table.clone(), one.sd.clone());
    let NewTake {
        mut poses, rate, ..
    } = args.take.new_take(one, Units::CM_Y, "GLB")?;
    let is_bvh = matches!(given, Some(SkeletonFile::Bvh(_)));
    if !is_bvh && args.units.is_given() {
        let what = "--units, --up and --left-handed are for a BVH skeleton: give it with \
                    --skeleton FILE.bvh; a GLB file is in meters, y up";
        return Err(Error::usage(what));
    }
    name_bone_ends(&mut poses, &table, args.force, is_bvh)?;
    let order = [Axis::Z, Axis::Y, Axis::X];
    let skeleton = args.joints.skeleton(given, &mut poses, sd, order)?;
    let no_joint = "no point has the name of a bone of the skeleton";
    let (fitted, report) = fit(&skeleton.fit(), &poses, &table, no_joint, args.force)?;
    let times: Vec<f64> = (0..poses.frames()).map(|t| t as f64 / rate).collect();
    let name = poses.take.as_ref().and_then(|take| take.first());
    let name = name.map_or("take", |take| take);
    let mesh = match skeleton.template() {
        Some(template) => SkinnedMesh::of_template(name, template, fitted.values(), &times),
        None => SkinnedMesh::of_skeleton(name, skeleton.fit().skeleton(), fitted.values(), &times),
    };
    args.take.write(&mesh.to_glb()?, true)?;
    args.json.write(&report)?;
    Ok(report.outcome)
}

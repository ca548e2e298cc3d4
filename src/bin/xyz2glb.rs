//! Turns a pose table into a skeleton that viewers play.

use clap::Parser;
use posing::cli::args::{CommonArgs, InputArgs, parse_rate};
use posing::cli::body_size::{IN_CENTIMETRES, check_body_size};
use posing::cli::ik::{fit, report_time_jumps};
use posing::cli::input::{check_single_stdin, open, or_stdin, read_table};
use posing::cli::one_take::one_take;
use posing::cli::run;
use posing::cli::streams::write_bytes;
use posing::io::{Asf, SkinnedMesh};
use posing::pose::BonePoints;
use posing::pose::bone_points::bone_ends_of_starts;
use posing::restore::ik::{SkeletonFit, estimate_skeleton};
use posing::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Convert a pose table to binary glTF: a skeleton that viewers play
///
/// Fits a skeleton as xyz2bvh does, and writes it with its motion and a simple mesh, an octahedron a bone, so that viewers
/// and browsers show it. Lengths are metres, y points up. For a body with skin, see body-synth; for FBX, let Blender
/// convert: blender -b --python-expr "import bpy; bpy.ops.import_scene.gltf(filepath='walk.glb');
/// bpy.ops.export_scene.fbx(filepath='walk.fbx')".
#[derive(Parser)]
#[command(
    name = "xyz2glb",
    version,
    after_help = "Examples:\n  posing xyz2glb -o walk.glb walk.csv\n  posing complete walk.csv | posing xyz2glb --skeleton 07.asf -o walk.glb"
)]
struct Args {
    /// Pose tables, CSV or NPY; - or nothing: standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Skeleton to fit, ASF [default: measured from the table, which needs the CMU joint names]
    #[arg(long, value_name = "SUBJECT.asf")]
    skeleton: Option<PathBuf>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Go on with a body that is smaller or larger than people are
    #[arg(long)]
    force: bool,
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
    check_single_stdin(files.iter().chain(&args.skeleton))?;
    let asf = args.skeleton.as_ref();
    let asf = asf.map(|path| Asf::read(open(path)?, None)).transpose()?;
    let input = InputArgs::plain(args.files.clone(), args.fps, &args.joints);
    let table = read_table(&input, false, false)?;
    let mut poses = one_take(table.poses, args.take.as_deref(), &table.name)?;
    let rate = match input.rate(&poses)? {
        Some(rate) => rate,
        None if poses.frames() == 1 => 1.0,
        None => {
            let what = format!("{}: has no frame rate; give it with --fps", table.name);
            return Err(Error::usage(what));
        }
    };
    let points = BonePoints::of(&poses.points, poses.xyz.view());
    if !args.force {
        let names = points.bone_ends(&poses.points);
        check_body_size(&poses, &names, &table.name, IN_CENTIMETRES)?;
    }
    if points == BonePoints::Starts {
        poses.points = bone_ends_of_starts(&poses.points);
    }
    let skeleton = match asf {
        Some(asf) => asf.skeleton,
        None => estimate_skeleton(&poses)?,
    };
    let fitted = fit(
        &SkeletonFit::new(&skeleton),
        &poses,
        &table.name,
        "no point has the name of a bone of the skeleton",
    )?;
    report_time_jumps(&poses, &table.name, "an animation");
    let times: Vec<f64> = (0..poses.frames()).map(|t| t as f64 / rate).collect();
    let names: Vec<String> = skeleton.bones().iter().map(|b| b.name.clone()).collect();
    let name = poses.take.as_ref().and_then(|take| take.first());
    let name = name.map_or("take", |take| take);
    let mesh = SkinnedMesh::of_skeleton(name, &skeleton, &names, fitted.values(), &times);
    write_bytes(args.output.as_deref(), &mesh.to_glb()?, true)
}

//! Turns a pose table into a skeleton that viewers play.

use clap::Parser;
use posing::Result;
use posing::cli::body_size::{IN_CENTIMETRES, check_body_size};
use posing::cli::ik::fit;
use posing::cli::input::open;
use posing::cli::new_take::NewTake;
use posing::cli::one_take_args::OneTakeArgs;
use posing::cli::run;
use posing::cli::units::TableUnits;
use posing::io::{Asf, SkinnedMesh};
use posing::pose::BonePoints;
use posing::pose::bone_points::bone_ends_of_starts;
use posing::restore::ik::{SkeletonFit, estimate_skeleton};
use std::path::PathBuf;
use std::process::ExitCode;

/// Convert a pose table to binary glTF: a skeleton that viewers play
///
/// Fits a skeleton as xyz2bvh does, and writes it with its motion and a simple mesh, an octahedron a bone, so that viewers
/// and browsers show it. Lengths are metres, y points up. For a body with skin, see body-synth; for FBX, see
/// posing-formats(7).
#[derive(Parser)]
#[command(
    name = "xyz2glb",
    version,
    after_help = "Examples:\n  posing xyz2glb -o walk.glb walk.csv\n  posing complete walk.csv | posing xyz2glb --skeleton 07.asf -o walk.glb"
)]
struct Args {
    /// Skeleton to fit, ASF [default: measured from the table, which needs the CMU joint names]
    #[arg(long, value_name = "SUBJECT.asf")]
    skeleton: Option<PathBuf>,
    /// Go on with a body that is smaller or larger than people are
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    take: OneTakeArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<()> {
    let one = args.take.read(args.skeleton.as_ref())?;
    let asf = args.skeleton.as_ref();
    let asf = asf.map(|path| Asf::read(open(path)?, None)).transpose()?;
    let table = one.table.clone();
    let NewTake {
        mut poses, rate, ..
    } = args.take.new_take(one, TableUnits::CM_Y, "GLB")?;
    let points = BonePoints::of(&poses.points, poses.xyz.view());
    if !args.force {
        let names = points.bone_ends(&poses.points);
        check_body_size(&poses, &names, &table, IN_CENTIMETRES)?;
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
        &table,
        "no point has the name of a bone of the skeleton",
    )?;
    let times: Vec<f64> = (0..poses.frames()).map(|t| t as f64 / rate).collect();
    let names: Vec<String> = skeleton.bones().iter().map(|b| b.name.clone()).collect();
    let name = poses.take.as_ref().and_then(|take| take.first());
    let name = name.map_or("take", |take| take);
    let mesh = SkinnedMesh::of_skeleton(name, &skeleton, &names, fitted.values(), &times);
    args.take.write(&mesh.to_glb()?, true)
}

//! Turns a take of an FBX file into a table of joint positions.

use clap::Parser;
use posing::Result;
use posing::cli::args::OutputArgs;
use posing::cli::fbx_args::FbxArgs;
use posing::cli::streams::write_table;
use posing::cli::{Outcome, messages};
use posing::io::Table;
use posing::io::fbx::to_poses;
use posing::io::input::take_name;
use posing::pose::units::Units;

/// Convert an FBX file to a pose table
///
/// Writes a pose table in centimeters, y up, whatever the file's unit and axes: one row per frame,
/// three columns per joint, depth first. A joint is a bone, or what stands between bones; meshes,
/// lights and cameras are none. Where a file has no bones, its largest moving tree of empty nodes
/// is the skeleton. Layers, pivots, pre-rotations and scales count. The take runs from its first
/// key to its last, and its time begins at 0.
///
/// A file of several takes or skeletons needs --take or --skeleton; the message lists them. Exit
/// code 3: keys are no numbers, and what hangs on them is empty.
#[derive(Parser)]
#[command(
    name = "fbx2xyz",
    version,
    after_help = "Examples:\
        \n  posing fbx2xyz walk.fbx > walk.csv\
        \n  posing fbx2xyz --fps 30 walk.fbx | posing plot -o walk.html"
)]
pub struct Args {
    #[command(flatten)]
    fbx: FbxArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    let file = args.fbx.open()?;
    let motion = args.fbx.motion(&file, &file.take(&args.fbx.choice())?)?;
    let mut poses = to_poses(&motion);
    let missing = poses.xyz.iter().filter(|v| v.is_nan()).count() / 3;
    if missing > 0 {
        let name = file.name();
        messages::info(&format!(
            "{name}: {missing} positions are empty: keys are not numbers"
        ));
    }
    poses.take = Some(vec![take_name(&args.fbx.path()).into(); poses.frames()]);
    let table = Table::from_poses(poses);
    let xyz = table.poses.xyz.view();
    write_table(&args.out, [Units::CM_Y; 2], &table, xyz, &[], |_| {
        Vec::new()
    })?;
    Ok(Outcome::of(missing > 0))
}

//! Makes meshes of a body.

use clap::Parser;
use posing::body::BodyModel;
use posing::cli::args::{CommonArgs, parse_rate};
use posing::cli::body::{open_body, read_rotations, read_shapes};
use posing::cli::body_take::{BodyTake, pose_take};
use posing::cli::mesh_output::MeshOutput;
use posing::cli::units::{TableUnits, Units, Up};
use posing::cli::{input, messages, run};
use posing::io::MeshFormat;
use posing::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Make meshes of a body from rotations or a pose table
///
/// Without rotations and poses, makes the body in the template's pose.
///
/// With --pose the body follows the joints of a pose table, which the model was told by body-train --joints: rotations and one shape
/// for the take are fitted to them, so that the bones are as long as those of the table. --shape puts another body into the same
/// rotations, at the same height above the ground.
#[derive(Parser)]
#[command(
    name = "body-synth",
    version,
    after_help = "Examples:\n  posing body-synth -m body.npz --shape 1.5,-1 -o tall.obj\n  posing body-synth -m body.npz --rotations rotations.csv -o frames/\n  posing body-synth -m body.npz --pose walk.csv -o walk.glb",
    after_long_help = "Files:\n  rotations.csv: take,time,part0.rx,part0.ry,part0.rz,...,root.x,root.y,root.z; rotation vectors of the parts in the world, radians, and the mean of the vertices of the root part, cm\n  shapes.csv: take,time,shape1,shape2,...; standard deviations of people; one row, or one a frame\n\nExamples:\n  posing body-synth -m body.npz --shape 1.5,-1 -o tall.obj\n  posing body-synth -m body.npz --rotations rotations.csv -o frames/\n  posing body-synth -m body.npz --pose walk.csv -o walk.glb"
)]
struct Args {
    /// Body model
    #[arg(short, long, value_name = "BODY.npz")]
    model: PathBuf,
    /// Rotations of the parts and place of the root, a row a mesh; - for standard input
    #[arg(long, value_name = "TABLE", conflicts_with = "pose")]
    rotations: Option<PathBuf>,
    /// Pose table whose joints the body follows; - for standard input
    #[arg(long, value_name = "POSES")]
    pose: Option<PathBuf>,
    /// Shape: comma-separated numbers, or a table (default: all 0; with --pose fitted)
    #[arg(long, value_name = "LIST|TABLE", allow_hyphen_values = true)]
    shape: Option<String>,
    /// Frames per second of a pose table without times
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
    /// Output: .obj, .ply, .stl for one mesh; .npz; .glb, an animated body for Blender, Unreal and viewers; or a folder (ending in /)
    /// for a file a mesh
    #[arg(short, long, value_name = "FILE|DIR/", help_heading = "Output")]
    output: PathBuf,
    /// Format of the files of a folder
    #[arg(long, value_name = "FORMAT", default_value = "ply", value_parser = ["obj", "ply", "stl"], help_heading = "Output")]
    mesh_format: String,
    /// Unit of length of the meshes
    #[arg(
        long,
        value_enum,
        value_name = "UNIT",
        default_value = "cm",
        help_heading = "Output"
    )]
    out_units: Units,
    /// Axis of the meshes that points up
    #[arg(
        long,
        value_enum,
        value_name = "AXIS",
        default_value = "y",
        help_heading = "Output"
    )]
    out_up: Up,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<()> {
    args.common.apply()?;
    let tables = args.rotations.iter().chain(&args.pose);
    input::check_single_stdin(tables.chain([&args.model]))?;
    let format = MeshFormat::of(format!("x.{}", args.mesh_format))?;
    let output = MeshOutput::of(&args.output, format)?;
    let body = open_body(&args.model)?;
    let take = with_shape(args, &body, take(args, &body)?)?;
    let units = TableUnits {
        unit: args.out_units,
        up: args.out_up,
    };
    take.write(&output, &body, units)?;
    messages::debug(&format!("made {} meshes", take.frames.len()));
    Ok(())
}

/// The rotations that are asked for.
fn take(args: &Args, body: &BodyModel) -> Result<BodyTake> {
    if let Some(path) = &args.pose {
        return pose_take(body, path, args.fps);
    }
    match &args.rotations {
        None => Ok(BodyTake::at_rest(body)),
        Some(path) => {
            let table = read_rotations(path, body.template.parts())?;
            Ok(BodyTake::of_rotations(table, args.fps))
        }
    }
}

/// The take with the shapes that are asked for.
fn with_shape(args: &Args, body: &BodyModel, mut take: BodyTake) -> Result<BodyTake> {
    let Some(text) = &args.shape else {
        return Ok(take);
    };
    let shapes = read_shapes(text, body.shape.len())?;
    let (frames, count) = (take.frames.len(), shapes.len());
    if frames == 1 && count > 1 && args.pose.is_none() && args.rotations.is_none() {
        take = take.repeated(count);
    } else if count != 1 && count != frames {
        return Err(Error::usage(format!(
            "--shape has {count} rows for {frames} frames; give one, or one a frame"
        )));
    }
    // The root of a table of rotations is where the user wants it; a pose table's is that of another body.
    Ok(match args.pose {
        Some(_) => take.on_body(body, shapes),
        None => BodyTake { shapes, ..take },
    })
}

//! Makes meshes of a body.

use clap::Parser;
use posing::body::BodyModel;
use posing::body::take::{BodyTake, frames_of};
use posing::cli::args::{InputArgs, parse_rate};
use posing::cli::body::pose_take;
use posing::cli::body::{open_body, read_rotations, read_shapes};
use posing::cli::body_output::TakeOutput;
use posing::cli::choice::choice;
use posing::cli::paths::OutputPath;
use posing::cli::{input, messages};
use posing::pose::units::{LengthUnit, Units, UpAxis};
use posing::{Error, Result};
use std::path::PathBuf;

/// Make meshes of a body from rotations or a pose table
///
/// Without rotations and poses, makes the body in the template's pose.
///
/// With --pose the body follows the joints of a pose table, which the model was told by body-train
/// --joints: rotations and one shape for the take are fitted to them, so that the bones are as long
/// as those of the table. --shape puts another body into the same rotations, at the same height
/// above the ground.
#[derive(Parser)]
#[command(
    name = "body-synth",
    version,
    after_help = "Examples:\
        \n  posing body-synth -m body.npz --shape 1.5,-1 -o tall.obj\
        \n  posing body-synth -m body.npz --rotations rotations.csv -o frames/\
        \n  posing body-synth -m body.npz --pose walk.csv -o walk.glb",
    after_long_help = "Files:\n  rotations.csv: \
                       take,time,part0.rx,part0.ry,part0.rz,...,root.x,root.y,root.z; rotation \
                       vectors of the parts in the world, radians, and the mean of the vertices \
                       of the root part, cm\n  shapes.csv: take,time,shape1,shape2,...; standard \
                       deviations of people; one row, or one a frame"
)]
pub struct Args {
    /// Body model
    #[arg(short, long, value_name = "BODY.npz")]
    model: PathBuf,
    /// Rotations of the parts and place of the root, a row per mesh; - for standard input
    #[arg(long, value_name = "TABLE", conflicts_with = "pose")]
    rotations: Option<PathBuf>,
    /// Pose table whose joints the body follows; - for standard input
    #[arg(long, value_name = "POSES")]
    pose: Option<PathBuf>,
    /// Shape: comma-separated numbers, or a table (default: all 0; with --pose fitted)
    #[arg(long, value_name = "LIST|TABLE", allow_hyphen_values = true)]
    shape: Option<String>,
    /// Frames per second of a table without times
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
    /// Output: .obj, .ply, .stl for one mesh; .npz; .glb, an animated body for Blender, Unreal and
    /// viewers; or a folder (ending in /) for a file per mesh
    #[arg(short, long, value_name = "FILE|DIR/", help_heading = "Output")]
    output: OutputPath,
    /// Format of the files of a folder [default: ply]
    #[arg(
        long,
        value_name = "FORMAT",
        value_parser = ["obj", "ply", "stl", "off"],
        help_heading = "Output"
    )]
    mesh_format: Option<String>,
    /// Unit of length of the meshes
    #[arg(
        long,
        value_parser = choice::<LengthUnit>(),
        value_name = "UNIT",
        default_value = "cm",
        help_heading = "Output"
    )]
    out_units: LengthUnit,
    /// Axis of the meshes that points up
    #[arg(
        long,
        value_parser = choice::<UpAxis>(),
        value_name = "AXIS",
        allow_hyphen_values = true,
        default_value = "y",
        help_heading = "Output"
    )]
    out_up: UpAxis,
}

pub fn work(args: &Args) -> Result<()> {
    let tables = args.rotations.iter().chain(&args.pose);
    input::check_single_stdin(tables.chain([&args.model]))?;
    let units = Units {
        unit: args.out_units,
        up: args.out_up,
    };
    let output = TakeOutput::of(&args.output, args.mesh_format.as_deref(), units)?;
    let body = open_body(&args.model)?;
    let take = with_shape(args, &body, take(args, &body)?)?;
    output.check_times(take.frames.len(), take.poses.time.is_some())?;
    output.write(&take, &body, units)?;
    messages::debug(&format!("made {} meshes", take.frames.len()));
    Ok(())
}

/// The rotations that are asked for.
fn take(args: &Args, body: &BodyModel) -> Result<BodyTake> {
    if let Some(path) = &args.pose {
        return pose_take(body, &InputArgs::plain(vec![path.clone()], args.fps));
    }
    match &args.rotations {
        None => Ok(BodyTake::at_rest(body)),
        Some(path) => {
            let table = read_rotations(path, body.template.parts())?;
            let poses = frames_of(table.frames.len(), table.table.time, table.table.take);
            Ok(BodyTake::of_rotations(&poses, table.frames, args.fps))
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
    if take.is_at_rest() && count > 1 {
        take = take.repeated(count);
    } else if count != 1 && count != frames {
        return Err(Error::usage(format!(
            "--shape has {count} rows for {frames} frames; give one, or one a frame"
        )));
    }
    let lacks = |k: &usize| take.frames[*k].is_some() && shapes[*k].is_none();
    if let Some(k) = (0..count).find(lacks) {
        return Err(Error::usage(format!("--shape: row {} is empty", k + 1)));
    }
    let shapes = shapes.into_iter().map(Option::unwrap_or_default).collect();
    // The root of a table of rotations is where the user wants it; a pose table's is that of
    // another body.
    Ok(match args.pose {
        Some(_) => take.on_body(body, shapes),
        None => BodyTake { shapes, ..take },
    })
}

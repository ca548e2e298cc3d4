//! Animates a body from a take of markers.

mod scan_markers;

use self::scan_markers::markers_on_scan;
use clap::Parser;
use posing::body::BodyModel;
use posing::body::Marker;
use posing::body::animation::Offsets;
use posing::body::take::BodyTake;
use posing::cli::args::TimedTableArgs;
use posing::cli::body::fit_take;
use posing::cli::body::{
    marker_frames, open_body, read_marker_map, read_shapes, smooth, write_rotations, write_shapes,
};
use posing::cli::body_output::TakeOutput;
use posing::cli::choice::choice;
use posing::cli::paths::OutputPath;
use posing::cli::{Outcome, input};
use posing::io::Table;
use posing::pose::units::{LengthUnit, Units, UpAxis, parse_length};
use posing::{Error, Result};
use std::path::PathBuf;

/// Animate a body from a take of markers
///
/// Fits one shape to the whole take, and the rotations of the parts to each frame, which starts
/// from the one before. Which vertex each marker is on comes from --on; or it is learned, with the
/// marker's distance from the skin, from a mesh of the person (--scan) and the frame at which it
/// was taken.
///
/// The meshes are the model's own (the predicted ones of body-fit): markers off the skin do not
/// dent them. --shape moves the take to another body.
///
/// Markers that do not fit are left out and named with their distance, mirrored ones are told: the
/// exit status is 3 then.
#[derive(Parser)]
#[command(
    name = "body-animate",
    version,
    after_help = "Examples:\n  posing body-animate -m body.npz --on on.csv -o frames/ \
                  markers.csv\n  posing body-animate -m body.npz --on on.csv --shape 2 -o \
                  other.npz --rotations rotations.csv markers.csv",
    after_long_help = "Files:\n  on.csv: point,vertex; the vertex that each point of the table is \
                       on, counted from 0"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Body model
    #[arg(short, long, value_name = "BODY.npz")]
    model: PathBuf,
    /// The vertex that each point is on
    #[arg(
        long,
        value_name = "MAP.csv",
        required_unless_present = "scan",
        conflicts_with = "scan"
    )]
    on: Option<PathBuf>,
    /// Mesh of the person, of the model's topology (from mesh-register or body-scan), where the
    /// markers are at frame --scan-frame
    #[arg(long, value_name = "MESH", requires_all = ["scan_frame", "scan_units"])]
    scan: Option<PathBuf>,
    /// Frame of the table, counted from 0, at which the scan was taken
    #[arg(long, value_name = "N")]
    scan_frame: Option<usize>,
    /// Unit of length of the scan: its file has none
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT")]
    scan_units: Option<LengthUnit>,
    /// Axis of the scan that points up
    #[arg(long, value_parser = choice::<UpAxis>(), value_name = "AXIS", default_value = "y")]
    #[arg(allow_hyphen_values = true)]
    scan_up: UpAxis,
    /// Noise of the markers: standard deviation per coordinate, in cm or with a unit
    #[arg(long, value_name = "LENGTH", default_value = "0.5", value_parser = parse_length)]
    noise: f64,
    /// Leave the markers as they are: else noise is taken from their paths first, as denoise --self
    /// does, where a rate is known
    #[arg(long)]
    no_smooth: bool,
    /// Shape of another body: comma-separated numbers, or a table of one row
    #[arg(long, value_name = "LIST|TABLE", allow_hyphen_values = true)]
    shape: Option<String>,
    /// Output: .npz; .glb, an animated body for Blender, Unreal and viewers; or a folder (ending
    /// in /) for a PLY file per frame
    #[arg(short, long, value_name = "FILE|DIR/", help_heading = "Output")]
    output: OutputPath,
    /// Write the rotations and the root position as a table, for body-synth
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    rotations: Option<OutputPath>,
    /// Write the shape as a table, for body-synth
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    shapes: Option<OutputPath>,
}

pub fn work(args: &Args) -> Result<Outcome> {
    let files = args.on.iter().chain(&args.scan);
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, files.chain([&args.model]))?;
    let output = TakeOutput::of(&args.output, None, Units::CM_Y)?;
    let body = open_body(&args.model)?;
    let mut table = input::read_table(&tables, false, false)?;
    let fps = tables.rate(&table.poses)?;
    if !args.no_smooth {
        smooth(&mut table, fps)?;
    }
    output.check_times(
        table.poses.frames(),
        table.poses.time.is_some() || fps.is_some(),
    )?;
    let other = args.shape.as_deref().map(|text| other_shape(text, &body));
    let other = other.transpose()?;
    let (names, markers) = markers(args, &body, &table)?;
    let frames = marker_frames(&body, &markers, &table, &names, "the map")?;
    let known = Offsets::Known;
    let named = (&names[..], &markers[..]);
    let (animation, findings) = fit_take(&body, named, &frames, args.noise, known, &table.name)?;
    let mut take = BodyTake::of(&body, &animation, &table.poses, fps);
    if let Some(shape) = other {
        take = take.on_body(&body, vec![shape]);
    }
    if let Some(path) = &args.rotations {
        write_rotations(path, &take.poses, body.template.parts(), &take.frames)?;
    }
    if let Some(path) = &args.shapes {
        let shapes = vec![Some(take.shape(0).to_vec()); take.frames.len()];
        write_shapes(path, &take.poses, take.shape(0).len(), &shapes)?;
    }
    output.write(&take, &body, Units::CM_Y)?;
    Ok(Outcome::of(findings > 0))
}

/// The one shape of a take.
fn other_shape(text: &str, body: &BodyModel) -> Result<Vec<f64>> {
    match &read_shapes(text, body.shape.len())?[..] {
        [Some(shape)] => Ok(shape.clone()),
        _ => Err(Error::usage("--shape: a take has one shape; give one row")),
    }
}

/// The names of the markers, and where they are on the body.
fn markers(args: &Args, body: &BodyModel, table: &Table) -> Result<(Vec<String>, Vec<Marker>)> {
    match (&args.on, &args.scan, args.scan_frame, args.scan_units) {
        (_, Some(scan), Some(frame), Some(unit)) => {
            let units = Units {
                unit,
                up: args.scan_up,
            };
            markers_on_scan(body, scan, units, table, frame)
        }
        (Some(on), ..) => read_marker_map(on, body.template.vertices.len()),
        _ => Err(Error::usage("give --on MAP.csv or --scan MESH")),
    }
}

//! Completes a body from a partial scan.

use clap::Parser;
use posing::body::scan_fit::fit_scan;
use posing::cli::args::MeshUnitArgs;
use posing::cli::body::open_body;
use posing::cli::paths::OutputPath;
use posing::cli::registration_points::{RegistrationPoints, read_scan};
use posing::cli::{input, messages};
use posing::io::mesh_output::MeshOutput;
use posing::{Place, Result};
use std::path::PathBuf;

/// Complete a body from a partial scan and a few points
///
/// Finds the pose and the shape of a body from a scan of a part of it, such as one side, with noise
/// and holes. Four to ten points that a person has placed on the scan start the pose. The output is
/// a whole mesh of the model's topology, in the unit and axis of the scan: where there is scan it
/// follows it, elsewhere it is the body that goes with it.
#[derive(Parser)]
#[command(
    name = "body-scan",
    version,
    after_help = "Examples:\
        \n  posing body-scan -m body.npz --units cm --points points.csv -o whole.ply scan.ply",
    after_long_help = "Files:\n  points.csv: vertex,x,y,z; a vertex of the model, counted from 0, \
                       and where it is on the scan, in the scan's unit"
)]
pub struct Args {
    /// Scan: OBJ, PLY, STL or OFF; without faces a cloud of points
    #[arg(value_name = "SCAN")]
    scan: PathBuf,
    /// Body model
    #[arg(short, long, value_name = "BODY.npz")]
    model: PathBuf,
    /// Points placed on the scan, four or more
    #[arg(long, value_name = "POINTS.csv")]
    points: PathBuf,
    #[command(flatten)]
    units: MeshUnitArgs,
    /// Output file: .obj, .ply, .stl or .npz
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: OutputPath,
}

pub fn work(args: &Args) -> Result<()> {
    input::check_single_stdin([&args.scan, &args.model, &args.points])?;
    let output = MeshOutput::of(&args.output, "ply")?;
    let body = open_body(&args.model)?;
    let units = args.units.table_units();
    let source = args.scan.display().to_string();
    let scan = read_scan(&args.scan, units)?;
    let template = &body.template.vertices;
    let placed = RegistrationPoints::read(&args.points, template.len(), units)?;
    placed.check(template, &scan)?;
    let fit = fit_scan(&body, &scan, &placed.points).map_err(|e| e.at(Place::file(&source)))?;
    if fit.is_inside_out {
        messages::info("the faces of the scan look inwards: they were turned round");
    }
    messages::info(&format!(
        "{:.0}% of the scan's points are within 1 cm of the body, {:.2} cm from it (RMS)",
        100.0 * fit.share,
        fit.rms
    ));
    if fit.share < 0.5 {
        messages::info("most of the scan is not on the body: are the points and --units right?");
    }
    output.write(&[fit.completed], body.template.surface(), units)
}

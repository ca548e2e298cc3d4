//! Lays a template's mesh on a raw scan.

use clap::Parser;
use posing::body::Template;
use posing::body::registration::{ROUNDS, Registration, register};
use posing::cli::args::MeshUnitArgs;
use posing::cli::body::{read_meshes, vertices};
use posing::cli::choice::choice;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::registration_points::{RegistrationPoints, read_scan};
use posing::cli::{input, messages};
use posing::io::MeshFormat;
use posing::io::mesh_output::mesh;
use posing::pose::units::{LengthUnit, Units, UpAxis};
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// Lay a template mesh on a raw scan
///
/// Writes a mesh that has the vertices and faces of the template and the surface of the scan
/// (non-rigid ICP), for body-train, body-fit and body-animate. Where the scan has holes, the mesh
/// follows its surroundings. A scan without faces is a cloud of points.
///
/// Some vertices of the template are placed on the scan by hand, in a program that shows meshes: 4
/// or more, better 10 for a scan in the template's pose, and 20 (joints, hands, feet, head) in
/// another. Axes need not agree. The mesh is in the scan's unit and place.
#[derive(Parser)]
#[command(
    name = "mesh-register",
    version,
    after_help = "Examples:\n  posing mesh-register --units cm --template template.ply --points \
                  points.csv -o registered.ply scan.ply",
    after_long_help = "Files:\n  template, scan: OBJ, PLY, STL, OFF\n  points.csv: vertex,x,y,z; \
                       a vertex of the template, counted from 0, and where it is on the scan, in \
                       the scan's unit"
)]
pub struct Args {
    /// Scan; - is standard input
    #[arg(value_name = "SCAN")]
    scan: PathBuf,
    /// Mesh whose vertices and faces the result has
    #[arg(long, value_name = "MESH")]
    template: PathBuf,
    /// Where vertices of the template are on the scan
    #[arg(long, value_name = "POINTS.csv")]
    points: PathBuf,
    #[command(flatten)]
    units: MeshUnitArgs,
    /// Unit of length of the template (default: that of the scan)
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT", help_heading = "Input")]
    template_units: Option<LengthUnit>,
    /// Output mesh: .obj, .ply or .stl
    #[arg(short, long, value_name = "MESH")]
    output: OutputPath,
}

pub fn work(args: &Args) -> Result<()> {
    MeshFormat::of(&args.output)?;
    input::check_single_stdin([&args.scan, &args.points])?;
    let units = args.units.table_units();
    let template = read_template(
        &args.template,
        Units {
            unit: args.template_units.unwrap_or(units.unit),
            up: UpAxis::Y.handed(args.units.axes.left_handed),
        },
    )?;
    let points = RegistrationPoints::read(&args.points, template.vertices.len(), units)?;
    let scan = read_scan(&args.scan, units)?;
    points.check(&template.vertices, &scan)?;
    let bar = Progress::new("rounds", ROUNDS as u64);
    let mut done = 0;
    let found = register(&template, &scan, &points.points, &mut || {
        done += 1;
        bar.set(done);
    })
    .map_err(|e| e.at(Place::file(args.template.display().to_string())))?;
    drop(bar);
    report(&found);
    mesh(&found.vertices, template.surface(), units).save(&args.output)
}

/// The template, as a body of one part.
fn read_template(path: &Path, units: Units) -> Result<Template> {
    let set = read_meshes(&[path], units)?;
    let fail = |what: String| Error::data(Place::file(&set.names[0]), what);
    if set.names.len() != 1 {
        return Err(fail(format!(
            "is one of {} meshes, expected one",
            set.names.len()
        )));
    }
    let faces = set.faces.iter().map(|f| f.map(|v| v as usize)).collect();
    let parts = vec![0; set.vertices.dim().1];
    Template::new(vertices(&set, 0), faces, parts).map_err(|e| e.at(Place::file(&set.names[0])))
}

/// Says how near the mesh is to the scan, what the scan does not show, and whether the mesh folds.
fn report(found: &Registration) {
    let seen: Vec<f64> = found.distances.iter().flatten().copied().collect();
    let all = found.distances.len();
    messages::info(&match seen.len() {
        0 => "no vertex is near the scan; check the points".into(),
        n => format!(
            "mean distance to the scan {:.3} cm; {:.1}% of {all} vertices without scan data",
            seen.iter().sum::<f64>() / n as f64,
            100.0 * (all - n) as f64 / all as f64
        ),
    });
    if found.folds > 0 {
        messages::info(&format!(
            "the mesh folds: {} triangles point against their neighbors",
            found.folds
        ));
    }
}

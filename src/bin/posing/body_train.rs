//! Learns a body from meshes.

use clap::Parser;
use glam::DVec3;
use posing::body::correspondence;
use posing::body::fit::FEWEST;
use posing::body::part_finding::find_parts;
use posing::body::train::{Settings, train};
use posing::body::{BodyModel, Template};
use posing::cli::args::MeshUnitArgs;
use posing::cli::body::{read_meshes, vertices};
use posing::cli::choice::choice;
use posing::cli::pair_file::PairFile;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::{messages, streams};
use posing::io::MeshSet;
use posing::io::text::excerpt;
use posing::pose::units::{LengthUnit, Units, UpAxis};
use posing::prior::provenance::{digest, entry};
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Learn a body's pose and shape from meshes
///
/// Learns how a surface follows its joints from poses of one person, and how bodies differ from
/// meshes of people in any pose (SCAPE). All meshes have one topology: the same vertices and faces
/// in the same order. The first pose is the template. body-synth makes meshes of the model,
/// body-fit completes markers, body-animate takes of markers.
///
/// Rigid parts are found from the poses, or given by --parts; joints stand where parts meet.
///
/// For one performer whose own poses are at hand, leave --shapes out: a model of people fits one
/// person less well than one of that person's poses (12 against 8 mm from 60 markers, registered
/// scans).
///
/// The summary says how far the vertices of meshes are that are left out of the training; model
/// info says it again.
#[derive(Parser)]
#[command(
    name = "body-train",
    version,
    after_help = "Examples:\
        \n  posing body-train --units cm --poses poses.npz --shapes people.npz -o body.npz\
        \n  posing body-train --units cm --poses poses/ --parts parts.csv -o body.npz",
    after_long_help = "Files:\n  meshes: OBJ, PLY, STL, OFF; folders of them, read in the order \
                       of their names; .npz with vertices (n, V, 3) and faces (F, 3)\n  \
                       parts.csv: vertex,part; both count from 0\n  joints.csv: part,joint; the \
                       point of a pose table at the joint where the part begins; in a second line \
                       of the same part, the point at its far end"
)]
pub struct Args {
    /// Meshes of one person in many poses; the first is the template
    #[arg(long, value_name = "MESHES", num_args = 1.., required = true)]
    poses: Vec<PathBuf>,
    /// Meshes of people, one each; without them the body has one shape
    #[arg(long, value_name = "MESHES", num_args = 1..)]
    shapes: Vec<PathBuf>,
    #[command(flatten)]
    units: MeshUnitArgs,
    /// Unit of length of --shapes [default: that of --units]
    #[arg(
        long,
        value_parser = choice::<LengthUnit>(),
        value_name = "UNIT",
        requires = "shapes",
        help_heading = "Input"
    )]
    shape_units: Option<LengthUnit>,
    /// Axis of --shapes that points up [default: that of --up]
    #[arg(
        long,
        value_parser = choice::<UpAxis>(),
        value_name = "AXIS",
        allow_hyphen_values = true,
        requires = "shapes",
        help_heading = "Input"
    )]
    shape_up: Option<UpAxis>,
    /// The rigid part of each vertex (default: parts are found from the poses)
    #[arg(long, value_name = "PARTS.csv")]
    parts: Option<PathBuf>,
    /// Number of parts to find
    #[arg(
        long,
        value_name = "N",
        default_value_t = 16,
        conflicts_with = "parts",
        value_parser = clap::value_parser!(u16).range(2..=256)
    )]
    part_count: u16,
    /// Points of a pose table at the joints where parts begin, for body-synth --pose
    #[arg(long, value_name = "JOINTS.csv")]
    joints: Option<PathBuf>,
    /// The model as Anguelov et al. (2005) published it: two joints a part, components of the
    /// matrices; less accurate
    #[arg(long)]
    paper: bool,
    /// Output file
    #[arg(short, long, value_name = "BODY.npz")]
    output: OutputPath,
}

pub fn work(args: &Args) -> Result<()> {
    let units = args.units.table_units();
    let poses = read_meshes(&args.poses, units)?;
    let people = if args.shapes.is_empty() {
        None
    } else {
        let units = Units {
            unit: args.shape_units.unwrap_or(units.unit),
            up: (args.shape_up).map_or(units.up, |up| up.handed(args.units.axes.left_handed)),
        };
        Some(read_people(args, units, &poses)?)
    };
    report_findings(&poses);
    let meshes = |set: &MeshSet| -> Vec<Vec<DVec3>> {
        (0..set.names.len()).map(|k| vertices(set, k)).collect()
    };
    let (pose_meshes, people_meshes) = (meshes(&poses), people.as_ref().map_or(Vec::new(), meshes));
    let template = template(args, &poses, &pose_meshes)?;
    let names = poses
        .names
        .iter()
        .chain(people.iter().flat_map(|p| &p.names));
    check(
        &template,
        names.zip(pose_meshes.iter().chain(&people_meshes)),
    )?;
    let settings = if args.paper {
        Settings::paper()
    } else {
        Settings::default()
    };
    let total = pose_meshes.len() + people_meshes.len();
    let bar = Progress::new("meshes", total as u64);
    let mut done = 0;
    let mut body = train(
        template,
        &pose_meshes,
        &people_meshes,
        &settings,
        &mut || {
            done += 1;
            bar.set(done);
        },
    )
    .map_err(|e| e.at(Place::file(&poses.names[0])))?;
    drop(bar);
    if let Some(path) = &args.joints {
        body.joint_names = joint_names(path, body.template.parts())?;
    }
    messages::info(&format!(
        "learned from {} poses and {} people: {} vertices, {} parts, {} components of shape",
        pose_meshes.len(),
        people_meshes.len(),
        body.template.vertices.len(),
        body.template.parts(),
        body.shape.len()
    ));
    report_errors(&body);
    save(args, &body, &settings, &poses, people.as_ref())
}

/// The people, of the topology of the poses.
fn read_people(args: &Args, units: Units, poses: &MeshSet) -> Result<MeshSet> {
    let people = read_meshes(&args.shapes, units)?;
    if people.faces != poses.faces || people.vertices.dim().1 != poses.vertices.dim().1 {
        let what = format!(
            "has {} vertices and {} faces, {} has {} and {}; poses and people need the same \
             vertices and faces",
            people.vertices.dim().1,
            people.faces.len(),
            poses.names[0],
            poses.vertices.dim().1,
            poses.faces.len()
        );
        return Err(Error::data(Place::file(&people.names[0]), what));
    }
    Ok(people)
}

/// Says how good the body is on what it was not learned from.
fn report_errors(body: &BodyModel) {
    let Some(errors) = &body.errors else {
        return;
    };
    let millimeters = |what: &str, cm: Option<f64>| match cm {
        Some(cm) => format!("{what} {:.1}", 10.0 * cm),
        None => format!("{what} unknown (of ten or more)"),
    };
    messages::info(&format!(
        "mean error of the vertices, mm: {}, {}, by {}s of the joints, {}",
        millimeters("decomposed", Some(errors.decomposed)),
        millimeters("poses left out", errors.poses),
        body.pose.inputs.name(),
        millimeters("people left out", errors.people),
    ));
}

/// Says what is odd about the template.
fn report_findings(poses: &MeshSet) {
    for finding in poses.mesh(0).check() {
        messages::info(&format!("{}: {finding}", poses.names[0]));
    }
}

fn template(args: &Args, poses: &MeshSet, meshes: &[Vec<DVec3>]) -> Result<Template> {
    let name = &poses.names[0];
    let fail = |e: Error| e.at(Place::file(name));
    let faces: Vec<[usize; 3]> = (poses.faces.iter())
        .map(|f| f.map(|v| v as usize))
        .collect();
    let first = meshes[0].clone();
    let parts = match &args.parts {
        Some(path) => read_parts(path, first.len())?,
        None => {
            let whole =
                Template::new(first.clone(), faces.clone(), vec![0; first.len()]).map_err(fail)?;
            let count = usize::from(args.part_count);
            find_parts(&whole.vertices, &whole.faces, meshes, count).map_err(fail)?
        }
    };
    Template::new(first, faces, parts).map_err(fail)
}

/// Whether all meshes are the template's, vertex by vertex.
fn check<'a>(
    template: &Template,
    mut meshes: impl Iterator<Item = (&'a String, &'a Vec<DVec3>)>,
) -> Result<()> {
    let own = |(name, mesh): (&'a String, &'a Vec<DVec3>)| {
        Some((name, correspondence::mismatch(template, mesh)?))
    };
    let first = meshes.next();
    let of_template = first.and_then(|(n, _)| Some((n, correspondence::wrong_template(template)?)));
    match of_template.or_else(|| meshes.find_map(own)) {
        Some((name, what)) => Err(Error::data(Place::file(name), what)),
        None => Ok(()),
    }
}

/// The part of each vertex (`vertex,part`).
fn read_parts(path: &std::path::Path, vertices: usize) -> Result<Vec<usize>> {
    const MOST_PARTS: usize = 2048;
    let file = PairFile::read(path, ["vertex", "part"])?;
    let mut parts = vec![usize::MAX; vertices];
    for (line, vertex, part) in &file.rows {
        let vertex = file.index(*line, vertex, "vertex", vertices)?;
        let part = file.index(*line, part, "part", MOST_PARTS)?;
        if parts[vertex] != usize::MAX && parts[vertex] != part {
            let what = format!("gives vertex {vertex} a second part");
            return Err(Error::data(Place::line(&file.name, *line), what));
        }
        parts[vertex] = part;
    }
    let fail = |what: String| Err(Error::data(Place::file(&file.name), what));
    if let Some(v) = parts.iter().position(|p| *p == usize::MAX) {
        return fail(format!(
            "has no part for vertex {v}; the meshes have {vertices} vertices (counted from 0)"
        ));
    }
    let count = parts.iter().max().map_or(0, |p| p + 1);
    match (0..count).find(|p| !parts.contains(p)) {
        Some(part) => fail(format!(
            "has part {} but not part {part}: number the parts from 0 without gaps",
            count - 1
        )),
        None => Ok(parts),
    }
}

/// The points where parts begin, and of a second line end (`part,joint`).
fn joint_names(path: &std::path::Path, parts: usize) -> Result<Vec<(usize, String)>> {
    let file = PairFile::read(path, ["part", "joint"])?;
    let mut names: Vec<(usize, String)> = Vec::new();
    for (line, part, joint) in &file.rows {
        let part = file.index(*line, part, "part", parts)?;
        let wrong = |what: String| Err(Error::data(Place::line(&file.name, *line), what));
        if names.iter().any(|(_, name)| name == joint) {
            return wrong(format!(
                "names the point \"{}\" a second time",
                excerpt(joint)
            ));
        }
        if names.iter().filter(|(p, _)| *p == part).count() == 2 {
            return wrong(format!(
                "gives part {part} a third point; it has one where it begins and one at its far \
                 end"
            ));
        }
        names.push((part, joint.clone()));
    }
    if names.len() < FEWEST {
        let what = format!("has {} points; a pose needs {FEWEST} or more", names.len());
        return Err(Error::data(Place::file(&file.name), what));
    }
    Ok(names)
}

fn save(
    args: &Args,
    body: &BodyModel,
    settings: &Settings,
    poses: &MeshSet,
    people: Option<&MeshSet>,
) -> Result<()> {
    let mut model = body.to_model();
    let flags = [
        ("paper", args.paper.to_string()),
        ("components", settings.components.to_string()),
        ("parts", body.template.parts().to_string()),
        ("parts-given", args.parts.is_some().to_string()),
    ];
    let digest_of = |set: &MeshSet| {
        let rows = (set.vertices.dim().0, 3 * set.vertices.dim().1);
        let flat = set.vertices.to_shape(rows);
        flat.map_or(String::new(), |flat| digest(&[], flat.view()))
    };
    let inputs = [poses].into_iter().chain(people).map(digest_of).collect();
    model.meta.history.push(entry("body-train", &flags, inputs));
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)
}

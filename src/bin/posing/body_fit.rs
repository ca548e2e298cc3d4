//! Completes a body from markers on it.

use clap::Parser;
use glam::{DMat3, DVec3};
use posing::body::completion::{Completion, complete};
use posing::body::fit::{Fit, FitProblem};
use posing::body::take::timed;
use posing::body::{BodyModel, MarkerModel};
use posing::cli::Outcome;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::body::{
    marker_frames, open_body, read_marker_map, report_fits, report_markers, write_rotations,
    write_shapes,
};
use posing::cli::progress::Progress;
use posing::cli::{input, streams};
use posing::io::MeshFormat;
use posing::io::mesh_output::{MeshOutput, face_array, vertex_array};
use posing::io::npz::{NpzArray, NpzValues, npz_bytes};
use posing::numeric::parallel;
use posing::pose::units::{Units, parse_length};
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Complete a body from markers on its skin
///
/// Finds, for each frame on its own, the rotations of the parts and the shape of a body whose
/// vertices are at the markers. The output has two meshes a frame: the predicted one is a body of
/// the model; the completed one is warped from it so that it goes (nearly) through the markers.
/// Positions and meshes are in centimeters.
///
/// Each part needs about three markers. For a take of one person, whose shape stays the same, use
/// body-animate.
#[derive(Parser)]
#[command(
    name = "body-fit",
    version,
    after_help = "Examples:\n  posing body-fit -m body.npz --on on.csv -o fits.npz markers.csv\n  \
                  posing body-fit -m body.npz --on on.csv --noise 0.5 -o fits.npz --meshes fits/ \
                  markers.csv",
    after_long_help = "Files:\n  on.csv: point,vertex; the vertex that each point of the table is \
                       on, counted from 0\n  fits.npz: completed and predicted (frames, V, 3) cm, \
                       rotations (frames, parts, 3, 3), shape (frames, K), faces (F, 3); NaN \
                       where a frame has too few markers\n\nExamples:\n  posing body-fit -m \
                       body.npz --on on.csv -o fits.npz markers.csv\n  posing body-fit -m \
                       body.npz --on on.csv --noise 0.5 -o fits.npz --meshes fits/ markers.csv"
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Body model
    #[arg(short, long, value_name = "BODY.npz")]
    model: PathBuf,
    /// The vertex that each point is on
    #[arg(long, value_name = "MAP.csv")]
    on: PathBuf,
    /// Noise of the markers: standard deviation per coordinate, in cm or with a unit
    #[arg(long, value_name = "LENGTH", default_value = "0.18", value_parser = parse_length)]
    noise: f64,
    /// Output file
    #[arg(short, long, value_name = "FITS.npz", help_heading = "Output")]
    output: PathBuf,
    /// Write the completed meshes to a folder, as PLY
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    meshes: Option<PathBuf>,
    /// Write the rotations and the root position as a table, for body-synth
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    rotations: Option<PathBuf>,
    /// Write the shapes as a table, for body-synth
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    shapes: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    input::check_single_stdin_with(&args.input, [&args.model, &args.on])?;
    let body = open_body(&args.model)?;
    let (names, markers) = read_marker_map(&args.on, body.template.vertices.len())?;
    let table = input::read_table(&args.input, false, false)?;
    let frames = marker_frames(&body, &markers, &table, &names, "the map")?;
    let poses = timed(&table.poses, args.input.rate(&table.poses)?);
    let model = MarkerModel::new(&body, &markers);
    let mut prior = body.fit_prior();
    prior.noise = args.noise;
    let bar = Progress::new("frames", frames.len() as u64);
    let mut fits: Vec<Option<(Fit, Completion)>> = Vec::with_capacity(frames.len());
    // In blocks, for the bar.
    for block in frames.chunks(32) {
        fits.extend(parallel::map_chunks(block.len(), 1, |range| {
            let problem = FitProblem::new(&model, &prior, &block[range.start]).ok()?;
            let fit = problem.solve(None);
            let shape = body.shape.matrices(&fit.state.shape);
            let completion = complete(&body, &fit, &shape, args.noise);
            Some((fit, completion))
        }));
        bar.set(fits.len() as u64);
    }
    drop(bar);
    let findings = report(&fits, &table.name, &names)?;
    write(args, &body, &fits)?;
    let state = |f: &Option<(Fit, Completion)>| {
        let (fit, completion) = f.as_ref()?;
        let root = body.template.root_of(&completion.predicted);
        Some((fit.state.rotations.clone(), root))
    };
    if let Some(path) = &args.rotations {
        let frames: Vec<_> = fits.iter().map(state).collect();
        write_rotations(path, &poses, body.template.parts(), &frames)?;
    }
    if let Some(path) = &args.shapes {
        let shapes: Vec<_> = fits
            .iter()
            .map(|f| Some(f.as_ref()?.0.state.shape.clone()))
            .collect();
        write_shapes(path, &poses, body.shape.len(), &shapes)?;
    }
    Ok(match findings {
        0 => Outcome::Done,
        _ => Outcome::Findings,
    })
}

/// Tells how the fits are; how many findings there are.
fn report(fits: &[Option<(Fit, Completion)>], source: &str, names: &[String]) -> Result<usize> {
    let rms: Vec<f64> = fits.iter().flatten().map(|(f, _)| f.rms).collect();
    if rms.is_empty() {
        let what = "no frame has four markers of the map or more";
        return Err(Error::data(Place::file(source), what));
    }
    report_fits(rms, fits.len(), "markers are", "the predicted bodies");
    let fits: Vec<&Fit> = fits.iter().flatten().map(|(fit, _)| fit).collect();
    Ok(report_markers(&fits, source, names))
}

fn write(args: &Args, body: &BodyModel, fits: &[Option<(Fit, Completion)>]) -> Result<()> {
    let meshes = |of: fn(&Completion) -> &Vec<DVec3>| -> Vec<Vec<DVec3>> {
        let mesh = |f: &Option<(Fit, Completion)>| f.as_ref().map(|(_, c)| of(c).clone());
        fits.iter().map(|f| mesh(f).unwrap_or_default()).collect()
    };
    let (parts, components) = (body.template.parts(), body.shape.len());
    let mut rotations = Vec::with_capacity(9 * parts * fits.len());
    let mut shapes = Vec::with_capacity(components * fits.len());
    for fit in fits {
        let none = (vec![DMat3::NAN; parts], vec![f64::NAN; components]);
        let state = fit.as_ref().map(|(f, _)| &f.state);
        let (turns, shape) = state.map_or(none, |s| (s.rotations.clone(), s.shape.clone()));
        // By rows.
        rotations.extend(
            turns
                .iter()
                .flat_map(|r| r.transpose().to_cols_array())
                .map(|v| v as f32),
        );
        shapes.extend(shape.iter().map(|v| *v as f32));
    }
    let array = |name: &str, shape: Vec<usize>, values| NpzArray {
        name: name.into(),
        shape,
        values: NpzValues::Floats(values),
    };
    let completed = meshes(|c| &c.completed);
    let faces = body.template.surface();
    let bytes = npz_bytes(&[
        vertex_array("completed", &completed, Units::CM_Y),
        vertex_array("predicted", &meshes(|c| &c.predicted), Units::CM_Y),
        array("rotations", vec![fits.len(), parts, 3, 3], rotations),
        array("shape", vec![fits.len(), components], shapes),
        face_array(faces),
    ])?;
    streams::write_bytes(Some(&args.output), &bytes, true)?;
    match &args.meshes {
        Some(folder) => MeshOutput::Folder(folder.clone(), MeshFormat::Ply).write(
            &completed,
            faces,
            Units::CM_Y,
        ),
        None => Ok(()),
    }
}

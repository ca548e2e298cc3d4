//! Completes a body from markers on it.

use clap::Parser;
use glam::{DMat3, DVec3};
use posing::body::animation::{MarkerFrame, Offsets, animate};
use posing::body::completion::{Completion, complete};
use posing::body::fit::{Fit, FitProblem};
use posing::body::fit_doubts::{has_few_markers, lying_axis};
use posing::body::fit_prior::FitPrior;
use posing::body::take::timed;
use posing::body::{BodyModel, MarkerModel};
use posing::cli::Outcome;
use posing::cli::args::TimedTableArgs;
use posing::cli::body::{
    marker_frames, open_body, read_marker_map, report_fits, report_free_parts, report_markers,
    write_rotations, write_shapes,
};
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::{input, messages, streams};
use posing::io::MeshFormat;
use posing::io::mesh_output::{MeshOutput, face_array, vertex_array};
use posing::io::npz::{NpzArray, NpzValues, npz_bytes};
use posing::numeric::parallel;
use posing::pose::units::{Units, parse_length};
use posing::{Error, Place, Result};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Complete a body from markers on its skin
///
/// Finds, for each frame on its own, the rotations of the parts and the shape of a body whose
/// vertices are at the markers. The output has two meshes a frame: the predicted one is a body of
/// the model; the completed one is warped from it so that it goes (nearly) through the markers.
/// Positions and meshes are in centimeters.
///
/// Each part needs about three markers. For a take of one person, whose shape stays the same, use
/// body-animate, or --one-person.
///
/// The completed mesh goes through the markers but for their noise: that of --noise, else what
/// tells each marker best from the others.
///
/// Markers that do not fit are left out and named with their distance. The exit status is 3 then,
/// and where markers are mirrored, a frame has less than two thirds of them, or everybody lies
/// down, as if another axis pointed up.
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
                       where a frame has too few markers"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Body model
    #[arg(short, long, value_name = "BODY.npz")]
    model: PathBuf,
    /// The vertex that each point is on
    #[arg(long, value_name = "MAP.csv")]
    on: PathBuf,
    /// Noise of the markers: standard deviation per coordinate, in cm or with a unit. 0: the
    /// completed mesh goes through them [default: 0.18 for the pose; for the completed mesh, what
    /// tells each marker best from the others]
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    noise: Option<f64>,
    /// All frames show one person: one shape for all of them
    #[arg(long)]
    one_person: bool,
    /// Output file
    #[arg(short, long, value_name = "FITS.npz", help_heading = "Output")]
    output: OutputPath,
    /// Write the completed meshes to a folder, as PLY
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    meshes: Option<OutputPath>,
    /// Write the rotations and the root position as a table, for body-synth
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    rotations: Option<OutputPath>,
    /// Write the shapes as a table, for body-synth
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    shapes: Option<OutputPath>,
    #[command(flatten)]
    json: JsonArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare(Some(&args.output))?;
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, [&args.model, &args.on])?;
    let body = open_body(&args.model)?;
    let (names, markers) = read_marker_map(&args.on, body.template.vertices.len())?;
    let table = input::read_table(&tables, false, false)?;
    let frames = marker_frames(&body, &markers, &table, &names, "the map")?;
    let poses = timed(&table.poses, tables.rate(&table.poses)?);
    let model = MarkerModel::new(&body, &markers);
    let mut prior = body.fit_prior();
    prior.noise = args.noise.unwrap_or(prior.noise);
    let fits = if args.one_person {
        fit_one_person(&body, &model, &prior, &frames, args.noise)
            .map_err(|e| e.at(Place::file(&table.name)))?
    } else {
        fit_each(&body, &frames, args.noise, |frame| {
            let problem = FitProblem::new(&model, &prior, frame).ok()?;
            Some(problem.solve(None))
        })
    };
    let findings =
        report(&fits, &table.name, &names)? + report_doubts(&body, &fits, &frames, &table.name);
    report_free_parts(&model, &frames, &table.name);
    write(args, &body, &fits)?;
    let state = |f: &Fitted| {
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
    args.json.write(told(&fits, &names))?;
    Ok(Outcome::of(findings > 0))
}

/// A frame's fit and its surfaces.
type Fitted = Option<(Fit, Completion)>;

/// Each frame by itself.
fn fit_each(
    body: &BodyModel,
    frames: &[MarkerFrame],
    noise: Option<f64>,
    fit: impl Fn(&MarkerFrame) -> Option<Fit> + Sync,
) -> Vec<Fitted> {
    let bar = Progress::new("frames", frames.len() as u64);
    let mut fits = Vec::with_capacity(frames.len());
    // In blocks, for the bar.
    for block in frames.chunks(32) {
        fits.extend(parallel::map_chunks(block.len(), 1, |range| {
            let fit = fit(&block[range.start])?;
            let shape = body.shape.matrices(&fit.state.shape);
            let completion = complete(body, &fit, &shape, noise);
            Some((fit, completion))
        }));
        bar.set(fits.len() as u64);
    }
    fits
}

/// All frames with one shape.
fn fit_one_person(
    body: &BodyModel,
    model: &MarkerModel,
    prior: &FitPrior,
    frames: &[MarkerFrame],
    noise: Option<f64>,
) -> Result<Vec<Fitted>> {
    let animation = animate(model, prior, frames, Offsets::Known)?;
    let shape = body.shape.matrices(&animation.shape);
    let surfaces = |fit: &Fit| {
        let mut fit = fit.clone();
        fit.state.shape = animation.shape.clone();
        let completion = complete(body, &fit, &shape, noise);
        (fit, completion)
    };
    Ok(parallel::map_chunks(animation.fits.len(), 1, |range| {
        animation.fits[range.start].as_ref().map(surfaces)
    }))
}

/// Tells how the fits are; how many findings there are.
fn report(fits: &[Fitted], source: &str, names: &[String]) -> Result<usize> {
    let rms: Vec<f64> = fits.iter().flatten().map(|(f, _)| f.rms).collect();
    if rms.is_empty() {
        let what = "no frame has four markers of the map or more";
        return Err(Error::data(Place::file(source), what));
    }
    report_fits(rms, fits.len(), "markers are", "the predicted bodies");
    let fits: Vec<&Fit> = fits.iter().flatten().map(|(fit, _)| fit).collect();
    Ok(report_markers(&fits, source, names))
}

/// Tells of frames with few markers, and of bodies that all lie; how many lines that are.
fn report_doubts(body: &BodyModel, fits: &[Fitted], frames: &[MarkerFrame], source: &str) -> usize {
    let fitted = frames.iter().zip(fits).filter(|(_, fit)| fit.is_some());
    let few = fitted.filter(|(frame, _)| has_few_markers(frame)).count();
    if few > 0 {
        messages::info(&format!(
            "{source}: {few} of {} frames have less than two thirds of the markers of the map: the \
             rest of the body is what is usual there",
            frames.len()
        ));
    }
    let states = fits.iter().flatten().map(|(fit, _)| &fit.state);
    let lying = lying_axis(body, states);
    if let Some(axis) = lying {
        messages::info(&format!(
            "{source}: all bodies lie along the axis {axis}, as hardly a pose of the training \
             does: if {axis} points up, convert the markers again with --up {axis}"
        ));
    }
    usize::from(few > 0) + usize::from(lying.is_some())
}

/// How the fits are, for JSON: of each frame the distance of the markers (RMS, cm), and those that
/// do not fit with theirs.
fn told(fits: &[Fitted], names: &[String]) -> Value {
    let fits = fits.iter().map(|fit| fit.as_ref().map(|(fit, _)| fit));
    let frames = fits.enumerate().map(|(t, fit)| told_frame(t, fit, names));
    json!({ "frames": frames.collect::<Vec<_>>() })
}

/// How the fit of a frame is, for JSON.
fn told_frame(frame: usize, fit: Option<&Fit>, names: &[String]) -> Value {
    let left_out = fit.map_or(&[][..], |fit| &fit.left_out).iter();
    let left_out = left_out.map(|(m, far)| (names[*m].clone(), json!(far)));
    json!({
        "row": frame + 1,
        "rms": fit.map(|fit| fit.rms),
        "left_out": left_out.collect::<serde_json::Map<_, _>>(),
        "is_mirrored": fit.is_some_and(|fit| fit.is_mirrored),
    })
}

fn write(args: &Args, body: &BodyModel, fits: &[Fitted]) -> Result<()> {
    let meshes = |of: fn(&Completion) -> &Vec<DVec3>| -> Vec<Vec<DVec3>> {
        let mesh = |f: &Fitted| f.as_ref().map(|(_, c)| of(c).clone());
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
        Some(folder) => MeshOutput::Folder(folder.to_path_buf(), MeshFormat::Ply).write(
            &completed,
            faces,
            Units::CM_Y,
        ),
        None => Ok(()),
    }
}

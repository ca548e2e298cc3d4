//! Gait of a session: curves, events, values and a page from the trials of a person.

use clap::Parser;
use ndarray::Array2;
use posing::cli::args::parse_positive;
use posing::cli::choice::choice;
use posing::cli::input::open;
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::{OutputPath, check_written};
use posing::cli::progress::Progress;
use posing::cli::read_args::TakeReadArgs;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::draw::href::encoded;
use posing::draw::take_page::is_take_page;
use posing::gait::{
    EventChoice, FilledGap, FlatFoot, GaitSettings, GaitTrial, Norm, PARAMETERS, Session,
    SessionTrial, Trial,
};
use posing::io::motion_file::ReadRules;
use posing::io::{C3d, MotionFormat, Table};
use posing::restore::{Complete, Restorer};
use posing::{Error, Place, Result};
use serde_json::json;
use std::path::{Path, PathBuf};

/// A filled position that is less sure is left empty, cm: as clean does.
const MOST_SD: f64 = 5.0;
/// The bytes of a norm at most.
const LARGEST_NORM: u64 = 1 << 24;

/// Compute gait from a lab's trials: angles, moments, events, values and a page
///
/// Reads C3D trials with the markers of Plug-in Gait and computes its joint centers and angles,
/// with force plates also forces, moments and powers; strikes and offs of the feet; cycles, and
/// what is told of each. Writes tables, C3D files and a page, index.html, into DIR. Subject
/// parameters are those stored in the trial, else of --parameter, else of the static trial, else
/// estimated from markers, which costs 2 degrees of hip and knee abduction. Gaps within a marker's
/// span are filled in memory; what a file stores as angles and moments is not used. Exit code 3:
/// something is estimated, missing or unsure; 1: a file could not be read, the others are computed
/// all the same.
///
/// Knees and hips differ from those of solve, which has no Plug-in Gait.
#[derive(Parser)]
#[command(
    name = "gait",
    version,
    after_help = "Examples:\
        \n  posing gait --static static.c3d walk.c3d -o report/\
        \n  posing gait --static static.c3d walk.c3d --norm norm.json -o report/\
        \n  posing gait walk.c3d --parameter LegLength=850 --parameter Bodymass=62 -o report/"
)]
pub struct Args {
    /// Trials of one person, C3D
    #[arg(value_name = "WALK.c3d", required = true)]
    walks: Vec<PathBuf>,
    /// Folder of the results: NAME.csv, NAME.mot, NAME.sto, NAME.c3d and NAME.html of each trial,
    /// cycles.csv, gait.json, index.html
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: OutputPath,
    /// Trial of the person standing, for the offsets of feet and head
    #[arg(long = "static", value_name = "STATIC.c3d", help_heading = "Method")]
    static_trial: Option<PathBuf>,
    /// Events of the feet [default: auto]
    #[arg(
        long,
        value_parser = choice::<EventChoice>(),
        value_name = "SOURCE",
        help_heading = "Method"
    )]
    events: Option<EventChoice>,
    /// Norm to compare with, as --make-norm writes it: for GVS and GPS, and the page
    #[arg(long, value_name = "NORM.json", help_heading = "Method")]
    norm: Option<PathBuf>,
    /// Write the norm of all cycles of the trials, which may be of several people, to this file
    #[arg(long, value_name = "NORM.json", help_heading = "Output")]
    make_norm: Option<OutputPath>,
    /// Whether the soles lay flat on the floor in the static trial [default: auto]
    #[arg(
        long,
        value_parser = choice::<FlatFoot>(),
        value_name = "WHETHER",
        help_heading = "Method"
    )]
    flat_foot: Option<FlatFoot>,
    /// Diameter of the markers, mm, for files that do not store it [default: 14]
    #[arg(long, value_name = "MM", value_parser = parse_positive, help_heading = "Method")]
    marker_diameter: Option<f64>,
    /// Subject parameter by Plug-in Gait's name, in mm, kg or radians: LKneeWidth=105, or KneeWidth
    /// for both sides (may be given again)
    #[arg(
        long,
        value_name = "NAME=VALUE",
        value_parser = parse_parameter,
        help_heading = "Method"
    )]
    parameter: Vec<(String, f64)>,
    /// Write the left foot's progression along +x as Vicon does, which is no angle of the foot
    #[arg(long, help_heading = "Output")]
    vicon_quirks: bool,
    /// Write the deviations that filled markers bring into columns NAME.sd
    #[arg(long, help_heading = "Output")]
    sd: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    read: TakeReadArgs,
}

/// A parameter that the model knows, with or without its side.
fn parse_parameter(text: &str) -> std::result::Result<(String, f64), String> {
    let expected = || {
        format!(
            "expected NAME=VALUE, NAME being one of {}",
            PARAMETERS.join(", ")
        )
    };
    let (name, value) = text.split_once('=').ok_or_else(expected)?;
    let is_it = |known: &&str| {
        let known = known.to_ascii_lowercase();
        let name = name.trim().to_ascii_lowercase();
        name == known || name.strip_prefix(['l', 'r']) == Some(&known)
    };
    let value: f64 = value.trim().parse().map_err(|_| expected())?;
    let is_known = PARAMETERS.iter().any(is_it) && value.is_finite();
    is_known
        .then(|| (name.trim().to_string(), value))
        .ok_or_else(expected)
}

/// A trial that could be read.
struct Opened {
    name: String,
    shown: String,
    file: C3d,
    trial: Trial,
}

pub fn work(args: &Args) -> Result<Outcome> {
    let report = JsonArgs::to_file(&args.output.join("gait.json"));
    report.prepare_report();
    let rules = args.read.rules();
    let norm = args.norm.as_ref().map(|path| read_norm(path)).transpose()?;
    let standing = args
        .static_trial
        .as_ref()
        .map(|path| opened(path, &rules))
        .transpose()?;
    let statics = standing.as_ref().map(|s| &s.trial);
    let settings = settings(args);
    let bar = Progress::new("gait", args.walks.len() as u64);
    let (mut trials, mut files, mut failed) = (Vec::new(), Vec::new(), Vec::new());
    for (i, path) in args.walks.iter().enumerate() {
        let done = opened(path, &rules).and_then(|own| {
            let computed = computed(&own, statics, &settings)?;
            Ok((computed, own.file))
        });
        match done {
            Ok((trial, file)) => {
                trials.push(trial);
                files.push(file);
            }
            Err(e) if args.walks.len() == 1 => return Err(e),
            Err(e) => failed.push((path, e.to_string())),
        }
        bar.set(i as u64 + 1);
    }
    drop(bar);
    failed.iter().for_each(|(_, e)| messages::error(e));
    let static_file = args
        .static_trial
        .as_ref()
        .map(|path| path.display().to_string());
    let session = Session::new(trials, static_file, norm)?;
    tell(&session);
    write(args, &session, &files)?;
    let mut told = session.report();
    let failures = failed
        .iter()
        .map(|(file, e)| json!({ "file": file, "error": e }));
    told["failed"] = failures.collect();
    report.write(&told)?;
    args.json.write(&told)?;
    Ok(if failed.is_empty() {
        Outcome::of(session.has_findings())
    } else {
        Outcome::Failed
    })
}

fn settings(args: &Args) -> GaitSettings {
    let mut settings = GaitSettings {
        flat_foot: args.flat_foot.unwrap_or_default(),
        vicon_quirks: args.vicon_quirks,
        events: args.events.unwrap_or_default(),
        ..GaitSettings::default()
    };
    for (name, value) in &args.parameter {
        settings.given.set(name, *value);
        ["L", "R"]
            .iter()
            .for_each(|side| settings.given.set(&format!("{side}{name}"), *value));
    }
    if let Some(diameter) = args.marker_diameter {
        settings.given.set("MarkerDiameter", diameter);
    }
    settings
}

fn read_norm(path: &Path) -> Result<(String, Norm)> {
    let name = path.display().to_string();
    let text = open(path)?.read_all(LARGEST_NORM)?;
    let norm = Norm::from_json(&text, &name)?;
    Ok((name, norm))
}

fn opened(path: &Path, rules: &ReadRules) -> Result<Opened> {
    let options = rules.of(path, MotionFormat::C3d);
    let mut file = C3d::read(open(path)?, options.keep_whole)?;
    file.take.rate = file.take.rate.or(options.fps);
    file.take
        .notes
        .iter()
        .for_each(|note| messages::info(&format!("{}: {note}", path.display())));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let ends = name
        .len()
        .checked_sub(4)
        .filter(|at| name.is_char_boundary(*at));
    let stem = ends.filter(|at| name[*at..].eq_ignore_ascii_case(".c3d"));
    Ok(Opened {
        trial: Trial::from_c3d(&file, options.units, options.up)?,
        name: stem.map_or(&*name, |at| &name[..at]).to_string(),
        shown: path.display().to_string(),
        file,
    })
}

/// Fills gaps and computes.
fn computed(
    own: &Opened,
    statics: Option<&Trial>,
    settings: &GaitSettings,
) -> Result<SessionTrial> {
    let place = |e: Error| e.at(Place::file(&own.shown));
    let (trial, sd, gaps) = filled(&own.trial).map_err(place)?;
    let mut gait = GaitTrial::new(&trial, statics, settings).map_err(place)?;
    gait.add_gaps(&trial, &gaps);
    let has_filled = gaps.iter().any(|gap| gap.sd_mm.is_some());
    let deviations = has_filled
        .then(|| gait.deviations(&trial, &sd))
        .transpose()?;
    Ok(SessionTrial {
        name: own.name.clone(),
        file: own.shown.clone(),
        trial,
        gait,
        deviations,
        gaps,
    })
}

/// The trial with its gaps filled, by what the other markers of its own frames tell, as clean does.
fn filled(trial: &Trial) -> Result<(Trial, Array2<f64>, Vec<FilledGap>)> {
    let times = (0..trial.markers.frames()).map(|t| trial.time(t)).collect();
    let table = Table::from_poses(trial.markers.to_poses(times));
    if !trial.has_gaps() {
        let none = Array2::from_elem((table.poses.frames(), table.poses.points.len()), f64::NAN);
        return Ok(trial.filled(&table.poses, none.view(), MOST_SD));
    }
    let how = Complete {
        fps: Some(trial.rate),
        ..Complete::default()
    };
    let restored = Restorer::without_model().complete(&table, &how)?;
    let shape = (table.poses.frames(), table.poses.points.len());
    let sd = Array2::from_shape_fn(shape, |(t, p)| restored.sd(t, p));
    Ok(trial.filled(&restored.table().poses, sd.view(), MOST_SD))
}

/// Tells what is to be known.
fn tell(session: &Session) {
    for trial in &session.trials {
        let filled: Vec<&FilledGap> = trial.gaps.iter().filter(|g| g.sd_mm.is_some()).collect();
        if !filled.is_empty() {
            let mut names: Vec<&str> = filled.iter().map(|g| g.marker).collect();
            names.dedup();
            let frames: usize = filled.iter().map(|g| g.frames[1] - g.frames[0]).sum();
            let (file, gaps) = (&trial.file, filled.len());
            let s = if gaps == 1 { "" } else { "s" };
            messages::info(&format!(
                "{file}: {gaps} gap{s} of {} filled, {frames} frames",
                names.join(", ")
            ));
        }
        let findings = trial.gait.findings.iter();
        findings.for_each(|f| messages::info(&format!("{}: {}", trial.file, f.what)));
    }
    let standing = session.trials.iter().find(|t| t.gait.direction.standing);
    if let Some(trial) = standing.filter(|_| session.static_file.is_none()) {
        messages::info(&format!(
            "{}: the person stands; --static {0} takes it for the offsets of feet and head",
            trial.file
        ));
    }
}

/// Fails where a C3D file would be replaced that no earlier run wrote: such a file has its player
/// beside it.
fn check_results(session: &Session, folder: &Path) -> Result<()> {
    for trial in &session.trials {
        let [file, player] =
            ["c3d", "html"].map(|end| folder.join(format!("{}.{end}", trial.name)));
        if file.exists() && !is_take_page(&player) {
            let path = file.display();
            let what = format!("{path} is there, and no earlier run of gait wrote it");
            return Err(Error::usage(format!("{what}: give another folder")));
        }
    }
    Ok(())
}

/// Writes all files.
fn write(args: &Args, session: &Session, files: &[C3d]) -> Result<()> {
    let folder = &*args.output;
    let named = |name: &str, end: &str| folder.join(format!("{name}.{end}"));
    let all = ["index.html", "cycles.csv", "gait.json"].map(|name| folder.join(name));
    let ends = ["csv", "mot", "sto", "c3d", "html"];
    let own = session
        .trials
        .iter()
        .flat_map(|t| ends.map(|end| named(&t.name, end)));
    check_written(all.iter().cloned().chain(own))?;
    check_results(session, folder)?;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    for (trial, file) in session.trials.iter().zip(files) {
        let put =
            |end: &str, bytes: &[u8]| write_bytes(Some(&named(&trial.name, end)), bytes, false);
        put("csv", &trial.to_csv(args.sd))?;
        put("mot", &trial.to_mot())?;
        put("sto", &trial.to_sto())?;
        match file.with_outputs(&trial.outputs(), &trial.events()) {
            Ok(bytes) => put("c3d", &bytes)?,
            Err(e) => messages::info(&format!("{e}; no {}.c3d", trial.name)),
        }
    }
    let mut players = Vec::new();
    for trial in &session.trials {
        let page = trial.player(Some("index.html"))?;
        if let Some(page) = &page {
            write_bytes(Some(&named(&trial.name, "html")), page.as_bytes(), false)?;
        }
        players.push(page.map(|_| encoded(&format!("{}.html", trial.name))));
    }
    write_bytes(Some(&all[0]), session.page(&players).as_bytes(), false)?;
    write_bytes(Some(&all[1]), &session.cycles_csv(), false)?;
    if let Some(path) = &args.make_norm {
        let none = || Error::usage("--make-norm: no cycle of the trials has all nine angles");
        let norm = session.own_norm().ok_or_else(none)?;
        write_bytes(Some(path), norm.to_json()?.as_bytes(), false)?;
    }
    Ok(())
}

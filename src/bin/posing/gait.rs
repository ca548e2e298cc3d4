//! Gait of a session: curves, events, values and a page from the trials of a person.

use clap::Parser;
use posing::cli::args::{parse_if, parse_positive};
use posing::cli::choice::choice;
use posing::cli::input::open;
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::{OutputPath, check_read, check_written};
use posing::cli::progress::Progress;
use posing::cli::read_args::TakeReadArgs;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::draw::href::encoded;
use posing::draw::take_page::is_take_page;
use posing::gait::{
    EventChoice, FilledGap, FlatFoot, GaitSettings, Norm, PARAMETERS, Session, SessionTrial,
    TrialFile, plausible_range,
};
use posing::io::motion_folder::MotionFolder;
use posing::{Error, Place, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The bytes of a norm at most.
const LARGEST_NORM: u64 = 1 << 24;

/// Compute gait from a lab's trials: angles, moments, events, values and a page
///
/// Reads C3D trials with the markers of Plug-in Gait and computes its joint centers and angles,
/// with force plates also forces, moments and powers; strikes and offs of the feet; cycles and
/// their values. Writes tables, C3D files and a page, index.html, into DIR. Subject parameters are
/// those stored in the trial, else of --parameter, else of the static trial, else estimated from
/// markers, which costs 2 degrees of hip and knee abduction. Gaps within a marker's span are filled
/// in memory; angles and moments that a file stores are not used. Trials of other marker sets get
/// angles between the bones that solve finds, which are not Plug-in Gait's. Exit code 3: something
/// is estimated, missing or unsure; 1: a file could not be read, the others are computed all the
/// same.
///
/// Columns of NAME.csv, a row a frame, time 0 at the file's frame 1: LHJC, LKJC, LAJC .x .y .z, the
/// centers of hip, knee and ankle, cm, y up. LKneeAngles .rx .ry .rz and so on, degrees, with the
/// signs of Plug-in Gait: flexion, adduction or varus, internal rotation. LGroundReactionForce .fx
/// .fy .fz, N/kg, in the laboratory's axes with z up; LKneeForce, N/kg, and LKneeMoment .mx .my
/// .mz, N mm/kg, in the axes of the distal segment; LKneePower .p, W/kg. R as L. Forces and moments
/// are empty where a foot is on the floor beside the plates. cycles.csv has the same over the
/// cycle, 0 to 100 percent, without the side's letter; rows with the cycle mean and sd are
/// statistics. gait.json has what is no curve: see posing-json(5). NAME.mot and NAME.sto have the
/// columns for OpenSim.
#[derive(Parser)]
#[command(
    name = "gait",
    version,
    after_help = "Examples:\
        \n  posing gait --static static.c3d walk.c3d -o report/\
        \n  posing gait --static static.c3d walk.c3d --norm norm.json -o report/\
        \n  posing gait --static static.c3d walk.c3d --events markers -o report/"
)]
pub struct Args {
    /// Trials of one person, C3D, or folders of them; the static trial among them is left out
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
    /// Write the norm of all cycles of the trials, which may be of several people, to this file;
    /// trials that turn are left out
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
    /// Write the deviations that filled and doubtful markers bring to centers and angles into
    /// columns NAME.sd
    #[arg(long, help_heading = "Output")]
    sd: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    read: TakeReadArgs,
}

/// A parameter that the model knows, with or without its side, and a value that people have.
fn parse_parameter(text: &str) -> std::result::Result<(String, f64), String> {
    let names = || PARAMETERS.map(|(name, _)| name).join(", ");
    let expected = || format!("expected NAME=VALUE, NAME being one of {}", names());
    let (name, value) = text.split_once('=').ok_or_else(expected)?;
    let [least, most] = plausible_range(name).ok_or_else(expected)?;
    let expected = format!("expected {least} to {most} (mm, kg or radians)");
    let value = parse_if(value.trim(), |v| (least..=most).contains(&v), &expected)?;
    Ok((name.trim().to_string(), value))
}

pub fn work(args: &Args) -> Result<Outcome> {
    let report = JsonArgs::to_file(&args.output.join("gait.json"));
    report.prepare_report();
    let rules = args.read.rules();
    let norm = args.norm.as_ref().map(|path| read_norm(path)).transpose()?;
    let static_trial = args.static_trial.as_ref();
    let opened = |path: &PathBuf| {
        let own = TrialFile::open(path, &rules)?;
        let notes = own.notes().iter();
        notes.for_each(|note| messages::info(&format!("{}: {note}", path.display())));
        Ok(own)
    };
    let standing = static_trial.map(opened).transpose()?;
    let settings = settings(args);
    let walks = walks(args)?;
    check_read(&walks)?;
    let bar = Progress::new("gait", walks.len() as u64);
    let (mut trials, mut failed) = (Vec::new(), Vec::new());
    for (i, path) in walks.iter().enumerate() {
        match opened(path).and_then(|own| own.compute(standing.as_ref(), &settings)) {
            Ok(computed) => trials.push(computed),
            Err(e) if walks.len() == 1 => return Err(e),
            Err(e) => failed.push((path.display().to_string(), e.to_string())),
        }
        bar.set(i as u64 + 1);
    }
    drop(bar);
    failed.iter().for_each(|(_, e)| messages::error(e));
    if trials.is_empty() {
        // The results of an earlier run stay.
        return Ok(Outcome::Failed);
    }
    let static_file = static_trial.map(|path| path.display().to_string());
    let (trials, files): (Vec<SessionTrial>, Vec<Option<Vec<u8>>>) = trials.into_iter().unzip();
    let mut session = Session::new(trials, static_file, norm)?;
    session.failed = failed;
    tell(&session);
    write(args, &session, &files)?;
    let told = session.report();
    report.write(&told)?;
    args.json.write(&told)?;
    Ok(if session.failed.is_empty() {
        Outcome::of(session.has_findings())
    } else {
        Outcome::Failed
    })
}

/// The trials: files, and the C3D files of folders; the static trial among them is none.
fn walks(args: &Args) -> Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in &args.walks {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let found = MotionFolder::search(path, None, |_| true).files.into_iter();
        let is_c3d = |path: &PathBuf| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("c3d"))
        };
        let found: Vec<PathBuf> = found.map(|(file, _)| file).filter(is_c3d).collect();
        if found.is_empty() {
            let place = Place::file(path.display().to_string());
            return Err(Error::data(place, "no C3D files in it"));
        }
        all.extend(found);
    }
    let identity = |path: &Path| std::fs::canonicalize(path).ok();
    let standing = args.static_trial.as_deref().and_then(identity);
    if all.len() > 1 && standing.is_some() {
        all.retain(|path| identity(path) != standing);
    }
    Ok(all)
}

fn settings(args: &Args) -> GaitSettings {
    let mut settings = GaitSettings {
        flat_foot: args.flat_foot.unwrap_or_default(),
        vicon_quirks: args.vicon_quirks,
        events: args.events.unwrap_or_default(),
        ..GaitSettings::default()
    };
    // One with its side goes before one for both.
    for (name, value) in &args.parameter {
        let both = ["L", "R"].map(|side| format!("{side}{name}"));
        both.iter()
            .for_each(|name| settings.given.set(name, *value));
    }
    for (name, value) in &args.parameter {
        settings.given.set(name, *value);
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

/// Tells what is to be known.
fn tell(session: &Session) {
    for trial in &session.trials {
        let filled: Vec<&FilledGap> = trial
            .trial
            .gaps
            .iter()
            .filter(|g| g.sd_mm.is_some())
            .collect();
        if !filled.is_empty() {
            let mut names: Vec<&str> = filled.iter().map(|g| g.marker).collect();
            names.dedup();
            let frames: usize = filled.iter().map(|g| g.frames[1] - g.frames[0]).sum();
            let (file, gaps) = (&trial.file, filled.len());
            let [s, of] = [gaps, frames].map(|n| if n == 1 { "" } else { "s" });
            messages::info(&format!(
                "{file}: {gaps} gap{s} of {} filled, {frames} frame{of}",
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

/// Fails where a file would be replaced that no earlier run wrote: its folder has no gait.json of
/// gait, or a C3D file there has no player beside it.
fn check_results<'a>(written: impl Iterator<Item = &'a PathBuf>, list: &Path) -> Result<()> {
    let list = std::fs::read(list).unwrap_or_default();
    let list: Value = serde_json::from_slice(&list).unwrap_or_default();
    for path in written.filter(|path| path.exists()) {
        let is_c3d = path.extension().is_some_and(|e| e == "c3d");
        let is_own =
            list["command"] == "gait" && (!is_c3d || is_take_page(&path.with_extension("html")));
        if !is_own {
            let path = path.display();
            let what = format!("{path} is there, and no earlier run of gait wrote it");
            return Err(Error::usage(format!("{what}: give another folder")));
        }
    }
    Ok(())
}

/// Writes all files.
fn write(args: &Args, session: &Session, files: &[Option<Vec<u8>>]) -> Result<()> {
    let folder = &*args.output;
    let named = |name: &str, end: &str| folder.join(format!("{name}.{end}"));
    let all = ["index.html", "cycles.csv", "gait.json"].map(|name| folder.join(name));
    let ends = ["csv", "mot", "sto", "c3d", "html"];
    let trials = session.trials.iter();
    let own = trials.flat_map(|t| ends.map(|end| named(&t.name, end)));
    let written: Vec<PathBuf> = all.iter().cloned().chain(own).collect();
    check_written(&written)?;
    check_results(written.iter(), &all[2])?;
    check_norm(args)?;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let mut players = Vec::new();
    for (trial, file) in session.trials.iter().zip(files) {
        let put = |end: &str, bytes: &[u8]| {
            let path = named(&trial.name, end);
            write_bytes(Some(&path), bytes, false)
        };
        put("csv", &trial.to_csv(args.sd))?;
        put("mot", &trial.to_mot())?;
        put("sto", &trial.to_sto())?;
        match file {
            Some(bytes) => put("c3d", bytes)?,
            // One of an earlier run is not this trial's.
            None => drop(std::fs::remove_file(named(&trial.name, "c3d"))),
        }
        let page = trial.player(Some("index.html"))?;
        if let Some(page) = &page {
            put("html", page.as_bytes())?;
        }
        players.push(page.map(|_| encoded(&format!("{}.html", trial.name))));
    }
    write_bytes(Some(&all[0]), session.page(&players).as_bytes(), false)?;
    write_bytes(Some(&all[1]), &session.cycles_csv(), false)?;
    let norm = args.make_norm.as_ref().zip(session.own_norm());
    if let Some((path, norm)) = norm {
        write_bytes(Some(path), norm.to_json()?.as_bytes(), false)?;
    } else if args.make_norm.is_some() {
        messages::info("no norm: no cycle of a straight walk has all nine angles");
    }
    Ok(())
}

/// Fails where --make-norm would replace a file that is no norm.
fn check_norm(args: &Args) -> Result<()> {
    let Some(path) = args.make_norm.as_ref().filter(|path| path.exists()) else {
        return Ok(());
    };
    read_norm(path).map(drop).map_err(|_| {
        let path = path.display();
        Error::usage(format!(
            "--make-norm {path}: that file is there, and is no norm of gait"
        ))
    })
}

//! Cleans whole takes of any format, one or a folder of them.

use clap::Parser;
use posing::audit::Limits;
use posing::clean::{
    CleanOutput, CleanReport, CleanSettings, NamingSettings, OutputFormat, SkeletonSettings, clean,
};
use posing::cli::args::{OutlierDetection, parse_hertz, parse_positive};
use posing::cli::choice::choice;
use posing::cli::input::open_model_or_builtin;
use posing::cli::json_report::JsonArgs;
use posing::cli::label_args::{ExchangeArgs, LikeArgs};
use posing::cli::marker_set::marker_set;
use posing::cli::motion_library::open_library;
use posing::cli::name_maps::name_map;
use posing::cli::paths::{OutputPath, command_files};
use posing::cli::progress::Progress;
use posing::cli::read_args::ReadArgs;
use posing::cli::{Outcome, messages};
use posing::ik::rotation_cleaning::RotationCleaning;
use posing::inbetween::MotionLibrary;
use posing::io::Model;
use posing::label::LabelSettings;
use posing::pose::units::parse_length;
use posing::pose::{Segment, joints};
use posing::prior::provenance::hex;
use posing::restore::Clean;
use posing::solve::JointSet;
use posing::{Error, Result};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Clean takes of any format: fill gaps, replace outliers, remove noise
///
/// Reads C3D, TRC, Motive CSV, Qualisys TSV, BVH, AMC, pose tables and keypoints as JSON (written
/// as CSV; a folder with a frame a file is a take), and writes each in its own format, with all
/// else that the file says. Tracks without names get some: by a labeled take in their folder (a
/// static, or any other), by those of --like, by the set of --set, or by the built-in set that
/// fits; of several people, each with the person's name before it. Where nothing fits, none gets a
/// name. Labels are put right then, as label does. Gaps are filled as by complete, outliers
/// replaced (the record keeps them), and takes with more noise than --noise-limit are denoised; all
/// else stays to the last digit. With --to, BVH and AMC files become positions, which are cleaned
/// as others are.
///
/// Else these keep their own rotations, which are cleaned joint by joint, without a model: any rig,
/// hands too. Where the joints tremble more than the limit, each is smoothed as strongly as it
/// bears; pops of some frames are bridged, and missing values (the word nan) filled. Every other
/// byte stays: header, order of channels, branches of angles, digits. Slow noise, which is
/// correlated over more than some frames, cannot be told from motion, and stays.
///
/// A whole body that is missing for up to a second (or --max-gap) is filled with motion like that
/// of the most similar stretches of the take, and of the library of --prior (see prior-train
/// --motion), if gaps simulated there say that this helps. In BVH files feet are not held to the
/// ground then.
///
/// Joints from video (MediaPipe, OpenPose, COCO, Human3.6M, and others that a map names) whose
/// bones change their lengths as noise does are cleaned of slow noise too: sides that were
/// exchanged are put back, each track is filtered by how fast it moves when, bones are drawn to one
/// length, and feet stay where they stand.
///
/// A folder is searched for such files; its results keep their places below DIR. Beside each
/// result, RESULT.json says what it was made from, how the file was taken, what was found, and how
/// each gap was filled. A file whose result is there and whose capture, settings and model are the
/// same is not cleaned again, so that a run that was stopped goes on. One bad file stops
/// no other. At the end, a table, and in DIR the page clean.html and the list clean.json; beside
/// results in which there is something to see, RESULT.html plays the take. Exit code 1: a file
/// failed; 3: none did, but there are findings to look at.
#[derive(Parser)]
#[command(
    name = "clean",
    version,
    after_help = "Examples:\n  posing clean gait.c3d -o clean.c3d || echo see clean.c3d.json\n  \
                  posing clean captures/ -o cleaned/ --fps 120 --up y || echo see \
                  cleaned/clean.html\n  posing clean walk.bvh -o whole.bvh --max-gap 0.5 || echo \
                  see whole.bvh.json\n  posing clean captures/ -o cleaned/ --fps 120 --up c3d=z \
                  --up trc=y --new-only || echo see cleaned/clean.html\n  posing clean gait.c3d \
                  -o clean.c3d --redo lfoot:1.2-1.9 || echo see clean.c3d.json"
)]
pub struct Args {
    /// Files, and folders that are searched for files
    #[arg(value_name = "IN", required = true)]
    inputs: Vec<PathBuf>,
    /// Write the result of one file to OUT, results of several files into the folder DIR
    #[arg(short, long, value_name = "OUT|DIR", help_heading = "Output")]
    output: OutputPath,
    #[command(flatten)]
    json: JsonArgs,
    /// Also solve takes of markers: skeleton and motion as NAME.bvh beside each result NAME.c3d, as
    /// solve --bvh has them, one for each of several people (NAME-Ann.bvh); by a marker set's name
    /// or file [default: of each take the one that knows most of its markers]. Joints by CMU's
    /// names or those of a map get the skeleton that xyz2bvh gives them. The word anatomical: joint
    /// centers as NAME.centers.csv, as solve --joints anatomical --sd has them
    #[arg(
        long,
        value_name = "NAME|FILE|anatomical",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "auto",
        help_heading = "Output"
    )]
    solve: Option<String>,
    /// Noise over which a take is denoised: of a coordinate, in cm or with a unit (1mm), and of the
    /// rotations of BVH and AMC files, in degrees (0.5deg; a number without a unit is for both)
    /// [default: 0.1cm and 0.25deg]
    #[arg(long, value_name = "CM|DEG", value_parser = NoiseLimit::parse, help_heading = "Method")]
    noise_limit: Option<NoiseLimit>,
    /// Remove no noise: only fill gaps and replace outliers
    #[arg(long, conflicts_with = "noise_limit", help_heading = "Method")]
    no_smooth: bool,
    /// Longest gap to fill, in seconds (default: no limit)
    #[arg(long, value_name = "SECONDS", value_parser = parse_positive, help_heading = "Method")]
    max_gap: Option<f64>,
    /// Take a stretch of a point for missing, in seconds as the file has them: LFHD:1.2-1.9
    /// (several times, of one file)
    #[arg(
        long,
        value_name = "NAME:FROM-TO",
        value_parser = Segment::parse,
        help_heading = "Method"
    )]
    redo: Vec<Segment>,
    #[command(flatten)]
    read: ReadArgs,
    /// Format of the results [default: that of each file, or by the extension of OUT]
    #[arg(
        long,
        value_parser = choice::<OutputFormat>(),
        value_name = "FORMAT",
        help_heading = "Output"
    )]
    to: Option<OutputFormat>,
    /// Write the page to FILE [default: DIR/clean.html], and the list for programs beside it, with
    /// the ending .json
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    page: Option<OutputPath>,
    /// Clean files again whose results are there, also where somebody changed these
    #[arg(long, help_heading = "Output")]
    again: bool,
    /// Tell only findings and failures that the last run into DIR did not have; only these count
    /// for the exit code
    #[arg(long, help_heading = "Output")]
    new_only: bool,
    /// Which points are which of the model's: a shipped map or a TOML file, as for complete
    /// [default: the shipped map that fits]
    #[arg(
        long,
        value_name = "NAME|FILE.toml",
        conflicts_with = "take_alone",
        help_heading = "Input"
    )]
    map: Option<String>,
    /// Take rotations of BVH and AMC files that stand still for over 0.2 s beside moving ones for
    /// missing ones: the last value was held. audit finds them
    #[arg(long, help_heading = "Input")]
    held_is_missing: bool,
    /// Go on with a body that is smaller or larger than people are
    #[arg(long, help_heading = "Input")]
    force: bool,
    /// Model file (default: the built-in model)
    #[arg(short, long, value_name = "MODEL.npz", help_heading = "Method")]
    model: Option<PathBuf>,
    /// Library of motion, by prior-train --motion: gaps of a whole body are filled from its takes
    /// too, where simulated gaps say that this helps
    #[arg(long, value_name = "MOTION.npz", help_heading = "Method")]
    prior: Option<PathBuf>,
    /// Use no model: learn from each take's own frames alone
    #[arg(long = "self", conflicts_with = "model", help_heading = "Method")]
    take_alone: bool,
    /// Whether outliers are detected and replaced [default: auto; with --redo, which says what is
    /// bad, none]
    #[arg(long, value_enum, help_heading = "Method")]
    outliers: Option<OutlierDetection>,
    /// Leave labels as they are: markers that changed places, pieces without a label, tracks
    /// without names
    #[arg(long, conflicts_with = "like", help_heading = "Method")]
    no_labels: bool,
    /// Keep the label of a point in a stretch, in seconds as the file has them, also where label
    /// would change it (may be given again)
    #[arg(
        long,
        value_name = "NAME:FROM-TO",
        value_parser = Segment::parse,
        conflicts_with = "no_labels",
        help_heading = "Method"
    )]
    keep_labels: Vec<Segment>,
    #[command(flatten)]
    like: LikeArgs,
    #[command(flatten)]
    exchange: ExchangeArgs,
    /// Marker set, by its name or file, that names tracks which no labeled take in their folder and
    /// none of --like does [default: the built-in set that fits]
    #[arg(
        long,
        value_name = "NAME|FILE",
        conflicts_with = "no_labels",
        help_heading = "Labels"
    )]
    set: Option<String>,
    /// Largest standard deviation of positions that are filled, in cm or with a unit; a gap that is
    /// less sure stays, and is a finding [default: 3cm; in proportion more where over 0.5 cm of
    /// noise are left in keypoints of video]
    #[arg(long, value_name = "CM", value_parser = parse_length, help_heading = "Method")]
    max_sd: Option<f64>,
    /// Smooth positions after all else: low-pass filter, as trim --butterworth
    #[arg(long, value_name = "HZ", value_parser = parse_hertz, help_heading = "Method")]
    butterworth: Option<f64>,
}

/// The word of --solve that is no marker set: a file of that name is meant by ./anatomical.
const ANATOMICAL: &str = "anatomical";

/// Limits of noise: of a coordinate, cm, and of rotations, degrees.
#[derive(Clone, Copy)]
struct NoiseLimit {
    positions: Option<f64>,
    rotations: Option<f64>,
}

impl NoiseLimit {
    fn parse(text: &str) -> std::result::Result<NoiseLimit, String> {
        let number = |text: &str| {
            text.parse::<f64>()
                .ok()
                .filter(|v| v.is_finite() && *v >= 0.0)
        };
        if let Some(degrees) = text.strip_suffix("deg") {
            let degrees = number(degrees).ok_or("expected degrees such as 0.5deg")?;
            return Ok(NoiseLimit {
                positions: None,
                rotations: Some(degrees),
            });
        }
        let positions = parse_length(text).map_err(|e| e.to_string())?;
        Ok(NoiseLimit {
            positions: Some(positions),
            rotations: number(text),
        })
    }
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare_report();
    let output = CleanOutput {
        path: args.output.to_path_buf(),
        to: args.to,
        page: args.page.as_deref().map(Path::to_path_buf),
        only_new: args.new_only,
        files: command_files(),
    };
    let bar = Progress::new("cleaning", 0);
    let progress = |done: usize, all: usize| bar.set_of(done as u64, all as u64);
    let report = clean(&args.inputs, &output, &settings(args)?, &progress)?;
    drop(bar);
    write_outputs(&report, &args.json)?;
    Ok(if report.has_failures() {
        Outcome::Failed
    } else {
        Outcome::of(report.has_findings())
    })
}

/// Writes the page, the table and the list. What the list has counts as reported, so it comes last;
/// where nobody reads the table any more, nothing new counts as written.
fn write_outputs(report: &CleanReport, json: &JsonArgs) -> Result<()> {
    report
        .errors()
        .for_each(|e| messages::error(&e.to_string()));
    report.notes().iter().for_each(|note| messages::info(note));
    report.write_page()?;
    let files = json!({ "files": report.files() });
    let written = json.write_report(None, || report.text(), files);
    let is_closed = written.as_ref().is_err_and(Error::is_closed_pipe);
    if written.is_ok() || is_closed && !report.only_new {
        report.write_list()?;
    }
    // The outcome says whether files failed, also where nobody reads the table.
    if is_closed { Ok(()) } else { written }
}

fn settings(args: &Args) -> Result<CleanSettings> {
    let model = model(args)?;
    let known = model
        .as_ref()
        .map_or_else(joints::cmu_names, |(model, ..)| model.meta.points.clone());
    let outliers = if args.redo.is_empty() {
        args.outliers != Some(OutlierDetection::None)
    } else {
        args.outliers == Some(OutlierDetection::Auto)
    };
    let read = args.read.rules()?;
    let takes = args.like.takes(&read)?;
    let like = args.like.templates_of(&takes)?;
    let set = args.set.as_deref().map(marker_set).transpose()?;
    let limit = |of: fn(NoiseLimit) -> Option<f64>| args.noise_limit.and_then(of);
    let map = args.map.as_ref().map(|map| name_map(map, &known));
    Ok(CleanSettings {
        read,
        model,
        motion: args.prior.as_deref().map(motion).transpose()?,
        map: map.transpose()?,
        method: Clean {
            noise_limit: limit(|limit| limit.positions).unwrap_or(Clean::default().noise_limit),
            outliers,
            max_gap: args.max_gap,
            max_sd: args.max_sd,
            fps: None,
        },
        rotation_noise_limit: limit(|limit| limit.rotations)
            .map_or(RotationCleaning::default().noise_limit, f64::to_radians),
        labels: (!args.no_labels).then(|| LabelSettings {
            keep: args.keep_labels.clone(),
            take_out: args.outliers != Some(OutlierDetection::None),
            like,
            exchange: args.exchange.exchange.clone(),
            option_names: messages::option_names(),
            ..LabelSettings::default()
        }),
        naming: NamingSettings::new(takes, set.as_deref())?,
        smooth: !args.no_smooth,
        held_is_missing: args.held_is_missing,
        limits: Limits::default(),
        force: args.force,
        again: args.again,
        redo: args.redo.clone(),
        butterworth: args.butterworth,
        skeletons: args.solve.as_deref().map(skeletons).transpose()?,
        option_names: messages::option_names(),
    })
}

fn skeletons(set: &str) -> Result<SkeletonSettings> {
    if set == ANATOMICAL {
        return Ok(SkeletonSettings {
            set: None,
            joints: JointSet::Anatomical,
        });
    }
    let set = (set != "auto").then(|| marker_set(set)).transpose()?;
    Ok(SkeletonSettings {
        set: set.map(|set| set.into_owned()),
        joints: JointSet::Cmu,
    })
}

/// A library of motion, and the digest of its bytes.
fn motion(path: &Path) -> Result<(MotionLibrary, String)> {
    let library = open_library(path)?;
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    Ok((library, hex(&Sha256::digest(bytes))))
}

/// The model, its name in messages and the digest of its bytes.
fn model(args: &Args) -> Result<Option<(Model, String, String)>> {
    if args.take_alone {
        return Ok(None);
    }
    let (model, name) = open_model_or_builtin(args.model.as_deref())?;
    let digest = hex(&Sha256::digest(model.to_bytes()?));
    Ok(Some((model, name, digest)))
}

//! Puts the labels of takes right.

use clap::Parser;
use posing::clean::{files_beside, write_labeled};
use posing::cli::args::parse_if;
use posing::cli::batch::{BatchJob, EXTENSIONS, batch, each_told};
use posing::cli::json_report::JsonArgs;
use posing::cli::label_args::{ExchangeArgs, LikeArgs};
use posing::cli::marker_set::marker_set;
use posing::cli::paths::{OutputPath, check_written};
use posing::cli::read_args::TakeReadArgs;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::io::MotionFile;
use posing::io::motion_file::ReadRules;
use posing::io::motion_folder::MotionFolder;
use posing::label::{LabelModel, LabelSettings, check_labels, label_from_nothing};
use posing::pose::{Segment, check_unit};
use posing::solve::{MarkerSet, naming_model, on_body};
use posing::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Put labels right: markers that changed places, pieces without a label, reflections
///
/// Reads takes of markers or points (C3D, TRC, Motive CSV, Qualisys TSV, NPZ, pose tables) and
/// writes each in its own format. Markers that changed places are put back, pieces of tracks
/// without a label (*68, Unlabeled 3) joined to the labels that they are, and stretches of a label
/// away from its marker taken out. No position changes: each moves to its label, or leaves it, with
/// its residual, its cameras and its digits. How tracks go on and what distances within the body
/// say decides; of a swap of most of a take, the mirror image of the body. What is not sure stays
/// as it was, and is told. Several people (Ann:LFHD, Ben:LFHD) are looked at one by one.
///
/// Beside each result, RESULT.json has every change with the evidence for it and the positions that
/// were taken out, and, where something changed or is not sure, RESULT.html plays the take before
/// and after. Exit code 3: something is not sure.
///
/// With --from-nothing, takes without any label: the pieces of each marker of a set move to one
/// column, which gets its name; what is not sure gets no label and is told.
#[derive(Parser)]
#[command(
    name = "label",
    version,
    after_help = "Examples:\
        \n  posing label gait.c3d -o labeled.c3d\
        \n  posing label captures/ -o labeled/ --up y || echo something is not sure\
        \n  posing label --dry-run walk.csv\
        \n  posing label raw.c3d --from-nothing --set cmu41 -o named.c3d || echo see the record\
        \n  posing label --learn-set gait.c3d -o set.json\
        \n  posing label raw.c3d --from-nothing --set set.json -o again.c3d || echo see the record",
    group = clap::ArgGroup::new("markers").args(["set", "like"]).multiple(true),
    group = clap::ArgGroup::new("task").args(["from_nothing", "learn", "learn_set"])
)]
pub struct Args {
    /// Takes, and folders that are searched for them
    #[arg(value_name = "TAKE", required = true)]
    inputs: Vec<PathBuf>,
    /// Write the result of one take to OUT, results of several into the folder DIR
    #[arg(
        short,
        long,
        value_name = "OUT|DIR",
        required_unless_present = "dry_run",
        help_heading = "Output"
    )]
    output: Option<OutputPath>,
    /// Say what would be changed, and write nothing
    #[arg(long, conflicts_with = "output", help_heading = "Output")]
    dry_run: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    read: TakeReadArgs,
    #[command(flatten)]
    like: LikeArgs,
    #[command(flatten)]
    exchange: ExchangeArgs,
    /// Name the tracks of takes without any labels, as the markers of --set or of the takes of
    /// --like: by a body, or by postures of theirs where few of their labels are on landmarks, put
    /// at the points of some frames and then fitted to the take
    #[arg(long, requires = "markers", help_heading = "From nothing")]
    from_nothing: bool,
    /// Marker set: cmu41, pig, rajagopal, opencap, motive, isb or sprint, or a file of one
    #[arg(
        long,
        value_name = "NAME|FILE",
        requires = "task",
        help_heading = "From nothing"
    )]
    set: Option<String>,
    /// Confidence from which on a label is given, from 0.5, below 1
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.9,
        value_parser = parse_confidence,
        requires = "from_nothing",
        help_heading = "From nothing"
    )]
    sure: f64,
    /// Learn a marker set from labeled takes, and write it to SET.json for --set: of markers that
    /// a built-in set knows, and of all that move as a bone does
    #[arg(
        long,
        conflicts_with_all = ["from_nothing", "like", "dry_run", "json"],
        help_heading = "From nothing"
    )]
    learn: bool,
    /// Learn a marker set from the labeled takes of folders, of any labels, and write it to
    /// SET.json for --set: from those in which people stand still, if there are some. If too few
    /// of the labels are on known landmarks, the set names tracks, and solve makes no skeleton by
    /// it
    #[arg(
        long,
        conflicts_with_all = ["from_nothing", "learn", "like", "dry_run", "json"],
        help_heading = "From nothing"
    )]
    learn_set: bool,
    /// Keep the label of a point in a stretch, in seconds as the file has them: LFHD:1.2-1.9 (may
    /// be given again, of one take)
    #[arg(
        long,
        value_name = "NAME:FROM-TO",
        value_parser = Segment::parse,
        help_heading = "Method"
    )]
    keep_labels: Vec<Segment>,
}

pub fn work(args: &Args) -> Result<Outcome> {
    if args.learn || args.learn_set {
        return learn(args, args.output.as_deref().unwrap_or(Path::new("-")));
    }
    if args.dry_run {
        args.json.prepare_report();
    } else {
        args.json.prepare(args.output.as_deref())?;
    }
    // A dry run has paths for results as well, and writes none.
    let output = args.output.as_deref().or(Some(Path::new("-")));
    let jobs = batch(&args.inputs, output, &EXTENSIONS, None)?;
    let results = jobs.iter().filter(|_| !args.dry_run);
    let results = results.filter_map(|job| job.output.as_deref());
    check_written(results.flat_map(files_beside))?;
    if jobs.len() > 1 && !args.keep_labels.is_empty() {
        let what = "--keep-labels is for a stretch of one take; give that file alone";
        return Err(Error::usage(what));
    }
    let like = args.like.takes(&args.read.rules())?;
    let settings = LabelSettings {
        keep: args.keep_labels.clone(),
        like: args.like.templates_of(&like)?,
        exchange: args.exchange.exchange.clone(),
        option_names: messages::option_names(),
        ..LabelSettings::default()
    };
    let model = args.from_nothing.then(|| model(args, &like)).transpose()?;
    each_told(&jobs, &args.json, |one| {
        label(args, &settings, model.as_deref(), one)
    })
}

fn parse_confidence(text: &str) -> std::result::Result<f64, String> {
    parse_if(
        text,
        |share| (0.5..1.0).contains(&share),
        "a number from 0.5, below 1",
    )
}

/// The model of the set, or of the labeled takes.
fn model(args: &Args, like: &[MotionFile]) -> Result<Box<dyn LabelModel>> {
    let set = args.set.as_deref().map(marker_set).transpose()?;
    let takes: Vec<_> = like.iter().map(MotionFile::poses).collect();
    naming_model(&takes, set.as_deref())
}

/// Learns a marker set and writes it.
fn learn(args: &Args, to: &Path) -> Result<Outcome> {
    let rules = args.read.rules();
    let set = args.set.as_deref().map(marker_set).transpose()?;
    let (set, name) = (set.as_deref(), to.display().to_string());
    let learned = if args.learn_set {
        let files = labeled_files(&args.inputs, &rules)?;
        let takes: Vec<_> = files.iter().map(MotionFile::poses).collect();
        let (learned, used) = MarkerSet::learn_from(&name, &takes, set)?;
        let of = |n: &usize| files[*n].table.name.as_str();
        let used: Vec<&str> = used.iter().map(of).collect();
        messages::info(&format!("learned from {}", used.join(", ")));
        learned
    } else {
        let files = args.inputs.iter();
        let files = files.map(|path| MotionFile::open_by(path, &rules));
        let files = files.collect::<Result<Vec<_>>>()?;
        let takes: Vec<_> = files.iter().map(|file| (file.poses(), None)).collect();
        MarkerSet::learn(&name, &takes, set)?
    };
    write_bytes(Some(to), learned.to_json()?.as_bytes(), false)?;
    Ok(Outcome::Done)
}

/// The takes of points among some files and those of folders; what is none in a folder is passed
/// over.
fn labeled_files(inputs: &[PathBuf], rules: &ReadRules) -> Result<Vec<MotionFile>> {
    let mut files = Vec::new();
    for input in inputs {
        if !input.is_dir() {
            files.push(MotionFile::open_by(input, rules)?);
            continue;
        }
        for (path, _) in MotionFolder::search(input, None, |_| true).files {
            match MotionFile::open_by(&path, rules) {
                Ok(file) if file.motion().is_none() => files.push(file),
                Ok(_) => {}
                Err(e) => messages::info(&format!("passed over: {e}")),
            }
        }
    }
    Ok(files)
}

fn label(
    args: &Args,
    settings: &LabelSettings,
    model: Option<&dyn LabelModel>,
    job: &BatchJob,
) -> Result<(Outcome, Value)> {
    let file = MotionFile::open_by(&job.input, &args.read.rules())?;
    check_unit(file.poses(), file.units(), &file.table.name)?;
    let (file, report) = match model {
        Some(model) => label_from_nothing(&file, model, args.sure, settings)?,
        None => {
            let settings = on_body(settings, &file.poses().points);
            let report = check_labels(&file, &settings)?;
            (file, report)
        }
    };
    let name = job.input.display().to_string();
    let named = report.named.iter().flat_map(|named| named.lines());
    let lines = named.chain(report.lines().map(String::from));
    let lines = lines.chain(file.computed_note());
    lines.for_each(|line| messages::info(&format!("{name}: {line}")));
    if let Some(path) = job.output.as_deref().filter(|_| !args.dry_run) {
        let note = write_labeled(&job.input, path, &file, &report, messages::option_names())?;
        note.iter()
            .for_each(|note| messages::info(&format!("{name}: {note}")));
    }
    let outcome = Outcome::of(report.is_unsure());
    Ok((outcome, json!({ "labels": report })))
}

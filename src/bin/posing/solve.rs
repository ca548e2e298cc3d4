//! Joints from labeled markers.

use clap::{Parser, ValueEnum};
use posing::cli::args::OutputArgs;
use posing::cli::endings::ending;
use posing::cli::input::open;
use posing::cli::json_report::JsonArgs;
use posing::cli::marker_set::marker_set;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::read_args::TakeReadArgs;
use posing::cli::streams::{write_bytes, write_table};
use posing::cli::{Outcome, messages};
use posing::gait::{GaitSettings, GivenValues, SessionTrial, TrialFile};
use posing::io::motion_file::ReadRules;
use posing::io::{Amc, Asf, MotionFile, Table};
use posing::pose::Units;
use posing::pose::one_take::first_frame_number;
use posing::solve::{JointSet, MarkerSet, SolveSettings, SolvedTake, solve};
use posing::{Error, Place, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Turn labeled markers into joints, a skeleton and its motion
///
/// Reads a take of markers (C3D, TRC, Motive CSV, Qualisys TSV, NPZ, pose table). Bones, the places
/// of the markers on them and the poses of 24 frames are fitted together, by what is known of
/// people; then every frame by itself. The marker set is that whose names cover most of the
/// markers. Markers may be missing, and some may be wrong; one that does not fit its name in the
/// whole take is named. Frames with fewer than three markers have no joints. Exit code 3: a marker
/// does not fit, or a frame has no joints.
///
/// Joints are the 23 of the built-in model, so that complete, denoise, edit and retarget go on from
/// them, or the centers of hips, knees, ankles, shoulders, elbows and wrists. Under Plug-in Gait's
/// markers these centers are its own, Vicon's to .001 mm, where the take or --static is a C3D that
/// stores LegLength, KneeWidth and AnkleWidth (group PROCESSING); arms need ShoulderOffset,
/// ElbowWidth and WristWidth. NAME.sd is 0 there, but for markers that were filled. Frames that
/// lack a marker of a center have the body model's, moved as far as both are apart in other frames.
/// Skeleton and motion (--bvh, --amc) are always the body model's, whose hips are 2 to 3 cm off
/// Vicon's.
///
/// Angles (--angles) have the names and signs of gait: Plug-in Gait's under its markers, else those
/// between the bones, with knees that flex only. --static is their zero, or tells Plug-in Gait's
/// offsets. Unknown values are nan, in tables empty.
///
/// The angle of hip, knee and ankle is Vicon's knee flexion up to 1 degree (2.4 at most) in the
/// mean of a walk by these centers, and 6 degrees (9 at most) larger by the body model's: 12 walks
/// of 6 children.
#[derive(Parser)]
#[command(
    name = "solve",
    version,
    after_help = "Examples:\
        \n  posing solve markers.c3d -o joints.csv\
        \n  posing solve markers.c3d --joints anatomical --sd -o centers.csv\
        \n  posing solve markers.c3d --bvh walk.bvh -o joints.csv\
        \n  posing solve markers.c3d --angles walk.mot -o joints.csv"
)]
pub struct Args {
    /// Take of labeled markers; with --learn several
    #[arg(value_name = "TAKE", required = true)]
    takes: Vec<PathBuf>,
    /// Joints: the 23 of the built-in model, or joint centers, Plug-in Gait's where it is known
    #[arg(long, value_enum, default_value = "23", help_heading = "Method")]
    joints: Joints,
    /// Marker set: auto, cmu41, pig, rajagopal, opencap, motive, isb or sprint, or a file of one
    #[arg(
        long,
        value_name = "NAME|FILE",
        default_value = "auto",
        help_heading = "Method"
    )]
    set: String,
    /// Static take of the person: markers on it tell bones too, also those that are only there (of
    /// the inner knee and ankle, as a rule), and Plug-in Gait's parameters that TAKE does not store
    #[arg(long = "static", value_name = "STATIC", help_heading = "Method")]
    static_take: Option<PathBuf>,
    /// Also write skeleton and motion as BVH
    #[arg(long, value_name = "OUT.bvh", help_heading = "Output")]
    bvh: Option<OutputPath>,
    /// Also write joint angles, degrees, as gait does: .mot or .sto for OpenSim, or .csv, its table
    #[arg(long, value_name = "OUT.mot", help_heading = "Output")]
    angles: Option<OutputPath>,
    /// Write the standard deviation of each joint into columns NAME.sd
    #[arg(long, help_heading = "Output")]
    sd: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    read: TakeReadArgs,
    /// Marker set of your own: a file of lines such as LKNE = "KNL", marker and landmark ({S} for
    /// the side, L or R). Landmarks: ASI PSI SACR ILC GT of the pelvis, in front, behind, in the
    /// middle behind, the crest, the trochanter; C7 CLAV T10 STRN RBAC LBAC STL of the trunk; FHD
    /// BHD HTOP HFRONT MAN of the head, MAN the chin; SHO ASH PSH of the shoulder; UPA, ELL ELM of
    /// the upper arm, the elbow outside and inside; FRM, WRR WRU of the forearm, the wrist at thumb
    /// and little finger; FIN HIN HOUT of the hand; TH, PAT, KNL KNM of the thigh, the kneecap, the
    /// knee outside and inside; SH TTA, ANL ANM of the shin, the ankle outside and inside; HEE MT5
    /// MT1 TOE MID HAL of the foot, HAL the big toe
    #[arg(
        long,
        value_name = "FILE.toml",
        conflicts_with = "set",
        help_heading = "Method"
    )]
    map: Option<PathBuf>,
    /// Marker set that --learn made: where each marker is on its bone
    #[arg(
        long,
        value_name = "SET.json",
        conflicts_with_all = ["set", "map"],
        help_heading = "Method"
    )]
    template: Option<PathBuf>,
    /// Learn a marker set from takes whose joints are known, and write it to this file
    #[arg(
        long,
        value_name = "SET.json",
        requires = "truth",
        conflicts_with_all = ["json", "bvh", "angles", "amc", "asf_out", "page", "output"],
        help_heading = "Method"
    )]
    learn: Option<OutputPath>,
    /// Joints of a take to learn from, once a take, in their order
    #[arg(
        long,
        value_name = "JOINTS.csv",
        requires = "learn",
        help_heading = "Method"
    )]
    truth: Vec<PathBuf>,
    /// Skeleton of the person, with CMU's bones, whose lengths are kept
    #[arg(long, value_name = "SUBJECT.asf", help_heading = "Method")]
    asf: Option<PathBuf>,
    /// Also write the motion as AMC, for the skeleton of --asf-out
    #[arg(long, value_name = "OUT.amc", help_heading = "Output")]
    amc: Option<OutputPath>,
    /// Also write the skeleton as ASF
    #[arg(long, value_name = "OUT.asf", help_heading = "Output")]
    asf_out: Option<OutputPath>,
    /// Also write a page that plays joints and markers, each with a line to its bone
    #[arg(long, value_name = "OUT.html", help_heading = "Output")]
    page: Option<OutputPath>,
    #[command(flatten)]
    out: OutputArgs,
}

/// Joints by their name on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Joints {
    /// The 23 of the built-in model
    #[value(name = "23")]
    Cmu,
    /// LHJC, LKJC, LAJC, LSJC, LEJC, LWJC and those of the right side
    Anatomical,
}

pub fn work(args: &Args) -> Result<Outcome> {
    let own = args.map.as_ref().or(args.template.as_ref());
    let own = match (own, args.set.as_str()) {
        (Some(path), _) => Some(Cow::Owned(MarkerSet::open(path)?)),
        (None, "auto") => None,
        (None, set) => Some(marker_set(set)?),
    };
    let set = own.as_deref();
    if let Some(path) = &args.learn {
        return learn(args, set, path);
    }
    args.json.prepare(args.out.output.as_deref())?;
    let (take, file) = take(args)?;
    let name = take.display().to_string();
    let place = |e: Error| e.at(Place::file(&name));
    let given = args
        .asf
        .as_ref()
        .map(|p| Asf::read(open(p)?, None))
        .transpose()?;
    let statics = args.static_take.as_ref();
    let statics = statics
        .map(|path| one_take(path, &args.read.rules()).map(Arc::new))
        .transpose()?;
    let mut subject = file.c3d().map(GivenValues::of_c3d).unwrap_or_default();
    if let Some(statics) = statics.as_ref().and_then(|file| file.c3d()) {
        subject.fill_from(&GivenValues::of_c3d(statics));
    }
    let settings = SolveSettings {
        joints: match args.joints {
            Joints::Cmu => JointSet::Cmu,
            Joints::Anatomical => JointSet::Anatomical,
        },
        set,
        skeleton: given.as_ref().map(|asf| &asf.skeleton),
        statics: statics.as_ref().map(|file| file.poses()),
        deviations_every: usize::from(args.sd),
        subject: Some(&subject),
        filled: file.table.sd.as_ref(),
    };
    let bar = Progress::new("solve", file.poses().frames() as u64);
    let solved = solve(file.poses(), &settings, &mut |t| bar.set(t as u64)).map_err(place)?;
    drop(bar);
    let findings = solved.findings();
    let lines = solved.lines().into_iter().chain(findings.iter().cloned());
    lines.for_each(|line| messages::info(&format!("{name}: {line}")));
    if let Some(to) = &args.angles {
        let standing = args.static_take.as_ref().zip(statics);
        let standing = standing.map(|(path, file)| TrialFile::new(path, file));
        let (own, standing) = (TrialFile::new(take, file.clone())?, standing.transpose()?);
        let settings = GaitSettings::default();
        let own = own.computed(Some((&solved, set)), standing.as_ref(), &settings);
        write_angles(to, &own.map_err(place)?)?;
    }
    write(args, &file, &solved)?;
    Ok(Outcome::of(!findings.is_empty()))
}

/// The take to solve, with a rate where a result needs one.
fn take(args: &Args) -> Result<(&PathBuf, Arc<MotionFile>)> {
    let end = |to: &OutputPath| ending(to).unwrap_or_default();
    if !matches!(
        args.angles.as_ref().map(end).as_deref(),
        None | Some("mot" | "sto" | "csv")
    ) {
        return Err(Error::usage("--angles: call the file .mot, .sto or .csv"));
    }
    let [take] = &args.takes[..] else {
        return Err(Error::usage(
            "several takes: give one, or learn from them with --learn",
        ));
    };
    let file = one_take(take, &args.read.rules())?;
    let is_timed = args.bvh.is_some() || args.angles.is_some();
    if is_timed && file.rate().is_none() {
        let what = "says no rate, which --bvh and --angles need; give it with --fps (frames per \
                    second)";
        return Err(Error::data(Place::file(&file.table.name), what));
    }
    Ok((take, Arc::new(file)))
}

/// A file of one take.
fn one_take(path: &Path, rules: &ReadRules) -> Result<MotionFile> {
    let file = MotionFile::open_by(path, rules)?;
    if file.poses().takes().len() > 1 {
        let what = "holds several takes; cut one out with trim --take";
        return Err(Error::data(Place::file(path.display().to_string()), what));
    }
    Ok(file)
}

/// Learns a marker set and writes it.
fn learn(args: &Args, set: Option<&MarkerSet>, to: &Path) -> Result<Outcome> {
    if args.truth.len() != args.takes.len() {
        return Err(Error::usage(format!(
            "{} takes and {} tables of joints: give --truth once a take, in their order",
            args.takes.len(),
            args.truth.len()
        )));
    }
    let rules = args.read.rules();
    let open = |paths: &[PathBuf], rules: &ReadRules| -> Result<Vec<MotionFile>> {
        paths.iter().map(|path| one_take(path, rules)).collect()
    };
    let (takes, truths) = (
        open(&args.takes, &rules)?,
        open(&args.truth, &ReadRules::default())?,
    );
    let both = takes.iter().zip(&truths);
    let both: Vec<_> = both.map(|(t, j)| (t.poses(), Some(j.poses()))).collect();
    let learned = MarkerSet::learn(&to.display().to_string(), &both, set)?;
    write_bytes(Some(to), learned.to_json()?.as_bytes(), false)?;
    Ok(Outcome::Done)
}

/// Writes the angles of a take; what costs them is told.
fn write_angles(to: &Path, trial: &SessionTrial) -> Result<()> {
    for finding in &trial.gait.findings {
        if let "estimated" | "other_model" | "static_differs" | "gap_unsure" = finding.kind {
            messages::info(&format!("{}: {}", trial.file, finding.what));
        }
    }
    let is_table = ending(to).is_some_and(|end| end == "csv");
    let table = is_table.then(|| trial.to_csv(false));
    write_bytes(Some(to), &table.unwrap_or_else(|| trial.to_mot()), false)
}

fn write(args: &Args, file: &MotionFile, solved: &SolvedTake) -> Result<()> {
    let table = Table::from_poses(solved.joints.clone());
    write_table(
        &args.out,
        [Units::CM_Y; 2],
        &table,
        table.poses.xyz.view(),
        &solved.sd_columns(),
        |t| solved.sd_cells(t),
    )?;
    if let Some(path) = &args.asf_out {
        write_bytes(Some(path), &solved.skeleton.to_bytes(), false)?;
    }
    if let Some(path) = &args.amc {
        let first = first_frame_number(&solved.joints, file.rate());
        let amc = Amc::from_values(&solved.skeleton, first, solved.values.view());
        write_bytes(Some(path), &amc.to_bytes(), false)?;
    }
    if let Some(path) = &args.bvh {
        let bvh = solved.to_bvh(file.rate().unwrap_or(1.0))?;
        write_bytes(Some(path), &bvh.to_bytes(1.0), false)?;
    }
    if let Some(path) = &args.page {
        match solved.page(&file.table.name, file.poses())? {
            Some(page) => write_bytes(Some(path), page.as_bytes(), false)?,
            None => messages::info("the take cannot be played: no page"),
        }
    }
    args.json.write(solved.report())
}

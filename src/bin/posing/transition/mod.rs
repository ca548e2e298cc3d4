//! Finds frames at which one take can go over into another, and blends takes there.

mod search;
mod take_pairs;

use self::search::{Transition, TransitionSettings, Transitions};
use clap::Parser;
use posing::cli::args::{TimedTableArgs, parse_if};
use posing::cli::feature_table::FittingMapArgs;
use posing::cli::metric_takes::{open_metric, read_takes};
use posing::cli::paths::OutputPath;
use posing::cli::{input, messages};
use posing::metric::{JointMap, PoseMetric};
use posing::{Error, Result};
use std::path::{Path, PathBuf};

/// Find frames at which one take can go over into another
///
/// Writes a_take, a_frame, b_take, b_frame, distance, bones, feet, acceleration, good: the frames
/// at which the poses of two takes are nearest, and whether a blend of the takes there is good.
/// Frames count from 0 within their take.
///
/// The distance is that of a metric of rdsr-train, or without one of coordinates and velocities.
/// bones, feet and acceleration are shares of limits; good is 1 where none is above 1. bones: no
/// bone leaves the range of its lengths in both takes by more than 5% of its length. feet: no
/// planted foot (slower than 20 cm/s, within 10 cm of its lowest height) is drawn faster than 30
/// cm/s. acceleration: no joint's is above its largest in either take.
///
/// A blend is the first take up to the transition, a passage about it, and the rest of the second
/// take, turned about the vertical and moved on the ground to go on where the first one is. In the
/// passage bones turn from one take to the other and keep their lengths, both takes go at one
/// cadence, and feet that stand stay in place.
#[derive(Parser)]
#[command(
    name = "transition",
    version,
    after_help = "Examples:\
        \n  posing transition two-takes.csv > transitions.csv\
        \n  posing transition -m metric.npz --good --blend joined.csv two-takes.csv\
        \n  posing transition --within walk.csv > loops.csv"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Metric, by rdsr-train (default: coordinates and velocities)
    #[arg(short, long, value_name = "METRIC.npz")]
    model: Option<PathBuf>,
    #[command(flatten)]
    map: FittingMapArgs,
    /// Take that is left (default: each)
    #[arg(long, value_name = "TAKE")]
    from: Option<String>,
    /// Take that is entered (default: each)
    #[arg(long, value_name = "TAKE")]
    to: Option<String>,
    /// Also transitions of a take into itself, of 1 s or more
    #[arg(long)]
    within: bool,
    /// Transitions of each pair of takes, at most
    #[arg(
        short,
        value_name = "N",
        default_value = "10",
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    n: u32,
    /// Good transitions only: looks past others until N are found
    #[arg(long, conflicts_with = "at")]
    good: bool,
    /// Write the blended take of the nearest good transition to FILE, CSV or NPY
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    blend: Option<OutputPath>,
    /// Only the transition at these frames of the two takes
    #[arg(long, value_name = "A,B", value_parser = frames)]
    at: Option<[usize; 2]>,
    /// Seconds between two transitions, in one of the takes at least
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = seconds)]
    apart: f64,
    /// Seconds of the blend [default: 0.3 to 1.2, the longest that is good]
    #[arg(long, value_name = "S", value_parser = seconds)]
    over: Option<f64>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
}

fn frames(text: &str) -> std::result::Result<[usize; 2], String> {
    let frame = |part: &str| part.trim().parse::<usize>().ok();
    (text.split_once(','))
        .and_then(|(a, b)| Some([frame(a)?, frame(b)?]))
        .ok_or_else(|| "expected two frames such as 120,30".into())
}

/// Above 0 to 60 seconds.
fn seconds(text: &str) -> std::result::Result<f64, String> {
    parse_if(text, |v| v > 0.0 && v <= 60.0, "seconds, above 0 to 60")
}

pub fn work(args: &Args) -> Result<()> {
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, &args.model)?;
    let is_stdout = |path: &Option<OutputPath>| path.as_deref().is_none_or(|p| p == Path::new("-"));
    if args.blend.is_some() && is_stdout(&args.blend) && is_stdout(&args.output) {
        return Err(Error::usage(
            "--blend -: the transitions go to standard output too; write them to a file with -o",
        ));
    }
    let metric = args.model.as_deref().map(open_metric).transpose()?;
    let map = args.map.joint_map(metric.as_ref())?;
    // A blend is so many frames, whatever the metric needs.
    let takes = read_takes(&tables, tables.files.clone(), map.as_ref(), true)?;
    let metric = match (metric, map) {
        (Some(metric), _) => metric,
        (None, Some(map)) => PoseMetric::of_coordinates(map),
        (None, None) => PoseMetric::of_coordinates(JointMap::fitting(&takes.poses.points)),
    };
    let settings = TransitionSettings {
        from: args.from.clone(),
        to: args.to.clone(),
        within: args.within,
        at: args.at,
        most: args.n as usize,
        is_good_only: args.good,
        apart: args.apart,
        over: args.over,
    };
    let transitions = Transitions::new(&takes, &metric, &settings)?;
    let found = transitions.find()?;
    report(&found);
    transitions.write(args.output.as_deref(), &found)?;
    match &args.blend {
        Some(path) => transitions.write_blend(&found, path),
        None => Ok(()),
    }
}

fn report(found: &[Transition]) {
    let good = found.iter().filter(|t| t.quality.is_good()).count();
    messages::info(&format!("{good} of {} transitions are good", found.len()));
}

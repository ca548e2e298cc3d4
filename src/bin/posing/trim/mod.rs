//! Chooses frames and points of takes, changes their rate and speed, filters them.

mod rotations;

use posing::cli::choice::named;
use posing::cli::paths::OutputPath;

use clap::Parser;
use posing::cli::args::{
    InputArgs, OutUnitArgs, OutputArgs, parse_hertz, parse_positive, parse_rate,
};
use posing::cli::input::{check_single_stdin, open, or_stdin, read_opened_table};
use posing::cli::messages;
use posing::cli::streams::{write_bytes, write_table};
use posing::io::csv::with_times;
use posing::io::motion_file::LARGEST_MOTION_FILE;
use posing::io::{Input, MotionFormat, Table, TableFormat, parse_point_names};
use posing::label::points_of_person;
use posing::pose::Poses;
use posing::pose::units::Units;
use posing::{Error, Place, Result};
use std::io::Cursor;
use std::path::PathBuf;

/// Choose frames, takes and points, resample, retime, rename, filter
///
/// Several tables become one. First a wrong rate is corrected (--rate-is), then frames are chosen
/// (--take, --from, --to), then values are filtered (--butterworth), then made faster (--speed) and
/// resampled, then points are chosen and renamed. Missing values stay missing, and nothing is
/// interpolated across them. The result has the columns take, time and the points; other columns
/// are left out. Of one CSV table with --rate-is alone, only the numbers of its times change.
///
/// A BVH or AMC file stays one, with its own skeleton, and FBX becomes BVH: --rate-is, --from,
/// --to, --butterworth, --speed and --resample work on its rotations. Each joint turns the shortest
/// way from frame to frame, wherever its angles wrap, and the root moves along splines; before a
/// lower rate, movement that it cannot show is filtered out. Values that stood still for four
/// frames stay as they are. Where only frames are chosen or the rate is corrected, the text of each
/// value stays.
#[derive(Parser)]
#[command(
    name = "trim",
    version,
    after_help = "Examples:\
        \n  posing trim --from 1.5 --to 4 walk.csv > part.csv\
        \n  posing trim --butterworth 6Hz walk.csv > smooth.csv\
        \n  posing trim --butterworth 12Hz --resample 30 walk.csv > walk30.csv\
        \n  posing trim --resample 30 walk.bvh -o walk30.bvh\
        \n  posing trim --rate-is 60 walk.bvh -o right.bvh\
        \n  posing trim --person Ann both.csv > ann.csv\
        \n  posing trim --points lwrist,rwrist --rename lwrist=left,rwrist=right walk.csv"
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// First time, in seconds as the table has it, 0 being the first frame of a BVH file, of which
    /// the nearest frame is taken
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Last time, in seconds as the table has it; or the output format, csv, npy or npz
    /// (default: by FILE's extension, else csv). It may be given twice, once for each
    #[arg(
        long,
        value_name = "SECONDS|FORMAT",
        allow_negative_numbers = true,
        value_parser = parse_to
    )]
    to: Vec<To>,
    /// Comma-separated takes; of an FBX file one
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    take: Vec<String>,
    /// Low-pass filter: Butterworth of second order, forwards and backwards (no lag, fourth order
    /// together), with half the power left at this cutoff; below .4 of the rate
    #[arg(long, value_name = "HZ", value_parser = parse_hertz)]
    butterworth: Option<f64>,
    /// Frames per second of the result, interpolated between measured neighbors: points by PCHIP,
    /// rotations by splines. For a lower rate, filter points first: what is faster than half of it
    /// turns into slow movement
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    resample: Option<f64>,
    /// Make the motion so many times faster; the rate stays
    #[arg(long, value_name = "X", value_parser = parse_positive)]
    speed: Option<f64>,
    /// The rate that the frames really have, where the file says a wrong one: times change, values
    /// do not
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    rate_is: Option<f64>,
    /// Comma-separated points, in the order of the result
    #[arg(long, value_name = "LIST")]
    points: Option<String>,
    /// The points of one of several people, without what tells people apart in their names: Ann of
    /// Ann:LFHD and Ben:LFHD, 2 of LFHD and LFHD_2
    #[arg(long, value_name = "NAME")]
    person: Option<String>,
    /// Comma-separated new names of points
    #[arg(long, value_name = "OLD=NEW,...", value_delimiter = ',', value_parser = parse_rename)]
    rename: Vec<(String, String)>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
    #[command(flatten)]
    out_units: OutUnitArgs,
    /// Skeleton of AMC takes [default: the ASF file beside each whose name begins the take's:
    /// 07.asf for 07_01.amc]
    #[arg(long, value_name = "SUBJECT.asf", help_heading = "Input")]
    asf: Option<PathBuf>,
    /// Skeleton of an FBX file that has several: the name of its root joint; of roots that are
    /// called alike, of the node above
    #[arg(long, value_name = "NAME", help_heading = "Input")]
    skeleton: Option<String>,
    /// Accept a BVH or AMC file whose last frame is cut off; that frame is dropped
    #[arg(long, help_heading = "Input")]
    keep_whole: bool,
}

/// What `--to` says: where frames end, or as what they are written.
#[derive(Debug, Clone, Copy)]
enum To {
    Seconds(f64),
    Format(TableFormat),
}

fn parse_to(text: &str) -> std::result::Result<To, String> {
    let seconds = text.parse().ok().filter(|s: &f64| s.is_finite());
    match (seconds, named(text)) {
        (Some(seconds), _) => Ok(To::Seconds(seconds)),
        (None, Some(format)) => Ok(To::Format(format)),
        (None, None) => Err("expected a time in seconds, or the format csv, npy or npz".into()),
    }
}

impl Args {
    /// Whether nothing but the rate is to be corrected, and CSV comes out.
    fn corrects_rate_alone(&self) -> bool {
        let flags = [self.from, self.butterworth, self.resample, self.speed];
        self.rate_is.is_some()
            && flags.iter().all(Option::is_none)
            && self.last().is_none()
            && self.take.is_empty()
            && self.first_of_tables().is_none()
            && self.output().format() == TableFormat::Csv
    }

    /// The first flag given that is for tables alone.
    fn first_of_tables(&self) -> Option<&'static str> {
        let format = self.to.iter().any(|to| matches!(to, To::Format(_)));
        let flags = [
            ("--points", self.points.is_some()),
            ("--person", self.person.is_some()),
            ("--rename", !self.rename.is_empty()),
            ("--out-units and --out-up", self.out_units.are_given()),
            ("a format by --to", format),
        ];
        flags
            .into_iter()
            .find_map(|(flag, given)| given.then_some(flag))
    }

    /// The last time that is chosen, in seconds.
    fn last(&self) -> Option<f64> {
        self.to.iter().rev().find_map(|to| match to {
            To::Seconds(seconds) => Some(*seconds),
            To::Format(_) => None,
        })
    }

    /// Where the result goes, and its format.
    fn output(&self) -> OutputArgs {
        let format = self.to.iter().rev().find_map(|to| match to {
            To::Format(format) => Some(*format),
            To::Seconds(_) => None,
        });
        OutputArgs {
            output: self.output.clone(),
            to: format,
        }
    }
}

fn parse_rename(text: &str) -> std::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((old, new)) if !old.is_empty() && !new.is_empty() => Ok((old.into(), new.into())),
        _ => Err("expected OLD=NEW".into()),
    }
}

pub fn work(args: &Args) -> Result<()> {
    let files = or_stdin(&args.input.files);
    check_single_stdin(&files)?;
    let input = open(&files[0])?;
    let format = MotionFormat::of(input.first_bytes());
    match format {
        MotionFormat::Csv if files.len() == 1 && args.corrects_rate_alone() => {
            correct_rate(args, input)
        }
        _ if format.has_rotations() => rotations::trim(args, &files, input),
        _ => trim_table(args, read_opened_table(input, &args.input)?),
    }
}

/// Changes only the times of a CSV table.
fn correct_rate(args: &Args, input: Input) -> Result<()> {
    let name = input.name.clone();
    let bytes = input.read_all(LARGEST_MOTION_FILE)?;
    let again = Input::new(&name, Cursor::new(bytes.clone()))?;
    let table = read_opened_table(again, &args.input)?;
    let times = corrected(args, &table.poses, args.input.rate(&table.poses)?);
    let times = times.map_err(|e| e.at(Place::file(&name)))?;
    let mended = with_times(&bytes, times.as_deref().unwrap_or_default());
    write_bytes(args.output.as_deref(), &mended.unwrap_or(bytes), false)
}

/// The times of a table whose rate is `fps`, as --rate-is corrects it.
fn corrected(args: &Args, poses: &Poses, fps: Option<f64>) -> Result<Option<Vec<f64>>> {
    match args.rate_is {
        None => Ok(poses.times(fps)),
        Some(_) if poses.time.is_none() => {
            let what = "has no times to correct; give the right rate with --fps where it is read";
            Err(what.into())
        }
        Some(rate) => poses.times_at_rate(rate).map(Some),
    }
}

fn trim_table(args: &Args, mut table: Table) -> Result<()> {
    let fps = args.input.rate(&table.poses)?;
    let bad = |e: Error| e.at(Place::file(&table.name));
    table.poses.time = corrected(args, &table.poses, fps).map_err(bad)?;
    let fps = args.rate_is.or(fps);
    let mut poses = chosen(args, &table.poses).map_err(bad)?;
    if let Some(cutoff) = args.butterworth {
        let short = poses.low_pass(cutoff, fps).map_err(bad)?;
        if short > 0 {
            messages::info(&format!(
                "{short} pieces of fewer than 10 frames are not filtered"
            ));
        }
    }
    poses = retimed(args, poses, fps).map_err(bad)?;
    if let Some(name) = &args.person {
        let own = points_of_person(&poses.points, name).map_err(bad)?;
        let names: Vec<String> = own.iter().map(|(p, _)| poses.points[*p].clone()).collect();
        let with = poses.with_points(&names);
        poses = with.map_err(|name| bad(format!("has no point \"{name}\"").into()))?;
        poses.points = own.into_iter().map(|(_, name)| name).collect();
    }
    if let Some(list) = &args.points {
        let names = parse_point_names(list)?;
        let with = poses.with_points(&names);
        poses = with.map_err(|name| bad(format!("has no point \"{name}\"").into()))?;
    }
    rename(args, &mut poses).map_err(bad)?;
    let mut result = Table::from_poses(poses);
    result.name.clone_from(&table.name);
    let xyz = result.poses.xyz.view();
    // The poses are in centimeters.
    let out_units = args.out_units.table_units(args.input.table_units());
    let units = [Units::CM_Y, out_units];
    write_table(&args.output(), units, &result, xyz, &[], |_| Vec::new())
}

/// The poses at other speed and rate.
fn retimed(args: &Args, mut poses: Poses, fps: Option<f64>) -> Result<Poses> {
    let speed = args.speed.unwrap_or(1.0);
    if args.speed.is_some() {
        poses = poses.sped_up(speed)?;
    }
    let Some(rate) = args.resample.or(fps.filter(|_| args.speed.is_some())) else {
        return Ok(poses);
    };
    if fps.is_some_and(|fps| rate < fps * speed) && args.butterworth.is_none() {
        messages::info(
            "fewer frames without --butterworth: what is faster than half of their rate turns \
             into slow movement",
        );
    }
    poses.resampled(rate)
}

/// The frames that the flags choose.
fn chosen(args: &Args, poses: &Poses) -> Result<Poses> {
    let names = poses.take.as_ref();
    let unknown = |take: &&String| names.is_none_or(|names| !names.iter().any(|n| **n == ***take));
    if let Some(take) = args.take.iter().find(unknown) {
        return Err(format!("has no take \"{take}\"").into());
    }
    let last = args.last();
    if (args.from.is_some() || last.is_some()) && poses.time.is_none() {
        return Err("has no times: --from and --to need them".into());
    }
    let is_chosen = |t: usize| {
        let time = poses.time.as_ref().map_or(0.0, |time| time[t]);
        let in_take = args.take.is_empty()
            || names.is_some_and(|names| args.take.iter().any(|take| **take == *names[t]));
        in_take
            && args.from.is_none_or(|from| time >= from - 1e-9)
            && last.is_none_or(|last| time <= last + 1e-9)
    };
    let frames: Vec<usize> = (0..poses.frames()).filter(|&t| is_chosen(t)).collect();
    if frames.is_empty() {
        return Err("has no frame that was asked for".into());
    }
    Ok(poses.with_frames(&frames))
}

/// Gives points their new names, all at once: left and right may be exchanged.
fn rename(args: &Args, poses: &mut Poses) -> Result<()> {
    let mut names = poses.points.clone();
    for (old, new) in &args.rename {
        let at = poses.points.iter().position(|p| p == old);
        let at = at.ok_or_else(|| format!("has no point \"{old}\" to rename"))?;
        names[at].clone_from(new);
    }
    let mut sorted = names.clone();
    sorted.sort();
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(format!("would have two points \"{}\"", pair[0]).into());
    }
    poses.points = names;
    Ok(())
}

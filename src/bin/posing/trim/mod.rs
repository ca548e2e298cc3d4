//! Chooses frames and points of takes, changes their rate, filters them.

use posing::cli::choice::named;
use posing::cli::paths::OutputPath;

use clap::Parser;
use posing::cli::args::{InputArgs, OutUnitArgs, OutputArgs, parse_hertz, parse_rate};
use posing::cli::input::read_table;
use posing::cli::messages;
use posing::cli::streams::write_table;
use posing::io::{Table, TableFormat, parse_point_names};
use posing::label::points_of_person;
use posing::pose::Poses;
use posing::pose::units::Units;
use posing::{Error, Place, Result};

/// Choose frames, takes and points, resample, rename, filter
///
/// Several tables become one. First frames are chosen (--take, --from, --to), then values are
/// filtered (--butterworth), then resampled, then points are chosen and renamed. Missing values
/// stay missing, and nothing is interpolated across them. The result has the columns take, time and
/// the points; other columns are left out.
#[derive(Parser)]
#[command(
    name = "trim",
    version,
    after_help = "Examples:\
        \n  posing trim --from 1.5 --to 4 walk.csv > part.csv\
        \n  posing trim --butterworth 6Hz walk.csv > smooth.csv\
        \n  posing trim --butterworth 12Hz --resample 30 walk.csv > walk30.csv\
        \n  posing trim --person Ann both.csv > ann.csv\
        \n  posing trim --points lwrist,rwrist --rename lwrist=left,rwrist=right walk.csv"
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// First time, in seconds as the table has it
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
    /// Comma-separated takes
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    take: Vec<String>,
    /// Low-pass filter: Butterworth of second order, forwards and backwards (no lag, fourth order
    /// together), with half the power left at this cutoff; below .4 of the rate
    #[arg(long, value_name = "HZ", value_parser = parse_hertz)]
    butterworth: Option<f64>,
    /// Frames per second of the result, interpolated (PCHIP) between measured neighbors. For a
    /// lower rate, filter first: what is faster than half of it turns into slow movement
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    resample: Option<f64>,
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
    let mut table = read_table(&args.input, false, false)?;
    let fps = args.input.rate(&table.poses)?;
    table.poses.time = table.poses.times(fps);
    let bad = |e: Error| e.at(Place::file(&table.name));
    let mut poses = chosen(args, &table.poses).map_err(bad)?;
    if let Some(cutoff) = args.butterworth {
        let short = poses.low_pass(cutoff, fps).map_err(bad)?;
        if short > 0 {
            messages::info(&format!(
                "{short} pieces of fewer than 10 frames are not filtered"
            ));
        }
    }
    if let Some(rate) = args.resample {
        if fps.is_some_and(|fps| rate < fps) && args.butterworth.is_none() {
            messages::info(
                "a lower rate without --butterworth: what is faster than half of it turns into \
                 slow movement",
            );
        }
        poses = poses.resampled(rate).map_err(bad)?;
    }
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

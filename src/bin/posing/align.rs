//! Lays a recording beside another in time.

use clap::Parser;
use ndarray::Array2;
use posing::cli::args::OutputArgs;
use posing::cli::endings::{check_ending, ending, ending_of};
use posing::cli::input::{check_single_stdin, open};
use posing::cli::json_report::JsonArgs;
use posing::cli::name_maps::name_map;
use posing::cli::paths::OutputPath;
use posing::cli::read_args::ReadArgs;
use posing::cli::streams::{write_bytes, write_table};
use posing::cli::{Outcome, messages};
use posing::io::motion_file::{LARGEST_MOTION_FILE, ReadRules, format_of};
use posing::io::{MotionFile, MotionFormat, NewTake, Table};
use posing::metric::time_alignment::{TimeAlignment, TimeAlignmentOptions, align, shared_points};
use posing::numeric::anti_alias::AntiAlias;
use posing::pose::{BonePoints, Poses, Retiming, Units, joints};
use posing::{Error, Place, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Lay a recording beside another of the same performance, in time
///
/// Finds how much later or earlier B begins than A, to a fraction of a frame, by the speeds of the
/// points that both have: by their names, or a map. Where they stand, which way they face and at
/// what rate they were recorded does not matter; nor do pieces that are missing. Writes B on A's
/// frames, in B's format: a BVH or AMC file in rotations, with as many frames as A, B's first and
/// last pose standing where B has none; markers and tables with A's times, and nothing where B has
/// none (files of markers as tables, unless OUT ends in .c3d or .trc).
///
/// Standard error tells the shift with its standard deviation (+-), the correlation of the speeds,
/// and how many points are shared. Exit code 3, and nothing is written: they share no points, or no
/// place is clearly better than all others.
#[derive(Parser)]
#[command(
    name = "align",
    version,
    after_help = "Examples:\
        \n  posing align mocap.csv video.csv -o video-on-mocap.csv\
        \n  posing align --drift mocap.csv video.csv -o video-on-mocap.csv --json=shift.json\
        \n  posing align walk.csv walk.bvh -o on-walk.bvh"
)]
pub struct Args {
    /// The recording whose frames and clock the result has; any format
    #[arg(value_name = "A")]
    first: PathBuf,
    /// The recording that is written on these frames; any format
    #[arg(value_name = "B")]
    second: PathBuf,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "OUT", help_heading = "Output")]
    output: Option<OutputPath>,
    /// Also find how much faster one clock runs, up to 1 %
    #[arg(long)]
    drift: bool,
    /// Which points are the same: a shipped map, or a TOML file with A's names and B's, as in
    /// lwrist = "left_wrist" [default: those of one name]
    #[arg(long, value_name = "NAME|FILE.toml")]
    map: Option<String>,
    #[command(flatten)]
    read: ReadArgs,
    #[command(flatten)]
    json: JsonArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare(args.output.as_deref())?;
    check_single_stdin([&args.first, &args.second])?;
    let rules = args.read.rules()?;
    let (_, a) = read(&args.first, &rules)?;
    let (bytes, b) = read(&args.second, &rules)?;
    let [timed_a, timed_b] = [timed(&a)?, timed(&b)?];
    let both = format!("{} and {}", a.table.name, b.table.name);
    let found = args.found(&timed_a, &timed_b);
    let (shared, found) = found.map_err(|e| e.at(Place::file(&both)))?;
    let Some(found) = found.filter(|found| found.is_clear) else {
        let drift = if args.drift {
            ""
        } else {
            " (if their clocks drift apart, --drift)"
        };
        let what = match (shared, found) {
            (0, _) => "share no points by their names; --map says which are the same".into(),
            (n, None) => format!("share {n} points, whose speeds are nowhere alike{drift}"),
            (n, Some(found)) => format!(
                "share {n} points, but no motion that is clearly the same: their speeds correlate \
                 by {:.3} at best, and by {:.3} elsewhere{drift}",
                found.correlation, found.elsewhere
            ),
        };
        messages::info(&format!("{both} {what}; nothing is written"));
        args.json.write(report(None, 1.0, shared))?;
        return Ok(Outcome::Findings);
    };
    tell(&a, &b, &found, shared);
    let result = Aligned::new(&timed_a, &timed_b, &found);
    result.write(args.output.as_ref(), &a, &b, bytes, &timed_b)?;
    args.json
        .write(report(Some(&found), a.rate().unwrap_or(1.0), shared))?;
    Ok(Outcome::Done)
}

impl Args {
    /// How many points are shared, and how B lies beside A: by the points' names, else, where
    /// joints of one have the names of the bones that start there, and of the other of those that
    /// end there, by what ends there.
    fn found(&self, a: &Poses, b: &Poses) -> Result<(usize, Option<TimeAlignment>)> {
        let known = a.points.iter().cloned().chain(joints::cmu_names());
        let known: Vec<String> = known.collect();
        let map = self.map.as_ref().map(|map| name_map(map, &known));
        let map = map.transpose()?;
        let by_names = |names: [&[String]; 2]| -> Result<(usize, Option<TimeAlignment>)> {
            let shared = shared_points(names[0], names[1], map.as_ref());
            let options = TimeAlignmentOptions { drift: self.drift };
            Ok((shared.len(), align(a, b, &shared, &options)?))
        };
        let is_clear =
            |found: &(usize, Option<TimeAlignment>)| found.1.is_some_and(|found| found.is_clear);
        let own = by_names([&a.points, &b.points])?;
        let stand = [a, b].map(|poses| BonePoints::of(&poses.points, poses.xyz.view()));
        if is_clear(&own) || stand[0] == stand[1] {
            return Ok(own);
        }
        let ends = [stand[0].bone_ends(&a.points), stand[1].bone_ends(&b.points)];
        let by_ends = by_names([&ends[0], &ends[1]])?;
        Ok(if is_clear(&by_ends) { by_ends } else { own })
    }
}

/// A file's bytes, unpacked, of FBX those of the BVH file that it becomes, and what they say.
fn read(path: &Path, rules: &ReadRules) -> Result<(Vec<u8>, MotionFile)> {
    let bytes = open(path)?.read_all(LARGEST_MOTION_FILE)?;
    let options = rules.of(path, format_of(&bytes));
    let file = MotionFile::read(path, bytes.clone(), &options)?;
    let bytes = match file.format {
        MotionFormat::Fbx => file.to_bytes()?,
        _ => bytes,
    };
    let name = &file.table.name;
    (file.notes.iter()).for_each(|note| messages::info(&format!("{name}: {note}")));
    Ok((bytes, file))
}

/// The poses of a file of one take, with times.
fn timed(file: &MotionFile) -> Result<Poses> {
    let fail = |what: &str| Error::data(Place::file(&file.table.name), what);
    let poses = file.poses();
    if poses.takes().len() > 1 {
        return Err(fail(
            "has several takes; choose one with posing trim --take",
        ));
    }
    if poses.frames() < 2 {
        return Err(fail("has too few frames to be laid beside another"));
    }
    let time = poses.times(file.rate());
    let time = time.ok_or_else(|| fail("has no times; give its rate with --fps"))?;
    if time.windows(2).any(|pair| pair[1] <= pair[0]) {
        return Err(fail("has times that do not rise"));
    }
    Ok(Poses {
        time: Some(time),
        ..poses.clone()
    })
}

/// Says how B lies beside A.
fn tell(a: &MotionFile, b: &MotionFile, found: &TimeAlignment, points: usize) {
    let rate = a.rate().unwrap_or(1.0);
    let (shift, sd) = (found.shift, found.shift_sd);
    let drift = match found.drift {
        0.0 => String::new(),
        drift => format!(
            "; a second of its clock lasts {:.6} s of {} ({:+.5} +- {:.5} %)",
            1.0 + drift,
            a.table.name,
            100.0 * drift,
            100.0 * found.drift_sd
        ),
    };
    messages::info(&format!(
        "{} begins {:.5} s (+- {sd:.5}) {} {}: {:.3} frames (+- {:.3}){drift}; correlation {:.3}, \
         {points} points shared{}",
        b.table.name,
        shift.abs(),
        if shift < 0.0 { "before" } else { "after" },
        a.table.name,
        shift.abs() * rate,
        sd * rate,
        found.correlation,
        if b.motion().is_some() {
            "; its first and last pose stand where it has no frames"
        } else {
            ""
        }
    ));
    if let Some(drift) = found.unasked_drift {
        let percent = 100.0 * drift;
        messages::info(&format!(
            "the clocks differ by {percent:.3} %: --drift follows that"
        ));
    }
}

/// What was found, for JSON.
fn report(found: Option<&TimeAlignment>, rate: f64, points: usize) -> Value {
    let Some(found) = found else {
        return json!({ "found": false, "points": points });
    };
    json!({
        "found": true,
        "points": points,
        "shift": found.shift,
        "shift_sd": found.shift_sd,
        "shift_frames": found.shift * rate,
        "drift": found.drift,
        "drift_sd": found.drift_sd,
        "correlation": found.correlation,
        "correlation_elsewhere": found.elsewhere,
        "unasked_drift": found.unasked_drift,
    })
}

/// A's frames, among B's.
struct Aligned {
    /// A's times.
    times: Vec<f64>,
    /// The times of A's frames by B's clock.
    in_b: Vec<f64>,
    /// Whether these are B's own.
    is_own: bool,
    /// Frames of A in a second of B's clock.
    rate: f64,
}

/// Times are equal that differ by less than this share of a frame.
const EQUAL: f64 = 1e-4;

impl Aligned {
    fn new(a: &Poses, b: &Poses, found: &TimeAlignment) -> Aligned {
        let [times, own] = [a, b].map(|poses| poses.time.clone().unwrap_or_default());
        let in_b: Vec<f64> = times
            .iter()
            .map(|t| own[0] + found.in_b(t - times[0]))
            .collect();
        let step = 1.0 / b.rate().unwrap_or(1.0);
        let is_near = |(x, y): (&f64, &f64)| (x - y).abs() < EQUAL * step;
        Aligned {
            is_own: own.len() == times.len()
                && own.iter().zip(&in_b).all(is_near)
                && own.iter().zip(&times).all(is_near),
            in_b,
            times,
            rate: a.rate().unwrap_or(1.0) * (1.0 + found.drift),
        }
    }

    /// Writes B on these frames; `bytes` are its own.
    fn write(
        &self,
        output: Option<&OutputPath>,
        a: &MotionFile,
        b: &MotionFile,
        bytes: Vec<u8>,
        poses: &Poses,
    ) -> Result<()> {
        let path = output.map(|path| &**path);
        let called = path.and_then(ending);
        if b.motion().is_some() {
            check_ending(path, &ending_of(b.format))?;
        }
        let is_called_so = called
            .as_ref()
            .is_none_or(|called| *called == ending_of(b.format));
        let is_table = matches!(
            b.format,
            MotionFormat::Csv | MotionFormat::Npy | MotionFormat::Npz
        );
        if self.is_own && is_called_so && (b.motion().is_some() || is_table || path.is_some()) {
            return write_bytes(path, &bytes, b.format == MotionFormat::Npy);
        }
        if b.motion().is_some() {
            let timing = self.retiming(poses);
            let frames = 0..poses.frames();
            let start = self.times.first().copied().unwrap_or(0.0);
            let bytes = b.bytes_at_times(frames, &timing, a.rate(), start)?;
            return write_bytes(path, &bytes, false);
        }
        let new = self.poses(poses)?;
        let rate = a.rate().unwrap_or(1.0);
        if b.c3d().is_some() {
            messages::info(&format!(
                "{}: its points alone are written, without analog channels, forces and events",
                b.table.name
            ));
        }
        match called.as_deref() {
            Some("c3d") => write_bytes(path, &NewTake::new(new, rate, b.units()).c3d()?, true),
            Some("trc") => write_bytes(path, &NewTake::new(new, rate, b.units()).trc()?, false),
            _ => {
                let table = Table::from_poses(new);
                let units = if is_table { b.units() } else { Units::CM_Y };
                let args = OutputArgs {
                    output: output.cloned(),
                    to: None,
                };
                let xyz = table.poses.xyz.view();
                write_table(&args, [Units::CM_Y, units], &table, xyz, &[], |_| {
                    Vec::new()
                })
            }
        }
    }

    /// B's points on A's frames.
    fn poses(&self, poses: &Poses) -> Result<Poses> {
        let xyz: Array2<f64> = poses.at_times(&self.in_b, self.rate)?;
        let take = poses.take.as_ref().and_then(|take| take.first().cloned());
        Ok(Poses {
            points: poses.points.clone(),
            xyz,
            time: Some(self.times.clone()),
            take: take.map(|take| vec![take; self.times.len()]),
        })
    }

    /// Where they are, counted in B's frames.
    fn retiming(&self, b: &Poses) -> Retiming {
        let (rate, time) = (
            b.rate().unwrap_or(1.0),
            b.time.as_deref().unwrap_or_default(),
        );
        let first = time.first().copied().unwrap_or(0.0);
        Retiming {
            at: self.in_b.iter().map(|t| (t - first) * rate).collect(),
            low_pass: None,
            anti_alias: AntiAlias::new(self.rate / rate),
        }
    }
}

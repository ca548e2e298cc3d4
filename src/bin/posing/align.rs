//! Lays a recording beside another in time.

use clap::Parser;
use posing::cli::endings::{check_ending, ending, ending_of};
use posing::cli::input::{check_single_stdin, open};
use posing::cli::json_report::JsonArgs;
use posing::cli::name_maps::name_map;
use posing::cli::paths::OutputPath;
use posing::cli::read_args::ReadArgs;
use posing::cli::streams::{write_bytes, write_points};
use posing::cli::{Outcome, messages};
use posing::io::motion_file::{LARGEST_MOTION_FILE, ReadRules, format_of};
use posing::io::{MotionFile, MotionFormat};
use posing::metric::time_alignment::{
    AlignedTakes, FramesInSecond, TimeAlignment, TimeAlignmentOptions, timed,
};
use posing::pose::{Poses, Units, joints};
use posing::{Place, Result};
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
    let known = a.poses().points.iter().cloned().chain(joints::cmu_names());
    let known: Vec<String> = known.collect();
    let map = args.map.as_ref().map(|map| name_map(map, &known));
    let options = TimeAlignmentOptions { drift: args.drift };
    let timed = [of_one_take(&a)?, of_one_take(&b)?];
    let names = format!("{} and {}", a.table.name, b.table.name);
    let both = AlignedTakes::new(&timed[0], &timed[1], map.transpose()?.as_ref(), &options);
    let both = both.map_err(|e| e.at(Place::file(&names)))?;
    let Some(found) = both.clear() else {
        let what = unclear(&both, args.drift);
        messages::info(&format!("{names} {what}; nothing is written"));
        args.json.write(report(None, 1.0, both.shared))?;
        return Ok(Outcome::Findings);
    };
    tell(&a, &b, &found, both.shared);
    write(args.output.as_ref(), &a, &b, &bytes, &both.frames(&found))?;
    let rate = a.rate().unwrap_or(1.0);
    args.json.write(report(Some(&found), rate, both.shared))?;
    Ok(Outcome::Done)
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
fn of_one_take(file: &MotionFile) -> Result<Poses> {
    timed(file.poses(), file.rate()).map_err(|e| e.at(Place::file(&file.table.name)))
}

/// Why nothing is written.
fn unclear(both: &AlignedTakes<'_>, drift: bool) -> String {
    let drift = if drift {
        ""
    } else {
        " (if their clocks drift apart, --drift)"
    };
    match (both.shared, both.found) {
        (0, _) => "share no points by their names; --map says which are the same".into(),
        (n, None) => format!("share {n} points, whose speeds are nowhere alike{drift}"),
        (n, Some(found)) => format!(
            "share {n} points, but no motion that is clearly the same: their speeds correlate by \
             {:.3} at best, and by {:.3} elsewhere{drift}",
            found.correlation, found.elsewhere
        ),
    }
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

/// Writes B, whose bytes are `bytes`, on A's frames: in its own format, or as it is called.
fn write(
    output: Option<&OutputPath>,
    a: &MotionFile,
    b: &MotionFile,
    bytes: &[u8],
    frames: &FramesInSecond<'_>,
) -> Result<()> {
    let (path, own) = (output.map(|path| &**path), ending_of(b.format));
    let is_motion = b.motion().is_some();
    if is_motion {
        check_ending(path, &own)?;
    }
    let called = path.and_then(ending);
    let keeps_format = match called {
        Some(called) => called == own,
        None => is_motion || b.format.is_pose_table() || path.is_some(),
    };
    if frames.are_own() && keeps_format {
        return write_bytes(path, bytes, b.format.is_binary());
    }
    if is_motion {
        let (all, retiming) = (0..b.poses().frames(), frames.retiming());
        let bytes = b.bytes_at_times(all, &retiming, a.rate(), frames.start())?;
        return write_bytes(path, &bytes, false);
    }
    if b.c3d().is_some() {
        messages::info(&format!(
            "{}: its points alone are written, without analog channels, forces and events",
            b.table.name
        ));
    }
    if let Some(others) = b.table.columns.of_no_point() {
        let name = &b.table.name;
        messages::info(&format!("{name}: other columns are left out: {others}"));
    }
    let table_units = if b.format.is_pose_table() {
        b.units()
    } else {
        Units::CM_Y
    };
    let units = [table_units, b.units()];
    write_points(output, frames.poses()?, a.rate().unwrap_or(1.0), units)
}

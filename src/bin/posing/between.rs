//! Motion between key poses.

use clap::Parser;
use ndarray::Array2;
use posing::cli::args::{InputArgs, OutputArgs, UpArgs, parse_rate};
use posing::cli::choice::choice;
use posing::cli::json_report::JsonArgs;
use posing::cli::motion_library::open_library;
use posing::cli::name_maps::name_map;
use posing::cli::paths::OutputPath;
use posing::cli::streams::{write_bytes, write_table};
use posing::cli::{input, messages};
use posing::ik::solve_missing_channels;
use posing::inbetween::{KeyedMotion, through_keys};
use posing::io::motion_file::ReadOptions;
use posing::io::{Bvh, MotionFile, Table};
use posing::pose::units::{LengthUnit, Units};
use posing::pose::{PointNaming, joints, one_take};
use posing::restore::body_size::check_body_size;
use posing::{Error, Place, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Make motion between key poses, from a library
///
/// Keys are the rows of a table at their times, or the frames of a BVH file; rows and frames
/// without positions are skipped. Each span of up to two seconds between two keys is filled with
/// motion like that of the most similar stretches of the library, where gaps simulated there say
/// that this helps; else by a spline through the keys. A line says how many spans are which; --json
/// tells the error expected of each, as a share of that of the spline, and the nearest takes.
///
/// Keys stay as they are. The result is no performance: it is not directed, has no style that the
/// library lacks, and does not obey physics; feet that stand in two keys may slide between. With
/// keys from a BVH file, a result that ends with .bvh has the file's own skeleton and rotations.
/// For a gap in a motion, complete --prior and clean --prior are better: they use the velocities
/// beside it, too.
#[derive(Parser)]
#[command(
    name = "between",
    version,
    after_help = "Examples:\n  posing between --prior motion.npz -o walk.csv keys.csv\n  \
                  posing between --prior motion.npz --fps 24 -o walk.bvh keys.bvh"
)]
#[command(mut_arg("up", |up| up.help(
    "Axis that points up in keys that do not say it, and in the result [default: y]"
)))]
#[command(mut_arg("left_handed", |left| left.help(
    "Axes of such keys, and of the result, are left-handed, as Unity's and Unreal's"
)))]
pub struct Args {
    /// Key poses: a pose table with times, BVH or AMC; - or nothing: a table from standard input
    #[arg(value_name = "KEYS")]
    keys: Option<PathBuf>,
    /// Library of motion, by prior-train --motion
    #[arg(long, value_name = "MOTION.npz")]
    prior: PathBuf,
    /// Frames per second of the result; every key has to lie on one of its frames
    #[arg(long, value_name = "F", default_value = "30", value_parser = parse_rate)]
    fps: f64,
    /// Which points are which joints: a shipped map or a TOML file, as for complete [default: the
    /// names themselves, else the shipped map that fits best]
    #[arg(long, value_name = "NAME|FILE.toml")]
    map: Option<String>,
    /// Take of the keys, if the table has several
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Go on with a body that is smaller or larger than people are
    #[arg(long)]
    force: bool,
    /// Unit of length of keys that do not say it, and of the result [default: cm]
    #[arg(long, value_name = "UNIT", value_parser = choice::<LengthUnit>())]
    units: Option<LengthUnit>,
    #[command(flatten)]
    axes: UpArgs,
    /// Write to FILE instead of standard output; FILE appears only when it is complete. With keys
    /// from a BVH file, FILE.bvh is BVH
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
    #[command(flatten)]
    json: JsonArgs,
}

pub fn work(args: &Args) -> Result<()> {
    args.json.prepare(args.output.as_deref())?;
    let library = open_library(&args.prior)?;
    let path = args.keys.as_deref().filter(|p| *p != Path::new("-"));
    let options = ReadOptions {
        units: args.units,
        ..args.axes.options()
    };
    let file = path.map(|path| MotionFile::open(path, &options));
    let file = file.transpose()?;
    let table = match &file {
        Some(file) => file.table.clone(),
        None => {
            let input = InputArgs {
                units: args.units,
                axes: args.axes,
                ..InputArgs::plain(Vec::new(), None)
            };
            input::read_table(&input, false, true)?
        }
    };
    let as_bvh = args.output.as_deref().is_some_and(is_bvh);
    let bvh = file.as_ref().and_then(MotionFile::bvh);
    if as_bvh && bvh.is_none() {
        let what = "a BVH file of motion needs the keys of a BVH file; write a table, and turn it \
                    into BVH with xyz2bvh";
        return Err(Error::usage(what));
    }
    let known = joints::cmu_names();
    let map = args
        .map
        .as_deref()
        .map(|m| name_map(m, &known))
        .transpose()?;
    let naming = map.map(PointNaming::Map);
    let keys = one_take(table.poses, args.take.as_deref(), &table.name)?;
    let own = PointNaming::of(&keys.points, keys.xyz.view(), &known);
    let names = naming.as_ref().unwrap_or(&own).model_names(&keys.points);
    let remedy = "give the unit with --units (m, mm, in)";
    if !args.force {
        check_body_size(&keys, &names, &table.name, remedy)?;
    }
    if let Some(bvh) = bvh {
        check_whole(bvh).map_err(|e| e.at(Place::file(&table.name)))?;
    }
    let place = |e: Error| e.at(Place::file(&table.name));
    let mut keyed = through_keys(&keys, args.fps, &library, naming.as_ref()).map_err(place)?;
    let take = keys.take.as_ref().and_then(|take| take.first());
    keyed.poses.take = take.map(|take| vec![take.clone(); keyed.poses.frames()]);
    report(&keyed);
    match (file.as_ref(), bvh.filter(|_| as_bvh)) {
        (Some(file), Some(bvh)) => {
            let units = file.units();
            let filled = with_rotations(bvh, &keyed, units, args.fps)?;
            let text = filled.to_bytes(units.unit.centimeters());
            write_bytes(args.output.as_deref(), &text, false)?;
        }
        _ => {
            let out = OutputArgs {
                output: args.output.clone(),
                to: None,
            };
            let table = Table::from_poses(keyed.poses.clone());
            let xyz = table.poses.xyz.view();
            let units = Units {
                unit: args.units.unwrap_or(Units::CM_Y.unit),
                up: args.axes.or(Units::CM_Y.up),
            };
            write_table(&out, [units; 2], &table, xyz, &[], |_| Vec::new())?;
        }
    }
    args.json.write(json!({ "spans": spans(&keyed, args.fps) }))
}

fn is_bvh(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("bvh"))
}

/// The motion with the skeleton of the keys: their frames keep their values, the others are solved
/// from positions.
fn with_rotations(keys: &Bvh, keyed: &KeyedMotion, units: Units, rate: f64) -> Result<Bvh> {
    let frames = keyed.poses.frames();
    let mut motion = Array2::from_elem((frames, keys.motion.ncols()), f64::NAN);
    for (row, frame) in &keyed.keys {
        motion.row_mut(*frame).assign(&keys.motion.row(*row));
    }
    let mut bvh = Bvh {
        motion,
        frame_time: 1.0 / rate,
        ..keys.clone()
    };
    bvh.motion = solve_missing_channels(&bvh, &keyed.poses, units.up.rotation())?;
    Ok(bvh)
}

/// Fails where a frame has some of its values.
fn check_whole(keys: &Bvh) -> Result<()> {
    for (t, row) in keys.motion.rows().into_iter().enumerate() {
        let known = row.iter().filter(|v| v.is_finite()).count();
        if known > 0 && known < row.len() {
            let what = format!("frame {t} has some values and lacks others: a key has all or none");
            return Err(Error::unfit(what));
        }
    }
    Ok(())
}

fn report(keyed: &KeyedMotion) {
    let moved = keyed.spans.iter().filter(|s| s.source.is_some()).count();
    let tried = keyed.spans.iter().filter(|s| s.is_tried).count();
    let counts = [
        (moved, "from motion"),
        (tried - moved, "by a spline: no similar motion was found"),
        (
            keyed.spans.len() - tried,
            "by a spline: under .1 or over 2 seconds",
        ),
    ];
    let counts = counts.iter().filter(|(n, _)| *n > 0);
    let what: Vec<String> = counts.map(|(n, what)| format!("{n} {what}")).collect();
    messages::info(&format!("spans between keys: {}", what.join("; ")));
}

fn spans(keyed: &KeyedMotion, rate: f64) -> Vec<Value> {
    let first = keyed.poses.time.as_ref().map_or(0.0, |time| time[0]);
    let rounded = |v: f64| (v * 1e4).round() / 1e4;
    let line = |span: &posing::inbetween::KeySpan| {
        let [from, to] = span.frames.map(|t| rounded(first + t as f64 / rate));
        let sd = keyed
            .sd
            .slice(ndarray::s![span.frames[0] + 1..span.frames[1], ..]);
        let known: Vec<f64> = sd.iter().copied().filter(|v| v.is_finite()).collect();
        let mean = known.iter().map(|v| v * v).sum::<f64>() / known.len() as f64;
        let mut line = json!({ "from": from, "to": to, "method": "spline" });
        if let Some(source) = &span.source {
            let near = |(take, seconds): &(Option<String>, f64)| {
                let seconds = rounded(*seconds);
                json!({ "take": take, "seconds": seconds })
            };
            line["method"] = "motion".into();
            line["expected"] = rounded(source.expected).into();
            line["weight"] = rounded(source.weight).into();
            line["sd"] = rounded(mean.sqrt()).into();
            line["nearest"] = source.nearest.iter().map(near).collect();
        }
        line
    };
    keyed.spans.iter().map(line).collect()
}

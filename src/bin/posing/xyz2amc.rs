//! Turns a pose table into an AMC take.

use clap::Parser;
use posing::Result;
use posing::cli::Outcome;
use posing::cli::args::{InputArgs, parse_rate};
use posing::cli::choice::choice;
use posing::cli::ik::{JointArgs, fit, name_bone_ends, report_time_jumps};
use posing::cli::input::{check_single_stdin, open, or_stdin, read_table};
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::io::{Amc, Asf, SkeletonFile};
use posing::pose::one_take::first_frame_number;
use posing::pose::rotation::Axis;
use posing::pose::units::LengthUnit;
use std::path::PathBuf;

/// Convert a pose table to an AMC take
///
/// Finds the values of the skeleton's degrees of freedom that are most probable given the points:
/// what these leave open, such as the twist of a limb, is as it mostly is in people. A point is the
/// end of the bone of the same name, or as --map says. Bones without a point stay at zero. Points
/// with a standard deviation (NAME.sd, as denoise --status writes it) weigh less. Standard error
/// reports the mean and largest distance between points and joints, and the largest turn of a bone
/// in a frame. Exit code 3: the mean over the points that drive the skeleton (not eyes, ears, heels
/// and fingers) is over 5% of the leg or over 2 cm, or most of its bones have no points; over 25%
/// or 10 cm is an error.
#[derive(Parser)]
#[command(
    name = "xyz2amc",
    version,
    after_help = "Examples:\n  posing xyz2amc --asf 07.asf walk.csv > walk.amc\n  posing amc2xyz \
                  --asf 07.asf --fps 120 07_01.amc | posing complete | posing xyz2amc --asf \
                  07.asf -o whole.amc"
)]
pub struct Args {
    /// Pose tables, CSV, NPY or NPZ; - or nothing: standard input
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Skeleton to fit (ASF)
    #[arg(long, value_name = "SUBJECT.asf")]
    asf: PathBuf,
    #[command(flatten)]
    joints_of: JointArgs,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    output: Option<OutputPath>,
    /// Go on with a body that is smaller or larger than people are, or that the skeleton does not
    /// fit
    #[arg(long)]
    force: bool,
    /// Take to write, if the table has several
    #[arg(long, value_name = "NAME")]
    take: Option<String>,
    /// Respect the skeleton's joint limits, which captured motion often exceeds
    #[arg(long)]
    limits: bool,
    /// Unit of the skeleton's lengths, if its :units section is wrong or missing
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT")]
    units: Option<LengthUnit>,
    /// Frames per second, for a table without times; used only to number the frames
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: Option<f64>,
    #[command(flatten)]
    json: JsonArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    args.json.prepare(args.output.as_deref())?;
    let files = or_stdin(&args.files);
    check_single_stdin(files.iter().chain([&args.asf]))?;
    let asf = Asf::read(open(&args.asf)?, args.units.map(LengthUnit::centimeters))?;
    let input = InputArgs::plain(args.files.clone(), args.fps);
    let table = read_table(&input, false, true)?;
    let name = table.name.clone();
    let (mut poses, sd) = table.one_take(args.take.as_deref())?;
    name_bone_ends(&mut poses, &name, args.force, false)?;
    let rate = input.rate(&poses)?;
    report_time_jumps(&poses, &name, "an AMC file");
    let no_joint = format!("no point has the name of a bone in {}", args.asf.display());
    let given = Some(SkeletonFile::Asf(asf.clone()));
    let skeleton = args
        .joints_of
        .skeleton(given, &mut poses, sd, [Axis::Z, Axis::Y, Axis::X])?;
    let fit_of = skeleton.fit().limits(args.limits);
    let (fitted, report) = fit(&fit_of, &poses, &name, &no_joint, args.force)?;
    let take = Amc::from_values(&asf, first_frame_number(&poses, rate), fitted.values());
    write_bytes(args.output.as_deref(), &take.to_bytes(), false)?;
    args.json.write(&report)?;
    Ok(report.outcome)
}

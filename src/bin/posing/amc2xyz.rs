//! Turns ASF/AMC takes into a table of joint positions.

use clap::Parser;
use posing::cli::args::{OutputArgs, parse_rate};
use posing::cli::choice::choice;
use posing::cli::input::{TakeNames, check_single_stdin, open, or_stdin};
use posing::cli::messages;
use posing::cli::streams::create_table;
use posing::io::amc::{AmcFrames, AmcReader};
use posing::io::input::take_name;
use posing::io::unit_writer::UnitWriter;
use posing::io::{Asf, Columns, Row, parse_point_names};
use posing::pose::kinematics::Space;
use posing::pose::units::{LengthUnit, Units};
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Convert ASF/AMC takes to a table of joint positions
///
/// Writes a pose table in centimeters, y up: one row per frame, three columns per joint. A joint is
/// the end of the bone of the same name. Several takes make one table. The column take is the
/// file's name, and time is (frame number - 1) / F, in seconds.
#[derive(Parser)]
#[command(
    name = "amc2xyz",
    version,
    after_help = "Examples:\
        \n  posing amc2xyz --asf 07.asf --fps 120 07_01.amc > walk.csv\
        \n  posing amc2xyz --asf 07.asf --fps 120 --space body -o poses.npy 07_*.amc"
)]
pub struct Args {
    /// Takes (AMC); - or nothing: standard input
    #[arg(value_name = "TAKE.amc")]
    takes: Vec<PathBuf>,
    /// Skeleton of the takes (ASF)
    #[arg(long, value_name = "SUBJECT.asf")]
    asf: PathBuf,
    /// Frames per second, which AMC files do not state; CMU's takes have 60 or 120
    #[arg(long, value_name = "F", value_parser = parse_rate)]
    fps: f64,
    /// Space of the written poses
    #[arg(long, value_parser = choice::<Space>(), default_value = "world")]
    space: Space,
    /// Joints to write: 23 (those of the built-in model), all, or a comma-separated list
    #[arg(long, value_name = "23|all|LIST", default_value = "23")]
    joints: String,
    /// Unit of the skeleton's lengths, if its :units section is wrong or missing
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT")]
    units: Option<LengthUnit>,
    /// Accept a take whose last frame is cut off; that frame is dropped
    #[arg(long)]
    keep_whole: bool,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let takes = or_stdin(&args.takes);
    check_single_stdin(takes.iter().chain([&args.asf]))?;
    let asf = Asf::read(open(&args.asf)?, args.units.map(LengthUnit::centimeters))?;
    let joints = joints(&asf, args)?;
    let bones = asf.skeleton.bones();
    let names = joints.iter().map(|&j| bones[j].name.clone()).collect();
    let mut sink = create_table(
        &args.out,
        [Units::CM_Y; 2],
        &Columns::for_points(names, true, true),
        &[],
    )?;
    let mut names = TakeNames::default();
    for take in &takes {
        let name = names.next(take);
        if *name != *take_name(take) {
            messages::info(&format!(
                "{}: is the take {name}, as another is called so",
                take.display()
            ));
        }
        convert(args, &asf, &joints, (take, name), &mut sink)?;
    }
    sink.finish()
}

fn joints(asf: &Asf, args: &Args) -> Result<Vec<usize>> {
    if args.joints == "all" {
        return Ok((0..asf.skeleton.bones().len()).collect());
    }
    let find = |name: &String| {
        asf.skeleton.find(name).ok_or_else(|| {
            let what = format!("has no bone \"{name}\"; list existing bones in --joints");
            Error::data(Place::file(args.asf.display().to_string()), what)
        })
    };
    parse_point_names(&args.joints)?.iter().map(find).collect()
}

fn convert(
    args: &Args,
    asf: &Asf,
    joints: &[usize],
    (take, name): (&Path, Arc<str>),
    sink: &mut UnitWriter,
) -> Result<()> {
    let mut reader = AmcReader::new(asf, open(take)?, args.keep_whole)?;
    let mut row = Row {
        take: Some(name),
        ..Row::default()
    };
    let mut frames = AmcFrames::default();
    while reader.read_block(&mut frames)? {
        let xyz = frames.positions(&asf.skeleton, joints, args.space);
        let poses = xyz.chunks_exact(3 * joints.len());
        for (&number, xyz) in frames.numbers.iter().zip(poses) {
            row.time = Some((number as f64 - 1.0) / args.fps);
            sink.write(&mut row, xyz, &[])?;
        }
    }
    if let Some(number) = reader.dropped {
        messages::info(&format!(
            "{}: dropped frame {number}, which is incomplete",
            take.display()
        ));
    }
    Ok(())
}

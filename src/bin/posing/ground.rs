//! Puts a take on a level floor, and holds its feet where they stand.

use clap::Parser;
use posing::Result;
use posing::cli::input::open;
use posing::cli::json_report::JsonArgs;
use posing::cli::name_maps::joint_map;
use posing::cli::paths::OutputPath;
use posing::cli::read_args::ReadArgs;
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages};
use posing::ground_file::ground_file;
use posing::ik::ground::{GroundReport, Standing};
use std::path::PathBuf;

/// Put a take on a level floor: no floating, slope or sinking, no sliding feet
///
/// The floor is where feet stand: points of feet that are slow, so no feet held up. Its height at
/// the first frame, its slope (up to 12 degrees) and a slow drift of the height are found, the last
/// two where they are more than 4 times their standard errors and change heights by 5 mm. The body
/// is carried onto a level floor at y = 0 as a whole. Then each foot is held in each contact at the
/// middle of its way, by its leg; what was added fades within 0.2 s. Bones keep their lengths, feet
/// their directions, and hips are lowered where a leg is too short, by 3 cm at most. Feet are held
/// by the joint of the toes, else the ankle. Takes of points, and feet that stand still, are not
/// held.
///
/// The lowest joints of feet stand at 0. Joints that were there within 7.5 mm stay, and so do those
/// of skeletons whose ankles stand low, as CMU's: these have soles below their joints, so thick
/// that ankles are 8 cm above them (for a leg of 80 cm), and stay within 3.5 cm of that. Markers
/// stay up to 6 cm above the floor. On a straight way at one speed a slope along it and sinking
/// are the same for the feet: it is taken for a slope.
///
/// BVH files keep every byte that does not change, and so does a sound take; FBX and AMC takes
/// become BVH files, others stay files of their format. Exit code 3: the take never stands, or not
/// on one floor (stairs, a climb), and is left as it is.
#[derive(Parser)]
#[command(
    name = "ground",
    version,
    after_help = "Examples:\
        \n  posing ground walk.bvh -o walk-ground.bvh\
        \n  posing ground --level-only --report floor.json walk.csv -o level.csv\
        \n  posing ground --fps 120 07_01.amc > walk-ground.bvh"
)]
pub struct Args {
    /// Take with rotations (BVH, FBX, AMC) or of points (a table, markers); - is standard input
    #[arg(value_name = "TAKE")]
    file: PathBuf,
    /// Write to OUT instead of standard output
    #[arg(short, long, value_name = "OUT", help_heading = "Output")]
    output: Option<OutputPath>,
    /// Do not hold feet: no joint but the root turns and moves
    #[arg(long, help_heading = "Method")]
    level_only: bool,
    /// Also write the floor and the contacts, in seconds, as JSON: see posing-json(5)
    #[arg(long, value_name = "R.json", help_heading = "Output")]
    report: Option<OutputPath>,
    /// Names of the joints: cmu, a shipped map or a TOML file [default: the map that fits, else the
    /// shape of the skeleton]
    #[arg(long, value_name = "NAME|FILE.toml", help_heading = "Method")]
    map: Option<String>,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn work(args: &Args) -> Result<Outcome> {
    let read = args.read.rules()?;
    let input = open(&args.file)?;
    let name = input.name.clone();
    let map = joint_map(args.map.as_deref())?;
    let done = ground_file(&args.file, input, &read, map.as_ref(), !args.level_only)?;
    done.notes.iter().for_each(|note| messages::info(note));
    messages::info(&format!("{name}: {}", told(&done.report)));
    write_bytes(args.output.as_deref(), &done.bytes, false)?;
    if let Some(path) = &args.report {
        JsonArgs::to_file(path).write(&done.report)?;
    }
    Ok(Outcome::of(done.report.standing != Standing::OnFloor))
}

/// What was found and done, in a line.
fn told(report: &GroundReport) -> String {
    let Some(floor) = report.floor else {
        let why = match report.standing {
            Standing::Never => "never stands",
            _ => "does not stand on one floor, but at several heights",
        };
        return format!("{why}; left as it is");
    };
    let moved = if report.leveled { "" } else { " (stays)" };
    let held = match report.held {
        Some(held) => format!(", {held} held"),
        None => String::new(),
    };
    let [before, after] = report.slide;
    let slide = match report.held {
        Some(_) => format!("{before:.2} at most, now {after:.2}"),
        None => format!("{before:.2} at most"),
    };
    format!(
        "floor at {:.2}, slope {:.2} degrees, sinking {:.2} per minute{moved}; {} contacts{held}, \
         sliding {slide}",
        floor.height,
        floor.slope,
        floor.sinking,
        report.contacts.len()
    )
}

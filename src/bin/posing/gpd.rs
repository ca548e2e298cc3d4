//! Describes poses by geometric features.

use clap::Parser;
use ndarray::{Axis, concatenate};
use posing::cli::args::TimedTableArgs;
use posing::cli::choice::choice;
use posing::cli::feature_table::{self, JointMapArgs, body_frames};
use posing::cli::input;
use posing::cli::paths::OutputPath;
use posing::io::TableFormat;
use posing::metric::{Family, Gpd};
use posing::{Error, Result};

/// Describe poses by 1,683 geometric features
///
/// Writes a row per frame: distances, directions and angles of joints, lines and planes of the
/// body, and how they move, without place, heading and size, after the columns take and time. Names
/// have no comma, such as LL_a(LShoulder-LElbow:LElbow-LHand) and JJ_o(LHand:Head)_x.
///
/// Families: J_c, coordinates (46); JJ_d, JJ_o, distances and directions of two joints (120, 360);
/// JL_d, LL_a, distances and angles of lines (420, 435); JP_d, LP_a, PP_a, of planes (65, 135, 10);
/// J_k, velocities and accelerations (92).
///
/// Lengths are in body heights: the median lengths of the bones from head to hip and from hip joint
/// to foot of each take, added up. Angles are in radians, times in seconds.
#[derive(Parser)]
#[command(
    name = "gpd",
    version,
    after_help = "Examples:\
        \n  posing gpd walk.csv > features.csv\
        \n  posing gpd --static --features JJ_d,LL_a -o features.npy walk.csv\
        \n  posing gpd --map joints.toml mine.csv",
    after_long_help = "Files:\n  joints.toml: which point is which joint, sixteen lines (for CMU: \
                       Hip = \"root\", Chest = \"thorax\", Neck = \"lowerneck\", Head = \"head\", \
                       LShoulder = \"lclavicle\", LElbow = \"lhumerus\", LHand = \"lwrist\", LHip \
                       = \"lhipjoint\", LKnee = \"lfemur\", LFoot = \"ltibia\", and R for the \
                       right side)"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    #[command(flatten)]
    map: JointMapArgs,
    /// Comma-separated families of features (default: all)
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = family)]
    features: Vec<Family>,
    /// Leave out velocities and accelerations: 1,591 features, without a frame rate
    #[arg(long = "static")]
    is_static: bool,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
    /// Output format, csv or npy (default: by FILE's extension, else csv)
    #[arg(
        long,
        value_parser = choice::<TableFormat>(),
        value_name = "FORMAT",
        help_heading = "Output"
    )]
    to: Option<TableFormat>,
}

fn family(text: &str) -> std::result::Result<Family, String> {
    let names = || Family::ALL.map(Family::name).join(", ");
    Family::of_name(text.trim()).ok_or_else(|| format!("expected families of {}", names()))
}

pub fn work(args: &Args) -> Result<()> {
    let mut families = if args.features.is_empty() {
        Family::ALL.to_vec()
    } else {
        args.features.clone()
    };
    if args.is_static {
        families.retain(|f| *f != Family::JointKinetics);
    }
    let named = args.output.as_ref().map(TableFormat::of_path);
    let format = args.to.or(named);
    if format == Some(TableFormat::Npz) {
        return Err(Error::usage("features are written as CSV or NPY"));
    }
    let gpd = Gpd::new(&families);
    let map = args.map.joint_map()?;
    let tables = args.tables.input();
    let table = input::read_table(&tables, false, false)?;
    let rates = tables.rates(&table.poses)?;
    if gpd.needs_rate() && rates.iter().any(Option::is_none) {
        return Err(Error::usage(
            "velocities need a frame rate, and the table's times give none; give it with --fps, \
             or leave them out with --static",
        ));
    }
    let takes = body_frames(&table.poses, &rates, &map, &table.name)?;
    let described: Vec<_> = takes.iter().map(|take| gpd.describe(take)).collect();
    let views: Vec<_> = described.iter().map(|d| d.view()).collect();
    let features = concatenate(Axis(0), &views).unwrap_or_default();
    feature_table::write(
        args.output.as_deref(),
        format == Some(TableFormat::Npy),
        &table.poses,
        &gpd.names(),
        &features,
    )
}

//! Proposes pairs of poses, and makes the page on which a person labels them.

mod output;

use self::output::{PairFormat, PairSet};
use clap::Parser;
use posing::Result;
use posing::cli::args::{SeedArgs, TimedTableArgs, format_of};
use posing::cli::feature_table::JointMapArgs;
use posing::cli::metric_takes::read_takes;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::metric::pair_proposal::PairRules;

/// Propose pairs of poses, and label them alike or not on a page
///
/// Writes one HTML page that needs no network. It shows each pair in motion, side by side, one over
/// the other, and cut from one to the other. A click or key answers alike or not; Save writes
/// a_take,a_frame,b_take,b_frame,label (1 alike, 0 not; frames count from 0 within their take).
///
/// The pairs are hard ones: their mean joint distance is small, without place and heading, with all
/// bodies at one height. Two poses of one take are at least 1 s apart. The pairs are spread over
/// takes and distances, and no two of them are within 0.25 s of each other on both sides.
#[derive(Parser)]
#[command(
    name = "pair-label",
    version,
    after_help = "Examples:\
        \n  posing pair-label -o pairs.html walk.csv\
        \n  posing pair-label --other-takes --count 40 --seconds 0.3 -o pairs.html two-people.csv\
        \n  posing pair-label --near 8 --csv pairs.csv walk.csv\
        \n  posing pair-label --map joints.toml -o pairs.html mine.csv"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    #[command(flatten)]
    map: JointMapArgs,
    /// Largest mean joint distance of a pair, cm at the takes' median body height
    #[arg(long, value_name = "CM", default_value_t = PairRules::default().near)]
    near: f64,
    /// Number of pairs, 1 to 2000
    #[arg(long, value_name = "N", default_value_t = PairRules::default().count)]
    count: usize,
    /// Seconds of motion to show before and after each pose, 0.1 to 5
    #[arg(long, value_name = "S", default_value_t = PairRules::default().margin)]
    seconds: f64,
    /// Only pairs of two different takes
    #[arg(long)]
    other_takes: bool,
    /// Heading of the page
    #[arg(long, value_name = "TEXT", default_value = "")]
    title: String,
    /// Write the pairs to FILE, with an empty label column
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    csv: Option<OutputPath>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
    /// Output format (default: by FILE's extension)
    #[arg(long, value_enum, value_name = "FORMAT", help_heading = "Output")]
    to: Option<PairFormat>,
    #[command(flatten)]
    seed: SeedArgs,
}

impl Args {
    fn rules(&self) -> PairRules {
        PairRules {
            near: self.near,
            count: self.count,
            margin: self.seconds,
            other_takes: self.other_takes,
            seed: self.seed.seed,
        }
    }
}

pub fn work(args: &Args) -> Result<()> {
    // --csv alone writes the table and nothing else.
    let format = match (&args.csv, &args.output, args.to) {
        (Some(_), None, None) => None,
        _ => Some(format_of(args.to, args.output.as_deref())?),
    };
    let rules = args.rules();
    let map = args.map.joint_map()?;
    let tables = args.tables.input();
    let takes = read_takes(&tables, tables.files.clone(), Some(&map), true)?;
    let pairs = PairSet::propose(&takes, &map, &rules)?;
    if let Some(path) = &args.csv {
        let bytes = pairs.write(PairFormat::Csv, "");
        write_bytes(Some(path), &bytes, false)?;
    }
    match format {
        Some(format) => {
            let bytes = pairs.write(format, &args.title);
            write_bytes(args.output.as_deref(), &bytes, false)
        }
        None => Ok(()),
    }
}

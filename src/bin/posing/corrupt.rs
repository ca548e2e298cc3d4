//! Damages poses on purpose, for tests.

use clap::Parser;
use posing::cli::args::{InputArgs, OutputArgs, SeedArgs, parse_positive};
use posing::cli::input::{RowStream, read_table};
use posing::cli::messages;
use posing::cli::streams::{create_table, write_table};
use posing::evaluate::damage::{Corruption, GapInjection};
use posing::io::{Row, parse_point_names};
use posing::pose::units::parse_length;
use posing::{Error, Place, Result};

/// Add noise, outliers or gaps to poses, for tests
///
/// Damage is applied in the order --dense, --sparse, --keep and --drop, --gaps. Missing values stay
/// missing, unchanged cells keep their text, and the same seed gives the same damage. Memory is
/// constant, except with --gaps.
#[derive(Parser)]
#[command(
    name = "corrupt",
    version,
    after_help = "Examples:\
        \n  posing corrupt --dense 1asf --seed 1 walk.csv > noisy.csv\
        \n  posing corrupt --sparse 1asf --share 0.2 walk.csv > outliers.csv\
        \n  posing corrupt --keep lclavicle,rclavicle,lwrist,rwrist,lfoot,rfoot walk.csv > six.csv\
        \n  posing corrupt --gaps 8 --length 0.4 --points 3 walk.csv > gaps.csv"
)]
pub struct Args {
    /// Add Gaussian noise to every coordinate; standard deviation in cm or with a unit (1asf =
    /// 5.644 cm)
    #[arg(long, value_name = "SD", value_parser = parse_length)]
    dense: Option<f64>,
    /// Add Gaussian noise to random points; standard deviation of each coordinate in cm or with a
    /// unit
    #[arg(long, value_name = "SD", value_parser = parse_length)]
    sparse: Option<f64>,
    /// Probability, 0 to 1, that --sparse hits a point in a frame, independently for each
    #[arg(long, value_name = "P", default_value_t = 0.2, requires = "sparse")]
    share: f64,
    /// Comma-separated points to keep; all others become empty
    #[arg(long, value_name = "LIST")]
    keep: Option<String>,
    /// Comma-separated points that become empty
    #[arg(long, value_name = "LIST")]
    drop: Option<String>,
    /// Number of gaps in each take; they spare the first and last frame of a run if it is long
    /// enough
    #[arg(long, value_name = "N", requires = "length")]
    gaps: Option<usize>,
    /// Length of a gap, in seconds; needs times in the table, or --fps
    #[arg(long, value_name = "SECONDS", requires = "gaps", value_parser = parse_positive)]
    length: Option<f64>,
    /// Number of points in a gap, chosen at random
    #[arg(long, value_name = "M", default_value_t = 1, requires = "gaps")]
    points: usize,
    #[command(flatten)]
    table: InputArgs,
    #[command(flatten)]
    out: OutputArgs,
    #[command(flatten)]
    seed: SeedArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let noise = args.dense.is_some() || args.sparse.is_some();
    if !noise && args.keep.is_none() && args.drop.is_none() && args.gaps.is_none() {
        let what = "nothing to do; give --dense, --sparse, --keep, --drop or --gaps";
        return Err(Error::usage(what));
    }
    let corruption = Corruption {
        dense: args.dense.unwrap_or(0.0),
        sparse: args.sparse.unwrap_or(0.0),
        share: args.share,
        keep: args.keep.as_deref().map(parse_point_names).transpose()?,
        drop: (args.drop.as_deref().map(parse_point_names).transpose()?).unwrap_or_default(),
        seed: args.seed.seed,
    };
    match args.gaps.zip(args.length) {
        Some((count, seconds)) => {
            let gaps = GapInjection {
                count,
                seconds,
                points: args.points,
                seed: args.seed.seed,
            };
            with_gaps(args, &corruption, &gaps)?;
        }
        None => frame_by_frame(args, &corruption)?,
    }
    Ok(())
}

/// Damages frames as they come: constant memory.
fn frame_by_frame(args: &Args, corruption: &Corruption) -> Result<()> {
    let mut rows = RowStream::open(&args.table, false, true)?;
    let corruptor = corruption.check(&rows.columns().points)?;
    let mut sink = create_table(
        &args.out,
        [args.table.table_units(); 2],
        rows.columns(),
        &[],
    )?;
    let (mut row, mut frame) = (Row::default(), 0);
    while rows.read(&mut row)? {
        let mut xyz = row.xyz.clone();
        corruptor.apply(frame, &mut xyz);
        frame += 1;
        sink.write(&mut row, &xyz, &[])?;
    }
    sink.finish()
}

/// Damages a whole table, and then each of its takes by gaps.
fn with_gaps(args: &Args, corruption: &Corruption, gaps: &GapInjection) -> Result<()> {
    let table = read_table(&args.table, false, true)?;
    let corruptor = corruption.check(&table.columns.points)?;
    if table.columns.time.is_none() && args.table.fps.is_none() {
        let what = "has no column time; give the frame rate with --fps";
        return Err(Error::data(Place::file(&table.name), what));
    }
    let rates = args.table.rates(&table.poses)?;
    let mut poses = table.poses.clone();
    corruptor.apply_frames(&mut poses.xyz);
    let skipped = &mut |what: &str| messages::info(&format!("{}: {what}", table.name));
    gaps.inject(&mut poses, &rates, &table.name, skipped)?;
    write_table(
        &args.out,
        [args.table.table_units(); 2],
        &table,
        poses.xyz.view(),
        &[],
        |_| Vec::new(),
    )
}

//! Finds poses like given ones.

use clap::Parser;
use posing::Result;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::metric_takes::{MetricTakes, read_takes};
use posing::cli::{input, messages, run, streams};
use posing::io::text::push_f32;
use posing::metric::nearest::Neighbour;
use posing::metric::{FrameRef, PoseDatabase, PoseMetric};
use std::path::PathBuf;
use std::process::ExitCode;

/// Find the poses of a database that are most like given ones
///
/// Writes take, frame, rank, found_take, found_frame, distance: for each frame of the input the nearest frames of the database by
/// a metric of rdsr-train, nearest first, exactly. Frames count from 0 within their take.
#[derive(Parser)]
#[command(
    name = "retrieve",
    version,
    after_help = "Examples:\n  posing retrieve -m metric.npz -k 10 --database poses.csv walk.csv\n  posing retrieve -m metric.npz --every 12 --other-takes --database poses.csv poses.csv"
)]
struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Metric, by rdsr-train
    #[arg(short, long, value_name = "METRIC.npz")]
    model: PathBuf,
    /// Table of the poses that are searched; same --fps, --joints, --units and --up as the input
    #[arg(long, value_name = "DB")]
    database: PathBuf,
    /// Poses to find for each frame
    #[arg(short, value_name = "N", default_value = "10", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    k: u32,
    /// Every N-th frame of each take only, in the input and the database; movement is seen from all frames
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Find poses of takes with other names only
    #[arg(long)]
    other_takes: bool,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<()> {
    args.common.apply()?;
    input::check_single_stdin_with(&args.input, [&args.database, &args.model])?;
    let model = input::open_model(&args.model)?;
    let metric = PoseMetric::from_model(&model, &args.model.display().to_string())?;
    let needs_rate = metric.needs_rate();
    let takes = |files| read_takes(&args.input, files, &metric.map, needs_rate);
    let database = takes(vec![args.database.clone()])?;
    let queries = takes(args.input.files.clone())?;
    let (rows, vectors) = database.embed(&metric, args.every as usize);
    let (query_rows, query_vectors) = queries.embed(&metric, args.every as usize);
    let is_other = |q: usize, row: usize| {
        let (query, found): (FrameRef, FrameRef) = (query_rows[q], rows[row]);
        !args.other_takes || queries.names[query.take] != database.names[found.take]
    };
    let found = PoseDatabase::new(vectors, metric.norm).nearest(
        query_vectors.view(),
        args.k as usize,
        is_other,
    );
    let empty = found.iter().filter(|f| f.is_empty()).count();
    if empty > 0 {
        messages::info(&format!(
            "nothing found for {empty} of {} frames: joints missing, or no take to search",
            found.len()
        ));
    }
    let mut out = streams::open_output(args.output.as_deref(), false)?;
    out.write(b"take,frame,rank,found_take,found_frame,distance\n")?;
    for (query, found) in query_rows.iter().zip(&found) {
        out.write(&lines(&queries, *query, &database, &rows, found))?;
    }
    out.finish()?;
    Ok(())
}

fn lines(
    queries: &MetricTakes,
    query: FrameRef,
    database: &MetricTakes,
    rows: &[FrameRef],
    found: &[Neighbour],
) -> Vec<u8> {
    let mut out = Vec::new();
    for (rank, neighbour) in found.iter().enumerate() {
        let at = rows[neighbour.row];
        queries.push_frame(&mut out, query);
        out.push(b',');
        out.extend((rank + 1).to_string().bytes());
        out.push(b',');
        database.push_frame(&mut out, at);
        out.push(b',');
        push_f32(&mut out, neighbour.distance);
        out.push(b'\n');
    }
    out
}

//! Distances of poses.

use clap::Parser;
use posing::cli::args::TimedTableArgs;
use posing::cli::feature_table::FittingMapArgs;
use posing::cli::metric_takes::{MetricTakes, open_metric, read_takes};
use posing::cli::paths::OutputPath;
use posing::cli::{input, messages, streams};
use posing::io::text::push_f32;
#[cfg(feature = "papers")]
use posing::metric::Baseline;
use posing::metric::pairs::{FrameRef, LabeledPair, best_threshold};
use posing::metric::{JointMap, PoseMetric};
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// Compute how alike poses are
///
/// Writes a_take,a_frame,b_take,b_frame,distance: a row for each frame of table A and the frame of
/// table B at its side, or for each pair of --pairs among the frames of the input, in order. Frames
/// count from 0 within their take. Where the pairs have labels, a message gives the best share of
/// right decisions by one threshold. A pose that lacks a joint has an empty distance.
///
/// Baselines: jod, wjod, ljod compare rotations of joints, fitted to points and so without the
/// twist about a bone; jcd, wjcd, ljcd coordinates; jrf-lms distances of joints; rgf-boost
/// chosen geometric features; game what game engines do. ljod, ljcd, jrf-lms and rgf-boost are
/// learned from --labels.
#[derive(Parser)]
#[command(
    name = "pose-distance",
    version,
    after_help = "Examples:\
        \n  posing pose-distance truth.csv restored.csv\
        \n  posing pose-distance -m metric.npz truth.csv restored.csv\
        \n  posing pose-distance --baseline wjod --all truth.csv restored.csv -o distances.csv\
        \n  posing pose-distance -m metric.npz --pairs pairs.csv poses.csv\
        \n  posing pose-distance --baseline ljcd --labels pairs.csv --pairs pairs.csv poses.csv"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Metric, by rdsr-train [default: coordinates and velocities, of a frame and of those .2 s
    /// before and after it]
    #[arg(short, long, value_name = "METRIC.npz")]
    model: Option<PathBuf>,
    /// A published distance instead
    #[arg(long, value_name = "NAME", value_parser = baseline, conflicts_with = "model")]
    baseline: Option<Baseline>,
    /// For a baseline that is learned: labeled pairs of frames of the input
    #[arg(long, value_name = "PAIRS.csv", requires = "baseline")]
    labels: Option<PathBuf>,
    /// Pairs of frames of the input: a_take,a_frame,b_take,b_frame and perhaps label
    #[arg(long, value_name = "PAIRS.csv")]
    pairs: Option<PathBuf>,
    /// Each frame of A with each of B
    #[arg(long, conflicts_with = "pairs")]
    all: bool,
    #[command(flatten)]
    map: FittingMapArgs,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
}

/// A distance that papers compare with, in a build without them: there is none.
#[cfg(not(feature = "papers"))]
#[derive(Debug, Clone, Copy)]
enum Baseline {}

#[cfg(not(feature = "papers"))]
fn baseline(name: &str) -> std::result::Result<Baseline, String> {
    Err(format!("{name} {}", posing::cli::NO_PAPERS))
}

#[cfg(feature = "papers")]
fn baseline(name: &str) -> std::result::Result<Baseline, String> {
    let names = || Baseline::ALL.map(Baseline::name).join(", ");
    Baseline::of_name(name).ok_or_else(|| format!("expected one of {}", names()))
}

pub fn work(args: &Args) -> Result<()> {
    let input = args.tables.input();
    let others = (args.model.iter()).chain(&args.labels).chain(&args.pairs);
    input::check_single_stdin_with(&input, others)?;
    let model = args.model.as_deref().map(open_metric).transpose()?;
    let map = args.map.joint_map(model.as_ref())?;
    let needs_rate = match (&model, args.baseline) {
        #[cfg(feature = "papers")]
        (None, Some(baseline)) => baseline.features().needs_rate(),
        (metric, _) => metric.as_ref().is_none_or(PoseMetric::needs_rate),
    };
    let read = |files| read_takes(&input, files, map.as_ref(), needs_rate);
    let tables = match &args.pairs {
        Some(_) => vec![read(input.files.clone())?],
        None => match &input.files[..] {
            [a, b] => vec![read(vec![a.clone()])?, read(vec![b.clone()])?],
            files => {
                let what = format!(
                    "expected two tables, A and B, or --pairs; {} given",
                    files.len()
                );
                return Err(Error::usage(what));
            }
        },
    };
    let metric = match (model, args.baseline) {
        (Some(metric), _) => metric,
        (None, None) => PoseMetric::of_coordinates(map.unwrap_or_default()),
        (None, Some(baseline)) => {
            learn_baseline(args, baseline, &map.unwrap_or_default(), &tables)?
        }
    };
    let (a, b) = (&tables[0], tables.last().unwrap_or(&tables[0]));
    match &args.pairs {
        Some(path) => write_pairs(args, &metric, a, path),
        None => write_tables(args, &metric, a, b),
    }
}

#[cfg(not(feature = "papers"))]
fn learn_baseline(
    _: &Args,
    baseline: Baseline,
    _: &JointMap,
    _: &[MetricTakes],
) -> Result<PoseMetric> {
    match baseline {}
}

#[cfg(feature = "papers")]
fn learn_baseline(
    args: &Args,
    baseline: Baseline,
    map: &JointMap,
    tables: &[MetricTakes],
) -> Result<PoseMetric> {
    let labels = match &args.labels {
        Some(path) => tables[0].read_pairs(path)?,
        None if baseline.is_learned() => {
            return Err(Error::usage(format!(
                "--baseline {} is learned from labeled pairs; give them with --labels",
                baseline.name()
            )));
        }
        None => Vec::new(),
    };
    let takes: Vec<_> = tables.iter().flat_map(|t| t.takes.clone()).collect();
    let metric = baseline.metric(map, &takes, &labels);
    metric.map_err(|e| e.at(Place::file(&tables[0].source)))
}

const HEAD: &[u8] = b"a_take,a_frame,b_take,b_frame,distance\n";

fn write_pairs(args: &Args, metric: &PoseMetric, takes: &MetricTakes, path: &Path) -> Result<()> {
    let (pairs, has_labels) = takes.read_pairs_to_compare(path)?;
    let (rows, vectors) = takes.embed(metric, 1);
    let row = |at: FrameRef| vectors.row(rows.binary_search(&at).unwrap_or(0));
    let distance = |p: &LabeledPair| metric.norm.distance(row(p.ends[0]), row(p.ends[1]));
    let distances: Vec<f32> = pairs.iter().map(distance).collect();
    let mut out = streams::open_output(args.output.as_deref(), false)?;
    out.write(HEAD)?;
    for (pair, distance) in pairs.iter().zip(&distances) {
        let mut line = Vec::new();
        push_row(
            &mut line,
            (takes, pair.ends[0]),
            (takes, pair.ends[1]),
            *distance,
        );
        out.write(&line)?;
    }
    out.finish()?;
    let judged = pairs.iter().zip(&distances).filter(|(_, d)| d.is_finite());
    let (is_alike, distances): (Vec<bool>, Vec<f32>) =
        judged.map(|(p, d)| (p.is_alike, *d)).unzip();
    if is_alike.len() < pairs.len() {
        let without = pairs.len() - is_alike.len();
        messages::info(&format!("{without} pairs have no distance: joints missing"));
    }
    if has_labels && let Some((precision, threshold)) = best_threshold(&distances, &is_alike) {
        messages::info(&format!(
            "{:.1}% of {} pairs are decided right by distances below {threshold:.4}",
            100.0 * precision,
            is_alike.len()
        ));
    }
    Ok(())
}

fn write_tables(args: &Args, metric: &PoseMetric, a: &MetricTakes, b: &MetricTakes) -> Result<()> {
    let (a_rows, a_vectors) = a.embed(metric, 1);
    let (b_rows, b_vectors) = b.embed(metric, 1);
    if !args.all && a_rows.len() != b_rows.len() {
        return Err(Error::data(
            Place::file(&b.source),
            format!(
                "has {} frames, {} has {}; rows are paired, or --all compares each with each",
                b_rows.len(),
                a.source,
                a_rows.len()
            ),
        ));
    }
    let mut out = streams::open_output(args.output.as_deref(), false)?;
    out.write(HEAD)?;
    for (i, from) in a_rows.iter().enumerate() {
        let mut lines = Vec::new();
        let beside = if args.all { 0..b_rows.len() } else { i..i + 1 };
        for j in beside {
            let distance = metric.norm.distance(a_vectors.row(i), b_vectors.row(j));
            push_row(&mut lines, (a, *from), (b, b_rows[j]), distance);
        }
        out.write(&lines)?;
    }
    out.finish()
}

fn push_row(
    out: &mut Vec<u8>,
    a: (&MetricTakes, FrameRef),
    b: (&MetricTakes, FrameRef),
    distance: f32,
) {
    a.0.push_frame(out, a.1);
    out.push(b',');
    b.0.push_frame(out, b.1);
    out.push(b',');
    if distance.is_finite() {
        push_f32(out, distance);
    }
    out.push(b'\n');
}

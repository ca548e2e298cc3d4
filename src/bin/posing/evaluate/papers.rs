//! `evaluate` whole: the benchmark of models, and the tests of distances.

use super::benchmark::{self, BenchmarkArgs};
use super::metric::{EvaluateMetricArgs, evaluate_metric};
use super::takes::EvaluateTakesArgs;
use super::{parsed, sources};
use clap::{Parser, Subcommand};
use posing::cli::args::TimedTableArgs;
use posing::cli::json_report::JsonArgs;
use posing::evaluate::benchmark::result_cache::ResultCache;
use posing::evaluate::benchmark::{Benchmark, Dataset, Shard};
use posing::evaluate::report::BenchmarkReport;
use posing::{Error, Result};
use std::path::PathBuf;

/// Compare models on poses they were not trained on
///
/// Runs every model on every task, split and seed. A model is trained on the training part of a
/// split and restores damaged poses of the test part. The score is the mean squared error (MSE)
/// over all coordinates, in asf² (1 asf = 5.644 cm). Tables must be in body space (posing amc2xyz
/// --space body); frames with missing points are left out.
///
/// Tasks: dense (noise of 1 asf on every coordinate, of known variance); sparse (noise of 1 asf on
/// each joint with probability 0.2; the model does not know which, and assumes the noise it was
/// tuned to, or else the mean variance); complete (only the joints of --observe are visible).
///
/// Splits: frames (a random half; test frames then have neighbors in the training half); takes
/// (whole takes are held out, a third of each subject's, at least two); subjects (whole subjects
/// are held out). A take's subject is its name up to the first _. With takes and subjects, copies,
/// overlaps and mirrored takes are detected and stay on one side of the split, and a model file
/// trained on one of the takes is an error.
///
/// Prints one table per split: the MSE of each task (* marks the best), its 95% interval (bootstrap
/// over takes; with frames, over frames), and the training MSE.
#[derive(Parser)]
#[command(
    name = "evaluate",
    version,
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\
        \n  posing evaluate --splits takes --seeds 5 -o bench 01.csv 02.csv 07.csv\
        \n  posing evaluate --models sparse,ksvd:n=500:k=5,ksvd-omp --tasks dense,complete \
        --base 0,0.05asf 07.csv\
        \n  posing evaluate --splits takes -m mine.npz my-takes.csv\
        \n  posing evaluate --splits takes --seeds 5 --cells 3/8 -o cells/3 01.csv 02.csv 07.csv\
        \n  posing evaluate --splits takes --seeds 5 01.csv 02.csv 07.csv --merge cells/* -o bench\
        \n  posing evaluate --config bench.toml\
        \n  posing evaluate takes -o bench two-people.csv\
        \n  posing evaluate metric --classes classes.csv takes.csv",
    after_long_help = include_str!("help.txt")
)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Tested>,
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Read settings from a TOML file; flags override them
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    #[command(flatten)]
    benchmark: BenchmarkArgs,
    /// Run nothing; compare the finished run in RUN (a DIR of -o) with Tables 1 to 4 of Lai et al.,
    /// and write tables.html and tables.csv into DIR. May be repeated: the run with most
    /// subjects gives Table 1, runs of one subject Tables 2 to 4
    #[arg(
        long,
        value_name = "RUN",
        help_heading = "Output",
        requires = "output",
        conflicts_with_all = ["config", "json"]
    )]
    paper: Vec<PathBuf>,
    /// Run only the I-th of N shares of the cells (a cell: a model on a task, split and seed), I
    /// from 1 to N, and write only the cache DIR/cells.jsonl: for several machines, each with
    /// a DIR of its own. --merge joins them
    #[arg(
        long,
        value_name = "I/N",
        help_heading = "Output",
        requires = "output",
        conflicts_with = "paper"
    )]
    cells: Option<Shard>,
    /// Run nothing; take the results that --cells left in these folders, and write the report into
    /// the DIR of -o. Tables and flags must be those of --cells: results of others do not
    /// count, and missing ones are an error. Name the tables before --merge
    #[arg(
        long,
        value_name = "DIR",
        num_args = 1..,
        help_heading = "Output",
        requires = "output",
        conflicts_with_all = ["cells", "paper"]
    )]
    merge: Vec<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Subcommand)]
enum Tested {
    Takes(EvaluateTakesArgs),
    /// Test distances of poses: published ones, and learners by features, on people that they have
    /// not learned from
    ///
    /// Distances learn from pairs of poses of some subjects and are tested on the others. Rules
    /// label the pairs in the place of people. class: poses are retrieved across people, and
    /// one found is right when its take is of the query's class. phase and blend: pairs are
    /// decided by one threshold. phase: alike at the same share of one action; blend: alike
    /// where a cross-fade keeps bone lengths, planted feet and accelerations within the clips' own
    /// ranges.
    ///
    /// Prints the precision of each distance with a 95% interval (bootstrap over takes); * marks
    /// the highest.
    Metric(EvaluateMetricArgs),
}

pub fn work(args: &Args) -> Result<()> {
    match &args.command {
        Some(Tested::Takes(args)) => return args.work(),
        Some(Tested::Metric(args)) => return evaluate_metric(args),
        None => {}
    }
    args.json.prepare_report();
    if let (false, Some(folder)) = (args.paper.is_empty(), &args.benchmark.output) {
        benchmark::write_paper_tables(&args.paper, folder)?;
        return Ok(());
    }
    if let Some(file) = args.merge.iter().find(|name| name.is_file()) {
        let what = format!(
            "--merge {}: is not a folder; name the tables before --merge",
            file.display()
        );
        return Err(Error::usage(what));
    }
    let plan = args.benchmark.clone().or_file(args.config.as_deref())?;
    let settings = plan.settings()?;
    settings.check()?;
    let input = args.tables.input();
    let tables = match input.files.as_slice() {
        [] => &plan.tables,
        files => files,
    };
    let data = Dataset::new(&sources(&input, tables)?, &plan.subjects)?;
    let bench = Benchmark::new(&data, settings)?;
    benchmark::report_exclusions(&bench);
    let mut cache = plan.output.as_deref().map(ResultCache::open).transpose()?;
    if let Some(shard) = args.cells
        && let Some(cache) = cache
    {
        return benchmark::run_shard(&bench, shard, cache);
    }
    if let (false, Some(cache)) = (args.merge.is_empty(), &mut cache) {
        benchmark::merge(&bench, &args.merge, cache)?;
    }
    let report = BenchmarkReport::new(&bench, benchmark::run(&bench, cache)?);
    if let Some(folder) = &plan.output {
        benchmark::write_results(folder, &report)?;
    }
    args.json
        .write_report(None, || report.text(), parsed(&report.json()?)?)
}

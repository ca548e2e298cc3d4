//! Compares models on poses they have not learnt from.

use clap::Parser;
use posing::Result;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::benchmark::{self, BenchmarkArgs, ResultCache, lengths, list, plan, sources};
use posing::cli::{Outcome, messages, run, streams};
use posing::evaluate::benchmark::{Benchmark, Dataset, summary};
use posing::evaluate::report::{BenchmarkReport, paper::Comparison};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare models on poses they were not trained on
///
/// Runs every model on every task, split and seed. A model is trained on the training part of a split and restores
/// damaged poses of the test part. The score is the mean squared error (MSE) over all coordinates, in asf² (1 asf =
/// 5.644 cm). Tables must be in body space (posing amc2xyz --space body); frames with missing points are left out.
///
/// Tasks: dense (noise of 1 asf on every coordinate, of known variance); sparse (noise of 1 asf on each joint with
/// probability 0.2; the model does not know which, and assumes the noise it was tuned to, or else the mean variance);
/// complete (only the joints of --observe are visible).
///
/// Splits: frames (a random half; test frames then have neighbours in the training half); takes (whole takes are held
/// out, a third of each subject's, at least two); subjects (whole subjects are held out). A take's subject is its name up
/// to the first _. With takes and subjects, copies, overlaps and mirrored takes are detected and stay on one side of the
/// split, and a model file trained on one of the takes is an error.
///
/// Prints one table per split: the MSE of each task (* marks the best), its 95% interval (bootstrap over takes; with
/// frames, over frames), and the training MSE.
#[derive(Parser)]
#[command(
    name = "evaluate",
    version,
    after_help = "Examples:\n  posing evaluate --splits takes --seeds 5 -o bench 01.csv 02.csv 07.csv\n  posing evaluate --models sparse,ksvd:n=500:k=5,ksvd-omp --tasks dense,complete --base 0,0.05asf 07.csv\n  posing evaluate --splits takes -m mine.npz my-takes.csv\n  posing evaluate --config bench.toml",
    after_long_help = LONG
)]
struct Args {
    #[command(flatten)]
    table: InputArgs,
    /// Read settings from a TOML file; flags override them
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Comma-separated models to train: kinds of prior-train, and ksvd and ksvd-omp, K-SVD as published; a dictionary takes
    /// :n=ATOMS and :k=SPARSITY (default: all)
    #[arg(long, value_name = "LIST", value_parser = list)]
    models: Option<::std::vec::Vec<String>>,
    /// Trained model to test as it is; may be repeated
    #[arg(short = 'm', long = "model", value_name = "MODEL.npz")]
    given: Vec<PathBuf>,
    /// Comma-separated tasks: dense, sparse, complete (default: all)
    #[arg(long, value_name = "LIST", value_parser = list)]
    tasks: Option<::std::vec::Vec<String>>,
    /// Comma-separated splits: frames, takes, subjects (default: all that the takes allow)
    #[arg(long, value_name = "LIST", value_parser = list)]
    splits: Option<::std::vec::Vec<String>>,
    /// Number of seeds; each has its own split, training and damage (default: 5)
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// First seed (default: 0)
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Largest number of test frames per split, and of training frames that are scored (default: 800)
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Comma-separated standard deviations of extra noise on every clean coordinate, in cm or with a unit (default: 0)
    #[arg(long, value_name = "LIST", value_parser = lengths)]
    base: Option<::std::vec::Vec<f64>>,
    /// Comma-separated joints that are visible in the task complete (default: the paper's six)
    #[arg(long, value_name = "LIST", value_parser = list)]
    observe: Option<::std::vec::Vec<String>>,
    /// Write results.csv, results.json, report.html and times.csv into DIR, and cache finished results there
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Run nothing; compare the finished run in RUN (a DIR of -o) with the paper's Tables 1 to 4, and write tables.html and
    /// tables.csv into DIR. May be repeated: the run with most subjects gives Table 1, runs of one subject Tables 2 to 4
    #[arg(long, value_name = "RUN", help_heading = "Output", requires = "output", conflicts_with_all = ["config", "fresh"])]
    paper: Vec<PathBuf>,
    /// Ignore the results cached in DIR
    #[arg(long, help_heading = "Output")]
    fresh: bool,
    #[command(flatten)]
    common: CommonArgs,
}

const LONG: &str = "\
Files:
bench.toml: all keys are optional; flags override them; paths are relative to the file; an unknown key is an error:
    tables = [\"01.csv\", \"07.csv\"]     models = [\"sparse\", \"ksvd:n=500\"]     model_files = [\"mine.npz\"]
    tasks = [\"dense\"]     splits = [\"takes\"]     seeds = 5     seed = 0     frames = 800
    base = [0, \"0.05asf\"]     observe = [\"lwrist\", \"rwrist\"]     output = \"bench\"
    [subjects]     take = \"subject\", where a take's name does not say
  DIR/results.csv: one row per model, task, split, base noise and seed, and one with the seed \"all\". Columns: frames, \
  units (number of takes; with the split frames, of frames), mse, low and high (95% interval), rms_cm, training_mse, \
  within_1sd and within_2sd (share of coordinates within one and two of the model's standard deviations), best.
  DIR/results.json: settings; data (takes, subjects, digests, twins: takes with equal poses); summary (one row over all \
  seeds, with by_joint, within: the shares within the deviations of gaussian_within, and to_best_other: the error divided by \
  that of the best other model, with its interval); cells (one row per seed, with by_take and the tuning curve).
  DIR/report.html: one self-contained page: ranking, test poses under all models, a completed take that plays; for each \
  split the tables, training against test error, error against sparsity and dictionary size, error by joint, calibration, tuning.
  DIR/times.csv: seconds per pose (one thread) and seconds of training; the only results that differ between runs.
  DIR/cells.jsonl, DIR/examples.jsonl: cache of finished results. A run that was killed resumes from them, with the same \
  results; a run with more models or seeds computes only the new ones.

Examples:
  posing evaluate --splits takes --seeds 5 -o bench 01.csv 02.csv 07.csv
  posing evaluate --models sparse,ksvd:n=500:k=5,ksvd-omp --tasks dense,complete --base 0,0.05asf 07.csv
  posing evaluate --splits takes -m mine.npz my-takes.csv
  posing evaluate --config bench.toml";

fn main() -> ExitCode {
    run(|args: Args| work(args))
}

/// Only writes what finished runs say of the paper's tables.
fn tables(runs: &[PathBuf], folder: &Path) -> Result<Outcome> {
    let runs = benchmark::finished(runs)?;
    let comparison = Comparison::new(&runs)?;
    let files = [
        ("tables.csv", comparison.csv()),
        ("tables.html", comparison.html()),
    ];
    benchmark::write(folder, &files)?;
    Ok(Outcome::Done)
}

fn work(args: Args) -> Result<Outcome> {
    args.common.apply()?;
    if let (false, Some(folder)) = (args.paper.is_empty(), &args.output) {
        return tables(&args.paper, folder);
    }
    let asked = BenchmarkArgs {
        models: args.models,
        files: args.given,
        tasks: args.tasks,
        splits: args.splits,
        seeds: args.seeds,
        seed: args.seed,
        frames: args.frames,
        base: args.base,
        observe: args.observe,
        output: args.output,
    };
    let plan = plan(asked, args.table.files.clone(), args.config.as_deref())?;
    plan.settings.check()?;
    let data = Dataset::new(&sources(&args.table, &plan.tables)?, &plan.subjects)?;
    if data.incomplete > 0 {
        messages::info(&format!(
            "{} frames skipped: missing points",
            data.incomplete
        ));
    }
    let bench = Benchmark::new(&data, plan.settings)?;
    for twin in bench.duplicates() {
        messages::info(&format!(
            "{} stays on the same side of every split",
            twin.describe(&data)
        ));
    }
    for what in bench.skipped_splits() {
        messages::info(&format!("left out: {what}"));
    }
    let work = match &plan.output {
        Some(folder) => Some(ResultCache::open(folder, args.fresh)?),
        None => None,
    };
    let (results, examples) = benchmark::run(&bench, work)?;
    let summary = summary::summarize(&results);
    let report = BenchmarkReport {
        dataset: &data,
        settings: bench.settings(),
        duplicates: bench.duplicates(),
        results: &results,
        summary: &summary,
        examples: &examples,
    };
    if let Some(folder) = &plan.output {
        let files = [
            ("results.csv", report.csv()),
            ("results.json", report.json()?),
            ("times.csv", report.times()),
            ("report.html", report.html()?),
        ];
        benchmark::write(folder, &files)?;
    }
    streams::write_bytes(None, report.text().as_bytes(), false)?;
    Ok(Outcome::Done)
}

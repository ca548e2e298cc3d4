//! Compares models on poses they have not learnt from.

use clap::Parser;
use posing::Result;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::benchmark::{self, BenchmarkArgs, ResultCache, lengths, list, plan, sources};
use posing::cli::{Outcome, messages, run, streams};
use posing::evaluate::benchmark::{Benchmark, Dataset, summary};
use posing::evaluate::report::tables::Results;
use posing::evaluate::report::{self, reproduction};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare models on poses they have not learnt from
///
/// Runs models x tasks x splits x seeds. Each model is trained on the training part of a split and restores damaged poses
/// of the test part; what counts is the mean squared error of a coordinate (MSE), in asf² (1 asf = 5.644 cm), over all
/// coordinates. Tables are to be in body space (posing amc2xyz --space body); a frame that lacks a point is left out.
///
/// Tasks: dense (noise of 1 asf on every coordinate, its variance told), sparse (noise of 1 asf on each joint with
/// probability 0.2; which joints is not told: a model reckons with the noise it was tuned to, one that was not tuned with
/// the mean variance), complete (only the joints of
/// --observe are seen).
///
/// Splits: frames (a random half; a test frame then has its neighbours in time in the training half), takes (whole takes
/// held out: of each subject a third, at least two), subjects (whole subjects held out). A take's subject is the part of
/// its name before the first _. Under takes and subjects nothing of a tested take is ever learnt from: takes that are the
/// same, share poses or mirror each other are found and kept on one side, and a model file that was trained from one of
/// the takes is refused.
///
/// A table a split is printed: the MSE of each task (the best marked *), its 95% interval (bootstrap over takes, under
/// frames over frames), and the MSE on poses that were learnt from.
#[derive(Parser)]
#[command(
    name = "evaluate",
    version,
    after_help = "ExampleSet:\n  posing evaluate --splits takes --seeds 5 -o bench 01.csv 02.csv 07.csv\n  posing evaluate --models sparse,ksvd:n=500:k=5,ksvd-omp --tasks dense,complete --base 0,0.05asf 07.csv\n  posing evaluate --splits takes -m mine.npz my-takes.csv\n  posing evaluate --config bench.toml",
    after_long_help = LONG
)]
struct Args {
    #[command(flatten)]
    table: InputArgs,
    /// Read what is not given by flags from a TOML file
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Models to train, with commas: kinds of model, sparse, ksvd and ksvd-omp as published (:n=ATOMS, :k=SPARSITY); default: all
    #[arg(long, value_name = "LIST", value_parser = list)]
    models: Option<::std::vec::Vec<String>>,
    /// A trained model, tested as it is; may be repeated
    #[arg(short = 'm', long = "model", value_name = "MODEL.npz")]
    given: Vec<PathBuf>,
    /// dense, sparse, complete (default: all)
    #[arg(long, value_name = "LIST", value_parser = list)]
    tasks: Option<::std::vec::Vec<String>>,
    /// frames, takes, subjects (default: all that the takes allow)
    #[arg(long, value_name = "LIST", value_parser = list)]
    splits: Option<::std::vec::Vec<String>>,
    /// DuplicateEvidence many seeds, each with a split, a training and a damage of its own (default: 5)
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// The first seed (default: 0)
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Test frames of a split at most, and as many of those learnt from (default: 800)
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Noise on every coordinate that is clean or exact, standard deviations with commas: cm, or with a unit (default: 0)
    #[arg(long, value_name = "LIST", value_parser = lengths)]
    base: Option<::std::vec::Vec<f64>>,
    /// The joints that completion sees (default: the paper's six)
    #[arg(long, value_name = "LIST", value_parser = list)]
    observe: Option<::std::vec::Vec<String>>,
    /// Write results.csv, results.json, report.html and times.csv into DIR, and keep finished cells there
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Run nothing: write the paper's Tables 1 to 4 beside what the finished run in RUN (a DIR of -o) has measured; may be
    /// repeated: runs of one subject go into Tables 2 to 4, the one of most subjects into Table 1. Writes tables.html and
    /// tables.csv into DIR
    #[arg(long, value_name = "RUN", help_heading = "Output", requires = "output", conflicts_with_all = ["config", "fresh"])]
    paper: Vec<PathBuf>,
    /// Run all cells anew, also those that DIR keeps
    #[arg(long, help_heading = "Output")]
    fresh: bool,
    #[command(flatten)]
    common: CommonArgs,
}

const LONG: &str = "\
Files:
  bench.toml keys, all optional; flags go before them, paths are from the file's folder, an unknown key is an error:
    tables = [\"01.csv\", \"07.csv\"]     models = [\"sparse\", \"ksvd:n=500\"]     model_files = [\"mine.npz\"]
    tasks = [\"dense\"]     splits = [\"takes\"]     seeds = 5     seed = 0     frames = 800
    base = [0, \"0.05asf\"]     observe = [\"lwrist\", \"rwrist\"]     output = \"bench\"
    [subjects]     take = \"subject\", where a take's name does not say
  DIR/results.csv: a line a model, task, split, base noise and seed, and one with the seed \"all\": frames, units (takes, \
or frames under that split), mse, low and high (95%), rms_cm, training_mse, within_1sd and within_2sd (the shares of \
coordinates that lie within one and two of the deviations the model states; exact and constant ones do not count), best.
  DIR/results.json: settings; data (takes, subjects, digests, twins: takes found to be one); summary (a row for all \
seeds: besides the CSV's numbers by_joint, within at the deviations of gaussian_within, and to_best_other, the error over \
that of the best other model with its interval on the same draws); cells (each seed by itself, with by_take and, where a model was tuned, its tuning curve).
  DIR/report.html: one page that needs nothing else: who is lowest; test poses under all models, that can be turned, and a \
take completed by all, that plays; by split the tables, training error against test error, error against sparsity and size \
of the dictionary (where several ksvd:n=..:k=.. were run), error by joint, calibration, how each model was tuned.
  DIR/times.csv: seconds a pose (one thread, while others work) and seconds of training. Times alone differ between runs.
  DIR/cells.jsonl, DIR/examples.jsonl: finished cells, and the poses that the page shows. A run that was killed goes on from them, to the same results; one with more models or \
seeds does only what is new.

ExampleSet:
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
    let files = [
        ("tables.csv", reproduction::csv(&runs)),
        ("tables.html", reproduction::html(&runs)?),
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
            "{} frames lack a point and are left out",
            data.incomplete
        ));
    }
    let bench = Benchmark::new(&data, plan.settings)?;
    for twin in bench.duplicates() {
        messages::info(&format!(
            "{} stays on one side with it",
            twin.describe(&data)
        ));
    }
    for what in bench.left_out() {
        messages::info(&format!("left out: {what}"));
    }
    let work = match &plan.output {
        Some(folder) => Some(ResultCache::open(folder, args.fresh)?),
        None => None,
    };
    let (cells, examples) = benchmark::run(&bench, work)?;
    let rows = summary::rows(&cells);
    let results = Results {
        data: &data,
        settings: bench.settings(),
        twins: bench.duplicates(),
        cells: &cells,
        rows: &rows,
        examples: &examples,
    };
    if let Some(folder) = &plan.output {
        let files = [
            ("results.csv", results.csv()),
            ("results.json", results.json()?),
            ("times.csv", results.times()),
            ("report.html", report::html(&results)?),
        ];
        benchmark::write(folder, &files)?;
    }
    streams::write_bytes(None, results.text().as_bytes(), false)?;
    Ok(Outcome::Done)
}

//! Learns a dictionary of poses by K-SVD.

use clap::{ArgGroup, Parser};
use posing::cli::args::{CommonArgs, InputArgs, SeedArgs, Space, parse_positive};
use posing::cli::training::{Run, ready};
use posing::cli::{Outcome, input, messages, run, streams};
use posing::io::input::ContentKind;
use posing::io::{Model, Table};
use posing::prior::{
    provenance::{digest, entry},
    sparse_coding::sparse_model,
    training_set::TrainingSet,
};
use posing::sparse::{Dictionary, Encoder, GrowthSearch, Ksvd, SelectionRule, random_atoms};
use posing::{Result, prior};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Train a sparse dictionary of poses by K-SVD
///
/// Finds unit-norm atoms such that every pose is approximately a weighted sum of at most K of them (Aharon, Elad and
/// Bruckstein 2006). Frames with missing points are skipped and counted. denoise, complete and encode use the
/// dictionary as a model; prior-train makes more accurate ones.
#[derive(Parser)]
#[command(
    name = "ksvd-train",
    version,
    group = ArgGroup::new("size").required(true).args(["atoms", "error"]),
    after_help = "Examples:\n  posing ksvd-train -n 1000 -o dict.npz poses.csv\n  posing ksvd-train --error 1.5 --valid other.csv --log train.jsonl --checkpoint train.ck -o dict.npz poses.npy"
)]
struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Number of atoms, at most the number of poses
    #[arg(short = 'n', long = "atoms", value_name = "ATOMS", value_parser = clap::value_parser!(u32).range(1..))]
    atoms: Option<u32>,
    /// Choose the number of atoms: grow the dictionary until the training RMS of a coordinate, in cm, is at most this (the
    /// paper's search: delta 2, growth 1.5)
    #[arg(long, value_name = "RMS", value_parser = parse_positive)]
    error: Option<f64>,
    /// Largest number of atoms per pose, 1 to 1000
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    sparsity: u32,
    /// Number of iterations
    #[arg(long, value_name = "N", default_value_t = 30)]
    iterations: u32,
    /// For a dictionary: rule that selects the next atom
    #[arg(long, value_enum, default_value = "oomp")]
    pursuit: RuleFlag,
    /// Initial atoms: a dictionary, or a table whose rows are scaled to unit norm (default: random poses)
    #[arg(long, value_name = "DICT.npz|TABLE")]
    init: Option<PathBuf>,
    /// Replace an atom whose coherence with a more used one exceeds C by the pose with the largest error (default: off)
    #[arg(long, value_name = "C", value_parser = parse_positive)]
    coherence: Option<f64>,
    /// Validation table; its error is reported after each iteration
    #[arg(long, value_name = "FILE")]
    valid: Option<PathBuf>,
    /// Save the state to FILE after each iteration, and resume from FILE if it exists
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Write one line of JSON per iteration
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Space in which poses are learnt
    #[arg(long, value_enum, default_value = "world")]
    space: Space,
    /// Credit line of the training data, stored in the model
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// Dictionary
    #[arg(short, long, value_name = "DICT.npz")]
    output: PathBuf,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum RuleFlag {
    /// Optimized orthogonal matching pursuit, the more accurate
    Oomp,
    /// Orthogonal matching pursuit, as in the paper
    Omp,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    input::check_single_stdin_with(&args.input, args.init.iter().chain(&args.valid))?;
    let world = args.space == Space::World;
    let poses = ready(&args.input, args.input.files.clone(), world, None)?;
    let valid = args
        .valid
        .as_ref()
        .map(|v| ready(&args.input, vec![v.clone()], world, Some(&poses)))
        .transpose()?;
    let ksvd = parameters(args);
    ksvd.check()?;
    let init = args
        .init
        .as_ref()
        .map(|p| initial(args, p, &poses))
        .transpose()?;
    let input = digest(&poses.points, poses.xyz.view());
    let flags = flags(args, init.as_ref(), &poses);
    let training = Run {
        ksvd: &ksvd,
        poses: poses.xyz.view(),
        validation: valid.as_ref().map(|v| v.xyz.view()),
        digest: format!(
            "{input} {flags:?} {:?}",
            valid.as_ref().map(|v| digest(&v.points, v.xyz.view()))
        ),
        atoms: (init.as_ref().map(Dictionary::len)).or(args.atoms.map(|n| n as usize)),
        checkpoint: args.checkpoint.as_deref(),
        log: args.log.as_deref(),
    };
    let state = training.train(|| {
        let dictionary = start(args, &ksvd, &poses, init)?;
        let search = Encoder::new(&dictionary, ksvd.omp())?.strategy(poses.xyz.nrows());
        messages::debug(&format!("{} atoms, search {search}", dictionary.len()));
        Ok(dictionary)
    })?;
    if let (Some(error), Some(last)) = (args.error, state.history.last())
        && !ksvd.reached(&state)
    {
        messages::info(&format!(
            "stopped at an RMS of {:.4} cm, above --error {error}",
            last.fresh_rms
        ));
    }
    let mut model = sparse_model(&poses, &state.dictionary, &ksvd.omp())?;
    model.meta.credit.clone_from(&args.credit);
    model
        .meta
        .history
        .push(entry("ksvd-train", &flags, poses.digests()));
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)?;
    training.finish()?;
    Ok(Outcome::Done)
}

fn parameters(args: &Args) -> Ksvd {
    let rule = match args.pursuit {
        RuleFlag::Oomp => SelectionRule::Oomp,
        RuleFlag::Omp => SelectionRule::Omp,
    };
    Ksvd {
        iterations: args.iterations as usize,
        sparsity: args.sparsity as usize,
        rule,
        coherence: args.coherence,
        target: args.error,
        ..Ksvd::default()
    }
}

/// The atoms to start from: those given, those the size search found, or random poses.
fn start(
    args: &Args,
    ksvd: &Ksvd,
    poses: &TrainingSet,
    init: Option<Dictionary>,
) -> Result<Dictionary> {
    if let Some(init) = init {
        return Ok(init);
    }
    let xyz = poses.xyz.view();
    let Some(error) = args.error else {
        return random_atoms(xyz, args.atoms.unwrap_or(1) as usize, args.seed.seed);
    };
    let search = GrowthSearch {
        error,
        seed: args.seed.seed,
        omp: ksvd.omp(),
        ..GrowthSearch::default()
    };
    let tell = |t: &posing::sparse::Trial| {
        messages::debug(&format!("{} atoms: RMS {:.4} cm", t.atoms, t.rms))
    };
    let found = search.start(xyz, &mut { tell })?;
    messages::info(&format!("starting from {} atoms", found.dictionary.len()));
    Ok(found.dictionary)
}

/// `--init`: a model's atoms, or a table's poses.
fn initial(args: &Args, path: &Path, poses: &TrainingSet) -> Result<Dictionary> {
    let input = input::open(path)?;
    let name = input.name.clone();
    let dictionary = if input.kind() == ContentKind::Npz {
        let model = Model::read(input)?;
        if model.meta.points != poses.points || model.meta.space != args.space.name() {
            let what = "is a dictionary whose points or space differ from the training poses'";
            return Err(posing::Error::data(posing::Place::file(&name), what));
        }
        prior::sparse_coding::dictionary(&model, &name)?
    } else {
        let table = Table::read(input, &args.input.options(false, false)?)?;
        Dictionary::from_rows(poses.comparable(&table.poses, &name)?.xyz.view())?
    };
    match args.atoms {
        Some(n) if n as usize != dictionary.len() => Err(posing::Error::usage(format!(
            "-n {n} contradicts --init, which has {} atoms",
            dictionary.len()
        ))),
        _ => Ok(dictionary),
    }
}

/// The flags that change numbers.
fn flags(
    args: &Args,
    init: Option<&Dictionary>,
    poses: &TrainingSet,
) -> Vec<(&'static str, String)> {
    let pursuit = if matches!(args.pursuit, RuleFlag::Oomp) {
        "oomp"
    } else {
        "omp"
    };
    let mut flags = vec![
        ("sparsity", args.sparsity.to_string()),
        ("iterations", args.iterations.to_string()),
        ("pursuit", pursuit.to_string()),
        ("space", args.space.name().to_string()),
        ("seed", args.seed.seed.to_string()),
    ];
    flags.extend(args.atoms.map(|n| ("atoms", n.to_string())));
    flags.extend(args.error.map(|e| ("error", e.to_string())));
    flags.extend(args.coherence.map(|c| ("coherence", c.to_string())));
    flags.extend(init.map(|d| ("init", digest(&poses.points, d.atoms()))));
    flags
}

//! Learns a dictionary of poses by K-SVD.

mod training;

use self::training::{KsvdArgs, TrainingRun};
use clap::{ArgGroup, Parser};
use posing::Result;
use posing::cli::args::{SeedArgs, Space, TableArgs};
use posing::cli::paths::OutputPath;
use posing::cli::training::ready;
use posing::cli::{input, messages, streams};
use posing::prior::provenance::{digest, entry};
use posing::prior::sparse_coding::sparse_model;
use posing::sparse::Dictionary;

/// Train a sparse dictionary of poses by K-SVD
///
/// Finds unit-norm atoms such that every pose is approximately a weighted sum of at most K of them
/// (Aharon, Elad and Bruckstein 2006). Frames with missing points are skipped and counted. denoise,
/// complete and encode use the dictionary as a model; prior-train makes more accurate ones.
#[derive(Parser)]
#[command(
    name = "ksvd-train",
    version,
    group = ArgGroup::new("size").required(true).args(["atoms", "error"]),
    after_help = "Examples:\
        \n  posing ksvd-train -n 1000 -o dict.npz poses.csv\
        \n  posing ksvd-train --error 1.5 --valid other.csv --log train.jsonl \
        --checkpoint train.ck -o dict.npz poses.npy"
)]
pub struct Args {
    #[command(flatten)]
    tables: TableArgs,
    #[command(flatten)]
    training: KsvdArgs,
    /// Dictionary
    #[arg(short, long, value_name = "DICT.npz")]
    output: OutputPath,
    #[command(flatten)]
    seed: SeedArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let (own, seed) = (&args.training, args.seed.seed);
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, own.init.iter().chain(&own.valid))?;
    let world = own.space == Space::World;
    let poses = ready(&tables, tables.files.clone(), world, None)?;
    let valid = own.valid.as_ref();
    let valid = valid.map(|v| ready(&tables, vec![v.clone()], world, Some(&poses)));
    let valid = valid.transpose()?;
    let ksvd = own.ksvd(seed);
    ksvd.check()?;
    let init = own.initial(&poses)?;
    let flags = own.history(seed, init.as_ref(), &poses);
    let valid_digest = valid.as_ref().map(|v| digest(&v.points, v.xyz.view()));
    let training = TrainingRun {
        ksvd: &ksvd,
        poses: poses.xyz.view(),
        validation: valid.as_ref().map(|v| v.xyz.view()),
        digest: format!(
            "{} {flags:?} {valid_digest:?}",
            digest(&poses.points, poses.xyz.view())
        ),
        atoms: (init.as_ref().map(Dictionary::len)).or(own.atoms.map(|n| n as usize)),
        checkpoint: own.checkpoint.as_deref(),
        log: own.log.as_deref(),
    };
    let state = training.train(|| own.start(&ksvd, poses.xyz.view(), init))?;
    if let (Some(error), Some(last)) = (own.error, state.history.last())
        && !ksvd.reached(&state)
    {
        messages::info(&format!(
            "stopped at an RMS of {:.4} cm, above --error {error}",
            last.fresh_rms
        ));
    }
    let mut model = sparse_model(&poses, &state.dictionary, &ksvd.omp())?;
    let step = entry("ksvd-train", &flags, poses.digests());
    model.meta.history.push(step);
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)?;
    training.finish()
}

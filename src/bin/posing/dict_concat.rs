//! Joins dictionaries into one.

use clap::Parser;
use posing::cli::args::parse_positive;
use posing::cli::paths::OutputPath;
use posing::cli::{input, messages, streams};
use posing::io::Model;
use posing::prior::provenance::{digest, entry};
use posing::prior::sparse_coding::dictionary;
use posing::sparse::{Dictionary, DictionaryMerge};
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Join dictionaries into one
///
/// Writes the atoms of all dictionaries, in order. Reports the number of copies, and the
/// cross-coherence of each pair of dictionaries: for each atom of the later one, its largest
/// absolute cosine with an atom of the earlier one. The time of this report grows with the square
/// of the number of atoms; --quiet leaves it out.
#[derive(Parser)]
#[command(
    name = "dict-concat",
    version,
    after_help = "Examples:\
        \n  posing dict-concat part-*.npz -o dict.npz\
        \n  posing dict-concat --prune 0.99 walk.npz run.npz -o dict.npz"
)]
pub struct Args {
    /// Dictionaries with the same points and space
    #[arg(value_name = "DICT.npz", required = true)]
    dictionaries: Vec<PathBuf>,
    /// Drop an atom whose coherence with an earlier one is at least this, above 0 to 1 (1: exact
    /// copies only)
    #[arg(long, value_name = "COHERENCE", value_parser = parse_positive)]
    prune: Option<f64>,
    /// Output file
    #[arg(short, long, value_name = "DICT.npz")]
    output: OutputPath,
}

pub fn work(args: &Args) -> Result<()> {
    input::check_single_stdin(&args.dictionaries)?;
    let models = args
        .dictionaries
        .iter()
        .map(|p| input::open_model(p))
        .collect::<Result<Vec<_>>>()?;
    let mut parts = Vec::new();
    for (model, path) in models.iter().zip(&args.dictionaries) {
        agrees(model, &models[0], path)?;
        parts.push(dictionary(model, &path.display().to_string())?);
    }
    let joined = DictionaryMerge {
        compare: !messages::is_quiet() && parts.len() > 1,
        prune: args.prune,
    }
    .join(&parts)?;
    report(args, &parts, &joined);
    let flags: Vec<_> = args
        .prune
        .map(|p| ("prune", p.to_string()))
        .into_iter()
        .collect();
    let inputs = parts
        .iter()
        .map(|p| digest(&models[0].meta.points, p.atoms()))
        .collect();
    let model = posing::prior::sparse_coding::joined_model(
        &models,
        &args
            .dictionaries
            .iter()
            .map(|p| p.display().to_string())
            .collect::<Vec<_>>(),
        &joined.dictionary,
        entry("dict-concat", &flags, inputs),
    )?;
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)
}

/// Parts must be of the same kind, points and space.
fn agrees(model: &Model, first: &Model, path: &std::path::Path) -> Result<()> {
    let what = if model.meta.kind != "sparse" {
        format!(
            "is a model of kind \"{}\", expected a dictionary (kind sparse)",
            model.meta.kind
        )
    } else if model.meta.points != first.meta.points {
        "has points that differ from the first dictionary's".to_string()
    } else if model.meta.space != first.meta.space {
        format!(
            "was trained in {} space, the first dictionary in {} space",
            model.meta.space, first.meta.space
        )
    } else {
        return Ok(());
    };
    Err(Error::data(Place::file(path.display().to_string()), what))
}

fn report(args: &Args, parts: &[Dictionary], joined: &posing::sparse::MergedDictionary) {
    let name = |i: usize| args.dictionaries[i].display();
    for c in &joined.closeness {
        messages::info(&format!(
            "{} and {}: coherence median {:.4}, 90% {:.4}, 99% {:.4}, largest {:.6}",
            name(c.first),
            name(c.second),
            c.median,
            c.p90,
            c.p99,
            c.max
        ));
    }
    let all: usize = parts.iter().map(Dictionary::len).sum();
    messages::info(&format!(
        "{all} atoms read, {} copies, {} dropped, {} written",
        joined.copies,
        joined.dropped.len(),
        joined.dictionary.len()
    ));
}

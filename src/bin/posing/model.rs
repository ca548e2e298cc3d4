//! Tells what a model is and where it came from.

use clap::{Parser, Subcommand};
use posing::cli::json_report::JsonArgs;
use posing::cli::paths::OutputPath;
use posing::cli::{input, streams};
use posing::inbetween::MotionLibrary;
use posing::io::Model;
use posing::prior::builtin_model;
use posing::solve::MarkerSet;
use posing::{Error, Result};
use serde_json::Value;
use std::path::PathBuf;

/// Show a model's training data, settings and credits
#[derive(Parser)]
#[command(
    name = "model",
    version,
    after_help = "Examples:\
        \n  posing model info\
        \n  posing model info dict.npz\
        \n  posing model save -o builtin.npz"
)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Print a model's kind, points, sizes, training error, history and credit
    Info {
        /// Model file, or a marker set that label or solve learned (default: the built-in model)
        #[arg(value_name = "MODEL.npz|SET.json")]
        model: Option<PathBuf>,
        #[command(flatten)]
        json: JsonArgs,
    },
    /// Write the built-in model to a file
    Save {
        /// Output file
        #[arg(short, long, value_name = "MODEL.npz")]
        output: OutputPath,
    },
}

/// Names in a list, and steps of the history, that a summary shows at most.
const NAMES: usize = 40;
const STEPS: usize = 4;

pub fn work(args: &Args) -> Result<()> {
    match &args.what {
        What::Info {
            model: Some(path),
            json,
        } if MarkerSet::is_learned(path)? => {
            let set = MarkerSet::open(path)?;
            let value = serde_json::from_str::<Value>(&set.to_json()?);
            json.prepare_report();
            json.write_report(None, || set.summary(), value.map_err(fault)?)?;
        }
        What::Info { model, json } => {
            let model = match model {
                Some(path) => input::open_model(path)?,
                None => builtin_model()?,
            };
            json.prepare_report();
            json.write_report(None, || summary(&model), json_of(&model)?)?;
        }
        What::Save { output } => {
            streams::write_bytes(Some(output), &builtin_model()?.to_bytes()?, true)?
        }
    }
    Ok(())
}

/// The meta data, and the shape of each array.
fn json_of(model: &Model) -> Result<Value> {
    let mut all = serde_json::to_value(&model.meta).map_err(fault)?;
    let shapes = model
        .arrays()
        .map(|(name, array)| (name.to_string(), vec![array.nrows(), array.ncols()].into()));
    all["arrays"] = Value::Object(shapes.collect());
    Ok(all)
}

fn fault(e: serde_json::Error) -> Error {
    Error::usage(e.to_string())
}

/// A screen of text; `--json` has what is too long for it.
fn summary(model: &Model) -> String {
    let meta = &model.meta;
    let mut lines = vec![("kind", meta.kind.clone())];
    let points = short_list(meta.points.iter().map(String::as_str));
    lines.push(("points", format!("{}: {points}", meta.points.len())));
    lines.push(("space", format!("{}, {}", meta.space, meta.units)));
    let arrays: Vec<_> = model.arrays().collect();
    // Arrays of one part are numbered: means.0.1 is one of `means`.
    let mut groups: Vec<&str> = arrays
        .iter()
        .filter_map(|(name, _)| name.split('.').next())
        .collect();
    groups.dedup();
    let numbers: usize = arrays.iter().map(|(_, a)| a.nrows() * a.ncols()).sum();
    let groups = short_list(groups.into_iter());
    lines.push((
        "arrays",
        format!("{}, {numbers} numbers: {groups}", arrays.len()),
    ));
    if let Ok(library) = MotionLibrary::from_model(model, "") {
        let minutes = library.seconds() / 60.0;
        let names = short_list(library.takes.iter().map(|t| t.name.as_str()));
        lines.push(("people", library.people().to_string()));
        lines.push(("takes", format!("{}: {names}", library.takes.len())));
        lines.push(("minutes", format!("{minutes:.1}")));
    }
    lines.extend(meta.sparsity.map(|k| ("sparsity", k.to_string())));
    let rms = |rms| format!("{rms:.4} cm per coordinate over the training poses");
    lines.extend(meta.training_rms.map(|e| ("rms", rms(e))));
    let scalars = meta
        .details
        .iter()
        .filter(|(_, v)| !v.is_object() && !v.is_array());
    let text = |value: &Value| match value.as_f64() {
        Some(number) => number.to_string(),
        None => value.to_string(),
    };
    lines.extend(scalars.map(|(key, value)| (key.as_str(), text(value))));
    for step in meta.history.iter().rev().take(STEPS).rev() {
        let flags: Vec<String> = step.flags.iter().map(|(k, v)| format!("{k}={v}")).collect();
        let made = format!("{} {} {}", step.command, step.version, flags.join(" "));
        lines.push(("made by", made));
        lines.push(("from", format!("{} takes or files", step.inputs.len())));
    }
    lines.extend(meta.credit.clone().map(|credit| ("credit", credit)));
    let line = |(name, value): (&str, String)| format!("{name:<10} {value}\n");
    lines.into_iter().map(line).collect()
}

/// The first names, and an ellipsis for more.
fn short_list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    let more = if names.len() > NAMES { " …" } else { "" };
    names[..names.len().min(NAMES)].join(" ") + more
}

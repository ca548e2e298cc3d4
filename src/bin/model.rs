//! Tells what a model is and where it came from.

use clap::{Parser, Subcommand};
use posing::cli::args::CommonArgs;
use posing::cli::{Outcome, input, run, streams};
use posing::io::Model;
use posing::prior::builtin;
use posing::{Error, Result};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Show a model's training data, settings and credits
#[derive(Parser)]
#[command(
    name = "model",
    version,
    after_help = "Examples:\n  posing model info\n  posing model info dict.npz\n  posing model save -o builtin.npz"
)]
struct Args {
    #[command(subcommand)]
    what: What,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Subcommand)]
enum What {
    /// Print a model's kind, points, sizes, training error, history and credit
    Info {
        /// Model file (default: the built-in model)
        #[arg(value_name = "MODEL.npz")]
        model: Option<PathBuf>,
        /// Print the metadata as JSON
        #[arg(long)]
        json: bool,
    },
    /// Write the built-in model to a file
    Save {
        /// Output file
        #[arg(short, long, value_name = "MODEL.npz")]
        output: PathBuf,
    },
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    match &args.what {
        What::Info { model, json } => {
            let model = match model {
                Some(path) => input::open_model(path)?,
                None => builtin::model()?,
            };
            let text = if *json {
                let json = serde_json::to_string_pretty(&model.meta);
                json.map_err(|e| Error::usage(e.to_string()))? + "\n"
            } else {
                told(&model)
            };
            streams::write_bytes(None, text.as_bytes(), false)?;
        }
        What::Save { output } => {
            streams::write_bytes(Some(output), &builtin::model()?.to_bytes()?, true)?
        }
    }
    Ok(Outcome::Done)
}

/// The model in words.
fn told(model: &Model) -> String {
    let meta = &model.meta;
    let mut text = String::new();
    // Writing to memory cannot fail.
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "{name:<10} {value}");
    };
    line("kind", &meta.kind);
    line(
        "points",
        &format!("{}: {}", meta.points.len(), meta.points.join(" ")),
    );
    line("space", &format!("{}, {}", meta.space, meta.units));
    for (name, array) in model.arrays() {
        line(
            "array",
            &format!("{name} {} x {}", array.nrows(), array.ncols()),
        );
    }
    if let Some(sparsity) = meta.sparsity {
        line("sparsity", &sparsity.to_string());
    }
    if let Some(rms) = meta.training_rms {
        line(
            "rms",
            &format!("{rms:.4} cm a coordinate, over the training poses"),
        );
    }
    for (key, value) in &meta.details {
        line(key, &value.to_string());
    }
    for step in &meta.history {
        let flags: Vec<String> = step.flags.iter().map(|(k, v)| format!("{k}={v}")).collect();
        line(
            "made by",
            &format!("{} {} {}", step.command, step.version, flags.join(" ")),
        );
        for input in &step.inputs {
            line("from", &format!("sha256 {input}"));
        }
    }
    if let Some(credit) = &meta.credit {
        line("credit", credit);
    }
    text
}

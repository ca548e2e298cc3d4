//! `evaluate` without the feature `papers`.

use super::takes::EvaluateTakesArgs;
use clap::{Parser, Subcommand};
use posing::cli::NO_PAPERS;
use posing::{Error, Result};
use std::ffi::OsString;

/// Test how well takes are restored
///
/// The benchmark of models and the test of distances, which papers compare with, are in builds with
/// the feature `papers`, as `cargo install --path .` makes them.
#[derive(Parser)]
#[command(
    name = "evaluate",
    version,
    args_conflicts_with_subcommands = true,
    arg_required_else_help = true,
    after_help = "Examples:\
        \n  posing evaluate takes -o bench two-people.csv"
)]
pub struct Args {
    #[command(subcommand)]
    command: Option<Tested>,
    /// Tables and flags of the benchmark
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    benchmark: Vec<OsString>,
}

#[derive(Subcommand)]
enum Tested {
    Takes(EvaluateTakesArgs),
}

pub fn work(args: &Args) -> Result<()> {
    match &args.command {
        Some(Tested::Takes(args)) => args.work(),
        None => Err(Error::usage(format!("all but `takes` {NO_PAPERS}"))),
    }
}

//! Turns poses into sparse codes.

mod code_table;

use clap::Parser;
use posing::cli::args::TableArgs;
use posing::cli::choice::choice;
use posing::cli::paths::OutputPath;

use posing::cli::input::{RowStream, check_single_stdin_with, open_model};
use posing::cli::streams::open_output;
use posing::prior::sparse_coding::dictionary;
use posing::sparse::{Encoder, Omp, SelectionRule};
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Convert poses to sparse codes
///
/// Writes one row per pose: atom1,coef1,…,atomK,coefK,rms. Atoms count from 0, and unused cells are
/// empty. The column rms is the root mean square error of a coordinate, in centimeters, over the
/// values that are not missing; it is empty if all are missing. Rows are used as they are: convert
/// with amc2xyz --space body first.
#[derive(Parser)]
#[command(
    name = "encode",
    version,
    after_help = "Examples:\
        \n  posing encode -m dict.npz poses.npy > codes.csv\
        \n  posing encode -m dict.npz --sparsity 5 --pursuit omp poses.csv"
)]
pub(crate) struct Args {
    #[command(flatten)]
    tables: TableArgs,
    /// Dictionary, as ksvd-train writes it
    #[arg(short, long, value_name = "DICT.npz")]
    model: PathBuf,
    /// Largest number of atoms per pose, 1 to 1000
    #[arg(
        long,
        value_name = "K",
        default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..=1000)
    )]
    sparsity: u32,
    /// Rule that selects the next atom
    #[arg(long, value_parser = choice::<SelectionRule>(), default_value = "oomp")]
    pursuit: SelectionRule,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    output: Option<OutputPath>,
}

pub fn work(args: &Args) -> Result<()> {
    let tables = args.tables.input();
    check_single_stdin_with(&tables, [&args.model])?;
    let model = open_model(&args.model)?;
    let dictionary = dictionary(&model, &args.model.display().to_string())?;
    let stream = RowStream::open(&tables, false, false)?;
    if stream.columns().points != model.meta.points {
        let what = format!(
            "has points that differ from the dictionary's ({}, …), or another order",
            model.meta.points[0]
        );
        return Err(Error::data(Place::file(stream.name()), what));
    }
    let encoder = Encoder::new(&dictionary, Omp::from(args))?;
    let mut output = open_output(args.output.as_deref(), false)?;
    code_table::write(stream, &encoder, args.sparsity as usize, &mut output)?;
    output.finish()
}

impl From<&Args> for Omp {
    fn from(args: &Args) -> Omp {
        Omp {
            sparsity: args.sparsity as usize,
            rule: args.pursuit,
            ..Omp::default()
        }
    }
}

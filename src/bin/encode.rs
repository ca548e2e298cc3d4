//! Turns poses into sparse codes.

use clap::Parser;
use ndarray::Array2;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::input::{RowStream, check_single_stdin_with, open_model};
use posing::cli::restoring::PursuitFlag;
use posing::cli::streams::open_output;
use posing::cli::{Outcome, messages, run};
use posing::io::Row;
use posing::io::text::{push_f32, push_f64, push_integer};
use posing::numeric::parallel;
use posing::prior::sparse_coding::dictionary;
use posing::sparse::{Encoder, Omp, SearchStrategy, SparseCodes};
use posing::{Error, Place, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Convert poses to sparse codes
///
/// Writes one row per pose: atom1,coef1,…,atomK,coefK,rms. Atoms count from 0, and unused cells are empty. The column
/// rms is the root mean square error of a coordinate, in centimetres, over the values that are not missing; it is empty
/// if all are missing. Rows are used as they are: convert with amc2xyz --space body first.
#[derive(Parser)]
#[command(
    name = "encode",
    version,
    after_help = "Examples:\n  posing encode -m dict.npz poses.npy > codes.csv\n  posing encode -m dict.npz --sparsity 5 --pursuit omp poses.csv"
)]
struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Dictionary, as ksvd-train writes it
    #[arg(short, long, value_name = "DICT.npz")]
    model: PathBuf,
    /// Largest number of atoms per pose, 1 to 1000
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    sparsity: u32,
    /// Rule that selects the next atom
    #[arg(long, value_enum, default_value = "oomp")]
    pursuit: PursuitFlag,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Poses that are coded together where an order among them counts: of more, neighbours are more alike.
const BATCH: usize = 1 << 13;
/// And where that is quick, by one thread.
const FEW: usize = 480;
/// Lines that one thread writes at a time.
const LINES: usize = 256;

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    check_single_stdin_with(&args.input, [&args.model])?;
    let model = open_model(&args.model)?;
    let dictionary = dictionary(&model, &args.model.display().to_string())?;
    let stream = RowStream::open(&args.input, false, false)?;
    if stream.columns().points != model.meta.points {
        let what = format!(
            "has points that differ from the dictionary's ({}, …), or another order",
            model.meta.points[0]
        );
        return Err(Error::data(Place::file(stream.name()), what));
    }
    let omp = Omp {
        sparsity: args.sparsity as usize,
        rule: args.pursuit.rule(),
        ..Omp::default()
    };
    let encoder = Encoder::new(&dictionary, omp)?;
    let mut sink = open_output(args.output.as_deref(), false)?;
    let header: Vec<String> = (1..=args.sparsity)
        .map(|k| format!("atom{k},coef{k}"))
        .collect();
    sink.write(format!("{},rms\n", header.join(",")).as_bytes())?;
    let is_quick = encoder.strategy(BATCH) == SearchStrategy::Gram;
    let most = if is_quick { FEW } else { BATCH };
    let mut batches = Batches::new(stream, most);
    let mut first = batches.next()?;
    if let Some(poses) = &first {
        let search = encoder.strategy(poses.nrows());
        messages::debug(&format!("{} atoms, search {search}", dictionary.len()));
    }
    let with_rows = encoder.strategy(most) == SearchStrategy::Gram;
    if let Some(poses) = first.take_if(|p| !with_rows || p.nrows() < most) {
        // By all threads: few poses; and bounds are made with the first, those coded beside would have to do without.
        sink.write(&coded(&encoder, omp.sparsity, &poses)?)?;
    }
    let ahead = match is_quick {
        true => 2 * rayon::current_num_threads() + 1,
        false => 2,
    };
    parallel::ordered_pipeline(
        ahead,
        || match first.take() {
            Some(poses) => Ok(Some(poses)),
            None => batches.next(),
        },
        |poses| match is_quick {
            true => parallel::single_threaded(|| coded(&encoder, omp.sparsity, &poses)),
            false => coded(&encoder, omp.sparsity, &poses),
        },
        |lines| sink.write(&lines),
    )?;
    sink.finish()?;
    Ok(Outcome::Done)
}

/// The poses of a stream, some to be coded together at a time.
struct Batches<'a> {
    stream: RowStream<'a>,
    most: usize,
    /// What ended the poses before, to be told after them.
    error: Option<Error>,
}

impl<'a> Batches<'a> {
    /// Up to `most` at a time.
    fn new(stream: RowStream<'a>, most: usize) -> Self {
        Batches {
            stream,
            most,
            error: None,
        }
    }

    /// The next; none after the last.
    fn next(&mut self) -> Result<Option<Array2<f32>>> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        let width = self.stream.columns().width();
        let mut values = Vec::with_capacity(self.most.min(FEW) * width);
        let mut row = Row::default();
        while values.len() < self.most * width {
            match self.stream.read(&mut row) {
                Ok(true) => values.extend(row.xyz.iter().map(|v| *v as f32)),
                Ok(false) => break,
                Err(error) if values.is_empty() => return Err(error),
                Err(error) => {
                    self.error = Some(error);
                    break;
                }
            }
        }
        let shape = (values.len() / width.max(1), width);
        let poses = Array2::from_shape_vec(shape, values).unwrap_or_default();
        Ok((poses.nrows() > 0).then_some(poses))
    }
}

/// The lines of some poses.
fn coded(encoder: &Encoder, sparsity: usize, poses: &Array2<f32>) -> Result<Vec<u8>> {
    // To the end, so that several are compared at once.
    let gaps = poses.fold(false, |any, v| any | !v.is_finite());
    let seen = gaps.then(|| poses.mapv(|v| f32::from(v.is_finite())));
    let codes = encoder.encode_weighted(poses.view(), seen.as_ref().map(|s| s.view()))?;
    let count = |i: usize| match &seen {
        Some(seen) => seen.row(i).sum(),
        None => poses.ncols() as f32,
    };
    let lines = |rows: std::ops::Range<usize>| {
        let mut out = Vec::with_capacity(64 * rows.len());
        for i in rows {
            // No number where nothing is seen: that is written as an empty cell.
            let squared = codes.squared_residuals[i] / f64::from(count(i));
            line(&mut out, sparsity, &codes, (i, squared.sqrt()));
        }
        out
    };
    Ok(parallel::map_chunks(codes.len(), LINES, lines).concat())
}

fn line(out: &mut Vec<u8>, sparsity: usize, codes: &SparseCodes, (i, rms): (usize, f64)) {
    let mut used = 0;
    for (atom, coefficient) in codes.entries(i) {
        push_integer(out, atom);
        out.push(b',');
        push_f32(out, coefficient);
        out.push(b',');
        used += 1;
    }
    out.extend(std::iter::repeat_n(b',', 2 * (sparsity - used)));
    push_f64(out, rms);
    out.push(b'\n');
}

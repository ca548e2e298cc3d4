//! Turns sparse codes back into poses.

use clap::Parser;
use posing::cli::args::OutputArgs;
use posing::cli::input::{check_single_stdin, open, open_model};
use posing::cli::streams::create_table;
use posing::io::csv::csv_fault;
use posing::io::text::parse_number;
use posing::io::{Columns, Row};
use posing::pose::units::Units;
use posing::prior::sparse_coding::dictionary;
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Convert sparse codes back to poses
///
/// A pose is the sum of its atoms times their coefficients. Reads the columns atom1, coef1, atom2,
/// coef2, …, and writes a pose table without takes and times.
#[derive(Parser)]
#[command(
    name = "decode",
    version,
    after_help = "Examples:\
        \n  posing encode -m dict.npz poses.npy | posing decode -m dict.npz > again.csv"
)]
pub struct Args {
    /// Codes, as encode writes them; - or nothing: standard input
    #[arg(value_name = "FILE", default_value = "-")]
    file: PathBuf,
    /// Dictionary, as ksvd-train writes it
    #[arg(short, long, value_name = "DICT.npz")]
    model: PathBuf,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn work(args: &Args) -> Result<()> {
    check_single_stdin([&args.file, &args.model])?;
    let model = open_model(&args.model)?;
    let dictionary = dictionary(&model, &args.model.display().to_string())?;
    let input = open(&args.file)?;
    let name = input.name.clone();
    let mut reader = csv::ReaderBuilder::new().from_reader(input.into_reader());
    let header = reader.headers().map_err(|e| csv_fault(&name, &e))?.clone();
    let pairs: Vec<(usize, usize)> = (1..)
        .map_while(|k| {
            let find = |what: &str| header.iter().position(|h| h == format!("{what}{k}"));
            find("atom").zip(find("coef"))
        })
        .collect();
    let rms = header.iter().position(|h| h == "rms");
    if pairs.is_empty() {
        return Err(Error::data(
            Place::line(&name, 1),
            "no columns atom1 and coef1; expected the output of encode",
        ));
    }
    let columns = Columns::for_points(model.meta.points.clone(), false, false);
    let mut sink = create_table(&args.out, [Units::CM_Y; 2], &columns, &[])?;
    for record in reader.records() {
        let record = record.map_err(|e| csv_fault(&name, &e))?;
        let line = record.position().map_or(0, csv::Position::line);
        let place = |part: String| Place::line(&name, line).part(part);
        if record.iter().any(|cell| cell.contains(['\n', '\r'])) {
            let what = "a cell continues on the next line; close its quote";
            return Err(Error::data(Place::line(&name, line), what));
        }
        let is_empty = |column: usize| record.get(column).is_none_or(str::is_empty);
        let is_unseen =
            rms.is_some_and(is_empty) && pairs.iter().all(|&(a, c)| is_empty(a) && is_empty(c));
        let (mut atoms, mut coefficients) = (Vec::new(), Vec::new());
        for (k, &(atom, coefficient)) in pairs.iter().enumerate() {
            let (atom, coefficient) = (
                record.get(atom).unwrap_or(""),
                record.get(coefficient).unwrap_or(""),
            );
            if atom.is_empty() && !coefficient.is_empty() {
                let what = format!("has a coefficient, but atom{} is empty", k + 1);
                return Err(Error::data(place(format!("coef{}", k + 1)), what));
            }
            if atom.is_empty() {
                continue;
            }
            let index = atom
                .parse::<u32>()
                .ok()
                .filter(|a| (*a as usize) < dictionary.len())
                .ok_or_else(|| {
                    let what = format!(
                        "expected an atom from 0 to {}, found \"{atom}\"",
                        dictionary.len() - 1
                    );
                    Error::data(place(format!("atom{}", k + 1)), what)
                })?;
            let coefficient =
                parse_number(coefficient).map_err(|e| e.at(place(format!("coef{}", k + 1))))?;
            atoms.push(index);
            coefficients.push(coefficient);
        }
        let pose = if is_unseen {
            vec![f64::NAN; columns.width()]
        } else {
            dictionary.combine(&atoms, &coefficients).to_vec()
        };
        sink.write(
            &mut Row {
                xyz: pose.clone(),
                ..Row::default()
            },
            &pose,
            &[],
        )?;
    }
    sink.finish()
}

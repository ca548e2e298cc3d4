//! Compares poses with the truth.

use clap::Parser;
use posing::cli::args::{InputArgs, parse_rate};
use posing::cli::choice::{choice, value_name};
use posing::cli::input::{check_single_stdin, read_table};
use posing::cli::json_report::JsonArgs;
use posing::cli::messages;
use posing::cli::paths::OutputPath;
use posing::evaluate::Score;
use posing::evaluate::alignment::point_order;
use posing::io::Table;
use posing::pose::units::LengthUnit;
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Compare poses with the truth
///
/// Prints, in total and for each point, the number of coordinates, their mean squared error (MSE)
/// and its root (RMS), the mean distance of a point and the largest error of a coordinate; then the
/// errors and variation of bone lengths, and accelerations (jitter raises them above the truth's).
/// The frames must be the same; points are matched by name. Coordinates missing in TRUTH are left
/// out; those missing in RESULT are counted as still missing.
#[derive(Parser)]
#[command(
    name = "score",
    version,
    after_help = "Examples:\
        \n  posing score truth.csv denoised.csv\
        \n  posing score --damaged gaps.csv truth.csv completed.csv\
        \n  posing denoise noisy.csv | posing score --units asf --json truth.csv -"
)]
pub struct Args {
    /// True poses, CSV or NPY; - for standard input
    #[arg(value_name = "TRUTH")]
    truth: PathBuf,
    /// Poses to score, CSV or NPY; - for standard input
    #[arg(value_name = "RESULT")]
    result: PathBuf,
    /// The table that RESULT was restored from: adds the errors where it was missing (by gap
    /// length), observed and changed
    #[arg(long, value_name = "TABLE")]
    damaged: Option<PathBuf>,
    /// Unit of the printed errors; Lai et al. use asf. Tables are in centimeters
    #[arg(long, value_parser = choice::<LengthUnit>(), value_name = "UNIT", default_value = "cm")]
    units: LengthUnit,
    #[command(flatten)]
    json: JsonArgs,
    /// Frames per second, for tables without times
    #[arg(long, value_name = "F", value_parser = parse_rate, help_heading = "Input")]
    fps: Option<f64>,
    /// Point names for an NPY array: 23 (the CMU joints) or a comma-separated list
    #[arg(long, value_name = "LIST", help_heading = "Input")]
    joints: Option<String>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
}

pub fn work(args: &Args) -> Result<()> {
    args.json.prepare_report();
    let files = [Some(&args.truth), Some(&args.result), args.damaged.as_ref()];
    let inputs: Vec<InputArgs> = files
        .into_iter()
        .flatten()
        .map(|file| InputArgs {
            joints: args.joints.clone(),
            ..InputArgs::plain(vec![file.clone()], args.fps)
        })
        .collect();
    check_single_stdin(inputs.iter().flat_map(|t| &t.files))?;
    let tables = inputs.iter().map(|input| read_table(input, true, false));
    let tables: Vec<Table> = tables.collect::<Result<_>>()?;
    let truth = &tables[0];
    if truth.poses.frames() == 0 {
        return Err(Error::data(
            Place::file(&truth.name),
            "has no frames to compare",
        ));
    }
    for other in &tables[1..] {
        point_order(&truth.poses, &other.poses).map_err(|what| {
            let what = format!(
                "{what} as in {}; tables to compare must have the same frames",
                truth.name
            );
            Error::data(Place::file(&other.name), what)
        })?;
        let first = |table: &Table| table.poses.take.as_ref().and_then(|t| t.first().cloned());
        if let (Some(own), Some(wanted)) = (first(other), first(truth))
            && own != wanted
        {
            messages::info(&format!(
                "{}: its take {own} is compared with take {wanted}",
                other.name
            ));
        }
        let more = other.poses.points.len() - truth.poses.points.len();
        if more > 0 {
            let noun = if more == 1 { "point" } else { "points" };
            let (name, truth) = (&other.name, &truth.name);
            messages::info(&format!(
                "{name}: ignored {more} {noun} that {truth} does not have"
            ));
        }
    }
    let score = Score::new(&truth.poses, &tables[1].poses)?;
    let rates = inputs[0].rates(score.clock())?;
    let mut score = score.with_rates(rates);
    if let Some(damaged) = tables.get(2) {
        score = score.by_gap(&damaged.poses)?;
    }
    let report = score.finish_in(&value_name(args.units), args.units.centimeters());
    let output = args.output.as_deref();
    args.json.write_report(
        output,
        || messages::option_names().in_text(&report.to_string()),
        &report,
    )
}

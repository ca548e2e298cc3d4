//! Takes the noise out of captured poses.

use clap::Parser;
use posing::Result;
use posing::cli::args::{CommonArgs, InputArgs, OutputArgs, Space, parse_length};
use posing::cli::restoring::{self, ModelFlags, StatusFlag};
use posing::cli::{Outcome, run};
use posing::restore::denoise::Denoise;
use std::process::ExitCode;

/// Take the noise out of captured poses
///
/// Changes values to what they more likely were, by a model of what poses look like and, in a take (a table with times,
/// or --fps), by what neighbouring frames tell. Empty cells stay empty without --fill.
///
/// A model learnt by prior-train or ksvd-train knows which distances are rigid, and answers keep them.
///
/// Outliers are found and put back. In a take they are points that jump away from their path and back, and those that break
/// rigid distances. In a single frame (--per-frame) distances tell how noisy most points are: where that is little (up to
/// 1 cm), or a few are too far off for it, those few are outliers; points that are found clean, and exact, stay where they are.
#[derive(Parser)]
#[command(
    name = "denoise",
    version,
    after_help = "Examples:\n  posing denoise noisy.csv > clean.csv\n  posing denoise --noise 0.5cm --fill --status -o clean.csv noisy.csv\n  posing denoise --per-frame -m dict.npz --sparsity 3 --published poses.npy"
)]
struct Args {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    model: ModelFlags,
    /// The noise, outliers aside: standard deviation of a coordinate, cm or with a unit (1asf), or auto; where more than
    /// 1 cm is given, no point of a single frame is an outlier
    #[arg(long, value_name = "CM|auto", default_value = "auto", value_parser = parse_noise)]
    noise: Noise,
    /// Whether points that cannot be where they were captured count for nothing
    #[arg(long, value_enum, default_value = "auto")]
    outliers: Outliers,
    /// Fill in missing points as well
    #[arg(long)]
    fill: bool,
    /// Answer each frame by itself, in constant memory
    #[arg(long)]
    per_frame: bool,
    #[command(flatten)]
    status: StatusFlag,
    /// Where the poses stand: anywhere, or with the root at the origin and no global rotation
    #[arg(long, value_enum, default_value = "world")]
    space: Space,
    #[command(flatten)]
    out: OutputArgs,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Copy)]
struct Noise(Option<f64>);

fn parse_noise(text: &str) -> std::result::Result<Noise, String> {
    if text == "auto" {
        Ok(Noise(None))
    } else {
        parse_length(text).map(|n| Noise(Some(n)))
    }
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Outliers {
    /// They are looked for
    Auto,
    /// Every point counts
    None,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    let settings = Denoise {
        noise: args.noise.0,
        outliers: args.outliers == Outliers::Auto,
        fill: args.fill,
    };
    restoring::denoise(
        &restoring::Task {
            input: &args.input,
            out: &args.out,
            model: &args.model,
            world: args.space == Space::World,
            per_frame: args.per_frame,
            status: args.status.status,
        },
        settings,
    )
}

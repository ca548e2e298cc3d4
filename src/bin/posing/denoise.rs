//! Takes the noise out of captured poses.

use clap::Parser;
use posing::Result;
use posing::cli::args::OutlierDetection;
use posing::cli::restoring::{RestoringArgs, Task, restore};
use posing::pose::units::parse_length;
use posing::restore::Denoise;

/// Remove noise and outliers from poses
///
/// In a take (a table with times, or with --fps), smooths the path of each point as strongly as its
/// motion bears, and draws it toward a pose model's estimate, the more the noisier it is. Without
/// times, each frame is estimated by the model alone, and rigid distances, such as bone lengths,
/// are kept. Empty cells stay empty without --fill, except where the value stood under another
/// point's name.
///
/// Outliers are replaced by their estimate. In a take, they are points that jump off their path and
/// back, or that break rigid distances. In a single frame (--per-frame), rigid distances give the
/// noise level: if it is at most 1 cm, or a few points are too far off for it, those points are
/// outliers. Points without noise are not changed. In a take, left and right points that are
/// exchanged for some frames are put back, and the bones of the limbs get one length each.
#[derive(Parser)]
#[command(
    name = "denoise",
    version,
    after_help = "Examples:\
        \n  posing denoise noisy.csv > clean.csv\
        \n  posing denoise --noise 0.5cm --fill --status -o clean.csv noisy.csv\
        \n  posing denoise --per-frame -m dict.npz --sparsity 3 --published -o clean.npy poses.npy"
)]
pub struct Args {
    /// Standard deviation of the noise of a coordinate, outliers aside, in cm or with a unit
    /// (0.5cm, 1asf); auto: estimated from the data. Over 1 cm, single frames are not searched
    /// for outliers
    #[arg(long, value_name = "CM|auto", default_value = "auto", value_parser = parse_noise)]
    noise: Noise,
    /// Whether to detect outliers
    #[arg(long, value_enum, default_value = "auto")]
    outliers: OutlierDetection,
    /// Also fill missing points
    #[arg(long)]
    fill: bool,
    #[command(flatten)]
    restoring: RestoringArgs,
}

/// Noise of a coordinate, at most, cm.
const MOST_NOISE: f64 = 1000.0;

#[derive(Clone, Copy)]
struct Noise(Option<f64>);

fn parse_noise(text: &str) -> std::result::Result<Noise, String> {
    if text == "auto" {
        Ok(Noise(None))
    } else {
        match parse_length(text).map_err(|e| e.to_string())? {
            n if n <= MOST_NOISE => Ok(Noise(Some(n))),
            _ => Err(format!(
                "expected at most {MOST_NOISE} cm: no body is larger"
            )),
        }
    }
}

pub fn work(args: &Args) -> Result<()> {
    let options = Denoise {
        noise: args.noise.0,
        outliers: args.outliers == OutlierDetection::Auto,
        fill: args.fill,
        max_gap: None,
        fps: args.restoring.input.fps,
        per_frame: args.restoring.per_frame,
    };
    restore(&args.restoring, &Task::Denoise(options))
}

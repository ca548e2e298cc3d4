//! Draws a table as SVG, or as a page that plays it.

use clap::Parser;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::input::check_single_stdin;
use posing::cli::plot::{PlotTable, bones, name_of, runs, text_table};
use posing::cli::streams::write_bytes;
use posing::cli::{Outcome, messages, run};
use posing::evaluate::figure::{self, Layout};
use posing::evaluate::player;
use posing::evaluate::scene::{Figure, Scene};
use posing::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Frames that are drawn where nothing is said.
const SPREAD: usize = 6;
/// More frames than this make an SVG that nothing opens.
const MOST_DRAWN: usize = 500;

/// Draw poses as SVG, or as an HTML page that plays them
///
/// Several tables are drawn side by side; they must have the same frames and points, matched by name. Bones connect the
/// CMU joints; for other points, use --bones. If a table has the columns NAME.status (denoise --status, complete
/// --status), changed and inferred points are marked.
#[derive(Parser)]
#[command(
    name = "plot",
    version,
    after_help = "Examples:\n  posing plot -o walk.svg walk.csv\n  posing plot --frames 0,30,60 --overlaid -o compare.svg truth.csv restored.csv\n  posing plot --title \"A walk\" --names truth,damaged,restored -o walk.html truth.csv damaged.csv restored.csv\n  posing complete --status walk.csv | posing plot -o walk.html"
)]
struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Comma-separated names of the figures (default: the file names)
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    names: Vec<String>,
    /// Comma-separated pairs of points to connect, such as head-neck,neck-chest (default: the CMU bones)
    #[arg(long, value_name = "LIST")]
    bones: Option<String>,
    /// Show every N-th frame
    #[arg(long, value_name = "N", conflicts_with = "frames")]
    every: Option<usize>,
    /// Heading
    #[arg(long, value_name = "TEXT", default_value = "")]
    title: String,
    /// Text below the heading
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
    /// Credit line of the data, at the end
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// Comma-separated frames to draw, counted from 0 (default: six, evenly spaced)
    #[arg(long, value_name = "LIST", value_delimiter = ',', help_heading = "SVG")]
    frames: Vec<usize>,
    /// Draw the figures on top of each other
    #[arg(long, conflicts_with = "trail", help_heading = "SVG")]
    overlaid: bool,
    /// Draw all frames in one panel, at their positions in the world
    #[arg(long, help_heading = "SVG")]
    trail: bool,
    /// Direction of the viewer, in degrees: 0 at +z, 90 at +x (default: the figure's side)
    #[arg(
        long,
        value_name = "DEGREES",
        allow_negative_numbers = true,
        help_heading = "SVG"
    )]
    azimuth: Option<f64>,
    /// Angle at which the viewer looks down, in degrees (default: 12)
    #[arg(
        long,
        value_name = "DEGREES",
        allow_negative_numbers = true,
        help_heading = "SVG"
    )]
    elevation: Option<f64>,
    /// CSV file to show below the figures, such as scores
    #[arg(long, value_name = "CSV", help_heading = "Page")]
    table: Option<PathBuf>,
    /// Caption of --table
    #[arg(
        long,
        value_name = "TEXT",
        default_value = "",
        requires = "table",
        help_heading = "Page"
    )]
    caption: String,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    /// Output format (default: by FILE's extension)
    #[arg(long, value_enum, value_name = "FORMAT", help_heading = "Output")]
    to: Option<To>,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum To {
    /// Picture of some frames
    Svg,
    /// Self-contained page that plays all frames
    Html,
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    let to = format(args)?;
    let files = match args.input.files.as_slice() {
        [] => &[PathBuf::from("-")][..],
        files => files,
    };
    check_single_stdin(files)?;
    let names: Vec<String> = match args.names.len() {
        0 => files.iter().map(|f| name_of(f)).collect(),
        n if n == files.len() => args.names.clone(),
        n => {
            let what = format!("--names has {n} names for {} figures", files.len());
            return Err(Error::usage(what));
        }
    };
    let mut drawn: Vec<PlotTable> = Vec::new();
    for file in files {
        let mut table = PlotTable::read(&InputArgs {
            files: vec![file.clone()],
            ..args.input.clone()
        })?;
        if let Some(first) = drawn.first() {
            table.match_to(first)?;
        }
        drawn.push(table);
    }
    let clock = drawn.iter().find(|d| d.poses.time.is_some());
    let clock = &clock.unwrap_or(&drawn[0]).poses;
    let Some(rate) = args.input.rate(clock)? else {
        let what = "the table's times give no frame rate; give it with --fps";
        return Err(Error::usage(what));
    };
    let bones = bones(args.bones.as_deref(), &clock.points)?;
    if bones.is_empty() {
        messages::info("no bones to draw between these points; list them with --bones");
    }
    let figures = drawn.iter().zip(&names).map(|(table, name)| Figure {
        name,
        xyz: table.poses.xyz.view(),
        status: table.status.as_ref().map(|s| s.view()),
    });
    let caption = args.caption.as_str();
    let table = args.table.as_ref().map(|t| text_table(t, caption));
    let scene = Scene {
        title: &args.title,
        points: &clock.points,
        bones: &bones,
        rate,
        figures: figures.collect(),
        runs: &runs(clock, rate),
        note: args.note.as_deref(),
        table: table.transpose()?,
        credit: args.credit.as_deref(),
        ..Scene::default()
    };
    let text = match to {
        To::Svg => svg(args, &scene)?,
        To::Html => {
            let options = player::Options {
                every: args.every,
                ..player::Options::default()
            };
            player::page(&scene, &options)?
        }
    };
    write_bytes(args.output.as_deref(), text.as_bytes(), false)?;
    Ok(Outcome::Done)
}

/// What `--to` or the file's name says; a flag of the other format is refused rather than passed over.
fn format(args: &Args) -> Result<To> {
    let ending = args.output.as_ref().and_then(|p| p.extension());
    let ending = ending.map(|e| e.to_string_lossy().to_lowercase());
    let to = match (args.to, ending.as_deref()) {
        (Some(to), _) => to,
        (None, Some("svg")) => To::Svg,
        (None, Some("html" | "htm")) => To::Html,
        _ => {
            let what = "choose a format: -o FILE.svg, -o FILE.html, or --to svg|html";
            return Err(Error::usage(what));
        }
    };
    let picture = [
        ("--frames", !args.frames.is_empty()),
        ("--overlaid", args.overlaid),
        ("--trail", args.trail),
        ("--azimuth", args.azimuth.is_some()),
        ("--elevation", args.elevation.is_some()),
    ];
    let page = [("--table", args.table.is_some())];
    let (others, only) = match to {
        To::Svg => (&page[..], "a page"),
        To::Html => (&picture[..], "an SVG"),
    };
    match others.iter().find(|(_, given)| *given) {
        Some((flag, _)) => Err(Error::usage(format!("{flag} is for {only} only"))),
        None => Ok(to),
    }
}

fn svg(args: &Args, scene: &Scene<'_>) -> Result<String> {
    let frames = match args.every {
        Some(0) => return Err(Error::usage("--every 0: must be at least 1")),
        Some(every) => (0..scene.frames()).step_by(every).collect(),
        None if args.frames.is_empty() => scene.spread(SPREAD),
        None => args.frames.clone(),
    };
    if frames.len() > MOST_DRAWN {
        let what = format!(
            "{} frames in one SVG; at most {MOST_DRAWN} are possible, see --every",
            frames.len()
        );
        return Err(Error::usage(what));
    }
    let defaults = figure::Options::default();
    let options = figure::Options {
        layout: match (args.overlaid, args.trail) {
            (true, _) => Layout::Overlaid,
            (_, true) => Layout::Trail,
            _ => Layout::Grid,
        },
        azimuth: args.azimuth,
        elevation: args.elevation.unwrap_or(defaults.elevation),
        ..defaults
    };
    figure::svg(scene, &frames, &options)
}

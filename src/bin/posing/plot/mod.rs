//! Draws tables or meshes as SVG, or as a page that plays them.

mod meshes;
mod pairs;
mod point_columns;
mod tables;

use self::meshes::{MeshArgs, MeshPlot, UnitsTyped};
use self::pairs::{draw_pair, pair_names};
use self::tables::{PlotFormat, PlotTable, SvgArgs, bones, text_table};
use clap::Parser;
use posing::cli::args::{InputArgs, format_of};
use posing::cli::fbx_choice::FbxChoiceArgs;
use posing::cli::input::{check_single_stdin, or_stdin};
use posing::cli::messages;
use posing::cli::paths::OutputPath;
use posing::cli::streams::write_bytes;
use posing::draw::mesh_sequences::are_meshes;
use posing::draw::mesh_sequences::name_of;
use posing::draw::player;
use posing::draw::scene::runs;
use posing::draw::scene::{Figure, Scene};
use posing::io::command_files::are_one;
use posing::{Error, Result};
use std::path::PathBuf;

/// Draw poses or meshes as SVG, or as an HTML page that plays them
///
/// Reads pose tables, BVH, FBX, C3D, TRC and AMC files, and other programs' tables of points and
/// keypoints as JSON. Two takes, of any of these formats and rates, are drawn over each other on
/// one timeline, in seconds; their page also has them side by side, and tells how far apart the
/// points are that both have by name, in cm, over time and by point. More
/// takes are drawn side by side; they must have the same frames and points, matched by name. Bones
/// connect the CMU joints and of the skeletons of complete --map; a BVH or FBX file is drawn with
/// its own bones; for other points, use --bones. If a table has the columns NAME.status
/// (denoise --status, complete --status), changed and inferred points are marked. A page has curves
/// of a joint and a list of the gaps to click; NAME.sd and NAME.method say there how each gap was
/// filled, and how surely.
///
/// Meshes are OBJ, PLY, STL or OFF files, folders of them, or NPZ files with vertices (frames, V,
/// 3) and faces (F, 3), such as body-fit's. An SVG shows some of them, shaded, from the front. A
/// page plays them with WebGL: each folder and NPZ file is a sequence of one topology, and all
/// other files together are one more. Lengths are shown if the unit is known: give --units
/// (body-fit's files are in cm).
#[derive(Parser)]
#[command(
    name = "plot",
    version,
    after_help = "Examples:\n  posing plot -o walk.svg walk.csv\n  posing plot --frames 0,30,60 \
                  --overlaid -o compare.svg truth.csv restored.csv\n  posing plot --title \"A \
                  walk\" --names truth,damaged,restored -o walk.html truth.csv damaged.csv \
                  restored.csv\n  posing complete --status walk.csv | posing plot -o walk.html\n  \
                  posing plot -o both.html gaps.csv completed.csv\n  posing plot -o old.html \
                  old.bvh\n  posing plot --units m -o bodies.svg scan.obj body.ply\n  posing \
                  plot --fps 30 --names scans,fits -o bodies.html scans/ bodies.npz\n  posing \
                  plot --fps 30 --array completed,predicted -o fits.html fits.npz"
)]
pub struct Args {
    // Before `input`, whose flags it looks at.
    #[command(flatten)]
    units_typed: UnitsTyped,
    #[command(flatten)]
    input: InputArgs,
    /// Comma-separated names of the figures (default: the file names)
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    names: Vec<String>,
    /// Comma-separated pairs of points to connect, such as head-neck,neck-chest (default: the CMU
    /// bones)
    #[arg(long, value_name = "LIST")]
    bones: Option<String>,
    /// Show every N-th frame
    #[arg(long, value_name = "N", conflicts_with = "frames")]
    every: Option<usize>,
    /// Heading
    #[arg(long, value_name = "TEXT", default_value = "")]
    title: String,
    #[command(flatten)]
    svg: SvgArgs,
    #[command(flatten)]
    fbx: FbxChoiceArgs,
    /// Text below the heading
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
    /// Credit line of the data, at the end
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    #[command(flatten)]
    meshes: MeshArgs,
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
    output: Option<OutputPath>,
    /// Output format (default: by FILE's extension)
    #[arg(long, value_enum, value_name = "FORMAT", help_heading = "Output")]
    to: Option<PlotFormat>,
}

const NO_RATE: &str = "the table's times give no frame rate; give it with --fps";
const NO_BONES: &str = "no bones to draw between these points; list them with --bones";

pub fn work(args: &Args) -> Result<()> {
    let to = format_of(args.to, args.output.as_deref())?;
    // A flag of the other format is refused rather than ignored.
    if let (PlotFormat::Html, Some(flag)) = (to, args.svg.given()) {
        return Err(Error::usage(format!("{flag} is for an SVG only")));
    }
    if let (PlotFormat::Svg, Some(_)) = (to, &args.table) {
        return Err(Error::usage("--table is for a page only"));
    }
    let files = or_stdin(&args.input.files);
    check_single_stdin(&files)?;
    if let Some(table) = &args.table
        && let Some(file) = files.iter().find(|file| are_one(file, table))
    {
        return Err(Error::usage(format!(
            "--table {} is the input {}; name another file, such as one of scores",
            table.display(),
            file.display()
        )));
    }
    let text = if are_meshes(&files)? {
        meshes(args, to)?
    } else {
        poses(args, to, &files)?
    };
    write_bytes(args.output.as_deref(), text.as_bytes(), false)
}

fn meshes(args: &Args, to: PlotFormat) -> Result<String> {
    if args.bones.is_some() {
        return Err(Error::usage("--bones is for tables only"));
    }
    let table = args.table.as_ref().map(|t| text_table(t, &args.caption));
    let plot = MeshPlot {
        input: &args.input,
        units_typed: args.units_typed.0,
        meshes: &args.meshes,
        svg: &args.svg,
        names: &args.names,
        every: args.every,
        title: &args.title,
        note: args.note.as_deref(),
        credit: args.credit.as_deref(),
    };
    plot.draw(to, table.transpose()?)
}

fn poses(args: &Args, to: PlotFormat, files: &[PathBuf]) -> Result<String> {
    if !args.meshes.array.is_empty() {
        return Err(Error::usage("--array is for meshes only"));
    }
    let names: Vec<String> = match args.names.len() {
        0 if files.len() == 2 => pair_names(files),
        0 => files.iter().map(|f| name_of(f)).collect(),
        n if n == files.len() => args.names.clone(),
        n => {
            let what = format!("--names has {n} names for {} figures", files.len());
            return Err(Error::usage(what));
        }
    };
    let drawn = PlotTable::read_all(&args.input, files, &args.fbx)?;
    let table = args.table.as_ref().map(|t| text_table(t, &args.caption));
    let table = table.transpose()?;
    let drawn = match <[PlotTable; 2]>::try_from(drawn) {
        Ok(pair) => return draw_pair(args, to, &pair, &names, table),
        Err(other) => other,
    };
    let clock = drawn.iter().find(|d| d.poses.time.is_some());
    let clock = &clock.unwrap_or(&drawn[0]).poses;
    let Some(rate) = args.input.rate(clock)? else {
        return Err(Error::usage(NO_RATE));
    };
    let own = drawn[0].bones.clone().filter(|_| args.bones.is_none());
    let bones = own.map_or_else(|| bones(args.bones.as_deref(), &clock.points), Ok)?;
    if bones.is_empty() {
        messages::info(NO_BONES);
    }
    let figures = drawn.iter().zip(&names).map(|(table, name)| Figure {
        name,
        xyz: table.poses.xyz.view(),
        status: table.columns.status.as_ref().map(|s| s.view()),
        sd: table.columns.sd.as_ref().map(|s| s.view()),
        method: table.columns.method.as_ref().map(|m| m.view()),
    });
    let scene = Scene {
        title: &args.title,
        points: &clock.points,
        bones: &bones,
        rate,
        figures: figures.collect(),
        runs: &runs(clock, rate),
        note: args.note.as_deref(),
        table,
        credit: args.credit.as_deref(),
        ..Scene::default()
    };
    match to {
        PlotFormat::Svg => args.svg.draw(&scene, args.every),
        PlotFormat::Html => player::page(&scene, args.every),
    }
}

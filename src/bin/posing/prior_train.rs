//! Learns a prior of poses of any kind.

use clap::Parser;
use posing::Result;
use posing::cli::args::{SeedArgs, Space, TableArgs};
use posing::cli::choice::{choice, value_name};
use posing::cli::motion_library::MotionArgs;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::training::{MultiscaleArgs, ready};
use posing::cli::{messages, streams};
use posing::prior::multiscale;
use posing::prior::provenance::entry;
use posing::prior::tuning::Tuning;
use posing::prior::{Kind, TrainOptions};

/// Train a pose model, or keep takes as a library of motion
///
/// denoise and complete use the model (-m MODEL.npz). Its error model is tuned for each task on
/// held-out poses; then the model is trained on all poses. Train on several takes: a single one
/// cannot be held out. Frames with missing points are skipped and counted.
///
/// With --motion nothing is trained: the takes are kept as a library of motion.
#[derive(Parser)]
#[command(
    name = "prior-train",
    version,
    after_help = "Examples:\
        \n  posing prior-train -o model.npz poses.csv\
        \n  posing prior-train --kind gaussian --space body -o gaussian.npz poses.npy\
        \n  posing prior-train --motion -o motion.npz motions/*.bvh\
        \n  posing denoise -m model.npz noisy.csv -o clean.csv"
)]
pub struct Args {
    #[command(flatten)]
    tables: TableArgs,
    /// Kind of model (default: multiscale, or nlm for more than 250 points, for which it would
    /// take too long)
    #[arg(long, value_name = "KIND", value_parser = kinds())]
    kind: Option<String>,
    /// Space in which poses are learned
    #[arg(long, value_parser = choice::<Space>(), default_value = "world")]
    space: Space,
    #[command(flatten)]
    size: MultiscaleArgs,
    #[command(flatten)]
    motion: MotionArgs,
    /// Credit line of the training data, stored in the model
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// Output file
    #[arg(short, long, value_name = "MODEL.npz")]
    output: OutputPath,
    #[command(flatten)]
    seed: SeedArgs,
}

/// The kinds, with what each is.
fn kinds() -> clap::builder::PossibleValuesParser {
    let value = |kind: Kind| {
        let value = clap::builder::PossibleValue::new(kind.name()).help(kind.description());
        match kind {
            // Its former name.
            Kind::Multiscale => value.alias("blocks"),
            _ => value,
        }
    };
    Kind::all()
        .into_iter()
        .map(value)
        .collect::<Vec<_>>()
        .into()
}

pub fn work(args: &Args) -> Result<()> {
    if args.motion.motion {
        let mut model = args.motion.model(&args.tables.files)?;
        model.meta.credit.clone_from(&args.credit);
        return streams::write_bytes(Some(&args.output), &model.to_bytes()?, true);
    }
    let world = args.space == Space::World;
    let tables = args.tables.input();
    let poses = ready(&tables, tables.files.clone(), world, None)?;
    let kind: Kind = match &args.kind {
        Some(name) => name.parse()?,
        None => Kind::for_points(poses.points.len()),
    };
    if args.kind.is_none() && kind != Kind::default() {
        messages::info(&format!(
            "{} points are too many for the kind {}: training {}; --kind says otherwise",
            poses.points.len(),
            Kind::default().name(),
            kind.name()
        ));
    }
    let options = TrainOptions {
        seed: args.seed.seed,
        ..TrainOptions::default()
    };
    let bar = Progress::new("prior-train", 0);
    let report = &mut |what: &str| {
        bar.set_message(what.to_string());
        messages::debug(what);
    };
    let mut model = match args.size.settings(kind)? {
        Some(settings) => multiscale::model(&poses, &options, &settings, report)?,
        None => kind.train_with_progress(&poses, &options, report)?,
    };
    drop(bar);
    if Tuning::read(&model).is_some_and(|t| t.tested == 0) {
        messages::info("too few poses to hold any out: the model is not tuned");
    }
    if kind == Kind::Multiscale && poses.takes.len() < 2 {
        messages::info(
            "a single take cannot be held out: all levels get equal weight and unlike poses are \
             not reported; train on several takes",
        );
    }
    model.meta.credit.clone_from(&args.credit);
    let mut flags = vec![
        ("kind", kind.name().to_string()),
        ("space", value_name(args.space)),
        ("seed", args.seed.seed.to_string()),
    ];
    if let Some(cells) = &args.size.cells {
        let cells: Vec<String> = cells.iter().map(usize::to_string).collect();
        flags.push(("cells", cells.join(",")));
    }
    flags.extend(args.size.leaves.map(|n| ("leaves", n.to_string())));
    let step = entry("prior-train", &flags, poses.digests());
    model.meta.history.push(step);
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)
}

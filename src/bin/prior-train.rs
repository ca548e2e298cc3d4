//! Learns a prior of poses of any kind.

use clap::{Parser, ValueEnum};
use posing::cli::flags::{Common, Seed, Space, TableIn};
use posing::cli::progress::Progress;
use posing::cli::training::ready;
use posing::cli::{Outcome, run, say, streams};
use posing::prior::blocks;
use posing::prior::train::{DEFAULT, KINDS, Training, train};
use posing::prior::training::entry;
use posing::prior::tuning::{HoldBack, Tuning};
use posing::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

/// Learn a prior of poses of any kind
///
/// Any of them is a model for denoise and complete. How much each is trusted is tuned, task by task, on a part of the
/// poses that it is not learnt from; then it is learnt from all of them. Poses that lack a point are not learnt from.
#[derive(Parser)]
#[command(
    name = "prior-train",
    version,
    after_help = "Examples:\n  posing prior-train -o model.npz poses.csv\n  posing prior-train --kind gaussian --space body -o gaussian.npz poses.npy\n  posing denoise -m model.npz noisy.csv -o clean.csv"
)]
struct Args {
    #[command(flatten)]
    input: TableIn,
    /// What kind of prior
    #[arg(long, value_name = "KIND", default_value = DEFAULT, value_parser = kinds())]
    kind: String,
    /// What is held back to tune on: whole takes (for motion not seen before), or frames at random; blocks hold back both
    #[arg(long, value_enum, value_name = "WHAT", default_value = "takes")]
    hold_back: HoldBackFlag,
    /// Where poses are learnt: in the model's space, to which each is carried, or as the rows are
    #[arg(long, value_enum, default_value = "world")]
    space: Space,
    /// For blocks: how many cells each level has, rising, with commas (default: 1,5,20,80,300)
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        help_heading = "Size"
    )]
    cells: Option<Vec<usize>>,
    /// For blocks: keep at most so many of the poses as blocks of their own (default: 80000)
    #[arg(long, value_name = "N", help_heading = "Size")]
    leaves: Option<usize>,
    /// Words that must go with the data (kept in the model)
    #[arg(long, value_name = "TEXT")]
    credit: Option<String>,
    /// The prior
    #[arg(short, long, value_name = "MODEL.npz")]
    output: PathBuf,
    #[command(flatten)]
    seed: Seed,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, ValueEnum)]
enum HoldBackFlag {
    /// About a fifth of the poses, as whole takes
    Takes,
    /// A fifth of the frames
    Frames,
}

/// The kinds, with what each is.
fn kinds() -> clap::builder::PossibleValuesParser {
    let value = |(name, what): &(&'static str, &'static str)| {
        clap::builder::PossibleValue::new(*name).help(*what)
    };
    KINDS.iter().map(value).collect::<Vec<_>>().into()
}

/// Blocks of another size than the usual, where that is asked for.
fn size(args: &Args) -> Result<Option<blocks::Settings>> {
    if args.cells.is_none() && args.leaves.is_none() {
        return Ok(None);
    }
    if args.kind != "blocks" {
        let what = "--cells and --leaves are for --kind blocks";
        return Err(Error::usage(what));
    }
    let mut settings = blocks::Settings::default();
    if let Some(cells) = &args.cells {
        settings.cells.clone_from(cells);
    }
    if let Some(leaves) = args.leaves {
        settings.leaves_kept = leaves;
    }
    Ok(Some(settings))
}

fn main() -> ExitCode {
    run(|args: Args| work(&args))
}

fn work(args: &Args) -> Result<Outcome> {
    args.common.apply()?;
    let world = args.space == Space::World;
    let poses = ready(&args.input, args.input.files.clone(), world, None)?;
    let (hold_back, held) = match args.hold_back {
        HoldBackFlag::Takes => (HoldBack::Takes, "takes"),
        HoldBackFlag::Frames => (HoldBack::Frames, "frames"),
    };
    let training = Training {
        poses: &poses,
        world,
        seed: args.seed.seed,
        hold_back,
    };
    let bar = Progress::new("prior-train", 0);
    let report = &mut |what: &str| {
        bar.tell(what.to_string());
        say::detail(what);
    };
    let mut model = match size(args)? {
        Some(settings) => blocks::model(&training, &settings, report)?,
        None => train(&args.kind, &training, report)?,
    };
    drop(bar);
    if Tuning::read(&model).is_some_and(|t| t.tested == 0) {
        say::note("too few poses to hold any back: nothing is tuned");
    }
    if args.kind == "blocks" && poses.takes.len() < 2 {
        say::note(
            "a single take: none can be held back, so the levels of blocks weigh alike and no pose is told to be unlike those seen",
        );
    }
    model.meta.credit.clone_from(&args.credit);
    let mut flags = vec![
        ("kind", args.kind.clone()),
        ("hold-back", held.to_string()),
        ("space", args.space.name().to_string()),
        ("seed", args.seed.seed.to_string()),
    ];
    if let Some(cells) = &args.cells {
        let cells: Vec<String> = cells.iter().map(usize::to_string).collect();
        flags.push(("cells", cells.join(",")));
    }
    flags.extend(args.leaves.map(|n| ("leaves", n.to_string())));
    let step = entry("prior-train", &flags, poses.digests());
    model.meta.history.push(step);
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)?;
    Ok(Outcome::Done)
}

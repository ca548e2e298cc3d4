//! Learns a distance of poses from labeled pairs.

use clap::Parser;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use posing::cli::args::{SeedArgs, TimedTableArgs, parse_if, parse_positive};
use posing::cli::feature_table::JointMapArgs;
use posing::cli::metric_takes::read_takes;
use posing::cli::paths::OutputPath;
use posing::cli::{input, messages, streams};
use posing::metric::train::Learner;
use posing::metric::{PoseFeatures, TrainSettings, Trained, train};
use posing::prior::provenance::{digest, entry};
use posing::{Error, Place, Result};
use std::path::PathBuf;

/// Learn how alike poses are from labeled pairs
///
/// Learns a metric, a distance of poses, from pairs of frames that are alike and from poses without
/// labels (RDSR). retrieve, pose-distance and transition use it. More pairs help slowly: of ten
/// poses found across people .881 were of the right action with 50 pairs, .887 with 150, .893 with
/// 500 (HDM05). rdsr, rca and nca learn from pairs of label 1
/// alone and leave those of label 0 out; l2 learns nothing.
///
/// A label says that two takes show the same around two frames. Within --reach seconds of them,
/// each pose is paired with the nearest poses of the takes that it is linked to. For labels that
/// hold for one instant only, such as transitions, give a short reach; 0 takes the pairs as they
/// are.
#[derive(Parser)]
#[command(
    name = "rdsr-train",
    version,
    after_help = "Examples:\
        \n  posing rdsr-train --pairs pairs.csv -o metric.npz poses.csv\
        \n  posing rdsr-train --paper --pairs pairs.csv -o paper.npz poses.csv\
        \n  posing retrieve -m metric.npz -k 10 --database poses.csv walk.csv",
    after_long_help = "Files:\n  pairs.csv: a_take,a_frame,b_take,b_frame,label; label 1: alike, \
                       0: not; frames count from 0 within their take"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Labeled pairs of frames of the input; l2 needs none. Where people contradict each other
    /// about a pair, the majority counts, by its lead
    #[arg(long, value_name = "PAIRS.csv")]
    pairs: Option<PathBuf>,
    #[command(flatten)]
    map: JointMapArgs,
    /// What describes a pose: geometric features (gpd), distances of joints (jrf), coordinates
    /// with velocities (jc), rotations with velocities (jo), what game engines compare (game)
    /// [default: gpd]
    #[arg(
        long,
        value_name = "SET",
        value_parser = ["gpd", "gpd+a", "jrf", "jc", "jo", "game"],
        hide_possible_values = true
    )]
    features: Option<String>,
    /// How the metric is learned
    #[arg(long, value_parser = learner(), value_name = "METHOD", default_value = "rdsr")]
    learner: Learner,
    /// Seconds to the frames before and after that are described too; 0: none [default: 0.2]
    #[arg(long, value_name = "S", value_parser = seconds)]
    window: Option<f64>,
    /// Seconds about a labeled frame for which its label holds [default: 1; with --paper 0]
    #[arg(long, value_name = "S", value_parser = seconds)]
    reach: Option<f64>,
    /// The method as Chen et al. (2011) published it: all features of one frame at unit length,
    /// ratio of traces, pairs as labeled; finds poses across people far worse
    #[arg(long, conflicts_with_all = ["features", "window", "learner", "reach"])]
    paper: bool,
    /// Poses without labels to learn from, drawn from the input, 0 to 20000 (8 N² bytes); 0: pairs
    /// alone
    #[arg(
        long = "unlabelled",
        alias = "unlabeled",
        value_name = "N",
        default_value_t = 5000,
        value_parser = clap::value_parser!(u32).range(..=20_000)
    )]
    unlabeled: u32,
    /// Dimensions of the metric, for learners of a projection: all but l2, lms and boost [default:
    /// 50]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=2000))]
    rank: Option<u16>,
    /// For rdsr: weight of the pairs against the unlabeled poses [default: 1]
    #[arg(long, value_name = "A", value_parser = parse_positive)]
    alpha: Option<f64>,
    /// For rdsr: sparsity of the graph of unlabeled poses, above 0 to 1 [default: 0.05]
    #[arg(long, value_name = "G", value_parser = share)]
    gamma: Option<f64>,
    /// Output file
    #[arg(short, long, value_name = "METRIC.npz")]
    output: OutputPath,
    #[command(flatten)]
    seed: SeedArgs,
}

#[cfg(feature = "papers")]
fn of_papers() -> Vec<Learner> {
    let all = posing::metric::PublishedLearner::ALL.iter();
    all.map(|learner| Learner::Other(learner)).collect()
}

#[cfg(not(feature = "papers"))]
fn of_papers() -> Vec<Learner> {
    Vec::new()
}

/// The methods, with what each is.
fn learner() -> impl TypedValueParser<Value = Learner> {
    let all: Vec<Learner> = [Learner::Rdsr, Learner::L2]
        .into_iter()
        .chain(of_papers())
        .collect();
    let values = (all.iter()).map(|l| PossibleValue::new(l.name()).help(l.description()));
    let values: PossibleValuesParser = values.collect::<Vec<_>>().into();
    values.map(move |name| {
        let found = all.iter().find(|l| l.name() == name);
        *found.expect("one of the values")
    })
}

fn seconds(text: &str) -> std::result::Result<f64, String> {
    parse_if(text, |v| (0.0..=60.0).contains(&v), "seconds, 0 to 60")
}

fn share(text: &str) -> std::result::Result<f64, String> {
    parse_if(text, |v| v > 0.0 && v <= 1.0, "a number above 0 to 1")
}

pub fn work(args: &Args) -> Result<()> {
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, &args.pairs)?;
    if args.pairs.is_none() && args.learner != Learner::L2 {
        return Err(Error::usage(
            "--pairs PAIRS.csv is missing: labeled pairs to learn from; without labels, retrieve \
             and pose-distance need no metric",
        ));
    }
    let map = args.map.joint_map()?;
    let settings = settings(args, map.clone());
    let needs_rate = settings.needs_rate();
    let takes = read_takes(&tables, tables.files.clone(), Some(&map), needs_rate)?;
    let pairs = match &args.pairs {
        Some(path) => takes.read_pairs(path)?,
        None => Vec::new(),
    };
    let trained =
        train(&takes.takes, &pairs, &settings).map_err(|e| e.at(Place::file(&takes.source)))?;
    report(args.learner, &trained);
    let mut model = trained.metric.to_model();
    let flags = [
        ("learner", args.learner.name().to_string()),
        ("rank", settings.rdsr.rank.to_string()),
        ("alpha", settings.rdsr.alpha.to_string()),
        ("gamma", settings.rdsr.gamma.to_string()),
        ("ridge", settings.rdsr.ridge.to_string()),
        ("reach", settings.reach.to_string()),
        ("paper", args.paper.to_string()),
        ("pairs", pairs.len().to_string()),
        ("unlabelled", trained.unlabeled.to_string()),
        ("seed", settings.seed.to_string()),
    ];
    let poses = takes.poses.xyz.mapv(|v| v as f32);
    let inputs = vec![digest(&takes.poses.points, poses.view())];
    model.meta.history.push(entry("rdsr-train", &flags, inputs));
    streams::write_bytes(Some(&args.output), &model.to_bytes()?, true)
}

fn settings(args: &Args, map: posing::metric::JointMap) -> TrainSettings {
    let mut settings = if args.paper {
        TrainSettings::paper(map)
    } else {
        TrainSettings::new(map)
    };
    if let Some(name) = &args.features {
        settings.features = PoseFeatures::of_name(name).unwrap_or(settings.features);
    }
    settings.learner = args.learner;
    settings.window = args.window.unwrap_or(settings.window);
    settings.reach = args.reach.unwrap_or(settings.reach);
    settings.unlabeled = args.unlabeled as usize;
    settings.seed = args.seed.seed;
    let rdsr = &mut settings.rdsr;
    rdsr.rank = args.rank.map_or(rdsr.rank, usize::from);
    rdsr.alpha = args.alpha.unwrap_or(rdsr.alpha);
    rdsr.gamma = args.gamma.unwrap_or(rdsr.gamma);
    settings
}

fn report(learner: Learner, trained: &Trained) {
    for (step, seconds) in &trained.seconds {
        messages::debug(&format!("{step}: {seconds:.2} s"));
    }
    if let Some(violation) = trained.violation {
        messages::debug(&format!(
            "sparse graph: optimality violated by at most {violation:.1e}"
        ));
    }
    if !trained.has_converged {
        messages::debug("the steps of the learner ended at their limit");
    }
    if trained.ignored > 0 {
        messages::info(&format!(
            "ignored {} pairs: joints missing",
            trained.ignored
        ));
    }
    if trained.contradicted > 0 {
        messages::info(&format!(
            "labeled both 1 and 0: {} pairs, of which the difference of the numbers counts",
            trained.contradicted
        ));
    }
    if learner == Learner::L2 {
        messages::info("nothing is learned: the features are scaled by how they vary");
        return;
    }
    let without = match trained.unlabeled {
        0 => String::new(),
        n => format!(", and {n} poses without labels"),
    };
    messages::info(&format!(
        "learned from {} pairs of label 1, {} of label 0{without}",
        trained.alike, trained.unlike
    ));
}

//! `evaluate metric` around the library: its flags, the classes of takes, its files.

use super::{parsed, write};
use clap::Args;
use posing::cli::args::TimedTableArgs;
use posing::cli::feature_table::JointMapArgs;
use posing::cli::json_report::JsonArgs;
use posing::cli::metric_takes::{MetricTakes, read_takes};
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::take_classes;
use posing::cli::{input, messages};
use posing::evaluate::retrieval::{ClassifiedTake, LabelRule, MetricSettings, TakeSet, test};
use posing::metric::JointMap;
use posing::metric::blend_test::ClipRange;
use posing::metric::clip::Clip;
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// Flags of `evaluate metric`.
#[derive(Debug, Clone, Args)]
pub struct EvaluateMetricArgs {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// What is done in each take, and by whom: take,class,subject; without a subject it is the
    /// take's name up to the first _
    #[arg(long, value_name = "CLASSES.csv")]
    classes: PathBuf,
    /// Comma-separated rules that label pairs: class, phase, blend
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        value_parser = rule,
        default_value = "class,phase,blend"
    )]
    labels: Vec<LabelRule>,
    /// Comma-separated subjects to test on (default: every second one)
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    test: Vec<String>,
    /// Pairs of each label, to learn from and to test on
    #[arg(long, value_name = "N", default_value_t = 500)]
    pairs: usize,
    /// Compare published distances only: no table of learners, ranks and numbers of poses
    #[arg(long)]
    short: bool,
    #[command(flatten)]
    map: JointMapArgs,
    /// Seed of all random draws
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Also write metric.csv, metric.json and report.html into DIR
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    output: Option<OutputPath>,
    #[command(flatten)]
    json: JsonArgs,
}

fn rule(text: &str) -> std::result::Result<LabelRule, String> {
    LabelRule::of_name(text.trim()).ok_or_else(|| "expected class, phase or blend".into())
}

/// Tests distances of poses, and prints tables.
///
/// # Errors
/// [`Error::Data`]: a file cannot be read, a take has no class, or there is nothing to learn from
/// or to test on.
pub fn evaluate_metric(args: &EvaluateMetricArgs) -> Result<()> {
    args.json.prepare_report();
    let tables = args.tables.input();
    input::check_single_stdin_with(&tables, [&args.classes])?;
    let map = args.map.joint_map()?;
    let takes = read_takes(&tables, tables.files.clone(), Some(&map), true)?;
    let source = takes.source.clone();
    let set = classified(takes, &args.classes, &map)?;
    let subjects = set.subjects();
    if let Some(unknown) = args.test.iter().find(|t| !subjects.contains(t)) {
        let what = format!("--test {unknown}: the subjects are {}", subjects.join(", "));
        return Err(Error::usage(what));
    }
    let settings = MetricSettings {
        rules: args.labels.clone(),
        tested: if args.test.is_empty() {
            subjects.into_iter().skip(1).step_by(2).collect()
        } else {
            args.test.clone()
        },
        pairs: args.pairs,
        seed: args.seed,
        is_short: args.short,
    };
    let bar = Progress::new("evaluate metric", Progress::SHARES);
    let report = test(&set, &map, &settings, &mut |what, share| {
        bar.set_share(what, share);
    })
    .map_err(|e| e.at(Place::file(source)))?;
    drop(bar);
    if let Some(folder) = &args.output {
        write(
            folder,
            &[
                ("metric.csv", report.csv()),
                ("metric.json", report.json()),
                ("report.html", report.html()),
            ],
        )?;
    }
    args.json
        .write_report(None, || report.text(), parsed(&report.json())?)
}

/// Takes with their classes; takes without one are left out, and said so.
fn classified(takes: MetricTakes, path: &Path, map: &JointMap) -> Result<TakeSet> {
    let classes = take_classes::read(path)?;
    let mut set = TakeSet::default();
    let mut left_out = 0;
    let ranges = takes.poses.takes().into_iter();
    for ((range, name), body) in ranges.zip(&takes.names).zip(takes.takes) {
        let Some(line) = classes.get(name) else {
            left_out += 1;
            continue;
        };
        let rate = body.rate.unwrap_or(1.0);
        let clip = Clip::new(takes.poses.slice(range), rate, map)
            .map_err(|e| e.at(Place::file(&takes.source)))?;
        set.about.push(ClassifiedTake {
            name: name.clone(),
            class: line.class.clone(),
            subject: line.subject().to_string(),
        });
        set.ranges.push(ClipRange::measure(&clip));
        set.takes.push(body);
        set.clips.push(clip);
    }
    if left_out > 0 {
        messages::info(&format!(
            "{left_out} takes are left out: {} gives them no class",
            path.display()
        ));
    }
    if set.about.is_empty() {
        Err(Error::data(
            Place::file(path.display().to_string()),
            "gives no class to any take of the input",
        ))
    } else {
        Ok(set)
    }
}

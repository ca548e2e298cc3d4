//! Finds poses like given ones, and motions like given ones.

mod matches;

use self::matches::Matches;
use clap::Parser;
use posing::cli::args::{TimedTableArgs, parse_if};
use posing::cli::feature_table::FittingMapArgs;
use posing::cli::metric_takes::{MetricTakes, open_index, open_metric, read_takes};
use posing::cli::paths::OutputPath;
use posing::cli::take_classes;
use posing::cli::{input, messages, streams};
use posing::io::csv::push_cell;
use posing::io::text::{excerpt, push_f32, push_f64};
use posing::metric::{EventSearch, Examples, PoseIndex, PoseMetric};
use posing::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// Find the poses of a database that are most like given ones, or the motions
///
/// Writes take, frame, rank, found_take, found_frame, distance, found_time: for each frame of the
/// input the nearest frames of the database, nearest first, exactly. Frames count from 0 within
/// their take; times are seconds.
///
/// With --events each take of the input is one example of a motion, such as a kick cut out with
/// trim, and found are the places where it is done: found_take, from, to, distance, nearest first.
/// An event is done at half to twice the pace of the example and overlaps no other.
///
/// Poses are alike by a metric of rdsr-train, or without one by coordinates and velocities in the
/// body's own frame: any skeleton whose joints are known by name, of any size, facing anywhere.
#[derive(Parser)]
#[command(
    name = "retrieve",
    version,
    after_help = "Examples:\n  posing retrieve -k 10 --database poses.csv walk.csv\n  \
                  posing retrieve --events --database poses.csv walk.csv\n  \
                  posing retrieve --events --like 07_01 --database poses.csv walk.csv\n  \
                  posing retrieve -m metric.npz --every 12 --other-takes --database \
                  poses.csv poses.csv\n  posing retrieve -m metric.npz --every 12 --classes \
                  classes.csv --scope 5,10 --picture found.svg --database poses.csv walk.csv > \
                  found.csv"
)]
pub struct Args {
    #[command(flatten)]
    tables: TimedTableArgs,
    /// Metric, by rdsr-train [default: coordinates and velocities, of a frame and of those .2 s
    /// before and after it]
    #[arg(short, long, value_name = "METRIC.npz")]
    model: Option<PathBuf>,
    #[command(flatten)]
    map: FittingMapArgs,
    /// Table of the poses that are searched; same --fps as the input
    #[arg(long, value_name = "DB", required_unless_present = "index")]
    database: Option<PathBuf>,
    /// With --database: keep it described in FILE; without: search that FILE, which is read far
    /// faster than a table and has its own metric
    #[arg(long, value_name = "FILE")]
    index: Option<OutputPath>,
    /// Poses to find for each frame, or events [default: 10; all, with --within or --like]
    #[arg(short, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    k: Option<u32>,
    /// Every N-th frame of each take only, in the input and the database; movement is seen from
    /// all frames
    #[arg(
        long,
        value_name = "N",
        default_value = "1",
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    every: u32,
    /// Find poses of takes with other names only
    #[arg(long)]
    other_takes: bool,
    /// Find where the motion of the input is done
    #[arg(long, conflicts_with_all = ["classes", "picture", "every"], help_heading = "Events")]
    events: bool,
    /// Greatest distance of an event
    #[arg(
        long,
        value_name = "D",
        requires = "events",
        value_parser = posing::cli::args::parse_positive,
        help_heading = "Events"
    )]
    within: Option<f64>,
    /// Comma-separated takes of the database that show the motion: events are as near as the
    /// farthest of these
    #[arg(
        long,
        value_name = "TAKES",
        value_delimiter = ',',
        requires = "events",
        conflicts_with = "within",
        help_heading = "Events"
    )]
    like: Vec<String>,
    /// Seconds between two events of a take, at least; many: one event a take, which ranks the
    /// takes
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        requires = "events",
        value_parser = seconds,
        help_heading = "Events"
    )]
    apart: f64,
    /// What is done in each take (take,class): adds the column right, 1 where the take found is of
    /// the query's class, and prints the share of these
    #[arg(long, value_name = "CLASSES.csv")]
    classes: Option<PathBuf>,
    /// Comma-separated numbers of poses found at which --classes judges (default: that of -k)
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        requires = "classes",
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    scope: Vec<u32>,
    /// Draw some queries and the poses found for them
    #[arg(
        long,
        value_name = "FILE.svg",
        requires = "database",
        help_heading = "Output"
    )]
    picture: Option<OutputPath>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<OutputPath>,
}

fn seconds(text: &str) -> std::result::Result<f64, String> {
    parse_if(text, |v| (0.0..=1e6).contains(&v), "seconds, 0 or more")
}

/// Poses or events that are found, unless one says otherwise.
const MOST: u32 = 10;

pub fn work(args: &Args) -> Result<()> {
    let index = args.index.as_deref().filter(|_| args.database.is_none());
    let index = index.map(Path::to_path_buf);
    let others = (args.database.iter().chain(&args.model))
        .chain(&args.classes)
        .chain(&index);
    let input = args.tables.input();
    input::check_single_stdin_with(&input, others)?;
    let most = args.k.unwrap_or(MOST);
    if let Some(scope) = args.scope.iter().find(|s| **s > most) {
        return Err(Error::usage(format!("--scope {scope} is above -k {most}")));
    }
    let (table, database) = database(args)?;
    let queries = read(args, input.files, &database.metric)?;
    let described = queries.index(&database.metric, args.every as usize);
    if args.events {
        find_events(args, &described, &database)
    } else {
        let poses = [(Some(&queries), &described), (table.as_ref(), &database)];
        find_poses(args, most as usize, poses)
    }
}

/// What is searched, and its table where it comes from one.
fn database(args: &Args) -> Result<(Option<MetricTakes>, PoseIndex)> {
    let model = args.model.as_deref().map(open_metric).transpose()?;
    let Some(table) = &args.database else {
        // clap asks for one of both.
        let path = args.index.as_deref().unwrap_or(Path::new(""));
        let index = open_index(path)?;
        if model.is_some_and(|model| model != index.metric) {
            let what = "is described by another metric than that of -m; leave -m out, or give \
                        --database to describe it anew";
            return Err(Error::data(Place::file(path.display().to_string()), what));
        }
        return Ok((None, index));
    };
    let metric = match model {
        Some(metric) => metric,
        None => PoseMetric::of_coordinates(args.map.joint_map(None)?.unwrap_or_default()),
    };
    let takes = read(args, vec![table.clone()], &metric)?;
    // An index answers for any frames.
    let every = if args.index.is_some() { 1 } else { args.every };
    let index = takes.index(&metric, every as usize);
    if let Some(path) = &args.index {
        streams::write_bytes(Some(path), &index.to_model().to_bytes()?, true)?;
    }
    Ok((Some(takes), index))
}

/// Takes of files, whose joints a learned metric knows, or --map, or the points' names.
fn read(args: &Args, files: Vec<PathBuf>, metric: &PoseMetric) -> Result<MetricTakes> {
    let learned = (!metric.is_of_coordinates()).then_some(metric);
    if learned.is_some() && args.map.is_given() {
        return Err(Error::usage(
            "--map cannot be used with a learned metric, which has its own",
        ));
    }
    let map = args.map.joint_map(learned)?;
    read_takes(
        &args.tables.input(),
        files,
        map.as_ref(),
        metric.needs_rate(),
    )
}

fn find_events(args: &Args, examples: &PoseIndex, database: &PoseIndex) -> Result<()> {
    let motions = Examples::new(examples, database)?;
    let mut search = EventSearch {
        most: usize::MAX,
        apart: args.apart,
        within: args.within.map_or(f32::INFINITY, |d| d as f32),
    };
    if !args.like.is_empty() {
        search.within = farthest(args, &motions, database, &search)?;
        messages::info(&format!(
            "the farthest of {} takes that show the motion is at distance {:.4}",
            args.like.len(),
            search.within
        ));
    }
    let is_limited = search.within.is_finite();
    let most = args.k.or((!is_limited).then_some(MOST));
    search.most = most.map_or(usize::MAX, |k| k as usize);
    let own: Vec<&str> = examples.takes.iter().map(|t| t.name.as_str()).collect();
    let allowed =
        |take: usize| !args.other_takes || !own.contains(&database.takes[take].name.as_str());
    let found = motions.find(&search, allowed);
    let mut out = streams::open_output(args.output.as_deref(), false)?;
    out.write(b"found_take,from,to,distance\n")?;
    for event in &found {
        let mut line = Vec::new();
        push_cell(&mut line, database.takes[event.take].name.as_bytes());
        for seconds in [event.from, event.to] {
            line.push(b',');
            push_f64(&mut line, seconds);
        }
        line.push(b',');
        push_f32(&mut line, event.distance);
        line.push(b'\n');
        out.write(&line)?;
    }
    messages::info(&format!(
        "found {} events in {} takes",
        found.len(),
        database.takes.len()
    ));
    out.finish()
}

/// The greatest distance at which the takes of --like show the motion.
fn farthest(
    args: &Args,
    motions: &Examples<'_>,
    database: &PoseIndex,
    search: &EventSearch,
) -> Result<f32> {
    let mut farthest = 0.0f32;
    for name in &args.like {
        let place = || {
            Place::file(
                args.database
                    .as_deref()
                    .or(args.index.as_deref())
                    .map_or(String::new(), |path| path.display().to_string()),
            )
        };
        if !database.takes.iter().any(|take| take.name == *name) {
            let what = format!("has no take \"{}\", which --like names", excerpt(name));
            return Err(Error::data(place(), what));
        }
        let found = motions.find(&EventSearch { most: 1, ..*search }, |take| {
            database.takes[take].name == *name
        });
        let Some(nearest) = found.first() else {
            let what = format!(
                "take \"{}\", which --like names, is shorter than half the motion",
                excerpt(name)
            );
            return Err(Error::data(place(), what));
        };
        farthest = farthest.max(nearest.distance);
    }
    Ok(farthest)
}

/// The queries and the database: their tables, for pictures, and as they are described.
type Described<'a> = (Option<&'a MetricTakes>, &'a PoseIndex);

fn find_poses(args: &Args, most: usize, sides: [Described<'_>; 2]) -> Result<()> {
    let every = args.every as usize;
    let [(_, queries), (_, database)] = sides;
    let (query_rows, query_poses) = queries.database(every);
    let (rows, poses) = database.database(every);
    let is_other = |q: usize, row: usize| {
        let takes = [query_rows.frame(q).take, rows.frame(row).take];
        let names = (queries, takes[0], database, takes[1]);
        !args.other_takes || names.0.takes[names.1].name != names.2.takes[names.3].name
    };
    let found = poses.nearest(query_poses.vectors().view(), most, is_other);
    let empty = found.iter().filter(|f| f.is_empty()).count();
    if empty > 0 {
        messages::info(&format!(
            "nothing found for {empty} of {} frames: joints missing, or no take to search",
            found.len()
        ));
    }
    let matches = Matches {
        sides,
        query_rows: &query_rows,
        rows: &rows,
        found: &found,
        classes: (args.classes.as_deref())
            .map(take_classes::read)
            .transpose()?,
    };
    let mut out = streams::open_output(args.output.as_deref(), false)?;
    out.write(matches.head())?;
    for query in 0..query_rows.count() {
        out.write(&matches.lines(query))?;
    }
    out.finish()?;
    if let Some(path) = &args.picture {
        streams::write_bytes(Some(path), matches.picture().as_bytes(), false)?;
    }
    let all = [most as u32];
    let scopes = match &args.scope[..] {
        [] => &all[..],
        scopes => scopes,
    };
    for scope in scopes {
        if let Some(share) = matches.precision(*scope as usize) {
            messages::info(&format!("precision at {scope}: {share:.3}"));
        }
    }
    Ok(())
}

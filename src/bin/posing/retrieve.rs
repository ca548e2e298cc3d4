//! Finds poses like given ones.

use clap::Parser;
use posing::cli::args::{CommonArgs, InputArgs};
use posing::cli::metric_takes::{MetricTakes, open_metric, read_takes};
use posing::cli::take_classes::{self, TakeClass};
use posing::cli::{input, messages, streams};
use posing::draw::figure::strip::{StripPose, strip};
use posing::evaluate::retrieval::SIXTEEN_JOINTS;
use posing::io::text::push_f32;
use posing::metric::nearest::Neighbor;
use posing::metric::{FrameRef, PoseDatabase};
use posing::{Error, Result};
use std::collections::HashMap;
use std::path::PathBuf;

/// Find the poses of a database that are most like given ones
///
/// Writes take, frame, rank, found_take, found_frame, distance: for each frame of the input the
/// nearest frames of the database by a metric of rdsr-train, nearest first, exactly. Frames count
/// from 0 within their take.
#[derive(Parser)]
#[command(
    name = "retrieve",
    version,
    after_help = "Examples:\n  posing retrieve -m metric.npz -k 10 --database poses.csv \
                  walk.csv\n  posing retrieve -m metric.npz --every 12 --other-takes --database \
                  poses.csv poses.csv\n  posing retrieve -m metric.npz --every 12 --classes \
                  classes.csv --scope 5,10 --picture found.svg --database poses.csv walk.csv > \
                  found.csv"
)]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    /// Metric, by rdsr-train
    #[arg(short, long, value_name = "METRIC.npz")]
    model: PathBuf,
    /// Table of the poses that are searched; same --fps, --joints, --units and --up as the input
    #[arg(long, value_name = "DB")]
    database: PathBuf,
    /// Poses to find for each frame
    #[arg(
        short,
        value_name = "N",
        default_value = "10",
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    k: u32,
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
    #[arg(long, value_name = "FILE.svg", help_heading = "Output")]
    picture: Option<PathBuf>,
    /// Write to FILE instead of standard output; FILE appears only when it is complete
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    output: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

/// Queries and poses found that are drawn, at most.
const PICTURED_QUERIES: usize = 8;
const PICTURED: usize = 10;

pub fn work(args: &Args) -> Result<()> {
    args.common.apply()?;
    let others = [&args.database, &args.model]
        .into_iter()
        .chain(&args.classes);
    input::check_single_stdin_with(&args.input, others)?;
    if let Some(scope) = args.scope.iter().find(|s| **s > args.k) {
        return Err(Error::usage(format!(
            "--scope {scope} is above -k {}",
            args.k
        )));
    }
    let metric = open_metric(&args.model)?;
    let needs_rate = metric.needs_rate();
    let takes = |files| read_takes(&args.input, files, &metric.map, needs_rate);
    let database = takes(vec![args.database.clone()])?;
    let queries = takes(args.input.files.clone())?;
    let (rows, vectors) = database.embed(&metric, args.every as usize);
    let (query_rows, query_vectors) = queries.embed(&metric, args.every as usize);
    let is_other = |q: usize, row: usize| {
        let (query, found): (FrameRef, FrameRef) = (query_rows[q], rows[row]);
        !args.other_takes || queries.names[query.take] != database.names[found.take]
    };
    let found = PoseDatabase::new(vectors, metric.norm).nearest(
        query_vectors.view(),
        args.k as usize,
        is_other,
    );
    let empty = found.iter().filter(|f| f.is_empty()).count();
    if empty > 0 {
        messages::info(&format!(
            "nothing found for {empty} of {} frames: joints missing, or no take to search",
            found.len()
        ));
    }
    let matches = Matches {
        queries: &queries,
        query_rows: &query_rows,
        database: &database,
        rows: &rows,
        found: &found,
        classes: args
            .classes
            .as_deref()
            .map(take_classes::read)
            .transpose()?,
    };
    let mut out = streams::open_output(args.output.as_deref(), false)?;
    out.write(matches.head())?;
    for query in 0..query_rows.len() {
        out.write(&matches.lines(query))?;
    }
    out.finish()?;
    if let Some(path) = &args.picture {
        streams::write_bytes(Some(path), matches.picture().as_bytes(), false)?;
    }
    let scopes = match &args.scope[..] {
        [] => &[args.k],
        scopes => scopes,
    };
    for scope in scopes {
        if let Some(share) = matches.precision(*scope as usize) {
            messages::info(&format!("precision at {scope}: {share:.3}"));
        }
    }
    Ok(())
}

/// Poses found, with what is needed to write, judge and draw them.
struct Matches<'a> {
    queries: &'a MetricTakes,
    query_rows: &'a [FrameRef],
    database: &'a MetricTakes,
    rows: &'a [FrameRef],
    found: &'a [Vec<Neighbor>],
    classes: Option<HashMap<String, TakeClass>>,
}

impl Matches<'_> {
    fn head(&self) -> &'static [u8] {
        match self.classes {
            Some(_) => b"take,frame,rank,found_take,found_frame,distance,right\n",
            None => b"take,frame,rank,found_take,found_frame,distance\n",
        }
    }

    fn lines(&self, query: usize) -> Vec<u8> {
        let mut out = Vec::new();
        for (rank, neighbor) in self.found[query].iter().enumerate() {
            self.queries.push_frame(&mut out, self.query_rows[query]);
            out.push(b',');
            out.extend((rank + 1).to_string().bytes());
            out.push(b',');
            self.database.push_frame(&mut out, self.rows[neighbor.row]);
            out.push(b',');
            push_f32(&mut out, neighbor.distance);
            if self.classes.is_some() {
                let right = self.is_right(query, neighbor);
                out.extend(
                    right
                        .map_or(String::from(","), |r| format!(",{}", u8::from(r)))
                        .bytes(),
                );
            }
            out.push(b'\n');
        }
        out
    }

    /// Whether a pose found is of its query's class; `None` where that is not known.
    fn is_right(&self, query: usize, neighbor: &Neighbor) -> Option<bool> {
        let classes = self.classes.as_ref()?;
        let wanted = classes.get(&self.queries.names[self.query_rows[query].take])?;
        let found = classes.get(&self.database.names[self.rows[neighbor.row].take])?;
        Some(wanted.class == found.class)
    }

    /// The share of right ones among the `scope` nearest, each take of the queries once.
    fn precision(&self, scope: usize) -> Option<f64> {
        let mut takes = vec![(0.0, 0.0); self.queries.names.len()];
        for (query, found) in self.found.iter().enumerate() {
            let judged = found
                .iter()
                .take(scope)
                .filter_map(|n| self.is_right(query, n));
            for is_right in judged {
                let take = &mut takes[self.query_rows[query].take];
                take.0 += f64::from(u8::from(is_right));
                take.1 += 1.0;
            }
        }
        let shares: Vec<f64> = (takes.iter().filter(|t| t.1 > 0.0))
            .map(|t| t.0 / t.1)
            .collect();
        (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
    }

    /// Some queries and what was found for them, as SVG.
    fn picture(&self) -> String {
        let pose = |takes: &MetricTakes, at: FrameRef, is_right| StripPose {
            joints: takes.takes[at.take].frame(at.frame).to_vec(),
            caption: format!("{} {}", takes.names[at.take], at.frame),
            is_right,
        };
        let step = self.found.len().div_ceil(PICTURED_QUERIES).max(1);
        let rows = (0..self.found.len()).step_by(step).map(|query| {
            let own = pose(self.queries, self.query_rows[query], None);
            let found = self.found[query].iter().take(PICTURED);
            let found =
                found.map(|n| pose(self.database, self.rows[n.row], self.is_right(query, n)));
            [own].into_iter().chain(found).collect()
        });
        strip(&rows.collect::<Vec<_>>(), SIXTEEN_JOINTS)
    }
}

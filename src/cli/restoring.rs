//! What `denoise` and `complete` share: the model, tables in and out, frames in batches or takes whole, statuses.

use super::args::{InputArgs, OutputArgs, PursuitFlag};
use super::input::{RowStream, check_single_stdin_with, open_model, read_table};
use super::progress::Progress;
use super::streams::{create_table, write_table};
use super::summary::{RunSummary, status_cells, status_columns};
use super::{Outcome, messages};
use crate::io::text::excerpt;
use crate::io::{Columns, Model, Row};
use crate::pose::Poses;
use crate::prior::OpenOptions;
use crate::restore::complete::{self, Complete};
use crate::restore::denoise::{self, Denoise};
use crate::restore::{BoundModel, RestoredFrames};
use crate::{Error, Result};
use clap::Args;
use ndarray::{Array2, ArrayView2, s};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Frames worked on at a time where each is answered by itself: enough for many threads, little memory.
const BATCH: usize = 512;

/// Which model, and how it is used.
#[derive(Debug, Clone, Args)]
pub struct ModelFlags {
    /// Model file (default: the built-in model)
    #[arg(short, long, value_name = "MODEL.npz", help_heading = "Model")]
    pub model: Option<PathBuf>,
    /// For a dictionary: largest number of atoms per pose, 1 to 1000; auto: as in training
    #[arg(long, value_name = "K|auto", default_value = "auto", value_parser = parse_sparsity, help_heading = "Model")]
    pub sparsity: Sparsity,
    /// For a dictionary: rule that selects the next atom
    #[arg(long, value_enum, default_value = "oomp", help_heading = "Model")]
    pub pursuit: PursuitFlag,
    /// Restore as published: by the sparse code or the posterior alone, without error model, rigid distances and outliers
    #[arg(long, help_heading = "Model")]
    pub published: bool,
}

/// How many atoms a pose.
#[derive(Debug, Clone, Copy)]
pub struct Sparsity(Option<usize>);

fn parse_sparsity(text: &str) -> std::result::Result<Sparsity, String> {
    match text.parse::<usize>() {
        _ if text == "auto" => Ok(Sparsity(None)),
        Ok(k) if (1..=1000).contains(&k) => Ok(Sparsity(Some(k))),
        _ => Err("expected a number of atoms from 1 to 1000, or auto".into()),
    }
}

/// Whether statuses are written.
#[derive(Debug, Clone, Args)]
pub struct StatusFlag {
    /// Add columns: NAME.status (observed, changed, inferred, rejected, unknown) and NAME.sd (standard deviation, cm) for
    /// each point; unlike for each frame (novelty of its pose in nats; 0: like the training poses)
    #[arg(long, help_heading = "Output")]
    pub status: bool,
}

/// One run of either command.
pub struct Task<'a> {
    /// Where poses come from.
    pub input: &'a InputArgs,
    /// Where they go.
    pub out: &'a OutputArgs,
    /// The model.
    pub model: &'a ModelFlags,
    /// Whether poses are placed.
    pub world: bool,
    /// Whether each frame is answered by itself.
    pub per_frame: bool,
    /// Whether statuses are written.
    pub status: bool,
}

/// Frames each by itself.
type Frames<'a> = dyn Fn(&BoundModel, ArrayView2<'_, f64>) -> RestoredFrames + 'a;
/// A take with its runs and rate.
type Take<'a> = dyn Fn(
        &BoundModel,
        ArrayView2<'_, f64>,
        &[Range<usize>],
        f64,
        &(dyn Fn(usize) + Sync),
    ) -> RestoredFrames
    + 'a;

/// Completes a table.
pub fn complete(
    task: &Task<'_>,
    settings: Complete,
    observe: Option<&[String]>,
) -> Result<Outcome> {
    if task.per_frame && settings.max_gap.is_some() {
        return Err(Error::usage(
            "--max-gap needs times and cannot be used with --per-frame",
        ));
    }
    let frames = |job: &BoundModel, xyz: ArrayView2<'_, f64>| complete::frames(job, xyz);
    let take = |job: &BoundModel,
                xyz: ArrayView2<'_, f64>,
                runs: &[Range<usize>],
                rate: f64,
                done: &(dyn Fn(usize) + Sync)| {
        complete::take(job, xyz, runs, rate, settings, done)
    };
    let mut summary = RunSummary::new(settings.max_gap.is_some());
    go(task, observe, true, &frames, &take, &mut summary)?;
    summary.report("left empty: too few points visible", task.status);
    Ok(Outcome::Done)
}

/// Denoises a table.
pub fn denoise(task: &Task<'_>, settings: Denoise) -> Result<Outcome> {
    let frames = |job: &BoundModel, xyz: ArrayView2<'_, f64>| denoise::frames(job, xyz, settings);
    let take = |job: &BoundModel,
                xyz: ArrayView2<'_, f64>,
                runs: &[Range<usize>],
                rate: f64,
                done: &(dyn Fn(usize) + Sync)| {
        denoise::take(job, xyz, runs, rate, settings, done)
    };
    let mut summary = RunSummary::default();
    go(task, None, false, &frames, &take, &mut summary)?;
    summary.report("left unchanged: too few points visible", task.status);
    Ok(Outcome::Done)
}

fn go(
    task: &Task<'_>,
    observe: Option<&[String]>,
    planar: bool,
    frames: &Frames<'_>,
    take: &Take<'_>,
    summary: &mut RunSummary,
) -> Result<()> {
    check_single_stdin_with(task.input, &task.model.model)?;
    if task.per_frame {
        return by_frames(task, observe, planar, frames, summary);
    }
    let table = read_table(task.input, planar, true)?;
    let hidden = hidden(&table.columns, observe)?;
    task.out
        .format()
        .check_added(&status_columns(task.status, &table.columns))?;
    let job = job(task, &table.columns)?;
    let Some(rate) = task.input.rate(&table.poses)? else {
        let lack = match table.poses.time {
            Some(_) => "the table's times give no frame rate",
            None => "the table has no time",
        };
        if summary.max_gap {
            let what = format!("--max-gap needs a frame rate, but {lack}; give it with --fps");
            return Err(Error::usage(what));
        }
        messages::info(&format!(
            "{lack}: restoring each frame by itself (--fps sets the frame rate)"
        ));
        let xyz = hide(table.poses.xyz.clone(), &hidden);
        let restored = frames(&job, job.gather(xyz.view()).view());
        let out = scatter(&job, &table.poses.xyz, &restored);
        summary.add(&job, &restored, job.gather(table.poses.xyz.view()).view());
        return write_table(
            task.out,
            &table,
            out.view(),
            &status_columns(task.status, &table.columns),
            |t| {
                status_cells(
                    task.status,
                    &job,
                    &table.columns,
                    &restored,
                    t,
                    &table.poses.xyz.row(t).to_vec(),
                )
            },
        );
    };
    let bar = Progress::new(
        if planar { "complete" } else { "denoise" },
        table.poses.frames() as u64,
    );
    let finished = AtomicU64::new(0);
    let progress = |n: usize| bar.set(finished.fetch_add(n as u64, Ordering::Relaxed) + n as u64);
    let mut out = table.poses.xyz.clone();
    let mut all = Vec::new();
    let runs = table.poses.runs();
    let rates = table.poses.rates();
    for (range, own) in table.poses.takes().into_iter().zip(rates) {
        let xyz = hide(
            table.poses.xyz.slice(s![range.clone(), ..]).to_owned(),
            &hidden,
        );
        // Both are in order: the take's runs are a stretch of all.
        let first = runs.partition_point(|r| r.start < range.start);
        let runs: Vec<Range<usize>> = runs[first..]
            .iter()
            .take_while(|r| r.end <= range.end)
            .map(|r| r.start - range.start..r.end - range.start)
            .collect();
        let gathered = job.gather(xyz.view());
        let rate = own.unwrap_or(rate);
        let restored = take(&job, gathered.view(), &runs, rate, &progress);
        summary.add(&job, &restored, gathered.view());
        let whole = scatter(
            &job,
            &table.poses.xyz.slice(s![range.clone(), ..]).to_owned(),
            &restored,
        );
        out.slice_mut(s![range.clone(), ..]).assign(&whole);
        all.push((range.start, restored));
    }
    drop(bar);
    write_table(
        task.out,
        &table,
        out.view(),
        &status_columns(task.status, &table.columns),
        |t| {
            let at = all
                .partition_point(|(start, _)| *start <= t)
                .saturating_sub(1);
            let before = table.poses.xyz.row(t).to_vec();
            all.get(at).map_or_else(Vec::new, |(start, r)| {
                status_cells(task.status, &job, &table.columns, r, t - start, &before)
            })
        },
    )
}

/// Frames in batches as they come: constant memory.
fn by_frames(
    task: &Task<'_>,
    observe: Option<&[String]>,
    planar: bool,
    frames: &Frames<'_>,
    summary: &mut RunSummary,
) -> Result<()> {
    let mut stream = RowStream::open(task.input, planar, true)?;
    let columns = stream.columns().clone();
    let hidden = hidden(&columns, observe)?;
    let job = job(task, &columns)?;
    let mut sink = create_table(task.out, &columns, &status_columns(task.status, &columns))?;
    for batch in 0.. {
        let mut rows = Vec::with_capacity(BATCH);
        let mut row = Row::default();
        while rows.len() < BATCH && stream.read(&mut row)? {
            rows.push(std::mem::take(&mut row));
        }
        if rows.is_empty() {
            break;
        }
        if batch == 0 {
            // Of few frames, as the last are, rounded times tell no rate that could contradict.
            task.input.rate(&Poses::without_points(
                rows.iter().map(|r| (r.time, r.take.clone())),
            ))?;
        }
        let flat: Vec<f64> = rows.iter().flat_map(|r| r.xyz.iter().copied()).collect();
        let xyz = Array2::from_shape_vec((rows.len(), columns.width()), flat).unwrap_or_default();
        let gathered = job.gather(hide(xyz.clone(), &hidden).view());
        let restored = frames(&job, gathered.view());
        summary.add(&job, &restored, gathered.view());
        let out = scatter(&job, &xyz, &restored);
        for (t, row) in rows.iter().enumerate() {
            let cells = status_cells(task.status, &job, &columns, &restored, t, &row.xyz);
            sink.write(row, &out.row(t).to_vec(), &cells)?;
        }
    }
    sink.finish()
}

fn job(task: &Task<'_>, columns: &Columns) -> Result<BoundModel> {
    let choice = OpenOptions {
        sparsity: task.model.sparsity.0,
        rule: task.model.pursuit.rule(),
        published: task.model.published,
        ..OpenOptions::default()
    };
    let (model, name) = match &task.model.model {
        Some(path) => (open_model(path)?, path.display().to_string()),
        None => (Model::builtin()?, "the built-in model".to_string()),
    };
    let kind = &model.meta.kind;
    let asks = choice.sparsity.is_some() || choice.rule != OpenOptions::default().rule;
    if asks && kind != "sparse" {
        messages::info(&format!(
            "{name} is of kind {kind}, not a dictionary: --sparsity and --pursuit have no effect"
        ));
    }
    let job = BoundModel::new(&model, &choice, &name, &columns.points, task.world)?;
    tell_strangers(&columns.points, &model.meta.points);
    Ok(job)
}

/// Says which points the model does not know.
fn tell_strangers(points: &[String], known: &[String]) {
    let strangers: Vec<String> = (points.iter().filter(|p| !known.contains(p)))
        .map(|p| excerpt(p))
        .collect();
    let (count, shown) = (strangers.len(), &strangers[..strangers.len().min(3)]);
    let more = if count > 3 { ", …" } else { "" };
    let names = format!("({}{more})", shown.join(", "));
    match count {
        0 => {}
        1 => messages::info(&format!(
            "1 point is not in the model and stays unchanged {names}"
        )),
        _ => messages::info(&format!(
            "{count} points are not in the model and stay unchanged {names}"
        )),
    }
}

/// The columns that `--observe` hides.
fn hidden(columns: &Columns, observe: Option<&[String]>) -> Result<Vec<usize>> {
    let Some(observe) = observe else {
        return Ok(Vec::new());
    };
    if let Some(name) = observe.iter().find(|n| !columns.points.contains(n)) {
        return Err(Error::usage(format!(
            "--observe {name}: the table has no point of this name"
        )));
    }
    let hidden = (0..columns.points.len()).filter(|&p| !observe.contains(&columns.points[p]));
    Ok(hidden.flat_map(|p| 3 * p..3 * p + 3).collect())
}

fn hide(mut xyz: Array2<f64>, hidden: &[usize]) -> Array2<f64> {
    for &i in hidden {
        xyz.column_mut(i).fill(f64::NAN);
    }
    xyz
}

/// The table's numbers with the restored ones in place.
fn scatter(job: &BoundModel, before: &Array2<f64>, restored: &RestoredFrames) -> Array2<f64> {
    let mut out = before.clone();
    for p in 0..restored.points() {
        let Some(at) = job.in_table(p) else { continue };
        for axis in 0..3 {
            let restored = restored.xyz.column(3 * p + axis);
            // What --observe hid and too little is seen to answer keeps what was captured.
            out.column_mut(3 * at + axis)
                .zip_mut_with(&restored, |o, r| {
                    if r.is_finite() {
                        *o = *r;
                    }
                });
        }
    }
    out
}

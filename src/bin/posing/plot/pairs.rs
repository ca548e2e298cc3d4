//! `plot` around the library, for two takes: on one timeline, with their differences.

use super::Args;
use super::tables::{PlotFormat, PlotTable, bones};
use posing::cli::messages;
use posing::draw::mesh_sequences::name_of;
use posing::draw::pair::{PairTake, TakePair};
use posing::draw::player;
use posing::draw::scene::{Scene, Table, pair_runs};
use posing::{Error, Result};
use std::path::PathBuf;

/// The names of two files, in full where they differ only in their endings or folders.
pub fn pair_names(files: &[PathBuf]) -> Vec<String> {
    let whole = |file: &PathBuf| {
        file.file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into()
    };
    let ways: [&dyn Fn(&PathBuf) -> String; 2] = [&|file| name_of(file), &whole];
    let names = ways.map(|way| files.iter().map(way).collect::<Vec<String>>());
    let differ = names.into_iter().find(|names| names[0] != names[1]);
    differ.unwrap_or_else(|| {
        files
            .iter()
            .map(|file| file.display().to_string())
            .collect()
    })
}

/// The drawing of two takes.
///
/// # Errors
/// Those of [`TakePair::new`], of a page and of an SVG; usage: a take has no rate.
pub fn draw_pair(
    args: &Args,
    to: PlotFormat,
    drawn: &[PlotTable; 2],
    names: &[String],
    table: Option<Table>,
) -> Result<String> {
    let rates = [rate(args, drawn, 0)?, rate(args, drawn, 1)?];
    let joined = joined(args.bones.as_deref(), drawn)?;
    let take = |k: usize| PairTake {
        name: &names[k],
        file: &drawn[k].file,
        poses: &drawn[k].poses,
        rate: rates[k],
        is_clocked: drawn[k].is_clocked,
        bones: &joined[k],
        status: drawn[k].columns.status.as_ref(),
        sd: drawn[k].columns.sd.as_ref(),
        method: drawn[k].columns.method.as_ref(),
    };
    let pair = TakePair::new([take(0), take(1)])?;
    pair.remarks
        .iter()
        .for_each(|remark| messages::info(remark));
    if pair.takes.iter().all(|take| take.bones.is_empty()) {
        messages::info(super::NO_BONES);
    }
    let (runs, title) = (pair_runs(&pair), format!("{} and {}", names[0], names[1]));
    let scene = Scene {
        title: if args.title.is_empty() {
            &title
        } else {
            &args.title
        },
        note: args.note.as_deref(),
        table,
        credit: args.credit.as_deref(),
        ..Scene::of_pair(&pair, &runs)
    };
    match to {
        PlotFormat::Svg => args.svg.draw(&scene, args.every),
        PlotFormat::Html => player::page(&scene, args.every),
    }
}

/// The frames a second of a take. `--fps` is that of a take that does not say its own; it must not
/// contradict the times of two tables that both do.
fn rate(args: &Args, drawn: &[PlotTable; 2], k: usize) -> Result<f64> {
    let own = drawn
        .each_ref()
        .map(|table| table.rate.or_else(|| table.poses.rate()));
    let table = &drawn[k];
    let is_taken = table.rate.is_some() || own[1 - k].is_none();
    let rate = own[k]
        .filter(|_| is_taken)
        .map_or_else(|| args.input.rate(&table.poses), |own| Ok(Some(own)));
    rate?.ok_or_else(|| Error::usage(format!("{}: {}", table.file, super::NO_RATE)))
}

/// The pairs of points to join of each take: those of --bones that it has, else those of its
/// skeleton or by the points' names.
fn joined(list: Option<&str>, drawn: &[PlotTable; 2]) -> Result<[Vec<(usize, usize)>; 2]> {
    let of_own = |table: &PlotTable| match &table.bones {
        Some(own) => Ok(own.clone()),
        None => bones(None, &table.poses.points),
    };
    let Some(list) = list else {
        return Ok([of_own(&drawn[0])?, of_own(&drawn[1])?]);
    };
    let points = drawn
        .iter()
        .flat_map(|table| table.poses.points.iter().cloned());
    let points: Vec<String> = points.collect();
    let listed = bones(Some(list), &points)?;
    let of = |table: &PlotTable| {
        let find = |p: usize| {
            table
                .poses
                .points
                .iter()
                .position(|name| *name == points[p])
        };
        let pairs = listed.iter().filter_map(|(a, b)| find(*a).zip(find(*b)));
        pairs.collect()
    };
    Ok([of(&drawn[0]), of(&drawn[1])])
}

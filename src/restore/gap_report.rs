//! The report of `complete`: every gap of a table, as text or JSON.

use super::{Restoration, RestoredGap};
use crate::io::Output;
use crate::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// One gap.
#[derive(Debug, Serialize)]
pub(crate) struct GapLine<'a> {
    /// The take, if the table names its takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    take: Option<&'a str>,
    point: &'a str,
    /// The first frame, counted from 0 within the take.
    first_frame: usize,
    frames: usize,
    /// How it was filled; none: it was not.
    method: &'a str,
    /// Standard deviation of a coordinate, cm.
    sd: Option<f64>,
    /// cm.
    longest_step: Option<f64>,
}

/// Writes the gaps of a restoration to a file: JSON where its name ends in .json, else aligned
/// text.
pub fn write(path: &Path, restored: &Restoration<'_>) -> Result<()> {
    let lines = gap_lines(restored);
    let text = match path.extension().is_some_and(|e| e == "json") {
        true => {
            serde_json::to_string_pretty(&lines).map_err(|e| Error::usage(e.to_string()))? + "\n"
        }
        false => text(&lines),
    };
    let mut out = Output::file(path)?;
    out.write(text.as_bytes())?;
    out.finish()
}

/// The gaps of a restoration.
pub(crate) fn gap_lines<'a>(restored: &Restoration<'a>) -> Vec<GapLine<'a>> {
    let takes = restored.source().poses.takes();
    let gaps = restored.gaps();
    gaps.iter().map(|g| line(restored, &takes, g)).collect()
}

fn line<'a>(
    restored: &Restoration<'a>,
    takes: &[std::ops::Range<usize>],
    gap: &RestoredGap,
) -> GapLine<'a> {
    let poses = &restored.source().poses;
    let start = gap.frames.start;
    let after = takes.partition_point(|t| t.start <= start);
    let first = after.checked_sub(1).map_or(0, |take| takes[take].start);
    let rounded = |v: f64| v.is_finite().then_some((v * 1e4).round() / 1e4);
    GapLine {
        take: poses.take.as_ref().map(|t| &*t[start]),
        point: &poses.points[gap.point],
        first_frame: start - first,
        frames: gap.frames.len(),
        method: gap.method.map_or("none", |m| m.name()),
        sd: rounded(gap.sd),
        longest_step: rounded(gap.longest_step),
    }
}

/// The gaps of a point of a take, summed up.
#[derive(Debug, Serialize)]
pub(crate) struct PointGapLine<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    take: Option<&'a str>,
    point: &'a str,
    gaps: usize,
    /// Frames of all gaps, and of the longest.
    frames: usize,
    longest: usize,
    /// The first frame of the longest gap, counted from 0 within the take.
    first_frame: usize,
    /// Gaps that were not filled.
    unfilled: usize,
    /// The largest standard deviation of a coordinate, cm.
    sd: Option<f64>,
}

/// The gaps point by point, those with most frames first.
pub(crate) fn by_point<'a>(lines: &[GapLine<'a>]) -> Vec<PointGapLine<'a>> {
    let mut all: BTreeMap<(Option<&str>, &str), PointGapLine<'a>> = BTreeMap::new();
    for line in lines {
        let sum = (all.entry((line.take, line.point))).or_insert_with(|| PointGapLine {
            take: line.take,
            point: line.point,
            gaps: 0,
            frames: 0,
            longest: 0,
            first_frame: line.first_frame,
            unfilled: 0,
            sd: None,
        });
        sum.gaps += 1;
        sum.frames += line.frames;
        if line.frames > sum.longest {
            (sum.longest, sum.first_frame) = (line.frames, line.first_frame);
        }
        sum.unfilled += usize::from(line.method == "none");
        let sds = sum.sd.into_iter().chain(line.sd);
        sum.sd = sds.reduce(f64::max);
    }
    let mut all: Vec<PointGapLine<'a>> = all.into_values().collect();
    all.sort_by_key(|sum| std::cmp::Reverse(sum.frames));
    all
}

fn text(lines: &[GapLine<'_>]) -> String {
    let width = |of: &dyn Fn(&GapLine<'_>) -> usize| lines.iter().map(of).max().unwrap_or(0).max(5);
    let take = width(&|l| l.take.unwrap_or("-").chars().count());
    let point = width(&|l| l.point.chars().count());
    let mut out = format!(
        "{:<take$}  {:<point$}  {:>11}  {:>6}  {:<10}  {:>8}  {:>16}\n",
        "take", "point", "first frame", "frames", "method", "sd, cm", "longest step, cm"
    );
    let number = |v: Option<f64>| v.map_or("-".to_string(), |v| format!("{v:.3}"));
    for l in lines {
        let _ = writeln!(
            out,
            "{:<take$}  {:<point$}  {:>11}  {:>6}  {:<10}  {:>8}  {:>16}",
            l.take.unwrap_or("-"),
            l.point,
            l.first_frame,
            l.frames,
            l.method,
            number(l.sd),
            number(l.longest_step)
        );
    }
    out
}

//! The report of `complete`: what became of a table, with every gap, as text or for JSON.

use super::{BodyGap, Restoration, RestorationCounts, RestoredGap};
use crate::pose::FillMethod;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// One gap.
#[derive(Debug, Serialize)]
#[doc(hidden)]
pub struct GapLine {
    /// The take, if the table names its takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    take: Option<String>,
    point: String,
    /// The first frame, counted from 0 within the take.
    first_frame: usize,
    frames: usize,
    /// How it was filled; none: it was not.
    method: &'static str,
    /// Standard deviation of a coordinate, cm.
    sd: Option<f64>,
    /// cm.
    longest_step: Option<f64>,
    /// Where the motion in it is from.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    motion: Option<MotionLine>,
}

/// Where the motion in a gap of a whole body is from.
#[derive(Debug, Clone, Serialize)]
#[doc(hidden)]
pub struct MotionLine {
    /// The error expected, as a share of that of the cubic that meets both ends.
    expected: f64,
    /// How much of the motion is used, from 0 to 1.
    weight: f64,
    nearest: Vec<NearestMotion>,
}

/// A take with motion alike; none: the take itself.
#[derive(Debug, Clone, Serialize)]
#[doc(hidden)]
pub struct NearestMotion {
    take: Option<String>,
    seconds: f64,
}

/// What became of a table.
///
/// ```
/// use posing_core::pose::Poses;
/// use posing_io::Table;
/// use posing_restore::{Complete, Restorer, gap_report::RestorationReport};
///
/// let mut xyz = ndarray::Array2::from_shape_fn((60, 3), |(t, c)| (t + c) as f64);
/// xyz.row_mut(10).fill(f64::NAN);
/// let table = Table::from_poses(Poses { points: vec!["knee".into()], xyz, ..Poses::default() });
/// let options = Complete { fps: Some(100.0), ..Complete::default() };
/// let restored = Restorer::without_model().complete(&table, &options)?;
/// let report = RestorationReport::of(&restored);
/// assert_eq!(report.counts().filled, 1);
/// assert!(report.text().contains("knee"));
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Serialize)]
pub struct RestorationReport {
    #[serde(flatten)]
    counts: RestorationCounts,
    /// Standard deviation of the noise that was assumed, cm: the mean over the frames.
    noise: f64,
    gaps: Vec<GapLine>,
}

impl RestorationReport {
    /// The report of a table that was restored whole.
    pub fn of(restored: &Restoration<'_>) -> RestorationReport {
        RestorationReport {
            gaps: gap_lines(restored),
            ..RestorationReport::of_counts(*restored.counts())
        }
    }

    /// The report of frames that were restored each by itself, which lists no gaps.
    pub fn of_counts(counts: RestorationCounts) -> RestorationReport {
        RestorationReport {
            counts,
            noise: counts.mean_noise(),
            gaps: Vec::new(),
        }
    }

    /// The frames and points by what became of them.
    pub fn counts(&self) -> &RestorationCounts {
        &self.counts
    }

    /// The gaps as aligned text.
    pub fn text(&self) -> String {
        text(&self.gaps)
    }
}

/// The gaps of a restoration.
#[doc(hidden)]
pub fn gap_lines(restored: &Restoration<'_>) -> Vec<GapLine> {
    let takes = restored.source().poses.takes();
    let gaps = restored.gaps();
    gaps.iter().map(|g| line(restored, &takes, g)).collect()
}

fn line(
    restored: &Restoration<'_>,
    takes: &[std::ops::Range<usize>],
    gap: &RestoredGap,
) -> GapLine {
    let poses = &restored.source().poses;
    let start = gap.frames.start;
    let after = takes.partition_point(|t| t.start <= start);
    let first = after.checked_sub(1).map_or(0, |take| takes[take].start);
    let rounded = |v: f64| v.is_finite().then_some((v * 1e4).round() / 1e4);
    GapLine {
        take: poses.take.as_ref().map(|t| t[start].to_string()),
        point: poses.points[gap.point].clone(),
        first_frame: start - first,
        frames: gap.frames.len(),
        method: gap.method.map_or("none", |m| m.name()),
        sd: rounded(gap.sd),
        longest_step: rounded(gap.longest_step),
        motion: motion_line(restored, gap),
    }
}

fn motion_line(restored: &Restoration<'_>, gap: &RestoredGap) -> Option<MotionLine> {
    if !matches!(gap.method, Some(FillMethod::Motion | FillMethod::Contact)) {
        return None;
    }
    let holds = |body: &&BodyGap| {
        body.frames.start <= gap.frames.start && gap.frames.end <= body.frames.end
    };
    let source = restored.body_gaps().iter().find(holds)?.source.as_ref()?;
    let rounded = |v: f64| (v * 1e3).round() / 1e3;
    let near = |(take, seconds): &(Option<String>, f64)| NearestMotion {
        take: take.clone(),
        seconds: rounded(*seconds),
    };
    Some(MotionLine {
        expected: rounded(source.expected),
        weight: rounded(source.weight),
        nearest: source.nearest.iter().map(near).collect(),
    })
}

/// The gaps of a point of a take, summed up.
#[derive(Debug, Serialize)]
#[doc(hidden)]
pub struct PointGapLine {
    #[serde(skip_serializing_if = "Option::is_none")]
    take: Option<String>,
    point: String,
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
#[doc(hidden)]
pub fn by_point(lines: &[GapLine]) -> Vec<PointGapLine> {
    let mut all: BTreeMap<(Option<&str>, &str), PointGapLine> = BTreeMap::new();
    for line in lines {
        let key = (line.take.as_deref(), line.point.as_str());
        let sum = (all.entry(key)).or_insert_with(|| PointGapLine {
            take: line.take.clone(),
            point: line.point.clone(),
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
    let mut all: Vec<PointGapLine> = all.into_values().collect();
    all.sort_by_key(|sum| std::cmp::Reverse(sum.frames));
    all
}

fn text(lines: &[GapLine]) -> String {
    let width = |of: &dyn Fn(&GapLine) -> usize| lines.iter().map(of).max().unwrap_or(0).max(5);
    let take = width(&|l| l.take.as_deref().unwrap_or("-").chars().count());
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
            l.take.as_deref().unwrap_or("-"),
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

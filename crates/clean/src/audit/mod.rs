//! Auditing takes: what in a capture is not as it should be, before anything is changed.
//!
//! Rates, units and axes are wrong more often than positions are, and gaps are written in many
//! ways. Each check says what it found, where, and the limit that it is over.

mod body;
mod bone_lengths;
mod file;
mod gaps;
mod held_rotations;
mod labels;
mod motion;
mod nearby;
mod orientation;
mod other_speeds;
mod page;
mod rotations;
mod take_pages;

pub(crate) use file::are_joints;
pub use file::count;
pub(crate) use file::name_options;
pub use file::{FileAudit, FileAuditor, files_to_audit};
pub use file::{audit_motion, kind_name};
pub use gaps::{GapSummary, PointGaps};
pub use held_rotations::{HeldRotations, held_rotations};
pub use page::page;
pub use take_pages::TakePages;

use crate::label::unlabeled::{labeled, labeled_poses};
use crate::pose::repeated_frames::RepeatedFrames;
use crate::pose::stray::{PointApart, points_apart};
use crate::pose::zeros::Zeros;
use crate::pose::{JointAngles, Poses, point_at, ranges};
use ndarray::{ArrayView2, s};
use serde::Serialize;
use std::ops::Range;

/// What is wrong with the rotations of a take: angles that jump though their joints hardly turn,
/// and rotations that were held. `rate`: frames a second; without one, nothing is held.
pub(crate) fn rotation_findings(joints: &[JointAngles], rate: Option<f64>) -> Vec<Finding> {
    let mut out = rotations::flips(joints);
    out.extend(held_rotations::held_findings(joints, rate));
    out
}

/// What is still as it should be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limits {
    /// The longest gap, seconds.
    pub gap: f64,
    /// The largest share of a point's frames that are missing.
    pub missing: f64,
    /// The speed of the fastest point, at 99% of its steps, cm/s.
    pub speed: f64,
    /// How far a point jumps off its path, cm.
    pub jump: f64,
    /// How tall a body is, cm: the largest extent of its points, in the median.
    pub size: [f64; 2],
    /// How far a distance between points that go together may drift from the first to the last
    /// quarter of a take, cm.
    pub drift: f64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            gap: 0.5,
            missing: 0.1,
            speed: 1500.0,
            jump: 3.0,
            size: [60.0, 260.0],
            drift: 2.0,
        }
    }
}

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FindingKind {
    /// The times repeat, go back, or pause.
    Time,
    /// Points move faster than people do: the rate is too high, or the unit too large.
    Rate,
    /// The body is smaller or larger than people are.
    Unit,
    /// The body stands along another axis than y, or is longest along it.
    UpAxis,
    /// The body is a mirror image.
    Mirrored,
    /// A point stands far off all others.
    Stray,
    /// A gap is long.
    LongGap,
    /// A point is missing often.
    Missing,
    /// A point is exactly at the origin: zeros for missing values.
    Zeros,
    /// Points change places.
    Swap,
    /// A piece of a track is another label's, or no label's.
    Label,
    /// Labels are exchanged in every frame.
    WholeTake,
    /// Left and right are exchanged altogether in every frame.
    Hand,
    /// A point leaves its path for some frames.
    Jump,
    /// A point has the very same position, or a joint the very same rotation, for many frames while
    /// others move: a value that was held.
    Held,
    /// Frames repeat the one before: they were doubled by a resampling, or held by an animator.
    HeldFrames,
    /// A point lies still, far from those it goes with, while they move.
    Fallen,
    /// A distance between points that go together drifts.
    Drift,
    /// An angle of a joint jumps though the joint hardly turns.
    EulerFlip,
    /// What a trial of gait holds contradicts itself: markers, parameters of the subject, plates.
    Gait,
}

/// Something that is not as it should be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What is wrong.
    pub kind: FindingKind,
    /// The points.
    pub points: Vec<String>,
    /// The first frame, from 0 within the take, and the one after the last.
    pub frames: Option<[usize; 2]>,
    /// One sentence: what, how much, and what to do.
    pub what: String,
}

/// The audit of one take.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TakeAudit {
    /// The name of the take, if it has one.
    pub take: Option<String>,
    /// The number of frames.
    pub frames: usize,
    /// Frames a second, if the table has times.
    pub rate: Option<f64>,
    /// The number of points.
    pub points: usize,
    /// The number of further tracks that have no label, which are left alone.
    pub unlabeled: usize,
    /// The largest extent of the points of a frame, without those that stand far off, in the
    /// median, cm.
    pub size: Option<f64>,
    /// What is missing.
    pub gaps: GapSummary,
    /// What is not as it should be.
    pub findings: Vec<Finding>,
}

/// One take as the checks see it.
struct Take<'a> {
    points: &'a [String],
    /// (frames, 3 J), cm; what is exactly at the origin is missing.
    xyz: ArrayView2<'a, f64>,
    /// With what is exactly at the origin.
    with_zeros: ArrayView2<'a, f64>,
    /// Seconds, one per frame.
    time: Option<&'a [f64]>,
    /// Ranges of consecutive frames.
    runs: Vec<Range<usize>>,
    rate: Option<f64>,
    /// Whether the points are joints that follow from rotations: none bears another's name, falls
    /// off or goes to a reflection.
    are_joints: bool,
}

/// Audits each take of a table; `fps` is the rate of a table without times.
///
/// ```
/// use posing_clean::audit::{FindingKind, Limits, audit};
/// use posing_core::pose::Poses;
///
/// let mut poses = Poses { points: vec!["head".into()], ..Poses::default() };
/// poses.xyz = ndarray::Array2::from_elem((40, 3), 100.0);
/// poses.xyz.row_mut(7).fill(0.0);
/// let takes = audit(&poses, Some(120.0), &Limits::default());
/// assert!(takes[0].findings.iter().any(|f| f.kind == FindingKind::Zeros));
/// ```
pub fn audit(poses: &Poses, fps: Option<f64>, limits: &Limits) -> Vec<TakeAudit> {
    audit_points(poses, fps, limits, false)
}

/// [`audit`] of points that may be joints, which follow from the rotations of a file.
pub(crate) fn audit_points(
    poses: &Poses,
    fps: Option<f64>,
    limits: &Limits,
    are_joints: bool,
) -> Vec<TakeAudit> {
    let points = labeled(&poses.points);
    let unlabeled = poses.points.len() - points.len();
    let poses = &*labeled_poses(poses, &points);
    let emptied = Zeros::emptied(poses);
    let all_runs = poses.runs();
    let takes = poses.takes().into_iter().zip(poses.rates());
    let one = |(frames, rate): (Range<usize>, Option<f64>)| {
        let runs = all_runs.iter().filter(|r| frames.contains(&r.start));
        let take = Take {
            points: &poses.points,
            xyz: emptied.xyz.slice(s![frames.clone(), ..]),
            with_zeros: poses.xyz.slice(s![frames.clone(), ..]),
            time: poses.time.as_ref().map(|time| &time[frames.clone()]),
            runs: runs
                .map(|r| r.start - frames.start..r.end - frames.start)
                .collect(),
            rate: rate.or(fps),
            are_joints,
        };
        let name = poses.take.as_ref().map(|t| t[frames.start].to_string());
        TakeAudit {
            unlabeled,
            ..audit_take(&take, name, limits)
        }
    };
    takes.map(one).collect()
}

fn audit_take(take: &Take<'_>, name: Option<String>, limits: &Limits) -> TakeAudit {
    let gaps = GapSummary::of(take);
    let apart = points_apart(take.xyz, limits.size[1]);
    let size = body::size(take, &apart);
    let mut findings = Vec::new();
    findings.extend(times(take, limits));
    findings.extend(body::wrong_unit(size, limits));
    let by_names = orientation::findings(take);
    findings
        .extend(by_names.unwrap_or_else(|| body::wrong_axis(size, limits).into_iter().collect()));
    findings.extend(body::stray(take, &apart));
    findings.extend(gaps.findings(take, limits));
    findings.extend(gaps::zeros(take));
    findings.extend(motion_findings(take, &apart, limits));
    TakeAudit {
        take: name,
        frames: take.xyz.nrows(),
        rate: take.rate,
        points: take.points.len(),
        unlabeled: 0,
        size: size.map(|axes| axes.into_iter().fold(0.0, f64::max)),
        gaps,
        findings,
    }
}

/// What is wrong in how points move, by the frames that do not repeat the one before.
fn motion_findings(take: &Take<'_>, apart: &[PointApart], limits: &Limits) -> Vec<Finding> {
    let repeated = RepeatedFrames::of(take.xyz);
    let xyz = repeated.rows(take.xyz);
    let kept = Take {
        points: take.points,
        xyz: xyz.view(),
        with_zeros: xyz.view(),
        time: None,
        runs: repeated.kept_runs(&take.runs),
        rate: take.rate.map(|rate| repeated.rate(rate)),
        are_joints: take.are_joints,
    };
    let mut findings = Vec::new();
    findings.extend(motion::too_fast(&kept, limits));
    findings.extend(motion::jumps(&kept, limits));
    findings.extend(motion::held(&kept, apart));
    if !take.are_joints {
        findings.extend(motion::swaps(&kept));
        findings.extend(bone_lengths::findings(&kept, limits));
    }
    for frames in findings.iter_mut().filter_map(|f| f.frames.as_mut()) {
        let shown = repeated.frames(&(frames[0]..frames[1]));
        *frames = [shown.start, shown.end];
    }
    findings.extend(repeated.describe().map(|what| Finding {
        kind: FindingKind::HeldFrames,
        points: Vec::new(),
        frames: None,
        what: format!("{what}: they stay, and only the others are judged"),
    }));
    findings
}

/// Times that repeat or go back, and pauses: rows that were left out are a gap of all points.
fn times(take: &Take<'_>, limits: &Limits) -> Option<Finding> {
    let finding = |frame: usize, what: String| Finding {
        kind: FindingKind::Time,
        points: Vec::new(),
        frames: Some([frame, frame + 1]),
        what,
    };
    if take.xyz.nrows() == 0 {
        return Some(finding(0, "there are no frames".to_string()));
    }
    let time = take.time?;
    let step = |t: &usize| time[*t] - time[t - 1];
    if let Some(t) = (1..time.len()).find(|t| step(t) <= 0.0) {
        let what = format!(
            "the time of frame {t} is {}, after {}",
            time[t],
            time[t - 1]
        );
        return Some(finding(t, what));
    }
    let longest = (1..time.len()).max_by(|a, b| step(a).total_cmp(&step(b)))?;
    (step(&longest) > limits.gap).then(|| {
        let what = format!(
            "{:.2} s pass before frame {longest} (limit {} s)",
            step(&longest),
            limits.gap
        );
        finding(longest, what)
    })
}

impl Take<'_> {
    /// The position of a point in a frame; `None` where a coordinate is missing.
    fn at(&self, frame: usize, point: usize) -> Option<glam::DVec3> {
        Some(point_at(self.xyz, frame, point)).filter(|at| at.is_finite())
    }

    /// Frames and those after them, within runs.
    fn steps(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs
            .iter()
            .flat_map(|r| r.start..r.end.saturating_sub(1))
    }

    fn finding(
        &self,
        kind: FindingKind,
        points: &[usize],
        frames: Option<Range<usize>>,
        what: String,
    ) -> Finding {
        Finding {
            kind,
            points: points.iter().map(|&p| self.points[p].clone()).collect(),
            frames: frames.map(|f| [f.start, f.end]),
            what,
        }
    }
}

#[cfg(test)]
mod tests;

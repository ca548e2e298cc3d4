//! What became of a file, and what of its result somebody should look at.

use super::one_file::{CleanSettings, keeps_rotations};
use super::record::Summary;
use super::sources::OutputFormat;
use crate::audit::{Finding, FindingKind, TakeAudit, audit};
use crate::cli::audit::kind_name;
use crate::cli::motion_file::{MotionFile, Source};
use crate::io::MotionFormat;
use crate::pose::{PointNaming, Poses};
use crate::restore::{Restoration, typical_noise};
use ndarray::ArrayView2;

/// Points and gaps that a finding lists.
const LISTED: usize = 4;

impl CleanSettings {
    /// What became of a file.
    pub(super) fn summary(
        &self,
        file: &MotionFile,
        to: Option<OutputFormat>,
        naming: &PointNaming,
        restored: &Restoration<'_>,
    ) -> Summary {
        let poses = &file.table.poses;
        let counts = restored.counts();
        let missing = |xyz: ArrayView2<'_, f64>| {
            let rows = xyz.rows().into_iter();
            rows.map(|row| count_missing(&row.to_vec())).sum::<usize>()
        };
        let noise = typical_noise(poses.xyz.view(), &poses.runs());
        let denoised = counts.mean_noise() > 0.0;
        let mut findings = self.remaining(poses, restored, file.rate());
        let left = missing(restored.xyz());
        findings.extend(left_open(left, restored));
        if noise > self.method.noise_limit && keeps_rotations(file, to) {
            findings.push(format!(
                "noise: {noise:.2} cm stay, since the file holds rotations (denoise, then xyz2bvh or xyz2amc, makes new ones)"
            ));
        }
        Summary {
            format: file.format.name().to_string(),
            frames: poses.frames(),
            points: poses.points.len(),
            rate: file.rate(),
            missing: missing(poses.xyz.view()),
            filled: missing(poses.xyz.view()) - left,
            outliers: if denoised || self.method.outliers && !keeps_rotations(file, to) {
                counts.rejected
            } else {
                0
            },
            noise,
            denoised,
            findings,
            notes: notes(file, naming, restored),
        }
    }

    /// What is wrong in the result, missing points aside.
    fn remaining(
        &self,
        poses: &Poses,
        restored: &Restoration<'_>,
        rate: Option<f64>,
    ) -> Vec<String> {
        let result = Poses {
            xyz: restored.xyz().to_owned(),
            ..poses.clone()
        };
        let takes = audit(&result, rate, &self.limits);
        let is_several = takes.len() > 1;
        let line = |take: &Option<String>, finding: &Finding| {
            let take = take.as_deref().filter(|_| is_several);
            let take = take.map_or(String::new(), |take| format!("{take}: "));
            format!("{take}{}: {}", kind_name(finding.kind), finding.what)
        };
        let is_gap = |f: &&Finding| matches!(f.kind, FindingKind::LongGap | FindingKind::Missing);
        let of_take = |take: &TakeAudit| {
            let findings = take.findings.iter().filter(|f| !is_gap(f));
            findings.map(|f| line(&take.take, f)).collect::<Vec<_>>()
        };
        takes.iter().flat_map(of_take).collect()
    }
}

/// The points of a frame that have a missing coordinate.
fn count_missing(row: &[f64]) -> usize {
    let points = row.chunks_exact(3);
    points.filter(|p| p.iter().any(|v| v.is_nan())).count()
}

/// What was not filled.
fn left_open(left: usize, restored: &Restoration<'_>) -> Option<String> {
    let poses = &restored.source().poses;
    let xyz = restored.xyz();
    let frames_of = |p: usize| {
        let is_missing = |t: &usize| (0..3).any(|c| xyz[[*t, 3 * p + c]].is_nan());
        (0..poses.frames()).filter(is_missing).count()
    };
    let mut points: Vec<(usize, usize)> = (0..poses.points.len())
        .map(|p| (frames_of(p), p))
        .filter(|(frames, _)| *frames > 0)
        .collect();
    points.sort_by_key(|(frames, _)| std::cmp::Reverse(*frames));
    let one = |(frames, p): &(usize, usize)| match *frames == poses.frames() {
        true => format!("{} always", poses.points[*p]),
        false => format!("{} in {frames} frames", poses.points[*p]),
    };
    (left > 0).then(|| {
        let some = listed(points.iter().map(one));
        format!("missing: {left} positions are not filled ({some})")
    })
}

/// Some of a list.
fn listed(all: impl ExactSizeIterator<Item = String>) -> String {
    let count = all.len();
    let some: Vec<String> = all.take(LISTED).collect();
    match count - some.len() {
        0 => some.join(", "),
        more => format!("{} and {more} more", some.join(", ")),
    }
}

/// What a person should know of how the file was taken.
fn notes(file: &MotionFile, naming: &PointNaming, restored: &Restoration<'_>) -> Vec<String> {
    let mut out = file.notes.clone();
    let (unit, up) = (&file.read_as.unit, &file.read_as.up);
    if file.format == MotionFormat::Bvh
        && (unit.from == Source::Custom || up.from == Source::Custom)
    {
        out.push(format!(
            "taken as {} and {} up, as BVH files are by custom",
            unit.value, up.value
        ));
    }
    if let PointNaming::Map(map) = naming {
        out.push(format!("the points have the names of the map {}", map.name));
    }
    match restored.counts().cuts {
        0 => {}
        n => out.push(format!(
            "the whole body jumps ({n}): nothing is joined across"
        )),
    }
    out
}

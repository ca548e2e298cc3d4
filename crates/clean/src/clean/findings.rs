//! What became of a file, and what of its result somebody should look at.

use super::one_file::{CleanSettings, CleanedTake, Known, keeps_rotations};
use super::places::{PlaceToSee, places};
use super::record::Summary;
use super::replaced::ReplacedPosition;
use super::sources::OutputFormat;
use crate::audit::{
    Finding, FindingKind, are_joints, audit_points, count, kind_name, rotation_findings,
};
use crate::io::motion_file::Source;
use crate::io::{MotionFile, MotionFormat};
use crate::label::unlabeled::{labeled, left_alone};
use crate::pose::zeros::Zeros;
use crate::pose::{PointNaming, Poses, Status, point_at};
use crate::restore::{Restoration, typical_noise};
use ndarray::ArrayView2;

/// Points and gaps that a finding lists.
const LISTED: usize = 4;

impl CleanSettings {
    /// What became of a file, of which `unheld` positions or values are not in the result.
    pub(super) fn summary(
        &self,
        file: &MotionFile,
        to: Option<OutputFormat>,
        naming: &PointNaming,
        cleaned: &CleanedTake<'_>,
        unheld: usize,
        known: Known<'_>,
    ) -> Summary {
        let (poses, restored) = (&file.table.poses, &cleaned.points);
        let rotations = cleaned.rotations.as_ref();
        let keeps = keeps_rotations(file, to);
        let points = labeled(&poses.points);
        let missing = |xyz: ArrayView2<'_, f64>| {
            // What was taken out is an outlier.
            let is_missing = |t: usize, p: usize| {
                !is_seen(xyz, t, p) && restored.status(t, p) != Status::Rejected
            };
            let of_frame = |t: usize| points.iter().filter(move |p| is_missing(t, **p)).count();
            (0..poses.frames()).map(of_frame).sum::<usize>()
        };
        let noise = typical_noise(Zeros::emptied(poses).xyz.view(), &poses.runs());
        let denoised = match rotations {
            Some(rotations) => rotations.is_smoothed(),
            None => restored.counts().mean_noise() > 0.0,
        };
        let (mut findings, mut found) = self.remaining(file, cleaned);
        let noise_deg = rotations.map(|r| r.noise());
        let (lacking, left) = (missing(poses.xyz.view()), missing(restored.xyz()));
        findings.extend(left_open(restored));
        let limit = self.rotation_noise_limit.to_degrees();
        let is_noise = rotations.is_some_and(|r| r.cleaned.is_noise);
        let noise_stays = !self.smooth && is_noise && noise_deg.is_some_and(|n| n >= limit);
        if let (true, Some(noise)) = (noise_stays, noise_deg) {
            findings.push(format!(
                "noise: {noise:.2} degrees stay, as nothing is smoothed"
            ));
        }
        if let Some(rotations) = rotations {
            findings.extend(rotations.findings());
            found.extend(rotations.places().into_iter().map(|mut place| {
                // A bone that is none of the points has no trail.
                place.point = place.point.filter(|p| poses.points.contains(p));
                place
            }));
        }
        let moved = known.replaced;
        let doubtful = restored.counts().rejected.saturating_sub(moved.len());
        if self.method.outliers && !keeps && doubtful > 0 {
            findings.push(format!(
                "outliers: {doubtful} more are not replaced, as too little is known there"
            ));
        }
        let mut filled = lacking - left;
        match (unheld, keeps) {
            (0, _) => {}
            (n, true) => {
                let are = if self.held_is_missing {
                    "are still held or nan"
                } else {
                    "are still nan"
                };
                findings.push(format!("missing: {n} values of the file {are}"));
            }
            (n, false) => {
                filled = filled.saturating_sub(n);
                let what = "do not fit into the file's integers: they stay as they were";
                findings.push(format!("range: {n} positions {what}"));
            }
        }
        let mut notes = notes(file, naming, restored);
        notes.extend(replacements(moved));
        notes.extend(
            rotations
                .iter()
                .flat_map(|r| r.notes(self.rotation_noise_limit)),
        );
        let called = |line: &String| self.option_names.in_text(line);
        Summary {
            format: file.format.name().to_string(),
            frames: poses.frames(),
            points: poses.points.len(),
            computed: file.computed().into_iter().map(String::from).collect(),
            rate: file.rate(),
            missing: lacking,
            filled,
            outliers: moved.len() + rotations.map_or(0, |r| r.popped()),
            noise,
            noise_deg,
            denoised,
            noise_stays,
            copied: false,
            findings: findings.iter().map(called).collect(),
            notes: notes.iter().map(called).collect(),
            places: places(
                known.places.into_iter().chain(found).collect(),
                known.audit,
                moved,
            ),
        }
    }

    /// What is wrong in the result, missing points aside, and where.
    fn remaining(
        &self,
        file: &MotionFile,
        cleaned: &CleanedTake<'_>,
    ) -> (Vec<String>, Vec<PlaceToSee>) {
        let result = Poses {
            xyz: cleaned.points.xyz().to_owned(),
            ..file.table.poses.clone()
        };
        let are_joints = cleaned.rotations.is_some() && are_joints(file);
        let mut takes = audit_points(&result, file.rate(), &self.limits, are_joints);
        if let (Some(rotations), Some(take)) = (&cleaned.rotations, takes.first_mut()) {
            let angles = file.joint_angles_of(rotations.cleaned.motion.view());
            take.findings
                .extend(rotation_findings(&angles, file.rate()));
        }
        let is_several = takes.len() > 1;
        let is_gap = |f: &&Finding| matches!(f.kind, FindingKind::LongGap | FindingKind::Missing);
        let (mut lines, mut places) = (Vec::new(), Vec::new());
        let mut first = 0;
        for take in &takes {
            let name = take.take.as_deref().filter(|_| is_several);
            let name = name.map_or(String::new(), |name| format!("{name}: "));
            for finding in take.findings.iter().filter(|f| !is_gap(f)) {
                let kind = kind_name(finding.kind);
                lines.push(format!("{name}{kind}: {}", finding.what));
                places.extend(finding.frames.map(|[start, _]| PlaceToSee {
                    what: kind.to_string(),
                    point: finding.points.first().cloned(),
                    frame: first + start,
                }));
            }
            first += take.frames;
        }
        (lines, places)
    }
}

/// The replaced positions in one line; the record has all.
fn replacements(moved: &[ReplacedPosition]) -> Option<String> {
    let one =
        |m: &ReplacedPosition| format!("{} in frame {} by {:.1} cm", m.point, m.frame, m.moved);
    (!moved.is_empty()).then(|| {
        let some = listed(moved.iter().map(one));
        format!(
            "outliers: {} replaced ({some}); the record has them as they were",
            moved.len()
        )
    })
}

fn is_seen(xyz: ArrayView2<'_, f64>, frame: usize, point: usize) -> bool {
    point_at(xyz, frame, point).is_finite()
}

/// What was not filled of the labeled points.
fn left_open(restored: &Restoration<'_>) -> Option<String> {
    let poses = &restored.source().poses;
    let xyz = restored.xyz();
    let frames_of = |p: usize| {
        let is_missing = |t: &usize| !is_seen(xyz, *t, p);
        (0..poses.frames()).filter(is_missing).count()
    };
    let mut points: Vec<(usize, usize)> = (labeled(&poses.points).into_iter())
        .map(|p| (frames_of(p), p))
        .filter(|(frames, _)| *frames > 0)
        .collect();
    points.sort_by_key(|(frames, _)| std::cmp::Reverse(*frames));
    let one = |(frames, p): &(usize, usize)| {
        if *frames == poses.frames() {
            format!("{} always", poses.points[*p])
        } else {
            format!("{} in {}", poses.points[*p], count(*frames, "frame"))
        }
    };
    let left: usize = points.iter().map(|(frames, _)| frames).sum();
    (left > 0).then(|| {
        let some = listed(points.iter().map(one));
        let are = if left == 1 { "is" } else { "are" };
        let positions = count(left, "position");
        format!("missing: {positions} {are} not filled ({some})")
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
    let is_custom = matches!(
        file.format,
        MotionFormat::Bvh | MotionFormat::Csv | MotionFormat::Npy
    );
    if is_custom && (unit.from == Source::Option || up.from == Source::Option) {
        out.push(format!(
            "taken as {} and {} up, by the flags",
            unit.value, up.value
        ));
    }
    if let PointNaming::Map(map) = naming {
        out.push(format!("the points have the names of the map {}", map.name));
    }
    out.extend(left_alone(&restored.source().columns.points));
    match restored.counts().exchanged {
        0 => {}
        n => out.push(format!(
            "left and right are exchanged ({n} pairs of points, frame by frame): put back"
        )),
    }
    if let Some(noise) = restored.counts().doubtful_noise() {
        out.push(format!(
            "noise: at most {noise:.2} cm, which cannot be told from motion: it stays"
        ));
    }
    match restored.counts().cuts {
        0 => {}
        n => out.push(format!(
            "the whole body jumps ({n}): nothing is joined across"
        )),
    }
    out
}

//! What of a result somebody should look at.

use super::places::{PlaceToSee, Told};
use super::redo::kept;
use super::restored::Restored;
use super::written::Written;
use crate::audit::{
    Finding, FindingKind, are_joints, audit_points, count, kind_name, rotation_findings,
};
use crate::io::MotionFile;
use crate::label::unlabeled::labeled;
use crate::pose::{Poses, Status, point_at, ranges};
use crate::restore::Restoration;
use crate::solve::{MarkerSet, doubt};

/// Points and gaps that a finding lists.
const LISTED: usize = 4;

impl Written<'_> {
    /// What somebody should look at: what is wrong in the result, and what could not be done.
    pub(super) fn findings(&self) -> Vec<Told> {
        let take = self.restored.take;
        let (points, rotations) = (&self.restored.points, self.restored.rotations.as_ref());
        let mut out = self.remaining();
        out.extend(left_open(points));
        let stays = |noise| format!("noise: {noise:.2} degrees stay, as nothing is smoothed");
        out.extend(self.noise_that_stays().map(stays).map(Told::from));
        out.extend(rotations.iter().flat_map(|r| r.findings()));
        out.extend(self.doubtful_outliers());
        out.extend(self.not_held().map(Told::from));
        out.extend(take.labels.findings());
        out.extend(doubt_of_labels(&take.file).map(Told::from));
        if take.run.job.to.is_none() {
            let kept = kept(&take.run.settings.redo, &take.file, points);
            out.extend(kept.into_iter().map(Told::from));
        }
        let names = take.run.settings.option_names;
        for told in &mut out {
            told.line = names.in_text(&told.line);
        }
        out
    }

    /// The noise of rotations, degrees, that is over the limit and stays, as nothing is smoothed.
    pub(super) fn noise_that_stays(&self) -> Option<f64> {
        let settings = self.restored.take.run.settings;
        let rotations = self.restored.rotations.as_ref();
        let noise = rotations
            .filter(|r| !settings.smooth && r.cleaned.is_noise)?
            .noise();
        (noise >= settings.rotation_noise_limit.to_degrees()).then_some(noise)
    }

    fn doubtful_outliers(&self) -> Option<Told> {
        let take = self.restored.take;
        let rejected = self.restored.points.counts().rejected;
        let doubtful = rejected.saturating_sub(self.replaced.len());
        let is_wanted = take.run.settings.method.outliers && !take.keeps_rotations();
        (is_wanted && doubtful > 0).then(|| Told {
            line: format!(
                "outliers: {doubtful} more are not replaced, as too little is known there"
            ),
            places: self.not_replaced(),
        })
    }

    /// Where the first outliers are that were not replaced.
    fn not_replaced(&self) -> Vec<PlaceToSee> {
        let (restored, points) = (&self.restored.points, &self.restored.take.file.table.poses);
        let is_replaced = |t: usize, point: &String| {
            let mut known = self.replaced.iter();
            known.any(|r| r.frame == t && r.point == *point)
        };
        let all = (0..points.frames()).flat_map(|t| (0..points.points.len()).map(move |p| (t, p)));
        let rejected = all.filter(|(t, p)| restored.status(*t, *p) == Status::Rejected);
        let named = rejected.map(|(t, p)| (t, &points.points[p]));
        let left = named.filter(|(t, point)| !is_replaced(*t, point));
        left.take(LISTED)
            .map(|(t, point)| PlaceToSee::of("outlier", Some(point), [t, t + 1]))
            .collect()
    }

    /// What the result does not hold.
    fn not_held(&self) -> Option<String> {
        let take = self.restored.take;
        let line = match (self.unheld, take.keeps_rotations()) {
            (0, _) => return None,
            (n, true) => {
                let are = if take.run.settings.held_is_missing {
                    "are still held or nan"
                } else {
                    "are still nan"
                };
                format!("missing: {n} values of the file {are}")
            }
            (n, false) => {
                let what = "do not fit into the file's integers: they stay as they were";
                format!("range: {n} positions {what}")
            }
        };
        Some(line)
    }

    /// What is wrong in the result, missing points aside.
    fn remaining(&self) -> Vec<Told> {
        let Restored {
            take,
            points,
            rotations,
            ..
        } = &self.restored;
        let file = &take.file;
        let result = Poses {
            xyz: points.xyz().to_owned(),
            ..file.table.poses.clone()
        };
        let are_joints = rotations.is_some() && are_joints(file);
        let mut takes = audit_points(&result, file.rate(), &take.run.settings.limits, are_joints);
        if let (Some(rotations), Some(take)) = (rotations, takes.first_mut()) {
            let angles = file.joint_angles_of(rotations.cleaned.motion.view());
            take.findings
                .extend(rotation_findings(&angles, file.rate()));
        }
        let is_several = takes.len() > 1;
        let is_gap = |f: &&Finding| matches!(f.kind, FindingKind::LongGap | FindingKind::Missing);
        let mut out = Vec::new();
        let mut first = 0;
        for take in &takes {
            let name = take.take.as_deref().filter(|_| is_several);
            let name = name.map_or(String::new(), |name| format!("{name}: "));
            for finding in take.findings.iter().filter(|f| !is_gap(f)) {
                let kind = kind_name(finding.kind);
                let place = |frames: [usize; 2]| {
                    let frames = frames.map(|t| first + t);
                    PlaceToSee::of(kind, finding.points.first(), frames)
                };
                out.push(Told {
                    line: format!("{name}{kind}: {}", finding.what),
                    places: finding.frames.map(place).into_iter().collect(),
                });
            }
            first += take.frames;
        }
        out
    }
}

/// Why the labels of a file may be of several people.
fn doubt_of_labels(file: &MotionFile) -> Option<String> {
    let set = MarkerSet::of(&file.poses().points).filter(|_| file.motion().is_none())?;
    doubt(file.poses(), set).map(|what| format!("labels: {what}"))
}

/// What was not filled of the labeled points.
fn left_open(restored: &Restoration<'_>) -> Option<Told> {
    let poses = &restored.source().poses;
    let xyz = restored.xyz();
    let missing = |p: usize| {
        let is_missing = move |t: &usize| !point_at(xyz, *t, p).is_finite();
        (0..poses.frames()).filter(is_missing)
    };
    let frames_of = |p: usize| missing(p).count();
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
    // The longest gap of a point; one that is never seen is nowhere.
    let place = |(frames, p): &(usize, usize)| {
        let gaps = ranges(missing(*p)).into_iter();
        let longest = gaps.max_by_key(ExactSizeIterator::len)?;
        let frames = (*frames < poses.frames()).then_some([longest.start, longest.end])?;
        Some(PlaceToSee::of("missing", Some(&poses.points[*p]), frames))
    };
    (left > 0).then(|| {
        let some = listed(points.iter().map(one));
        let are = if left == 1 { "is" } else { "are" };
        let positions = count(left, "position");
        Told {
            line: format!("missing: {positions} {are} not filled ({some})"),
            places: points.iter().take(LISTED).filter_map(place).collect(),
        }
    })
}

/// Some of a list.
pub(super) fn listed(all: impl ExactSizeIterator<Item = String>) -> String {
    let count = all.len();
    let some: Vec<String> = all.take(LISTED).collect();
    match count - some.len() {
        0 => some.join(", "),
        more => format!("{} and {more} more", some.join(", ")),
    }
}

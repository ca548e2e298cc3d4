//! Labels: what `posing label` would put right, and labels that are wrong in every frame.

use super::{Finding, FindingKind, TakeAudit};
use crate::io::MotionFile;
use crate::label::LabelSettings;
use crate::label::changes::{Change, ChangeKind};
use crate::label::relabeling::{Relabeling, relabel};
use crate::label::sides::Unsure;
use crate::label::templates::WholeTakeKind;
use crate::pose::Poses;
use crate::solve::on_body;
use std::ops::Range;

/// Pieces of tracks that are listed.
const LISTED: usize = 3;

/// Adds what is wrong with the labels of a file to the audits of its takes. Returns notes, a line
/// each.
pub(super) fn add(
    file: &MotionFile,
    settings: &LabelSettings,
    takes: &mut [TakeAudit],
) -> Vec<String> {
    if file.motion().is_some() {
        let what = "holds rotations: its labels were not checked".to_string();
        return Vec::from_iter((!settings.like.is_empty()).then_some(what));
    }
    let poses = file.poses();
    let Some(rate) = file.rate() else {
        return Vec::new();
    };
    let found = relabel(poses, rate, &on_body(settings, &poses.points));
    for (frames, take) in poses.takes().into_iter().zip(takes) {
        let of_take = Labels {
            poses,
            first: frames.start,
        };
        if found.unchecked.is_none() {
            take.findings.retain(|f| f.kind != FindingKind::Swap);
        }
        let own = of_take.findings(&found, &frames, &take.findings);
        take.findings.extend(own);
        let whole = found.whole.iter().filter(|(of, _)| *of == frames);
        take.findings.extend(whole.map(|(_, whole)| {
            let kind = match whole.kind {
                WholeTakeKind::Hand => FindingKind::Hand,
                _ => FindingKind::WholeTake,
            };
            let what = whole.sentence(&poses.points);
            of_take.finding(kind, &whole.points, None, what)
        }));
    }
    let unchecked = (found.unchecked).map(|why| format!("labels were not checked: {why}"));
    found.notes.into_iter().chain(unchecked).collect()
}

/// The labels of a take.
struct Labels<'a> {
    poses: &'a Poses,
    /// Its first frame in the table.
    first: usize,
}

impl Labels<'_> {
    /// What labels would become of the frames of a take; `known` was found already.
    fn findings(
        &self,
        found: &Relabeling,
        frames: &Range<usize>,
        known: &[Finding],
    ) -> Vec<Finding> {
        let changes = found.changes.iter();
        let own: Vec<&Change> = changes
            .filter(|c| frames.contains(&c.frames.start))
            .collect();
        let is_ring = |c: &&&Change| matches!(c.kind, ChangeKind::Swap | ChangeKind::Cycle);
        let mut out: Vec<Finding> = own.iter().filter(is_ring).map(|c| self.ring(c)).collect();
        let unsure = found.unsure.iter();
        let unsure = unsure.filter(|u| u.frames.first().is_some_and(|f| frames.contains(&f.start)));
        out.extend(unsure.map(|u| self.unsure(u)));
        let is_told = |c: &Change| {
            let name = &self.poses.points[c.tracks[0]];
            known
                .iter()
                .any(|f| f.kind == FindingKind::Jump && f.points.first() == Some(name))
        };
        let of_kind = |kind: ChangeKind| {
            let all = own
                .iter()
                .filter(move |c| c.kind == kind && !(kind == ChangeKind::Out && is_told(c)));
            all.copied().collect::<Vec<_>>()
        };
        out.extend(self.pieces(
            &of_kind(ChangeKind::Joined),
            "without a label",
            "joins them",
        ));
        out.extend(self.pieces(
            &of_kind(ChangeKind::Moved),
            "of another label",
            "moves them",
        ));
        out.extend(self.pieces(&of_kind(ChangeKind::Out), "of no label", "takes them out"));
        out
    }

    fn finding(
        &self,
        kind: FindingKind,
        points: &[usize],
        frames: Option<&Range<usize>>,
        what: String,
    ) -> Finding {
        Finding {
            kind,
            points: points
                .iter()
                .map(|p| self.poses.points[*p].clone())
                .collect(),
            frames: frames.map(|f| [f.start - self.first, f.end - self.first]),
            what,
        }
    }

    fn names(&self, points: &[usize]) -> String {
        let all: Vec<&str> = points
            .iter()
            .map(|p| self.poses.points[*p].as_str())
            .collect();
        all.join(" and ")
    }

    /// The frames of a range within the take, from 0.
    fn frames(&self, range: &Range<usize>) -> String {
        match range.len() {
            1 => format!("frame {}", range.start - self.first),
            _ => format!(
                "frames {} to {}",
                range.start - self.first,
                range.end - 1 - self.first
            ),
        }
    }

    fn ring(&self, change: &Change) -> Finding {
        let what = format!(
            "{} changed places in {}: label puts them back",
            self.names(&change.tracks),
            self.frames(&change.frames)
        );
        self.finding(
            FindingKind::Swap,
            &change.tracks,
            Some(&change.frames),
            what,
        )
    }

    fn unsure(&self, unsure: &Unsure) -> Finding {
        let frames: Vec<String> = unsure.frames.iter().map(|f| self.frames(f)).collect();
        let (names, frames) = (self.names(&unsure.labels), frames.join(", "));
        let what = if unsure.is_part {
            format!("{names} changed places, perhaps in {frames} too: nothing says it")
        } else {
            format!("{names} changed places in {frames}, or in all others: nothing says which")
        };
        self.finding(
            FindingKind::Swap,
            &unsure.labels,
            unsure.frames.first(),
            what,
        )
    }

    /// Pieces of tracks that become another label, or none, in one finding.
    fn pieces(&self, changes: &[&Change], whose: &str, does: &str) -> Option<Finding> {
        let first = changes.first()?;
        let one = |c: &&Change| {
            let to = c
                .tracks
                .get(1)
                .map_or("no label", |p| &self.poses.points[*p]);
            format!(
                "{} in {} is {to}",
                self.poses.points[c.tracks[0]],
                self.frames(&c.frames)
            )
        };
        let some: Vec<String> = changes.iter().take(LISTED).map(one).collect();
        let what = match changes.len() {
            1 => format!("{}: label {}", some[0], does.replace("them", "it")),
            n if n <= LISTED => format!("{}: label {does}", some.join(", ")),
            n => format!("{n} pieces {whose} ({}, …): label {does}", some.join(", ")),
        };
        let mut points: Vec<usize> = changes
            .iter()
            .map(|c| c.tracks[c.tracks.len() - 1])
            .collect();
        points.sort_unstable();
        points.dedup();
        Some(self.finding(FindingKind::Label, &points, Some(&first.frames), what))
    }
}

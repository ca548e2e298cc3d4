//! The labels of a capture, put right before it is cleaned.

use super::named_by::NamedBy;
use super::naming::Named;
use super::places::{PlaceToSee, Told};
use crate::Result;
use crate::draw::href::encoded;
use crate::draw::scene::Table;
use crate::error::OptionNames;
use crate::io::MotionFile;
use crate::label::{LabelReport, LabelSettings, NamedTracks, UnsureTrack, check_labels};
use crate::solve::on_body;
use ndarray::{Array2, ArrayView2};
use std::collections::BTreeMap;

/// Changes that a note tells each.
const LISTED: usize = 6;
/// Changes that a page lists.
const TABLED: usize = 300;

/// What was done to the labels of a capture.
#[derive(Default)]
pub(super) struct Relabeled {
    /// By what it got names, if it had none.
    pub named: Option<NamedBy>,
    pub report: LabelReport,
    /// The positions (frames, 3 P) as they were, where some moved.
    pub captured: Option<Array2<f64>>,
    /// What the page calls options.
    pub option_names: OptionNames,
}

/// The file with its labels put right, and what was changed; rotations have no labels.
pub(super) fn relabeled(
    settings: Option<&LabelSettings>,
    file: MotionFile,
    named: Option<Named>,
) -> Result<(MotionFile, Relabeled)> {
    let Some(settings) = settings.filter(|_| file.motion().is_none()) else {
        return Ok((file, Relabeled::default()));
    };
    let (by, report) = match named {
        Some(Named { by, report }) => (Some(by), report),
        None => (None, None),
    };
    let mut out = Relabeled {
        named: by,
        report: report.map_or_else(
            || check_labels(&file, &on_body(settings, &file.poses().points)),
            Ok,
        )?,
        captured: None,
        option_names: settings.option_names,
    };
    if out.report.moves.is_empty() {
        return Ok((file, out));
    }
    let moved = file.moved(&out.report.moves)?;
    out.captured = Some(file.table.poses.xyz);
    Ok((moved, out))
}

impl Relabeled {
    /// Whether names or positions are others than the capture's.
    pub(super) fn are_changed(&self) -> bool {
        self.captured.is_some() || self.report.named.is_some()
    }

    /// The positions of a file as they were captured (frames, 3 points), cm.
    pub(super) fn captured<'a>(&'a self, file: &'a MotionFile) -> ArrayView2<'a, f64> {
        self.captured
            .as_ref()
            .unwrap_or(&file.table.poses.xyz)
            .view()
    }

    /// The frames and labels of positions that were taken out.
    pub(super) fn taken_out(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let out = self.report.moves.iter().filter(|m| m.to.is_none());
        out.flat_map(|m| m.frames.clone().map(|t| (t, m.from)))
    }

    /// What was changed, a line each, the first of them.
    pub(super) fn notes(&self) -> Vec<String> {
        let changes = &self.report.changes;
        let mut out = self.names();
        let first = changes.iter().take(LISTED);
        out.extend(first.map(|change| format!("labels: {}", change.what)));
        if changes.len() > LISTED {
            let more = changes.len() - LISTED;
            out.push(format!("labels: {more} more changes; the record has them"));
        }
        out.extend(self.report.notes.clone());
        out.extend(self.report.unchecked.clone());
        out
    }

    /// By what a capture without names got some, a line each.
    fn names(&self) -> Vec<String> {
        let Some(by) = &self.named else {
            return Vec::new();
        };
        let names = self.report.named.iter().flat_map(NamedTracks::notes);
        let what = by.by.as_deref().unwrap_or_default();
        let names = names.map(|line| format!("labels: {line}, as in {what}"));
        names
            .chain(by.passed_over.iter().map(|why| format!("labels: {why}")))
            .collect()
    }

    /// What is not sure.
    pub(super) fn findings(&self) -> impl Iterator<Item = Told> + '_ {
        let told = |what: &str, places| Told {
            line: format!("labels: {what}"),
            places,
        };
        let not_sure = |label, frames| PlaceToSee::of("label not sure", label, frames);
        let nothing = self.named.as_ref().and_then(NamedBy::nothing);
        let doubts = self.report.named.iter().flat_map(move |named| {
            named.doubts().into_iter().map(move |doubt| {
                let is_of = |u: &&UnsureTrack| {
                    let [start, _] = u.frames;
                    doubt.starts_with(&format!("{} in frames {start} to ", u.track))
                };
                let at = named.unsure.iter().find(is_of);
                let place = at.map(|u| not_sure(Some(&u.track), u.frames));
                told(&doubt, place.into_iter().collect())
            })
        });
        let unsure = self.report.unsure.iter().map(move |u| {
            let places = u.frames.iter().map(|f| not_sure(u.labels.first(), *f));
            told(&u.what, places.collect())
        });
        let nothing = nothing.map(|what| told(&what, Vec::new()));
        nothing.into_iter().chain(doubts).chain(unsure)
    }

    /// Where labels were changed.
    pub(super) fn places(&self) -> impl Iterator<Item = PlaceToSee> + '_ {
        self.report.changes.iter().take(LISTED).map(|c| {
            let label = c.to.as_ref().unwrap_or(&c.from);
            PlaceToSee::of("label changed", Some(label), c.frames)
        })
    }

    /// How many changes of each kind there are.
    pub(super) fn put_right(&self) -> BTreeMap<String, usize> {
        let mut out = BTreeMap::new();
        for change in &self.report.changes {
            *out.entry(change.kind.name().to_string()).or_default() += 1;
        }
        out
    }

    /// What the record has of it: nothing of files without labels.
    pub(super) fn record(&self) -> Option<&LabelReport> {
        let LabelReport {
            named,
            changes,
            unsure,
            unchecked,
            ..
        } = &self.report;
        let is_empty =
            changes.is_empty() && unsure.is_empty() && unchecked.is_none() && named.is_none();
        (!is_empty).then_some(&self.report)
    }
}

/// The changes of labels as a table for a page, whose rows lead to their frames and points; `None`
/// where there are none.
pub(super) fn label_table(report: &LabelReport, names: OptionNames) -> Option<Table> {
    let mut out = Table {
        caption: names.in_text(
            "Labels that were changed, or are not sure (frames count from 0): a row leads to the \
             frame before. In another run, the option `keep_labels NAME:FROM-TO` keeps a label.",
        ),
        header: ["Change", "Label", "Frames", "Evidence, nats", "Side by"]
            .map(String::from)
            .to_vec(),
        ..Table::default()
    };
    let mut add = |cells: [String; 5], point: &str, start: usize| {
        out.rows.push(cells.to_vec());
        let frame = start.saturating_sub(1);
        out.links
            .push(format!("#frame={frame}&trail={}", encoded(point)));
    };
    let frames = |[start, end]: [usize; 2]| format!("{start}\u{2013}{}", end.max(1) - 1);
    for unsure in &report.unsure {
        for of in &unsure.frames {
            let point = unsure.labels.first().map_or("", String::as_str);
            let cells = ["not sure".into(), unsure.labels.join(", "), frames(*of)];
            let [change, labels, frames] = cells;
            add(
                [change, labels, frames, String::new(), String::new()],
                point,
                of[0],
            );
        }
    }
    for change in report.changes.iter().take(TABLED) {
        let labels = match (&change.to, change.ring.len()) {
            (_, 3..) => change.ring.join(", "),
            (Some(to), _) => format!("{}, {to}", change.from),
            (None, _) => change.from.clone(),
        };
        let cells = [
            change.kind.name().to_string(),
            labels,
            frames(change.frames),
            change
                .evidence
                .map_or(String::new(), |nats| format!("{nats:.0}")),
            change.side.map_or("", |side| side.name()).to_string(),
        ];
        add(
            cells,
            change.to.as_ref().unwrap_or(&change.from),
            change.frames[0],
        );
    }
    (!out.rows.is_empty()).then_some(out)
}

//! The places of a take to look at, of which a page has links.

use super::replaced::ReplacedPosition;
use crate::audit::{TakeAudit, count};
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::HashSet;

/// Places of each kind.
const LISTED: usize = 8;
/// Places of one finding.
const OF_FINDING: usize = 4;

/// A place of a take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceToSee {
    /// What is there.
    pub what: String,
    /// The point.
    pub point: Option<String>,
    /// The frame, counted from 0 over the file.
    pub frame: usize,
    /// The frame after the last; `None`: it is one frame, or the first of many.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<usize>,
    /// The finding that is there: which of the file's, counted from 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finding: Option<usize>,
}

impl PlaceToSee {
    /// Frames of a point, the first and the one after the last.
    pub(super) fn of(what: &str, point: Option<&String>, [start, end]: [usize; 2]) -> PlaceToSee {
        PlaceToSee {
            what: what.to_string(),
            point: point.cloned(),
            frame: start,
            end: Some(end),
            finding: None,
        }
    }

    /// The first frame, and the one after the last.
    pub(super) fn frames(&self) -> [usize; 2] {
        [self.frame, self.end.unwrap_or(self.frame + 1)]
    }

    /// The same in seconds from the first frame of the file, at `rate` frames a second.
    pub(super) fn seconds(&self, rate: Option<f64>) -> Option<[f64; 2]> {
        let rate = rate.filter(|rate| *rate > 0.0)?;
        Some(self.frames().map(|t| (1e4 * t as f64 / rate).round() / 1e4))
    }
}

/// A finding in a line, and where it is.
pub(super) struct Told {
    pub line: String,
    pub places: Vec<PlaceToSee>,
}

impl From<String> for Told {
    fn from(line: String) -> Told {
        let places = Vec::new();
        Told { line, places }
    }
}

/// The places of the findings, then what else is to be seen: what was `changed`, the longest gaps
/// of the points, and the farthest outliers.
pub(super) fn places(
    findings: &[Told],
    mut changed: Vec<PlaceToSee>,
    before: &[TakeAudit],
    replaced: &[ReplacedPosition],
) -> Vec<PlaceToSee> {
    changed.truncate(LISTED);
    changed.extend(longest_gaps(before));
    let mut far: Vec<&ReplacedPosition> = replaced.iter().collect();
    far.sort_by(|a, b| b.moved.total_cmp(&a.moved));
    changed.extend(far.into_iter().take(LISTED).map(|r| {
        let frames = [r.frame, r.frame + 1];
        PlaceToSee::of("outlier", Some(&r.point), frames)
    }));
    let of_finding = |(i, told): (usize, &Told)| {
        let own = told.places.iter().take(OF_FINDING).cloned();
        let finding = Some(i);
        own.map(move |place| PlaceToSee { finding, ..place })
            .collect::<Vec<_>>()
    };
    let mut out: Vec<PlaceToSee> = findings.iter().enumerate().flat_map(of_finding).collect();
    let known: HashSet<(Option<String>, usize)> =
        out.iter().map(|p| (p.point.clone(), p.frame)).collect();
    changed.retain(|p| !known.contains(&(p.point.clone(), p.frame)));
    out.extend(changed);
    out
}

/// The longest gap of each point, the longest first.
fn longest_gaps(takes: &[TakeAudit]) -> Vec<PlaceToSee> {
    let mut gaps = Vec::new();
    let mut first = 0;
    for take in takes {
        for gap in &take.gaps.by_point {
            let [start, end] = gap.longest;
            gaps.push((Reverse(end - start), first + start, &gap.point));
        }
        first += take.frames;
    }
    gaps.sort();
    let place = |(length, frame, point): (Reverse<usize>, usize, &String)| {
        let what = format!("gap of {}", count(length.0, "frame"));
        PlaceToSee::of(&what, Some(point), [frame, frame + length.0])
    };
    gaps.into_iter().take(LISTED).map(place).collect()
}

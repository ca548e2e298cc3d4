//! The places of a take to look at, of which a page has links.

use super::replaced::ReplacedPosition;
use crate::audit::TakeAudit;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;

/// Places of each kind.
const LISTED: usize = 8;

/// A place of a take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceToSee {
    /// What is there.
    pub what: String,
    /// The point.
    pub point: Option<String>,
    /// The frame, counted from 0 over the file.
    pub frame: usize,
}

/// The places of what was found, the longest gaps of the points, and the farthest outliers.
pub(crate) fn places(
    found: Vec<PlaceToSee>,
    before: &[TakeAudit],
    replaced: &[ReplacedPosition],
) -> Vec<PlaceToSee> {
    let mut out = found;
    out.truncate(LISTED);
    out.extend(longest_gaps(before));
    let mut far: Vec<&ReplacedPosition> = replaced.iter().collect();
    far.sort_by(|a, b| b.moved.total_cmp(&a.moved));
    out.extend(far.into_iter().take(LISTED).map(|r| PlaceToSee {
        what: "outlier".to_string(),
        point: Some(r.point.clone()),
        frame: r.frame,
    }));
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
    let place = |(length, frame, point): (Reverse<usize>, usize, &String)| PlaceToSee {
        what: match length.0 {
            1 => "gap of 1 frame".to_string(),
            n => format!("gap of {n} frames"),
        },
        point: Some(point.clone()),
        frame,
    };
    gaps.into_iter().take(LISTED).map(place).collect()
}

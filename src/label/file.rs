//! The labels of a file put right.

use super::changes::{Change, ChangeKind};
use super::repair::Unsure;
use super::take::{Relabeling, relabel};
use crate::io::{MotionFile, PointMove};
use crate::{Error, Place, Result};
use std::ops::Range;

/// What is wrong with the labels of a file, and the moves that put it right.
#[derive(Debug, Clone, Default)]
pub struct LabelReport {
    /// Positions that are another label's, or none's.
    pub moves: Vec<PointMove>,
    /// What was changed, a line each.
    pub changes: Vec<String>,
    /// What is not sure and stays, a line each.
    pub unsure: Vec<String>,
    /// Why labels were not checked, if they were not.
    pub unchecked: Option<String>,
}

/// Finds what is wrong with the labels of a file.
///
/// Nothing is written, and no position changes: [`MotionFile::write_moved`] makes the moves.
///
/// # Errors
/// [`Error::Data`]: neither the file nor an option says its rate, or it holds
/// rotations.
pub fn check_labels(file: &MotionFile) -> Result<LabelReport> {
    let poses = file.poses();
    if file.motion().is_some() {
        let what = "holds rotations, whose points have no labels to change";
        return Err(Error::data(Place::file(&file.table.name), what));
    }
    let Some(rate) = file.rate().or((poses.frames() < 2).then_some(1.0)) else {
        let what = "has no times that give a rate; give it with the option `fps F` (frames per \
                    second)";
        return Err(Error::data(Place::file(&file.table.name), what));
    };
    Ok(LabelReport::new(&relabel(poses, rate), &poses.points))
}

impl LabelReport {
    fn new(found: &Relabeling, names: &[String]) -> LabelReport {
        LabelReport {
            moves: found.moves.clone(),
            changes: found.changes.iter().map(|c| line(c, names)).collect(),
            unsure: found.unsure.iter().map(|u| unsure_line(u, names)).collect(),
            unchecked: found
                .unchecked
                .map(|why| format!("labels were not checked: {why}")),
        }
    }
}

/// A change in words.
fn line(change: &Change, names: &[String]) -> String {
    let name = |k: usize| names[change.tracks[k]].as_str();
    let frames = frames(&change.frames);
    match change.kind {
        ChangeKind::Swap => format!(
            "{} and {} changed places in {frames}: put back",
            name(0),
            name(1)
        ),
        ChangeKind::Cycle => {
            let all: Vec<&str> = (0..change.tracks.len()).map(name).collect();
            format!(
                "{} changed places in a ring in {frames}: put back",
                all.join(", ")
            )
        }
        ChangeKind::Joined => format!("{} in {frames} is {}: joined", name(0), name(1)),
        ChangeKind::Moved => format!("{} in {frames} is {}: moved", name(0), name(1)),
        ChangeKind::Out => format!("{} in {frames} is not {}: taken out", name(0), name(0)),
    }
}

/// What is not sure in words.
fn unsure_line(unsure: &Unsure, names: &[String]) -> String {
    let all: Vec<&str> = unsure.labels.iter().map(|l| names[*l].as_str()).collect();
    let frames: Vec<String> = unsure.frames.iter().map(frames).collect();
    format!(
        "{} changed places in {}, or in all others: nothing says which, so nothing moves",
        all.join(" and "),
        frames.join(", ")
    )
}

/// Frames as people count them, from 1.
fn frames(range: &Range<usize>) -> String {
    match range.len() {
        1 => format!("frame {}", range.end),
        _ => format!("frames {}-{}", range.start + 1, range.end),
    }
}

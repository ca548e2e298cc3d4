//! The labels of a table of points put right.

use super::changes::{Change, changes, moves};
use super::repair::{LabeledTake, Repair, Unsure, repair};
use super::unlabeled::is_unlabeled;
use crate::io::PointMove;
use crate::pose::Poses;
use ndarray::Axis;
use std::ops::Range;

/// What is done to the labels of a table; points and frames are those of the table.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Relabeling {
    pub moves: Vec<PointMove>,
    pub changes: Vec<Change>,
    pub unsure: Vec<Unsure>,
    /// Why labels were not checked, if they were not.
    pub unchecked: Option<&'static str>,
}

/// Labels of more points are not checked.
const MOST_POINTS: usize = 500;

/// Finds what is wrong with the labels of some poses, take by take, at `rate` frames a second.
pub(crate) fn relabel(poses: &Poses, rate: f64) -> Relabeling {
    let mut out = Relabeling::default();
    if poses.points.len() > MOST_POINTS {
        out.unchecked = Some("over 500 points");
        return out;
    }
    let runs = poses.runs();
    for take in poses.takes() {
        let own = runs
            .iter()
            .filter(|r| r.start >= take.start && r.end <= take.end);
        let own: Vec<Range<usize>> = own.cloned().collect();
        out.add(poses, &own, &take, rate);
    }
    out
}

impl Relabeling {
    /// Adds what is wrong in one take.
    fn add(&mut self, poses: &Poses, runs: &[Range<usize>], take: &Range<usize>, rate: f64) {
        let (labels, loose): (Vec<usize>, Vec<usize>) =
            (0..poses.points.len()).partition(|p| !is_unlabeled(&poses.points[*p]));
        if labels.len() < FEWEST_LABELS {
            return;
        }
        let order: Vec<usize> = labels.iter().chain(&loose).copied().collect();
        let columns: Vec<usize> = order.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let names: Vec<String> = order.iter().map(|p| poses.points[*p].clone()).collect();
        let xyz = poses
            .xyz
            .slice(ndarray::s![take.clone(), ..])
            .select(Axis(1), &columns);
        let first = take.start;
        let runs: Vec<Range<usize>> = runs
            .iter()
            .map(|r| r.start - first..r.end - first)
            .collect();
        let found: Repair = repair(LabeledTake {
            names: &names,
            labels: labels.len(),
            xyz: xyz.view(),
            runs: &runs,
            rate,
        });
        let moves = moves(&found);
        let shifted = |r: &Range<usize>| r.start + first..r.end + first;
        self.changes
            .extend(changes(&moves, labels.len()).into_iter().map(|c| Change {
                frames: shifted(&c.frames),
                tracks: c.tracks.iter().map(|t| order[*t]).collect(),
                ..c
            }));
        let is_move = |m: &PointMove| m.to.is_some() || m.from < labels.len();
        self.moves
            .extend(moves.into_iter().filter(is_move).map(|m| PointMove {
                from: order[m.from],
                to: m.to.map(|to| order[to]),
                frames: shifted(&m.frames),
            }));
        self.unsure.extend(found.unsure.into_iter().map(|u| Unsure {
            labels: u.labels.iter().map(|l| order[*l]).collect(),
            frames: u.frames.iter().map(shifted).collect(),
        }));
    }
}

/// Fewer labels say nothing of each other.
const FEWEST_LABELS: usize = 4;

//! What was done to the labels of a take, change by change.

use super::repair::Repair;
use crate::io::PointMove;
use std::ops::Range;

/// What kind of change it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ChangeKind {
    /// Two labels changed places.
    Swap,
    /// Three or more did.
    Cycle,
    /// A track without a label is a label's.
    Joined,
    /// A label's places are another's.
    Moved,
    /// A label's places are no label's.
    Out,
}

/// A change: moves that belong together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Change {
    pub kind: ChangeKind,
    pub frames: Range<usize>,
    /// The tracks, each of which moved to the next, the last to the first of a swap or cycle.
    pub tracks: Vec<usize>,
}

/// The moves that a repair makes, track after track.
pub(crate) fn moves(repair: &Repair) -> Vec<PointMove> {
    let mut out: Vec<PointMove> = Vec::new();
    let mut last: Option<&PointMove> = None;
    for piece in &repair.pieces {
        let before = last.replace(piece);
        if piece.to == Some(piece.from) {
            continue;
        }
        let goes_on = before.is_some_and(|b| (b.from, b.to) == (piece.from, piece.to));
        match out.last_mut().filter(|_| goes_on) {
            Some(open) => open.frames.end = piece.frames.end,
            None => out.push(piece.clone()),
        }
    }
    out
}

/// The changes that some moves make, in the order of their frames; tracks below `labels` are
/// labels.
pub(crate) fn changes(moves: &[PointMove], labels: usize) -> Vec<Change> {
    let mut is_told = vec![false; moves.len()];
    let mut out = Vec::new();
    for (n, one) in moves.iter().enumerate() {
        if is_told[n] {
            continue;
        }
        let Some(to) = one.to else {
            if one.from < labels {
                out.push(change(ChangeKind::Out, one, vec![one.from]));
            }
            continue;
        };
        let ring = if one.from < labels {
            ring(moves, n, &is_told)
        } else {
            None
        };
        let Some(ring) = ring else {
            let kind = if one.from < labels {
                ChangeKind::Moved
            } else {
                ChangeKind::Joined
            };
            out.push(change(kind, one, vec![one.from, to]));
            continue;
        };
        ring.iter().for_each(|k| is_told[*k] = true);
        let kind = if ring.len() == 2 {
            ChangeKind::Swap
        } else {
            ChangeKind::Cycle
        };
        let tracks = ring.iter().map(|k| moves[*k].from).collect();
        let mut all = change(kind, one, tracks);
        all.frames.start = ring
            .iter()
            .map(|k| moves[*k].frames.start)
            .min()
            .unwrap_or(0);
        all.frames.end = ring.iter().map(|k| moves[*k].frames.end).max().unwrap_or(0);
        out.push(all);
    }
    out.sort_by_key(|c| (c.frames.start, c.tracks.clone()));
    out
}

fn change(kind: ChangeKind, of: &PointMove, tracks: Vec<usize>) -> Change {
    Change {
        kind,
        frames: of.frames.clone(),
        tracks,
    }
}

/// The moves at about the same time that bring a track back to itself.
fn ring(moves: &[PointMove], first: usize, is_told: &[bool]) -> Option<Vec<usize>> {
    let home = moves[first].from;
    let overlaps = |k: usize| {
        let (a, b) = (&moves[first].frames, &moves[k].frames);
        let both = a.end.min(b.end).saturating_sub(a.start.max(b.start));
        2 * both > a.len().max(b.len())
    };
    let mut ring = vec![first];
    loop {
        let to = moves[*ring.last()?].to?;
        if to == home {
            return (ring.len() > 1).then_some(ring);
        }
        let next = (0..moves.len())
            .find(|k| moves[*k].from == to && !is_told[*k] && !ring.contains(k) && overlaps(*k));
        ring.push(next?);
    }
}

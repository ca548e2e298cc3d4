//! What was done to the labels of a take, change by change.

use super::repair::{Assigned, Repair};
use std::ops::Range;

/// Frames of a track that are another's: they move there, or leave the labels.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Move {
    /// The track that they stand in.
    pub track: usize,
    pub frames: Range<usize>,
    /// The label whose they are; `None`: no label's.
    pub to: Option<usize>,
    /// By how many nats they fit better there; 0 where the exchange of names says it.
    pub nats: f64,
}

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
    pub nats: f64,
}

/// The moves that a repair makes, track after track.
pub(crate) fn moves(repair: &Repair) -> Vec<Move> {
    let mut out: Vec<Move> = Vec::new();
    let mut last: Option<&Assigned> = None;
    for piece in &repair.pieces {
        let before = last.replace(piece);
        if piece.label == Some(piece.track) {
            continue;
        }
        let goes_on = before.is_some_and(|b| b.track == piece.track && b.label == piece.label);
        match out.last_mut().filter(|_| goes_on) {
            Some(open) => {
                open.frames.end = piece.frames.end;
                open.nats = open.nats.max(piece.nats);
            }
            None => out.push(Move {
                track: piece.track,
                frames: piece.frames.clone(),
                to: piece.label,
                nats: piece.nats,
            }),
        }
    }
    out
}

/// The changes that some moves make, in the order of their frames; tracks below `labels` are
/// labels.
pub(crate) fn changes(moves: &[Move], labels: usize) -> Vec<Change> {
    let mut is_told = vec![false; moves.len()];
    let mut out = Vec::new();
    for (n, one) in moves.iter().enumerate() {
        if is_told[n] {
            continue;
        }
        let Some(to) = one.to else {
            if one.track < labels {
                out.push(change(ChangeKind::Out, one, vec![one.track]));
            }
            continue;
        };
        let ring = if one.track < labels {
            ring(moves, n, &is_told)
        } else {
            None
        };
        let Some(ring) = ring else {
            let kind = if one.track < labels {
                ChangeKind::Moved
            } else {
                ChangeKind::Joined
            };
            out.push(change(kind, one, vec![one.track, to]));
            continue;
        };
        ring.iter().for_each(|k| is_told[*k] = true);
        let kind = if ring.len() == 2 {
            ChangeKind::Swap
        } else {
            ChangeKind::Cycle
        };
        let tracks = ring.iter().map(|k| moves[*k].track).collect();
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

fn change(kind: ChangeKind, of: &Move, tracks: Vec<usize>) -> Change {
    Change {
        kind,
        frames: of.frames.clone(),
        tracks,
        nats: of.nats,
    }
}

/// The moves at about the same time that bring a track back to itself.
fn ring(moves: &[Move], first: usize, is_told: &[bool]) -> Option<Vec<usize>> {
    let home = moves[first].track;
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
            .find(|k| moves[*k].track == to && !is_told[*k] && !ring.contains(k) && overlaps(*k));
        ring.push(next?);
    }
}

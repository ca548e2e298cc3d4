//! What was done to the labels of a take, change by change.

use super::sides::SideBy;
use crate::io::PointMove;
use serde::Serialize;
use std::collections::HashSet;
use std::ops::Range;

/// What a change of labels does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChangeKind {
    /// Two labels that were exchanged for some frames go back.
    Swap,
    /// Three or more labels that were exchanged in a ring go back.
    Cycle,
    /// A track without a label gets the label of its marker.
    Joined,
    /// Positions move from a label to the label of their marker.
    Moved,
    /// Two labels that were exchanged in every frame go back.
    WholeTake,
    /// Positions of no marker, such as a reflection, lose their label.
    #[serde(rename = "taken-out")]
    Out,
}

impl ChangeKind {
    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            ChangeKind::Swap => "swap",
            ChangeKind::Cycle => "ring",
            ChangeKind::Joined => "joined",
            ChangeKind::Moved => "moved",
            ChangeKind::WholeTake => "whole take",
            ChangeKind::Out => "taken out",
        }
    }
}

/// A change: moves that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    pub kind: ChangeKind,
    pub frames: Range<usize>,
    /// The tracks, each of which moved to the next, the last to the first of a swap or cycle.
    pub tracks: Vec<usize>,
    pub moves: Vec<PointMove>,
    /// How much likelier the positions are as they are then, nats.
    pub nats: f64,
    /// What decided which side of an exchange is right.
    pub side: Option<SideBy>,
}

impl Change {
    fn new(kind: ChangeKind, tracks: Vec<usize>, moves: Vec<PointMove>) -> Change {
        let start = moves.iter().map(|m| m.frames.start).min();
        let end = moves.iter().map(|m| m.frames.end).max();
        Change {
            kind,
            frames: start.unwrap_or(0)..end.unwrap_or(0),
            tracks,
            moves,
            nats: 0.0,
            side: None,
        }
    }
}

/// The moves that some fragments make, track after track.
pub(crate) fn moves(fragments: &[PointMove]) -> Vec<PointMove> {
    let mut out: Vec<PointMove> = Vec::new();
    let mut last: Option<&PointMove> = None;
    for fragment in fragments {
        let before = last.replace(fragment);
        if fragment.to == Some(fragment.from) {
            continue;
        }
        let goes_on = before.is_some_and(|b| (b.from, b.to) == (fragment.from, fragment.to));
        match out.last_mut().filter(|_| goes_on) {
            Some(open) => open.frames.end = fragment.frames.end,
            None => out.push(fragment.clone()),
        }
    }
    out
}

/// The changes that some moves make, in the order of their frames; tracks below `labels` are
/// labels. Tracks without a label that stay so are none.
pub(crate) fn changes(moves: Vec<PointMove>, labels: usize) -> Vec<Change> {
    let mut is_told = vec![false; moves.len()];
    let mut out = Vec::new();
    for (n, one) in moves.iter().enumerate() {
        if is_told[n] {
            continue;
        }
        let is_label = one.from < labels;
        let (kind, tracks) = match one.to {
            None if is_label => (ChangeKind::Out, vec![one.from]),
            None => continue,
            Some(to) if is_label => match ring(&moves, n, &is_told) {
                Some(ring) => {
                    ring.iter().for_each(|k| is_told[*k] = true);
                    let kind = match ring.len() {
                        2 => ChangeKind::Swap,
                        _ => ChangeKind::Cycle,
                    };
                    let tracks = ring.iter().map(|k| moves[*k].from).collect();
                    let moves = ring.iter().map(|k| moves[*k].clone()).collect();
                    out.push(Change::new(kind, tracks, moves));
                    continue;
                }
                None => (ChangeKind::Moved, vec![one.from, to]),
            },
            Some(to) => (ChangeKind::Joined, vec![one.from, to]),
        };
        out.push(Change::new(kind, tracks, vec![one.clone()]));
    }
    out.sort_by_key(|c| (c.frames.start, c.tracks.clone()));
    out
}

/// Keeps of some changes what is wanted, and can be made without the others: none brings a
/// position to where another stays. `has(track, frame)`: whether the track is seen there.
pub(crate) fn wanted(
    mut changes: Vec<Change>,
    is_wanted: impl Fn(&Change) -> bool,
    has: impl Fn(usize, usize) -> bool,
) -> Vec<Change> {
    let before = changes.len();
    changes.retain(is_wanted);
    if changes.len() == before {
        return changes;
    }
    loop {
        let leaves: HashSet<(usize, usize)> = (changes.iter().flat_map(|c| &c.moves))
            .flat_map(|m| m.frames.clone().map(|t| (m.from, t)))
            .collect();
        let is_open = |change: &Change| {
            let mut arrives = (change.moves.iter())
                .filter_map(|m| Some((m.to?, m.frames.clone())))
                .flat_map(|(to, frames)| frames.map(move |t| (to, t)));
            arrives.all(|(to, t)| !has(to, t) || leaves.contains(&(to, t)))
        };
        let open: Vec<bool> = changes.iter().map(is_open).collect();
        if open.iter().all(|o| *o) {
            return changes;
        }
        let mut open = open.into_iter();
        changes.retain(|_| open.next() == Some(true));
    }
}

/// Exchanges pairs of tracks in every frame of a take, after all other changes in it.
pub(crate) fn exchange_in_take(
    changes: &mut Vec<Change>,
    pairs: &[usize],
    take: &Range<usize>,
    by: SideBy,
) {
    let other = |point: usize| {
        let k = pairs.iter().position(|p| *p == point)?;
        pairs.get(k ^ 1).copied()
    };
    let mut left: Vec<Vec<Range<usize>>> = vec![vec![take.clone()]; pairs.len()];
    for change in changes.iter_mut() {
        for step in change
            .moves
            .iter_mut()
            .filter(|m| take.contains(&m.frames.start))
        {
            if let Some(k) = pairs.iter().position(|p| *p == step.from) {
                left[k] = (left[k].iter())
                    .flat_map(|r| {
                        let first = r.start..step.frames.start.clamp(r.start, r.end);
                        [first, step.frames.end.clamp(r.start, r.end)..r.end]
                    })
                    .filter(|r| !r.is_empty())
                    .collect();
            }
            step.to = step.to.map(|to| other(to).unwrap_or(to));
        }
        change.moves.retain(|m| m.to != Some(m.from));
        if matches!(change.kind, ChangeKind::Joined | ChangeKind::Moved) {
            change.tracks.truncate(1);
            change
                .tracks
                .extend(change.moves.first().and_then(|m| m.to));
        }
    }
    changes.retain(|change| !change.moves.is_empty());
    for (k, pair) in pairs.chunks_exact(2).enumerate() {
        let moves = [0, 1].into_iter().flat_map(|n| {
            let of = |frames: &Range<usize>| PointMove {
                from: pair[n],
                to: Some(pair[1 - n]),
                frames: frames.clone(),
            };
            left[2 * k + n].iter().map(of).collect::<Vec<_>>()
        });
        changes.push(Change {
            kind: ChangeKind::WholeTake,
            frames: take.clone(),
            tracks: pair.to_vec(),
            moves: moves.collect(),
            nats: f64::NAN,
            side: Some(by),
        });
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

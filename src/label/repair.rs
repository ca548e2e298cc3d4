//! Labels put right: exchanged ones back, pieces without a label joined, stretches away from a
//! point taken out.
//!
//! 1. Tracks are cut into pieces and these linked; exchanges between labels follow ([`pieces`],
//!    [`links`], [`identities`]), and where one lasts long, the body's mirror image says which side
//!    is right ([`super::mirror`]). That alone puts exchanges back.
//! 2. Pieces that are linked are a path. In some rounds each path, the best known ones aside, moves
//!    to the label that fits it far better: one that nobody holds then, one that shorter paths
//!    hold, one that another path gives for its own, or none.
//!
//! No position changes. What is not sure stays as it was and is told.

use super::evidence::Evidence;
use super::identities::{Course, Exchange, Exchanged, exchanges};
use super::links::{End, Links, link_cost};
use super::mirror::Mirror;
use super::pieces::{Piece, pieces};
use super::tuning::repair::*;
use crate::io::PointMove;
use crate::pose::point_at;
use ndarray::{Array2, ArrayView2};
use std::collections::BTreeMap;
use std::ops::Range;

/// A take whose labels are to be put right.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LabeledTake<'a> {
    /// The tracks' names (N): labels first, then those that have none.
    pub names: &'a [String],
    /// How many are labels.
    pub labels: usize,
    /// (frames, 3 N), cm; NaN is missing.
    pub xyz: ArrayView2<'a, f64>,
    /// Ranges of consecutive frames.
    pub runs: &'a [Range<usize>],
    /// Frames a second.
    pub rate: f64,
}

/// Labels of which one side of an exchange is right and nothing says which.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unsure {
    pub labels: Vec<usize>,
    pub frames: Vec<Range<usize>>,
}

/// What becomes of the tracks of a take.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Repair {
    /// Every piece, track after track, and the label that it is: its own where it stays.
    pub pieces: Vec<PointMove>,
    pub unsure: Vec<Unsure>,
}

/// Puts the labels of a take right.
pub(crate) fn repair(take: LabeledTake<'_>) -> Repair {
    let pieces = pieces(take.xyz, take.runs, take.rate);
    let Links { mut links, ends } = Links::new(take.xyz, &pieces, take.labels, take.rate);
    let found = exchanges(&pieces, &mut links, take.labels);
    let named = take.xyz.slice(ndarray::s![.., ..3 * take.labels]);
    let mut unsure = Vec::new();
    let stretches = match found.is_empty() {
        true => Vec::new(),
        false => take.stretches(&found, named, &mut unsure),
    };
    let identity = |piece: &Piece| match piece.track < take.labels {
        true => Some(point_in(piece.track, piece.frames.start, &stretches)),
        false => None,
    };
    let identities: Vec<Option<usize>> = pieces.iter().map(identity).collect();
    let mut state = State::new(take, pieces, ends, identities);
    state.join(&links);
    for round in 0..ROUNDS {
        if !state.round(round) {
            break;
        }
    }
    state.assigned(unsure)
}

/// The point whose places a track has from a frame on.
fn point_in(track: usize, frame: usize, stretches: &[Exchanged]) -> usize {
    let mut point = track;
    // The last exchange that began comes off first.
    let then = stretches.iter().rev().filter(|s| s.frames.contains(&frame));
    for stretch in then {
        if let Some(k) = stretch.to.iter().position(|to| *to == point) {
            point = stretch.labels[k];
        }
    }
    point
}

impl LabeledTake<'_> {
    /// The stretches in which labels stand under each other's names, those aside of which nothing
    /// says which side is right.
    fn stretches(
        &self,
        found: &[Exchange],
        named: ArrayView2<'_, f64>,
        unsure: &mut Vec<Unsure>,
    ) -> Vec<Exchanged> {
        let evidence = Evidence::learn(named);
        let course = Course {
            evidence: &evidence,
            places: named,
            rate: self.rate,
        };
        let mirror = Mirror::new(&self.names[..self.labels], named);
        let mut by_labels: BTreeMap<&[usize], Vec<&Exchange>> = BTreeMap::new();
        for exchange in found {
            by_labels
                .entry(&exchange.labels)
                .or_default()
                .push(exchange);
        }
        let mut out = Vec::new();
        for (labels, exchanges) in by_labels {
            let stretches = course.stretches(&exchanges);
            let side = self.right_side(labels, &stretches, &mirror);
            match side {
                Side::Named => out.extend(stretches),
                Side::Exchanged => out.extend(self.others(labels, &stretches)),
                Side::Unknown => unsure.push(Unsure {
                    labels: labels.to_vec(),
                    frames: stretches.into_iter().map(|s| s.frames).collect(),
                }),
            }
        }
        out.sort_by_key(|s| s.frames.start);
        out
    }

    /// Where the names of labels that were exchanged are right.
    fn right_side(&self, labels: &[usize], stretches: &[Exchanged], mirror: &Mirror<'_>) -> Side {
        let exchanged: Vec<Range<usize>> = stretches.iter().map(|s| s.frames.clone()).collect();
        let rest = outside(&exchanged, self.xyz.nrows());
        let seen = |ranges: &[Range<usize>]| {
            let is_seen = |t: &usize| {
                labels
                    .iter()
                    .any(|l| point_at(self.xyz, *t, *l).is_finite())
            };
            ranges.iter().cloned().flatten().filter(is_seen).count() as f64
        };
        let (within, without) = (seen(&exchanged), seen(&rest));
        let share = within / (within + without).max(1.0);
        let shorter = share.min(1.0 - share);
        if shorter < LONG {
            return Side::Named;
        }
        let costs = mirror
            .cost(labels, &rest)
            .zip(mirror.cost(labels, &exchanged));
        match costs.map(|(named, exchanged)| exchanged - named) {
            Some(better) if better > CLEAR => Side::Named,
            // Labels in a ring are not put back by its inverse.
            Some(better) if better < -CLEAR && labels.len() == 2 => Side::Exchanged,
            _ if shorter > OPEN => Side::Unknown,
            _ => Side::Named,
        }
    }

    /// The stretches in which two labels do not stand under each other's names.
    fn others(&self, labels: &[usize], stretches: &[Exchanged]) -> Vec<Exchanged> {
        let frames: Vec<Range<usize>> = stretches.iter().map(|s| s.frames.clone()).collect();
        let rest = outside(&frames, self.xyz.nrows()).into_iter();
        let exchanged = rest.map(|frames| Exchanged {
            labels: labels.to_vec(),
            to: labels.iter().rev().copied().collect(),
            frames,
        });
        exchanged.collect()
    }
}

/// On which side of an exchange the names are right.
enum Side {
    Named,
    Exchanged,
    Unknown,
}

/// The frames of a take outside of some ranges, which are in order.
fn outside(ranges: &[Range<usize>], frames: usize) -> Vec<Range<usize>> {
    let starts = std::iter::once(0).chain(ranges.iter().map(|r| r.end));
    let ends = ranges
        .iter()
        .map(|r| r.start)
        .chain(std::iter::once(frames));
    let all = starts.zip(ends).map(|(start, end)| start..end);
    all.filter(|r| r.start < r.end).collect()
}

/// Pieces that are linked.
#[derive(Debug, Clone)]
struct Path {
    pieces: Vec<usize>,
    /// How many frames it has.
    frames: usize,
    /// How many of them bear which name.
    named: BTreeMap<usize, usize>,
    label: Option<usize>,
    /// Whether it stays as it is.
    stands: bool,
}

/// How well a path fits a label.
#[derive(Debug, Clone, Copy)]
struct Fit {
    /// Nats a frame.
    mean: f64,
    /// S: nats in all.
    score: f64,
}

/// A move of a path.
#[derive(Debug, Clone)]
enum Move {
    To(usize),
    Exchange(usize),
    Oust(usize, Vec<usize>),
    Out,
}

/// Which path holds which label when.
struct State<'a> {
    take: LabeledTake<'a>,
    pieces: Vec<Piece>,
    ends: Vec<[End; 2]>,
    identities: Vec<Option<usize>>,
    paths: Vec<Path>,
    path_of: Vec<usize>,
    /// Where each label is (frames, 3 L), cm.
    places: Array2<f64>,
    /// The piece that holds a label in a frame, by label and frame.
    holder: Vec<Vec<Option<usize>>>,
    evidence: Evidence,
}

impl<'a> State<'a> {
    fn new(
        take: LabeledTake<'a>,
        pieces: Vec<Piece>,
        ends: Vec<[End; 2]>,
        identities: Vec<Option<usize>>,
    ) -> State<'a> {
        let frames = take.xyz.nrows();
        State {
            take,
            path_of: vec![0; pieces.len()],
            pieces,
            ends,
            identities,
            paths: Vec::new(),
            places: Array2::from_elem((frames, 3 * take.labels), f64::NAN),
            holder: vec![vec![None; frames]; take.labels],
            evidence: Evidence::learn(Array2::zeros((0, 0)).view()),
        }
    }

    /// Makes paths of the linked pieces, each with the name that most of its frames have.
    fn join(&mut self, links: &[super::links::Link]) {
        let mut next = vec![None; self.pieces.len()];
        let mut is_first = vec![true; self.pieces.len()];
        // Where nothing says which side of an exchange is right, what was linked stays apart.
        let is_one = |link: &&super::links::Link| {
            let [from, to] = [link.from, link.to].map(|p| self.identities[p]);
            from == to || from.is_none() || to.is_none()
        };
        for link in links.iter().filter(is_one) {
            next[link.from] = Some(link.to);
            is_first[link.to] = false;
        }
        for first in (0..self.pieces.len()).filter(|p| is_first[*p]) {
            let chain: Vec<usize> =
                std::iter::successors(Some(first), |p: &usize| next[*p]).collect();
            let mut named = BTreeMap::new();
            for p in &chain {
                self.path_of[*p] = self.paths.len();
                if let Some(label) = self.identities[*p] {
                    *named.entry(label).or_insert(0) += self.pieces[*p].frames.len();
                }
            }
            let frames = chain.iter().map(|p| self.pieces[*p].frames.len()).sum();
            self.paths.push(Path {
                pieces: chain,
                frames,
                named,
                label: None,
                stands: 2 * frames > self.take.xyz.nrows(),
            });
        }
        let mut longest: Vec<usize> = (0..self.paths.len()).collect();
        longest.sort_by_key(|p| (std::cmp::Reverse(self.paths[*p].frames), *p));
        for path in longest {
            let most = self.paths[path]
                .named
                .iter()
                .max_by_key(|(label, n)| (**n, usize::MAX - **label));
            if let Some(label) = most
                .map(|(label, _)| *label)
                .filter(|l| self.is_free(path, *l, &[]))
            {
                self.set(path, Some(label));
            }
        }
    }

    /// Whether no path but some holds a label in the frames of another.
    fn is_free(&self, path: usize, label: usize, but: &[usize]) -> bool {
        let is_open = |t: usize| {
            let holder = self.holder[label][t].map(|piece| self.path_of[piece]);
            holder.is_none_or(|h| h == path || but.contains(&h))
        };
        self.frames(path).all(is_open)
    }

    fn frames(&self, path: usize) -> impl Iterator<Item = usize> + '_ {
        self.paths[path]
            .pieces
            .iter()
            .flat_map(|p| self.pieces[*p].frames.clone())
    }

    /// Gives a path a label, or none.
    fn set(&mut self, path: usize, label: Option<usize>) {
        let before = std::mem::replace(&mut self.paths[path].label, label);
        for &p in &self.paths[path].pieces {
            let Piece { track, frames, .. } = &self.pieces[p];
            for t in frames.clone() {
                if let Some(before) = before {
                    self.holder[before][t] = None;
                    (0..3).for_each(|c| self.places[[t, 3 * before + c]] = f64::NAN);
                }
            }
            for t in frames.clone() {
                if let Some(label) = label {
                    self.holder[label][t] = Some(p);
                    let from = 3 * track;
                    (0..3).for_each(|c| {
                        self.places[[t, 3 * label + c]] = self.take.xyz[[t, from + c]]
                    });
                }
            }
        }
    }

    /// One round over the paths; whether something moved.
    fn round(&mut self, round: usize) -> bool {
        self.evidence = Evidence::learn(self.places.view());
        let mut moved = round == 0 && self.take_out_stretches();
        let mut labeled: Vec<usize> = Vec::new();
        let mut loose: Vec<usize> = Vec::new();
        for (n, path) in self
            .paths
            .iter()
            .enumerate()
            .filter(|(_, path)| !path.stands)
        {
            match path.named.is_empty() && path.label.is_none() {
                true => loose.push(n),
                false => labeled.push(n),
            }
        }
        labeled.sort_by_key(|p| (self.paths[*p].frames, *p));
        loose.sort_by_key(|p| (std::cmp::Reverse(self.paths[*p].frames), *p));
        for path in labeled.into_iter().chain(loose) {
            if let Some(step) = self.best_move(path) {
                self.make(path, step);
                moved = true;
            }
        }
        moved
    }

    fn make(&mut self, path: usize, step: Move) {
        match step {
            Move::To(label) => self.set(path, Some(label)),
            Move::Out => self.set(path, None),
            Move::Oust(label, holders) => {
                holders.iter().for_each(|h| self.set(*h, None));
                self.set(path, Some(label));
            }
            Move::Exchange(other) => {
                let labels = [self.paths[path].label, self.paths[other].label];
                self.set(path, None);
                self.set(other, None);
                self.set(path, labels[1]);
                self.set(other, labels[0]);
            }
        }
    }

    /// Takes out paths that jump off their track and back.
    fn take_out_stretches(&mut self) -> bool {
        let away: Vec<usize> = (0..self.paths.len()).filter(|p| self.is_away(*p)).collect();
        for path in &away {
            self.make(*path, Move::Out);
            self.paths[*path].stands = true;
        }
        !away.is_empty()
    }

    fn is_away(&self, path: usize) -> bool {
        let Path {
            pieces,
            frames,
            label,
            ..
        } = &self.paths[path];
        let [piece] = pieces[..] else { return false };
        let Piece {
            track,
            frames: range,
            jumps,
        } = &self.pieces[piece];
        if label.is_none() || *jumps != [true; 2] || *frames as f64 > AWAY_LONGEST * self.take.rate
        {
            return false;
        }
        let step = |t: usize| {
            point_at(self.take.xyz, t, *track).distance(point_at(self.take.xyz, t - 1, *track))
        };
        let beside = self.pieces[piece - 1].frames.len() + self.pieces[piece + 1].frames.len();
        let is_far = step(range.start) >= AWAY && step(range.end) >= AWAY;
        let fits = |label: usize| {
            self.fit(path, label, &[])
                .is_some_and(|f| f.score >= AWAY_SCORE)
        };
        is_far && 2 * frames <= beside && !label.is_some_and(fits)
    }

    /// How well a path fits a label, some labels left out of the neighbors; `None` where too few of
    /// these are seen.
    fn fit(&self, path: usize, label: usize, without: &[usize]) -> Option<Fit> {
        let of = &self.paths[path];
        let step = of.frames.div_ceil(MOST_FRAMES).max(1);
        let (mut sum, mut count, mut n) = (0.0, 0, 0);
        for &p in &of.pieces {
            let Piece { track, frames, .. } = &self.pieces[p];
            for t in frames.clone() {
                n += 1;
                if (n - 1) % step > 0 {
                    continue;
                }
                let place = point_at(self.take.xyz, t, *track);
                let nats = self
                    .evidence
                    .at(label, place, t, self.places.view(), without);
                if let Some(nats) = nats {
                    sum += nats.min(MOST_NATS);
                    count += 1;
                }
            }
        }
        if count == 0 {
            return None;
        }
        let mean = sum / count as f64;
        let share = of
            .named
            .get(&label)
            .map_or(0.0, |n| *n as f64 / of.frames as f64);
        let weight = (1.0 + of.frames as f64 / (APART * self.take.rate)).min(MOST_WEIGHT);
        Some(Fit {
            mean,
            score: weight * (mean + NAMED * share),
        })
    }

    /// How well the ends of a path go on in what holds a label beside it: -30 to 12.
    fn continuity(&self, path: usize, label: usize) -> f64 {
        let longest = (super::tuning::links::LONGEST * self.take.rate) as usize;
        let pieces = &self.paths[path].pieces;
        let (Some(&first), Some(&last)) = (pieces.first(), pieces.last()) else {
            return 0.0;
        };
        let at = |t: usize| self.holder[label].get(t).copied().flatten();
        let is_other = |p: &usize| self.path_of[*p] != path;
        let (start, end) = (
            self.pieces[first].frames.start,
            self.pieces[last].frames.end,
        );
        let before = (start.saturating_sub(longest + 1)..start)
            .rev()
            .find_map(|t| at(t).filter(is_other));
        let after = (end..end + longest + 1).find_map(|t| at(t).filter(is_other));
        let clipped = |cost: f64| (LINKED - cost / 2.0).clamp(-UNLINKED, LINKED);
        let before = before.map(|p| {
            let gap = start.saturating_sub(self.pieces[p].frames.end);
            clipped(link_cost(
                &self.ends[p][1],
                &self.ends[first][0],
                gap,
                self.take.rate,
            ))
        });
        let after = after.map(|p| {
            let gap = self.pieces[p].frames.start.saturating_sub(end);
            clipped(link_cost(
                &self.ends[last][1],
                &self.ends[p][0],
                gap,
                self.take.rate,
            ))
        });
        before.unwrap_or(0.0) + after.unwrap_or(0.0)
    }

    /// The move of a path that gains most, if it is enough.
    fn best_move(&self, path: usize) -> Option<Move> {
        let own = self.paths[path].label;
        let own_fit = match own {
            Some(label) => Some(self.fit(path, label, &[])?),
            None => None,
        };
        let old = own
            .zip(own_fit)
            .map_or(0.0, |(label, fit)| fit.score + self.continuity(path, label));
        let mut moves: Vec<(f64, Move)> = Vec::new();
        for label in (0..self.take.labels).filter(|l| Some(*l) != own) {
            let holders = self.holders(path, label);
            if !holders.is_empty() && (own.is_some() || !self.are_shorter(&holders, path)) {
                continue;
            }
            let Some(fit) = self.fit(path, label, &[]) else {
                continue;
            };
            let continuity = self.continuity(path, label);
            if !self.is_fit(path, label, fit, continuity) {
                continue;
            }
            if holders.is_empty() {
                moves.push((fit.score + continuity - old, Move::To(label)));
                continue;
            }
            let lost = holders.iter().filter_map(|h| self.fit(*h, label, &[]));
            let lost: f64 = lost.map(|f| f.score).sum();
            moves.push((fit.score - lost, Move::Oust(label, holders)));
        }
        if let Some((own, fit)) = own.zip(own_fit) {
            if fit.mean < self.evidence.own[own][1] {
                moves.extend(self.exchanging(path, own));
            }
            let first = self.paths[path]
                .pieces
                .first()
                .map(|p| self.pieces[*p].jumps[0]);
            let last = self.paths[path]
                .pieces
                .last()
                .map(|p| self.pieces[*p].jumps[1]);
            let jumps = first == Some(true) || last == Some(true);
            if fit.score < if jumps { POOR } else { POOREST } {
                moves.push((-old, Move::Out));
            }
        }
        let best = moves.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(gain, _)| *gain > LEAST_GAIN)
            .map(|(_, step)| step)
    }

    /// The other paths that hold a label in the frames of one.
    fn holders(&self, path: usize, label: usize) -> Vec<usize> {
        let frames = self.frames(path);
        let all = frames.filter_map(|t| self.holder[label][t].map(|p| self.path_of[p]));
        let mut holders: Vec<usize> = all.filter(|h| *h != path).collect();
        holders.dedup();
        holders.sort_unstable();
        holders.dedup();
        holders
    }

    fn are_shorter(&self, holders: &[usize], path: usize) -> bool {
        let is =
            |h: &usize| self.paths[*h].frames < self.paths[path].frames && !self.paths[*h].stands;
        holders.iter().all(is)
    }

    /// Whether a path is as near to the neighbors of a label as its own places are, or goes on in
    /// them, or is long and like no other.
    fn is_fit(&self, path: usize, label: usize, fit: Fit, continuity: f64) -> bool {
        let [median, few] = self.evidence.own[label];
        if fit.mean >= few {
            return true;
        }
        if continuity >= GOES_ON && fit.mean >= few - (median - few).max(LOWER) {
            return true;
        }
        let is_long = self.paths[path].frames as f64 >= LASTING * self.take.rate;
        let is_good = is_long && continuity >= -BROKEN && fit.mean >= GOOD;
        let mut others = (0..self.take.labels).filter(|other| *other != label);
        let is_worse = |other| {
            self.fit(path, other, &[])
                .is_none_or(|o| fit.mean >= o.mean + BETTER)
        };
        is_good && others.all(is_worse)
    }

    /// A path and another that give each other their labels.
    fn exchanging(&self, path: usize, own: usize) -> Option<(f64, Move)> {
        let mut others: Vec<usize> = self
            .frames(path)
            .step_by(FRAME_STEP)
            .flat_map(|t| self.holder.iter().filter_map(move |of| of[t]))
            .map(|piece| self.path_of[piece])
            .filter(|other| *other != path && !self.paths[*other].stands)
            .collect();
        others.sort_unstable();
        others.dedup();
        let gain = |other: usize| {
            let label = self.paths[other].label?;
            let both = [own, label];
            if !self.is_free(path, label, &[other]) || !self.is_free(other, own, &[path]) {
                return None;
            }
            let fit = |path, label| self.fit(path, label, &both).map(|f| f.score);
            let gain = fit(path, label)? + fit(other, own)? - fit(path, own)? - fit(other, label)?;
            Some((gain, Move::Exchange(other)))
        };
        others
            .into_iter()
            .filter_map(gain)
            .max_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn assigned(self, unsure: Vec<Unsure>) -> Repair {
        let of = |(p, piece): (usize, &Piece)| PointMove {
            from: piece.track,
            frames: piece.frames.clone(),
            to: self.paths[self.path_of[p]].label,
        };
        Repair {
            pieces: self.pieces.iter().enumerate().map(of).collect(),
            unsure,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::changes::{Change, ChangeKind, changes, moves};
    use super::*;
    use glam::{DMat3, DVec3};

    const FRAMES: usize = 900;
    const NAMES: [&str; 15] = [
        "LSHO", "LUPA", "LELB", "LFRM", "LWRA", "LWRB", "RSHO", "RUPA", "RELB", "RFRM", "RWRA",
        "RWRB", "CLAV", "STRN", "C7",
    ];

    /// Two arms that swing, each about its shoulder and its elbow, and a trunk.
    fn body() -> Array2<f64> {
        let mut xyz = Array2::zeros((FRAMES, 45));
        for t in 0..FRAMES {
            let time = t as f64 / 120.0;
            let trunk = DVec3::new(10.0 * time, 3.0 * (5.0 * time).sin(), 0.0);
            for side in 0..2 {
                let s = if side == 0 { 1.0 } else { -1.0 };
                let upper = DMat3::from_rotation_x(0.6 * (3.0 * time + s).sin());
                let lower = upper * DMat3::from_rotation_x(0.5 + 0.4 * (4.0 * time - s).sin());
                let shoulder = trunk + DVec3::new(18.0 * s, 140.0, 0.0);
                let elbow = shoulder + upper * DVec3::new(2.0 * s, -28.0, 0.0);
                let places = [
                    shoulder,
                    shoulder + upper * DVec3::new(5.0 * s, -14.0, 2.0),
                    elbow,
                    elbow + lower * DVec3::new(3.0 * s, -12.0, 3.0),
                    elbow + lower * DVec3::new(3.0 * s, -24.0, 2.5),
                    elbow + lower * DVec3::new(-3.0 * s, -24.0, -2.5),
                ];
                for (k, place) in places.into_iter().enumerate() {
                    set(&mut xyz, t, 6 * side + k, place);
                }
            }
            for (k, off) in [[0.0, 135.0, 9.0], [0.0, 118.0, 11.0], [0.0, 146.0, -8.0]]
                .into_iter()
                .enumerate()
            {
                set(&mut xyz, t, 12 + k, trunk + DVec3::from_array(off));
            }
        }
        for (i, v) in xyz.iter_mut().enumerate() {
            *v += 0.03 * (i as f64 * 12.9898).sin();
        }
        xyz
    }

    fn set(xyz: &mut Array2<f64>, t: usize, point: usize, place: DVec3) {
        (0..3).for_each(|c| xyz[[t, 3 * point + c]] = place[c]);
    }

    fn swap(xyz: &mut Array2<f64>, frames: Range<usize>, [a, b]: [usize; 2]) {
        for (t, c) in frames.flat_map(|t| (0..3).map(move |c| (t, c))) {
            xyz.swap([t, 3 * a + c], [t, 3 * b + c]);
        }
    }

    /// What is changed in a take of these tracks, and what is not sure; tracks beyond the names
    /// have no label.
    fn found(xyz: &Array2<f64>) -> (Vec<Change>, Vec<Unsure>) {
        let mut names: Vec<String> = NAMES.map(String::from).to_vec();
        names.extend((NAMES.len()..xyz.ncols() / 3).map(|n| format!("*{n}")));
        let run = 0..xyz.nrows();
        let repair = repair(LabeledTake {
            names: &names,
            labels: NAMES.len(),
            xyz: xyz.view(),
            runs: std::slice::from_ref(&run),
            rate: 120.0,
        });
        (changes(&moves(&repair), NAMES.len()), repair.unsure)
    }

    fn of(change: &Change) -> (ChangeKind, Range<usize>, Vec<usize>) {
        (change.kind, change.frames.clone(), change.tracks.clone())
    }

    #[test]
    fn a_take_that_is_right_stays() {
        assert_eq!(found(&body()), (vec![], vec![]));
    }

    #[test]
    fn exchanges_and_stretches_away_are_found_to_the_frame() {
        let mut xyz = body();
        swap(&mut xyz, 200..260, [4, 5]);
        // To the end of the take, and in a ring.
        swap(&mut xyz, 700..900, [10, 11]);
        swap(&mut xyz, 400..450, [1, 2]);
        swap(&mut xyz, 400..450, [2, 3]);
        for t in 300..330 {
            let place = point_at(xyz.view(), t, 8) + DVec3::new(9.0, 12.0, 5.0);
            set(&mut xyz, t, 8, place);
        }
        let (changes, unsure) = found(&xyz);
        let all: Vec<_> = changes.iter().map(of).collect();
        assert_eq!(unsure, []);
        assert_eq!(all[0], (ChangeKind::Swap, 200..260, vec![4, 5]));
        assert_eq!(all[1], (ChangeKind::Out, 300..330, vec![8]));
        assert_eq!((all[2].0, &all[2].1), (ChangeKind::Cycle, &(400..450)));
        assert_eq!(all[3], (ChangeKind::Swap, 700..900, vec![10, 11]));
        assert_eq!(all.len(), 4);
    }

    #[test]
    fn pieces_are_joined_and_reflections_are_not() {
        let truth = body();
        let mut xyz = Array2::from_elem((FRAMES, 51), f64::NAN);
        xyz.slice_mut(ndarray::s![.., ..45]).assign(&truth);
        for t in 240..420 {
            let place = point_at(truth.view(), t, 4);
            set(&mut xyz, t, 4, DVec3::NAN);
            if (246..415).contains(&t) {
                set(&mut xyz, t, 15, place);
            }
            set(&mut xyz, t, 16, place + DVec3::new(12.0, 7.0, 9.0));
        }
        let (changes, unsure) = found(&xyz);
        let all: Vec<_> = changes.iter().map(of).collect();
        assert_eq!(all, [(ChangeKind::Joined, 246..415, vec![15, 4])]);
        assert_eq!(unsure, []);
    }

    #[test]
    fn the_mirror_image_says_which_side_of_a_long_exchange_is_right() {
        for frames in [300..700, 100..650] {
            let mut xyz = body();
            swap(&mut xyz, frames.clone(), [2, 4]);
            let (changes, unsure) = found(&xyz);
            assert_eq!(unsure, []);
            let all: Vec<_> = changes.iter().map(of).collect();
            assert_eq!(all, [(ChangeKind::Swap, frames, vec![2, 4])]);
        }
        // Mirror images of each other say nothing.
        let mut xyz = body();
        swap(&mut xyz, 300..700, [4, 10]);
        let (changes, unsure) = found(&xyz);
        assert_eq!(changes, []);
        assert_eq!(unsure.len(), 1);
        assert_eq!(unsure[0].labels, [4, 10]);
    }
}

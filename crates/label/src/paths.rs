//! Fragments that are linked, and the label of each: in some rounds, every path moves to the label
//! that fits it far better: one that nobody holds then, one that shorter paths hold, one that
//! another path gives for its own, or none.

use super::evidence::{Evidence, independent_frames};
use super::fragments::{Fragment, Link};
use super::labeled_take::LabeledTake;
use super::links::{End, chains, link_cost};
use super::tuning::out_and_back;
use super::tuning::repair::*;
use crate::io::PointMove;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;

/// Fragments that are linked.
#[derive(Debug, Clone)]
struct Path {
    fragments: Vec<usize>,
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
pub(crate) struct Paths<'a> {
    take: LabeledTake<'a>,
    fragments: Vec<Fragment>,
    ends: Vec<[End; 2]>,
    identities: Vec<Option<usize>>,
    paths: Vec<Path>,
    path_of: Vec<usize>,
    /// Where each label is (frames, 3 L), cm.
    positions: Array2<f64>,
    /// The fragment that holds a label in a frame, by label and frame.
    holder: Vec<Vec<Option<usize>>>,
    evidence: Evidence,
}

impl<'a> Paths<'a> {
    pub(crate) fn new(
        take: LabeledTake<'a>,
        fragments: Vec<Fragment>,
        ends: Vec<[End; 2]>,
        identities: Vec<Option<usize>>,
    ) -> Paths<'a> {
        let frames = take.xyz.nrows();
        Paths {
            take,
            path_of: vec![0; fragments.len()],
            fragments,
            ends,
            identities,
            paths: Vec::new(),
            positions: Array2::from_elem((frames, 3 * take.labels), f64::NAN),
            holder: vec![vec![None; frames]; take.labels],
            evidence: Evidence::learn(Array2::zeros((0, 0)).view()),
        }
    }

    /// Makes paths of the linked fragments, each with the name that most of its frames have.
    pub(crate) fn join(&mut self, links: &[Link]) {
        // Where nothing says which side of an exchange is right, what was linked stays apart.
        let is_one = |link: &&Link| {
            let [from, to] = [link.from, link.to].map(|p| self.identities[p]);
            from == to || from.is_none() || to.is_none()
        };
        for chain in chains(self.fragments.len(), links.iter().filter(is_one).copied()) {
            let mut named = BTreeMap::new();
            for p in &chain {
                self.path_of[*p] = self.paths.len();
                if let Some(label) = self.identities[*p] {
                    *named.entry(label).or_insert(0) += self.fragments[*p].frames.len();
                }
            }
            let frames = chain.iter().map(|p| self.fragments[*p].frames.len()).sum();
            self.paths.push(Path {
                fragments: chain,
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

    /// Leaves the paths of some labels where they are.
    pub(crate) fn keep(&mut self, labels: &[usize]) {
        let is_kept = |path: &&mut Path| path.label.is_some_and(|label| labels.contains(&label));
        let kept = self.paths.iter_mut().filter(is_kept);
        kept.for_each(|path| path.stands = true);
    }

    /// Whether no path but some holds a label in the frames of another.
    fn is_free(&self, path: usize, label: usize, but: &[usize]) -> bool {
        let is_open = |t: usize| {
            let holder = self.holder[label][t].map(|fragment| self.path_of[fragment]);
            holder.is_none_or(|h| h == path || but.contains(&h))
        };
        self.frames(path).all(is_open)
    }

    fn frames(&self, path: usize) -> impl Iterator<Item = usize> + '_ {
        self.paths[path]
            .fragments
            .iter()
            .flat_map(|p| self.fragments[*p].frames.clone())
    }

    /// Gives a path a label, or none.
    fn set(&mut self, path: usize, label: Option<usize>) {
        let before = std::mem::replace(&mut self.paths[path].label, label);
        for &p in &self.paths[path].fragments {
            let Fragment { track, frames, .. } = &self.fragments[p];
            for t in frames.clone() {
                if let Some(before) = before {
                    self.holder[before][t] = None;
                    (0..3).for_each(|c| self.positions[[t, 3 * before + c]] = f64::NAN);
                }
            }
            for t in frames.clone() {
                if let Some(label) = label {
                    self.holder[label][t] = Some(p);
                    let from = 3 * track;
                    (0..3).for_each(|c| {
                        self.positions[[t, 3 * label + c]] = self.take.xyz[[t, from + c]]
                    });
                }
            }
        }
    }

    /// One round over the paths; whether something moved.
    pub(crate) fn round(&mut self, round: usize) -> bool {
        let mut moved = false;
        match round {
            0 => moved = self.take_out_stretches(),
            _ => self.evidence = Evidence::learn(self.positions.view()),
        }
        let mut labeled: Vec<usize> = Vec::new();
        let mut loose: Vec<usize> = Vec::new();
        for (n, path) in self
            .paths
            .iter()
            .enumerate()
            .filter(|(_, path)| !path.stands)
        {
            if path.named.is_empty() && path.label.is_none() {
                loose.push(n)
            } else {
                labeled.push(n)
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

    /// Takes out paths that jump off their track and back, and fit nothing there; the distances are
    /// learned from all others. Whether there are some.
    fn take_out_stretches(&mut self) -> bool {
        let away: Vec<usize> = (0..self.paths.len()).filter(|p| self.is_away(*p)).collect();
        let labels: Vec<Option<usize>> = away.iter().map(|p| self.paths[*p].label).collect();
        away.iter().for_each(|path| self.set(*path, None));
        self.evidence = Evidence::learn(self.positions.view());
        // What jumps with its neighbors, as where a frame was dropped, is with them still.
        let back = away.iter().zip(&labels);
        back.for_each(|(path, label)| self.set(*path, *label));
        let is_out = |path: &usize| {
            let label = self.paths[*path].label;
            let fit = label.and_then(|label| self.fit(*path, label, &[]));
            fit.is_none_or(|f| f.score < AWAY_SCORE)
        };
        let out: Vec<usize> = away.into_iter().filter(is_out).collect();
        for path in &out {
            self.set(*path, None);
            self.paths[*path].stands = true;
        }
        !out.is_empty()
    }

    /// Whether a path jumps off its track and back.
    fn is_away(&self, path: usize) -> bool {
        let Path {
            fragments,
            frames,
            label,
            ..
        } = &self.paths[path];
        let [fragment] = fragments[..] else {
            return false;
        };
        let Fragment {
            track,
            frames: range,
            jumps,
        } = &self.fragments[fragment];
        if label.is_none()
            || *jumps != [true; 2]
            || *frames as f64 > out_and_back::LONGEST * self.take.rate
        {
            return false;
        }
        let at = |t: usize| point_at(self.take.xyz, t, *track);
        // A frame that was dropped is no jump: all goes on.
        let is_far = |t: usize| {
            let step = |t: usize| at(t) - at(t - 1);
            let beside = [t.checked_sub(1).filter(|t| *t > 0), Some(t + 1)];
            let usual = beside
                .into_iter()
                .flatten()
                .filter(|t| *t < self.take.xyz.nrows());
            let usual: Vec<DVec3> = usual.map(step).filter(|s| s.is_finite()).collect();
            let usual = usual.iter().sum::<DVec3>() / usual.len().max(1) as f64;
            step(t).distance(usual) >= out_and_back::LEAST
        };
        // A false cut beside it parts no path.
        let mut beside = [fragment - 1, fragment + 1]
            .map(|p| self.path_of[p])
            .to_vec();
        beside.dedup();
        let beside: usize = beside.iter().map(|p| self.paths[*p].frames).sum();
        is_far(range.start) && is_far(range.end) && 2 * frames <= beside
    }

    /// How well a path fits a label, some labels left out of the neighbors; `None` where too few of
    /// these are seen.
    fn fit(&self, path: usize, label: usize, without: &[usize]) -> Option<Fit> {
        let of = &self.paths[path];
        let step = of.frames.div_ceil(MOST_FRAMES).max(1);
        let (mut sum, mut count, mut n) = (0.0, 0, 0);
        for &p in &of.fragments {
            let Fragment { track, frames, .. } = &self.fragments[p];
            for t in frames.clone() {
                n += 1;
                if (n - 1) % step > 0 {
                    continue;
                }
                let position = point_at(self.take.xyz, t, *track);
                let nats = self
                    .evidence
                    .at(label, position, t, self.positions.view(), without);
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
        let weight = independent_frames(of.frames, self.take.rate).min(MOST_WEIGHT);
        Some(Fit {
            mean,
            score: weight * (mean + NAMED * share),
        })
    }

    /// How well the ends of a path go on in what holds a label beside it: -30 to 12.
    fn continuity(&self, path: usize, label: usize) -> f64 {
        let longest = (super::tuning::links::LONGEST * self.take.rate) as usize;
        let fragments = &self.paths[path].fragments;
        let (Some(&first), Some(&last)) = (fragments.first(), fragments.last()) else {
            return 0.0;
        };
        let at = |t: usize| self.holder[label].get(t).copied().flatten();
        let is_other = |p: &usize| self.path_of[*p] != path;
        let (start, end) = (
            self.fragments[first].frames.start,
            self.fragments[last].frames.end,
        );
        let before = (start.saturating_sub(longest + 1)..start)
            .rev()
            .find_map(|t| at(t).filter(is_other));
        let after = (end..end + longest + 1).find_map(|t| at(t).filter(is_other));
        let linked = |[from, to]: [usize; 2], gap| {
            let ends = [&self.ends[from][1], &self.ends[to][0]];
            let cost = link_cost(ends[0], ends[1], gap, self.take.rate);
            (LINKED - cost / 2.0).clamp(-UNLINKED, LINKED)
        };
        let gap = |end: usize, start: usize| start.saturating_sub(end);
        let before = before.map(|p| linked([p, first], gap(self.fragments[p].frames.end, start)));
        let after = after.map(|p| linked([last, p], gap(end, self.fragments[p].frames.start)));
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
                .fragments
                .first()
                .map(|p| self.fragments[*p].jumps[0]);
            let last = self.paths[path]
                .fragments
                .last()
                .map(|p| self.fragments[*p].jumps[1]);
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

    /// Whether a path is as near to the neighbors of a label as its own positions are, or goes on
    /// in them, or is long and like no other.
    fn is_fit(&self, path: usize, label: usize, fit: Fit, continuity: f64) -> bool {
        let [median, few] = self.evidence.own[label];
        if fit.mean >= few {
            return true;
        }
        if continuity >= GOES_ON && fit.mean >= few - (median - few).max(LOWER) {
            return true;
        }
        // It goes on at both ends.
        if continuity >= 2.0 * GOES_ON && fit.mean > 0.0 {
            return true;
        }
        let is_long = self.paths[path].frames as f64 >= LASTING * self.take.rate;
        let is_good =
            is_long && continuity >= -BROKEN && fit.mean >= GOOD || fit.score + continuity >= SURE;
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
            .map(|fragment| self.path_of[fragment])
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

    /// The fragments, each with the label that it is.
    pub(crate) fn assigned(&self) -> Vec<PointMove> {
        let of = |(p, fragment): (usize, &Fragment)| PointMove {
            from: fragment.track,
            frames: fragment.frames.clone(),
            to: self.paths[self.path_of[p]].label,
        };
        self.fragments.iter().enumerate().map(of).collect()
    }

    /// The distances within the take as it is labeled now, and the positions of its labels.
    pub(crate) fn learned(self) -> (Evidence, Array2<f64>) {
        (self.evidence, self.positions)
    }
}

//! Which point each fragment of a labeled track is, by what was exchanged when.
//!
//! Links between fragments of different labels count only where they close: a goes on in b and b in
//! a, or in a ring of up to six, at one time; or a goes on in b, which was missing, and ends there.
//! Such an exchange lasts until another of the same labels, or until the tracks of all of them end
//! or jump and the distances to others say that they changed places again. Where the distances
//! leave it open, it is not known; neither is it where they say so though no track ends.

use super::evidence::{Evidence, independent_frames};
use super::fragments::{Fragment, Link};
use super::tuning::identities::*;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::{Array2, ArrayView2};
use std::collections::BTreeMap;
use std::ops::Range;

/// Labels that change places at one time: `to[k]` is where the point of `labels[k]` goes on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Exchange {
    /// The frame from which it holds.
    pub frame: usize,
    /// In their order.
    pub labels: Vec<usize>,
    pub to: Vec<usize>,
}

/// The exchanges among the links of fragments whose tracks are `labels` below their number. Links
/// of different labels that are part of none are taken out.
pub(crate) fn exchanges(
    fragments: &[Fragment],
    links: &mut Vec<Link>,
    labels: usize,
) -> Vec<Exchange> {
    let is_other = |link: &Link| {
        let [from, to] = [link.from, link.to].map(|p| fragments[p].track);
        from != to && from < labels && to < labels
    };
    let others: Vec<Link> = links.iter().copied().filter(is_other).collect();
    let mut by_track: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (n, link) in others.iter().enumerate() {
        by_track
            .entry(fragments[link.from].track)
            .or_default()
            .push(n);
    }
    let gap = |n: usize| fragments[others[n].from].frames.end..fragments[others[n].to].frames.start;
    let mut is_used = vec![false; others.len()];
    let mut found = Vec::new();
    for first in 0..others.len() {
        if is_used[first] {
            continue;
        }
        let ring = match ring(first, &others, fragments, &by_track, &is_used) {
            Some(ring) => ring,
            None if is_handed_over(&others[first], fragments) => vec![first],
            None => continue,
        };
        ring.iter().for_each(|n| is_used[*n] = true);
        let track = |p: usize| fragments[p].track;
        let mut pairs: Vec<(usize, usize)> = ring
            .iter()
            .map(|n| (track(others[*n].from), track(others[*n].to)))
            .collect();
        if let [(from, to)] = pairs[..] {
            pairs.push((to, from));
        }
        pairs.sort_unstable();
        found.push(Exchange {
            frame: ring.iter().map(|n| gap(*n).end).min().unwrap_or(0),
            labels: pairs.iter().map(|p| p.0).collect(),
            to: pairs.iter().map(|p| p.1).collect(),
        });
    }
    let is_closed = |link: &Link| {
        let n = others.iter().position(|other| other == link);
        n.is_none_or(|n| is_used[n])
    };
    links.retain(is_closed);
    found.sort_by(|a, b| (a.frame, &a.labels).cmp(&(b.frame, &b.labels)));
    found
}

/// Whether a track ends where another begins, and one goes on in the other: these changed places
/// while the second point was missing.
fn is_handed_over(link: &Link, fragments: &[Fragment]) -> bool {
    let (from, to) = (&fragments[link.from], &fragments[link.to]);
    from.frames.end == to.frames.start && !from.jumps[1] && !to.jumps[0]
}

/// The links that bring the point of the first back to its track, if there are.
fn ring(
    first: usize,
    others: &[Link],
    fragments: &[Fragment],
    by_track: &BTreeMap<usize, Vec<usize>>,
    is_used: &[bool],
) -> Option<Vec<usize>> {
    let gap = |n: usize| fragments[others[n].from].frames.end..fragments[others[n].to].frames.start;
    let (of_first, home) = (gap(first), fragments[others[first].from].track);
    let is_at_once = |n: usize| {
        let own = gap(n);
        own.start <= of_first.end && of_first.start <= own.end
    };
    let mut ring = vec![first];
    while ring.len() <= LONGEST_RING {
        let track = fragments[others[*ring.last()?].to].track;
        if track == home {
            return Some(ring);
        }
        let next = by_track.get(&track)?.iter().copied();
        let mut next = next.filter(|n| !is_used[*n] && !ring.contains(n) && is_at_once(*n));
        ring.push(next.next()?);
    }
    None
}

/// All that is known of a set of labels that change places.
pub(crate) struct Course<'a> {
    /// The tracks as they are named (frames, 3 L), cm.
    pub positions: ArrayView2<'a, f64>,
    pub fragments: &'a [Fragment],
    /// Frames a second.
    pub rate: f64,
}

/// Where each of some points is throughout a take. A state says in which track, by its index among
/// the labels; the points are those of the tracks in one stretch, whose state is the first.
pub(crate) struct Followed {
    pub states: Vec<Vec<usize>>,
    /// The frames of the take, in order, and the state in them; `None` where nothing says it.
    pub stretches: Vec<(Range<usize>, Option<usize>)>,
}

/// Stretches between exchanges that are seen: once one state is known, all are.
struct Chain {
    /// Frames, and where the points of its beginning are then.
    stretches: Vec<(Range<usize>, Vec<usize>)>,
    /// Whether it begins where no track ends, so that no change is to be seen.
    goes_on: bool,
}

impl Course<'_> {
    /// Follows the points of some labels through their exchanges, in order and all of the same
    /// labels, and through what may be others: where the tracks of all of them end or jump. Which
    /// of these are exchanges, the distances to other labels decide: those of the longest chain at
    /// first, then of all that is known.
    pub(crate) fn follow(&self, exchanges: &[&Exchange]) -> Followed {
        let labels = &exchanges[0].labels;
        let index = |label: &usize| labels.iter().position(|l| l == label).unwrap_or(0);
        let steps: Vec<Vec<usize>> = exchanges
            .iter()
            .map(|e| e.to.iter().map(index).collect())
            .collect();
        let states = closure(labels.len(), &steps);
        let all = steps
            .iter()
            .fold(states[0].clone(), |state, step| after(&state, step));
        let is_closed = all == states[0];
        let chains = self.chains(labels, exchanges, &steps, !is_closed);
        // The longest between positions where a track ends.
        let first = longest(&chains, |frames| self.seen(labels, frames));
        let mut known = vec![None; chains.len()];
        let mut state = Some(0);
        for c in first.clone() {
            known[c] = state;
            state = state.and_then(|s| state_after(&states, s, &chains[c]));
        }
        if first.len() < chains.len() {
            for _ in 0..ROUNDS {
                let positions = self.undone(labels, &states, &stretches(&chains, &known, &states));
                let evidence = Evidence::of(positions.view(), labels);
                let gains: Vec<Vec<f64>> = (chains.iter())
                    .map(|chain| self.gains(&evidence, labels, &states, chain))
                    .collect();
                known = likeliest(&chains, &gains, &states, first.start, is_closed);
            }
        }
        Followed {
            stretches: stretches(&chains, &known, &states),
            states,
        }
    }

    /// The chains of a take; `everywhere`: others may begin where no track ends, too.
    fn chains(
        &self,
        labels: &[usize],
        exchanges: &[&Exchange],
        steps: &[Vec<usize>],
        everywhere: bool,
    ) -> Vec<Chain> {
        let frames = self.positions.nrows();
        let mut bounds: Vec<(usize, Option<usize>, bool)> = Vec::new();
        bounds.extend((exchanges.iter().enumerate()).map(|(n, e)| (e.frame, Some(n), false)));
        let ends = self.ends(labels).into_iter().map(|t| (t, None, false));
        bounds.extend(ends.filter(|(t, ..)| exchanges.iter().all(|e| e.frame != *t)));
        let every = ((EVERY * self.rate) as usize).max(1);
        let is_apart = |t: &usize| bounds.iter().all(|(bound, ..)| bound.abs_diff(*t) >= every);
        if everywhere {
            let more: Vec<usize> = (every..frames).step_by(every).filter(is_apart).collect();
            bounds.extend(more.into_iter().map(|t| (t, None, true)));
        }
        bounds.sort_unstable();
        let same: Vec<usize> = (0..labels.len()).collect();
        let mut out = vec![Chain {
            stretches: vec![(0..frames, same.clone())],
            goes_on: false,
        }];
        for (t, step, goes_on) in bounds {
            let Some(chain) = out.last_mut() else { break };
            let Some((last, state)) = chain.stretches.last_mut() else {
                break;
            };
            last.end = t.min(frames);
            match step {
                Some(n) => {
                    let state = after(state, &steps[n]);
                    chain.stretches.push((t.min(frames)..frames, state));
                }
                None => out.push(Chain {
                    stretches: vec![(t..frames, same.clone())],
                    goes_on,
                }),
            }
        }
        out
    }

    /// The frames from which the tracks of all of some labels are seen again, or after which they
    /// jump.
    fn ends(&self, labels: &[usize]) -> Vec<usize> {
        let of = |label: usize| -> Vec<[usize; 2]> {
            let own: Vec<&Fragment> = self.fragments.iter().filter(|p| p.track == label).collect();
            let ends = own.windows(2).map(|w| [w[0].frames.end, w[1].frames.start]);
            ends.collect()
        };
        let mut common = of(labels[0]);
        for label in &labels[1..] {
            let own = of(*label);
            let both = |a: &[usize; 2]| {
                let [start, end] = *a;
                let meets = own.iter().map(move |b| [start.max(b[0]), end.min(b[1])]);
                meets.filter(|both| both[0] <= both[1]).collect::<Vec<_>>()
            };
            common = common.iter().flat_map(both).collect();
        }
        let mut out: Vec<usize> = common.into_iter().map(|[_, end]| end).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// In how many frames any of some labels is seen.
    fn seen(&self, labels: &[usize], frames: &Range<usize>) -> usize {
        let is_seen = |t: &usize| {
            let mut all = labels.iter();
            all.any(|l| point_at(self.positions, *t, *l).is_finite())
        };
        frames.clone().filter(is_seen).count()
    }

    /// The positions of the labels, those of some only where it is known where they are.
    fn undone(
        &self,
        labels: &[usize],
        states: &[Vec<usize>],
        stretches: &[(Range<usize>, Option<usize>)],
    ) -> Array2<f64> {
        let mut out = self.positions.to_owned();
        for (frames, state) in stretches {
            for (t, (k, label)) in (frames.clone()).flat_map(|t| {
                let labels = labels.iter().enumerate();
                labels.map(move |label| (t, label))
            }) {
                let position = state.map_or(DVec3::NAN, |s| {
                    point_at(self.positions, t, labels[states[s][k]])
                });
                (0..3).for_each(|c| out[[t, 3 * label + c]] = position[c]);
            }
        }
        out
    }

    /// The nats for each state at the beginning of a chain.
    fn gains(
        &self,
        evidence: &Evidence,
        labels: &[usize],
        states: &[Vec<usize>],
        chain: &Chain,
    ) -> Vec<f64> {
        let mut out = vec![0.0; states.len()];
        for (frames, state) in &chain.stretches {
            let each = self.nats(evidence, labels, frames.clone());
            for (gain, first) in out.iter_mut().zip(states) {
                let state = after(first, state);
                *gain += state
                    .iter()
                    .enumerate()
                    .map(|(k, s)| each[[k, *s]])
                    .sum::<f64>();
            }
        }
        out
    }

    /// The nats for each of some points in the track of each of their labels, in some frames.
    fn nats(&self, evidence: &Evidence, labels: &[usize], frames: Range<usize>) -> Array2<f64> {
        let count = labels.len();
        let seen = self.seen(labels, &frames);
        let step = frames.len().div_ceil(MOST_FRAMES).max(1);
        let (mut sum, mut known) = (Array2::zeros((count, count)), 0);
        for t in frames.step_by(step) {
            let positions: Vec<DVec3> = (labels.iter())
                .map(|l| point_at(self.positions, t, *l))
                .collect();
            let at = |(k, s): (usize, usize)| {
                if positions[s].is_finite() {
                    evidence.at(labels[k], positions[s], t, self.positions, labels)
                } else {
                    Some(0.0)
                }
            };
            let all = (0..count * count).map(|n| at((n / count, n % count)));
            let Some(all) = all.collect::<Option<Vec<f64>>>() else {
                continue;
            };
            if positions.iter().any(|position| position.is_finite()) {
                sum.iter_mut().zip(all).for_each(|(sum, nats)| *sum += nats);
                known += 1;
            }
        }
        sum * (independent_frames(seen, self.rate) / f64::from(known.max(1)))
    }
}

/// The chains that are longest together, no track ending between them.
fn longest(chains: &[Chain], seen: impl Fn(&Range<usize>) -> usize) -> Range<usize> {
    let is_start = |c: &usize| !chains[*c].goes_on;
    let starts: Vec<usize> = (0..chains.len()).filter(is_start).collect();
    let ends = starts.iter().skip(1).copied().chain([chains.len()]);
    let all = starts.iter().zip(ends).map(|(start, end)| *start..end);
    let frames = |of: &Range<usize>| -> usize {
        let all = chains[of.clone()].iter().flat_map(|c| &c.stretches);
        all.map(|(frames, _)| seen(frames)).sum()
    };
    // Of equals the first.
    let all: Vec<Range<usize>> = all.collect();
    all.into_iter().rev().max_by_key(frames).unwrap_or(0..0)
}

/// The state at the beginning of each chain, where it is far likelier than any other; that of the
/// chain `first` is the first one. None is known where they change though no track ends.
fn likeliest(
    chains: &[Chain],
    gains: &[Vec<f64>],
    states: &[Vec<usize>],
    first: usize,
    is_closed: bool,
) -> Vec<Option<usize>> {
    let count = states.len();
    let ends = |c: usize, s: usize| state_after(states, s, &chains[c]);
    let change = |c: usize, from: usize, to: usize| {
        if ends(c - 1, from) == Some(to) {
            0.0
        } else if chains[c].goes_on {
            -2.0 * CLEAR
        } else if is_closed {
            -CLEAR
        } else {
            0.0
        }
    };
    let own = |c: usize, s: usize| {
        if c == first && s > 0 {
            f64::NEG_INFINITY
        } else {
            gains[c][s]
        }
    };
    let most = |all: &mut dyn Iterator<Item = f64>| all.fold(f64::NEG_INFINITY, f64::max);
    // The best way to each state, and on from it.
    let mut to: Vec<Vec<f64>> = vec![(0..count).map(|s| own(0, s)).collect()];
    for c in 1..chains.len() {
        let of =
            |s| own(c, s) + most(&mut (0..count).map(|from| to[c - 1][from] + change(c, from, s)));
        to.push((0..count).map(of).collect());
    }
    let mut on: Vec<Vec<f64>> = vec![vec![0.0; count]; chains.len()];
    for c in (1..chains.len()).rev() {
        let of = |s| most(&mut (0..count).map(|to| on[c][to] + own(c, to) + change(c, s, to)));
        on[c - 1] = (0..count).map(of).collect();
    }
    let best = |c: usize| {
        let all = (0..count).map(|s| (to[c][s] + on[c][s], s));
        let mut all: Vec<(f64, usize)> = all.collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let clear = all.get(1).is_none_or(|second| all[0].0 - second.0 >= CLEAR);
        (all[0].1, clear)
    };
    let all: Vec<(usize, bool)> = (0..chains.len()).map(best).collect();
    let is_broken = |c: usize| chains[c].goes_on && ends(c - 1, all[c - 1].0) != Some(all[c].0);
    let is_broken = (1..chains.len()).any(is_broken);
    let known = all
        .into_iter()
        .map(|(s, is_clear)| (is_clear && !is_broken).then_some(s));
    known.collect()
}

/// The stretches of chains and their states, by those at their beginnings.
fn stretches(
    chains: &[Chain],
    known: &[Option<usize>],
    states: &[Vec<usize>],
) -> Vec<(Range<usize>, Option<usize>)> {
    let mut out: Vec<(Range<usize>, Option<usize>)> = Vec::new();
    for (chain, first) in chains.iter().zip(known) {
        for (frames, state) in &chain.stretches {
            let state = first.and_then(|first| {
                let state = after(&states[first], state);
                states.iter().position(|s| *s == state)
            });
            match out.last_mut().filter(|last| last.1 == state) {
                Some(last) => last.0.end = frames.end,
                None => out.push((frames.clone(), state)),
            }
        }
    }
    out.retain(|(frames, _)| !frames.is_empty());
    out
}

/// The state at the end of a chain by that at its beginning.
fn state_after(states: &[Vec<usize>], first: usize, chain: &Chain) -> Option<usize> {
    let (_, last) = chain.stretches.last()?;
    let state = after(&states[first], last);
    states.iter().position(|s| *s == state)
}

/// Where points are after one more exchange, each number an index among the labels.
fn after(state: &[usize], step: &[usize]) -> Vec<usize> {
    state.iter().map(|at| step[*at]).collect()
}

/// All states that some exchanges lead to and back from, the first of them that none happened.
fn closure(labels: usize, steps: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut states: Vec<Vec<usize>> = vec![(0..labels).collect()];
    let mut k = 0;
    while k < states.len() && states.len() < MOST_STATES {
        for step in steps {
            let next = after(&states[k], step);
            if !states.contains(&next) {
                states.push(next);
            }
        }
        k += 1;
    }
    states
}

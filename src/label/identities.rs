//! Which point each piece of a labeled track is, by what was exchanged when.
//!
//! Links between pieces of different labels count only where they close: a goes on in b and b in a,
//! or in a ring of up to six, at one time; or a goes on in b, which was missing, and ends there.
//! Such an exchange lasts until another of the same labels. One that has no other end may end, or
//! begin, in a gap of all its labels nearby: which of these ends there are, the distances decide,
//! and where they do not, the fewest exchanged frames.

use super::evidence::{Evidence, independent_frames};
use super::links::Link;
use super::pieces::Piece;
use super::tuning::identities::*;
use crate::pose::point_at;
use ndarray::ArrayView2;
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

/// The exchanges among the links of pieces whose tracks are `labels` below their number. Links of
/// different labels that are part of none are taken out.
pub(crate) fn exchanges(pieces: &[Piece], links: &mut Vec<Link>, labels: usize) -> Vec<Exchange> {
    let is_other = |link: &Link| {
        let [from, to] = [link.from, link.to].map(|p| pieces[p].track);
        from != to && from < labels && to < labels
    };
    let others: Vec<Link> = links.iter().copied().filter(is_other).collect();
    let mut by_track: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (n, link) in others.iter().enumerate() {
        by_track.entry(pieces[link.from].track).or_default().push(n);
    }
    let gap = |n: usize| pieces[others[n].from].frames.end..pieces[others[n].to].frames.start;
    let mut is_used = vec![false; others.len()];
    let mut found = Vec::new();
    for first in 0..others.len() {
        if is_used[first] {
            continue;
        }
        let ring = match ring(first, &others, pieces, &by_track, &is_used) {
            Some(ring) => ring,
            None if is_handed_over(&others[first], pieces) => vec![first],
            None => continue,
        };
        ring.iter().for_each(|n| is_used[*n] = true);
        let track = |p: usize| pieces[p].track;
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
fn is_handed_over(link: &Link, pieces: &[Piece]) -> bool {
    let (from, to) = (&pieces[link.from], &pieces[link.to]);
    from.frames.end == to.frames.start && !from.jumps[1] && !to.jumps[0]
}

/// The links that bring the point of the first back to its track, if there are.
fn ring(
    first: usize,
    others: &[Link],
    pieces: &[Piece],
    by_track: &BTreeMap<usize, Vec<usize>>,
    is_used: &[bool],
) -> Option<Vec<usize>> {
    let gap = |n: usize| pieces[others[n].from].frames.end..pieces[others[n].to].frames.start;
    let (of_first, home) = (gap(first), pieces[others[first].from].track);
    let is_at_once = |n: usize| {
        let own = gap(n);
        own.start <= of_first.end && of_first.start <= own.end
    };
    let mut ring = vec![first];
    while ring.len() <= LONGEST_RING {
        let track = pieces[others[*ring.last()?].to].track;
        if track == home {
            return Some(ring);
        }
        let next = by_track.get(&track)?.iter().copied();
        let mut next = next.filter(|n| !is_used[*n] && !ring.contains(n) && is_at_once(*n));
        ring.push(next.next()?);
    }
    None
}

/// Where two or more labels stand under each other's names: the point of `labels[k]` is in the
/// track of `to[k]` meanwhile.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Exchanged {
    pub labels: Vec<usize>,
    pub to: Vec<usize>,
    pub frames: Range<usize>,
}

/// All that is known of a set of labels that change places.
pub(crate) struct Course<'a> {
    pub evidence: &'a Evidence,
    /// The tracks as they are named (frames, 3 L), cm.
    pub places: ArrayView2<'a, f64>,
    /// Frames a second.
    pub rate: f64,
}

/// A way through the take: the nats for it, the exchanged frames, and the state of each interval.
#[derive(Debug, Clone)]
struct Way {
    nats: f64,
    frames: usize,
    states: Vec<usize>,
}

impl Course<'_> {
    /// The stretches in which the labels of some exchanges, all of the same labels and in order,
    /// stand under each other's names.
    pub(crate) fn stretches(&self, exchanges: &[&Exchange]) -> Vec<Exchanged> {
        let labels = &exchanges[0].labels;
        let place = |label: &usize| labels.iter().position(|l| l == label).unwrap_or(0);
        let steps: Vec<Vec<usize>> = exchanges
            .iter()
            .map(|e| e.to.iter().map(place).collect())
            .collect();
        let states = closure(labels.len(), &steps);
        // Intervals end where an exchange is, or may be.
        let mut bounds: Vec<(usize, Option<usize>)> = exchanges
            .iter()
            .enumerate()
            .map(|(n, e)| (e.frame, Some(n)))
            .collect();
        bounds.extend(
            self.gaps_near(labels, exchanges)
                .into_iter()
                .map(|t| (t, None)),
        );
        bounds.sort_unstable();
        let mut ways: Vec<Vec<Way>> = vec![
            vec![Way {
                nats: 0.0,
                frames: 0,
                states: vec![]
            }];
            states.len()
        ];
        let mut start = 0;
        for k in 0..=bounds.len() {
            let end = bounds.get(k).map_or(self.places.nrows(), |b| b.0);
            let gains = self.gains(labels, &states, start..end);
            for (s, ways) in ways.iter_mut().enumerate() {
                for way in ways {
                    way.nats += gains[s];
                    way.frames += if s == 0 { 0 } else { end - start };
                    way.states.push(s);
                }
            }
            if let Some((_, step)) = bounds.get(k) {
                let follows = |from: usize, to: usize| match step {
                    Some(n) => states[to] == after(&states[from], &steps[*n]),
                    None => true,
                };
                ways = (0..states.len())
                    .map(|to| {
                        let from = (0..states.len()).filter(|from| follows(*from, to));
                        best(from.flat_map(|from| ways[from].iter().cloned()).collect())
                    })
                    .collect();
            }
            start = end;
        }
        let chosen = chosen(ways.into_iter().flatten().collect());
        let mut out: Vec<Exchanged> = Vec::new();
        let mut start = 0;
        for (k, s) in chosen.states.iter().enumerate() {
            let end = bounds.get(k).map_or(self.places.nrows(), |b| b.0);
            let to: Vec<usize> = states[*s].iter().map(|p| labels[*p]).collect();
            match out
                .last_mut()
                .filter(|last| last.frames.end == start && last.to == to)
            {
                Some(last) => last.frames.end = end,
                None if *s > 0 && end > start => out.push(Exchanged {
                    labels: labels.clone(),
                    to,
                    frames: start..end,
                }),
                None => {}
            }
            start = end;
        }
        out
    }

    /// The first frames after gaps of all of some labels that are near an exchange of theirs.
    fn gaps_near(&self, labels: &[usize], exchanges: &[&Exchange]) -> Vec<usize> {
        let reach = (REACH * self.rate) as usize;
        let is_gap = |t: usize| {
            labels
                .iter()
                .all(|l| !point_at(self.places, t, *l).is_finite())
        };
        let mut out = Vec::new();
        for exchange in exchanges {
            let first = exchange.frame.saturating_sub(reach).max(1);
            let last = (exchange.frame + reach).min(self.places.nrows());
            out.extend((first..last).filter(|t| is_gap(t - 1) && !is_gap(*t)));
        }
        out.sort_unstable();
        out.dedup();
        // An exchange that is known to be behind the gap is that end.
        out.retain(|t| exchanges.iter().all(|e| e.frame != *t));
        out
    }

    /// The nats for each state in some frames.
    fn gains(&self, labels: &[usize], states: &[Vec<usize>], frames: Range<usize>) -> Vec<f64> {
        let is_seen = |t: &usize| {
            labels
                .iter()
                .all(|l| point_at(self.places, *t, *l).is_finite())
        };
        let seen: Vec<usize> = frames.clone().filter(is_seen).collect();
        let weight = independent_frames(seen.len(), self.rate);
        let step = seen.len().div_ceil(MOST_FRAMES).max(1);
        let sampled: Vec<usize> = seen.into_iter().step_by(step).collect();
        let of = |state: &Vec<usize>| {
            let at = |t: usize| {
                let each = labels.iter().zip(state).map(|(label, s)| {
                    let place = point_at(self.places, t, labels[*s]);
                    self.evidence.at(*label, place, t, self.places, labels)
                });
                each.sum::<Option<f64>>()
            };
            let known: Vec<f64> = sampled.iter().filter_map(|t| at(*t)).collect();
            known.iter().sum::<f64>() / known.len().max(1) as f64
        };
        let named = of(&states[0]);
        states
            .iter()
            .map(|state| weight * (of(state) - named))
            .collect()
    }
}

/// Where points are after one more exchange, each number a place among the labels.
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

/// The ways that no other has both more nats and fewer exchanged frames than.
fn best(mut ways: Vec<Way>) -> Vec<Way> {
    ways.sort_by(|a, b| a.frames.cmp(&b.frames).then(b.nats.total_cmp(&a.nats)));
    let mut most = f64::NEG_INFINITY;
    ways.retain(|way| {
        let is_more = way.nats > most;
        most = most.max(way.nats);
        is_more
    });
    ways.truncate(MOST_WAYS);
    ways
}

/// The way with the fewest exchanged frames among those that are nearly as likely as any.
fn chosen(ways: Vec<Way>) -> Way {
    let most = ways.iter().fold(f64::NEG_INFINITY, |m, w| m.max(w.nats));
    let likely = ways.into_iter().filter(|w| w.nats >= most - CLEAR);
    let fewest = likely.min_by(|a, b| a.frames.cmp(&b.frames).then(b.nats.total_cmp(&a.nats)));
    fewest.unwrap_or(Way {
        nats: 0.0,
        frames: 0,
        states: vec![],
    })
}

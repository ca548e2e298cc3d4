//! Links between fragments of tracks: which fragment goes on in which.
//!
//! The ends of two fragments, each a line through its last or first frames, are carried on to the
//! middle between them. They may differ by the acceleration of a body, `σ² = s² + 2 (A (Δ/2)²)² +
//! 2 (v h)²` (Δ the time between them, h half of it in frames), or stand where they stood, if one
//! of them hardly moves. A link
//! holds where it is far cheaper than every other of both ends. Fragments that follow each other
//! without a gap are linked before others: a point's own return some frames later is cheap too.

use super::fragments::{Fragment, Link};
use super::next_fragments::NextFragments;
use super::tuning::links::*;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;
use std::collections::HashSet;
use std::ops::Range;

/// The position of an end of a fragment, cm, and its velocity away from the fragment, cm a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct End {
    at: DVec3,
    velocity: DVec3,
}

impl End {
    /// The first and the last end of a fragment.
    pub(crate) fn both(xyz: ArrayView2<'_, f64>, fragment: &Fragment) -> [End; 2] {
        let frames = &fragment.frames;
        let count = frames.len().min(LINE);
        let position = |t: usize| point_at(xyz, t, fragment.track);
        let of = |frame: &dyn Fn(usize) -> usize| {
            let middle = (count - 1) as f64 / 2.0;
            let (mut at, mut slope, mut squares) = (DVec3::ZERO, DVec3::ZERO, 0.0);
            for k in 0..count {
                let off = middle - k as f64;
                at += position(frame(k)) / count as f64;
                slope += position(frame(k)) * off;
                squares += off * off;
            }
            let velocity = if squares > 0.0 {
                slope / squares
            } else {
                DVec3::ZERO
            };
            End {
                at: at + velocity * middle,
                velocity,
            }
        };
        [of(&|k| frames.start + k), of(&|k| frames.end - 1 - k)]
    }
}

/// What it costs that one end goes on in another after `gap` missing frames, χ².
pub(crate) fn link_cost(from: &End, to: &End, gap: usize, rate: f64) -> f64 {
    let frames = (gap + 1) as f64;
    // What stood still on both sides may have moved meanwhile; what moves goes on.
    let still = variance(gap, rate) + (STILL * frames / rate).powi(2);
    let speed = from
        .velocity
        .length_squared()
        .min(to.velocity.length_squared());
    let moved = (from.at.distance_squared(to.at) + speed * frames.powi(2)) / still;
    carried_cost(from, to, gap, rate).min(moved)
}

/// The same if it neither stands nor starts to move.
fn carried_cost(from: &End, to: &End, gap: usize, rate: f64) -> f64 {
    let half = (gap + 1) as f64 / 2.0;
    let carried = (from.at + half * from.velocity).distance_squared(to.at + half * to.velocity);
    carried / variance(gap, rate)
}

/// By how much two ends may miss each other, cm².
fn variance(gap: usize, rate: f64) -> f64 {
    let half = (gap + 1) as f64 / 2.0;
    let time = (gap + 1) as f64 / rate;
    NOISE.powi(2)
        + 2.0 * (ACCELERATION * (time / 2.0).powi(2)).powi(2)
        + 2.0 * (VELOCITY_NOISE * half).powi(2)
}

/// What it costs that an end goes on in another after so many frames at a rate.
type LinkCost = fn(&End, &End, usize, f64) -> f64;

/// The links between fragments that hold, and the ends of all.
pub(crate) struct Links {
    pub links: Vec<Link>,
    pub ends: Vec<[End; 2]>,
    next: NextFragments,
}

impl Links {
    /// Links `fragments` of the tracks of `xyz` (frames, 3 J; cm), those below `labels` labeled, at
    /// `rate` frames a second, over at most [`LONGEST`] seconds.
    pub(crate) fn new(
        xyz: ArrayView2<'_, f64>,
        fragments: &[Fragment],
        labels: usize,
        rate: f64,
    ) -> Links {
        let ends: Vec<[End; 2]> = fragments.iter().map(|p| End::both(xyz, p)).collect();
        let starts = Starts::new(fragments);
        let [longest, soon] = [LONGEST, CLOSED_GAP].map(|seconds| (seconds * rate) as usize);
        let mut links: Vec<Link> = Vec::new();
        let mut is_taken = vec![[false; 2]; fragments.len()];
        let candidates = |gaps: Range<usize>, is_taken: &[[bool; 2]], cost_of: LinkCost| {
            let mut found: Vec<(Link, f64)> = Vec::new();
            for from in (0..fragments.len()).filter(|p| !is_taken[*p][1]) {
                let end = fragments[from].frames.end;
                let next = starts.within(end + gaps.start..end + gaps.end);
                for &to in next.iter().filter(|p| !is_taken[**p][0]) {
                    let gap = fragments[to].frames.start - end;
                    let cost = cost_of(&ends[from][1], &ends[to][0], gap, rate);
                    if cost <= HIGHEST + CHEAPER {
                        found.push((Link { from, to }, cost));
                    }
                }
            }
            found
        };
        let soon = candidates(0..soon + 1, &is_taken, carried_cost);
        let next = NextFragments::new(&soon, fragments);
        let track = |p: usize| Some(fragments[p].track).filter(|track| *track < labels);
        for gaps in [0..1, 1..longest + 1] {
            let mut found = candidates(gaps.clone(), &is_taken, link_cost);
            let closing: HashSet<Link> = next.closing(&links, track).into_iter().collect();
            // A label does not go on without one, nor begin so, where it does elsewhere. Across a
            // gap, only evidence joins a fragment without a label; and no two labels change places
            // there if one of them goes on without a label.
            let is_allowed = |link: &Link| {
                let of = [link.from, link.to].map(track);
                let are_labels = of.iter().all(Option::is_some);
                if gaps.start == 0 {
                    return are_labels || of == [None; 2] || !next.is_elsewhere(link);
                }
                let is_closed = next.beside(link).any(|other| closing.contains(&other));
                let is_same = fragments[link.from].track == fragments[link.to].track;
                is_same || are_labels && !is_closed
            };
            // What is clear leaves fewer choices to the others.
            loop {
                let mut clear = clearest(&found, fragments.len());
                clear.retain(is_allowed);
                for link in &clear {
                    is_taken[link.from][1] = true;
                    is_taken[link.to][0] = true;
                }
                found.retain(|(link, _)| !is_taken[link.from][1] && !is_taken[link.to][0]);
                if clear.is_empty() {
                    break;
                }
                links.extend(clear);
            }
        }
        Links { links, ends, next }
    }

    /// Links fragments without a label into the gaps that they close; `label` says which a fragment
    /// has.
    pub(crate) fn close(&mut self, label: impl Fn(usize) -> Option<usize>) {
        let closing = self.next.closing(&self.links, label);
        self.links.extend(closing);
    }
}

/// Fragments in the order of their starts.
struct Starts {
    fragments: Vec<usize>,
    frames: Vec<usize>,
}

impl Starts {
    fn new(of: &[Fragment]) -> Starts {
        let mut fragments: Vec<usize> = (0..of.len()).collect();
        fragments.sort_by_key(|p| (of[*p].frames.start, *p));
        let frames = fragments.iter().map(|p| of[*p].frames.start).collect();
        Starts { fragments, frames }
    }

    /// Those that start in some frames.
    fn within(&self, frames: Range<usize>) -> &[usize] {
        let [first, end] =
            [frames.start, frames.end].map(|t| self.frames.partition_point(|s| *s < t));
        &self.fragments[first..end]
    }
}

/// The fragments that are linked, chain by chain.
pub(crate) fn chains(fragments: usize, links: impl Iterator<Item = Link>) -> Vec<Vec<usize>> {
    let mut next = vec![None; fragments];
    let mut is_first = vec![true; fragments];
    for link in links {
        next[link.from] = Some(link.to);
        is_first[link.to] = false;
    }
    let firsts = (0..fragments).filter(|p| is_first[*p]);
    let chain = |first| std::iter::successors(Some(first), |p: &usize| next[*p]).collect();
    firsts.map(chain).collect()
}

/// Keeps of some links what is cheap, and far cheaper than every other of both ends.
fn clearest(found: &[(Link, f64)], fragments: usize) -> Vec<Link> {
    // The cheapest two of each end.
    let mut cheapest = vec![[[f64::INFINITY; 2]; 2]; fragments];
    for (link, cost) in found {
        for (fragment, end) in [(link.from, 1), (link.to, 0)] {
            let two = &mut cheapest[fragment][end];
            if *cost < two[0] {
                *two = [*cost, two[0]];
            } else if *cost < two[1] {
                two[1] = *cost;
            }
        }
    }
    let is_clear = |(link, cost): &&(Link, f64)| {
        let ends = [cheapest[link.from][1], cheapest[link.to][0]];
        *cost <= HIGHEST
            && ends
                .iter()
                .all(|two| *cost <= two[0] && two[1] >= cost + CHEAPER)
    };
    found
        .iter()
        .filter(is_clear)
        .map(|(link, _)| *link)
        .collect()
}

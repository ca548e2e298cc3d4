//! Links between fragments of tracks: which fragment goes on in which.
//!
//! The ends of two fragments, each a line through its last or first frames, are carried on to the
//! middle between them. They may differ by the acceleration of a body, `σ² = s² + 2 (A (Δ/2)²)² +
//! 2 (v h)²` (Δ the time between them, h half of it in frames), or stand where they stood, if one
//! of them hardly moves. A link
//! holds where it is far cheaper than every other of both ends. Fragments that follow each other
//! without a gap are linked before others: a point's own return some frames later is cheap too.

use super::fragments::Fragment;
use super::tuning::links::*;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;

/// A fragment that goes on in another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Link {
    /// The fragments.
    pub from: usize,
    pub to: usize,
}

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
    let half = (gap + 1) as f64 / 2.0;
    let time = (gap + 1) as f64 / rate;
    let variance = NOISE.powi(2)
        + 2.0 * (ACCELERATION * (time / 2.0).powi(2)).powi(2)
        + 2.0 * (VELOCITY_NOISE * half).powi(2);
    let carried = (from.at + half * from.velocity).distance_squared(to.at + half * to.velocity);
    // What stood still on both sides may have moved meanwhile; what moves goes on.
    let still = variance + (STILL * time).powi(2);
    let speed = from
        .velocity
        .length_squared()
        .min(to.velocity.length_squared());
    let moved = (from.at.distance_squared(to.at) + speed * ((gap + 1) as f64).powi(2)) / still;
    (carried / variance).min(moved)
}

/// The links between fragments that hold, and the ends of all.
pub(crate) struct Links {
    pub links: Vec<Link>,
    pub ends: Vec<[End; 2]>,
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
        let mut by_start: Vec<usize> = (0..fragments.len()).collect();
        by_start.sort_by_key(|p| (fragments[*p].frames.start, *p));
        let starts: Vec<usize> = by_start
            .iter()
            .map(|p| fragments[*p].frames.start)
            .collect();
        let longest = (LONGEST * rate) as usize;
        let mut links: Vec<Link> = Vec::new();
        let mut is_taken = vec![[false; 2]; fragments.len()];
        for gaps in [0..1, 1..longest + 1] {
            let mut found: Vec<(Link, f64)> = Vec::new();
            for from in (0..fragments.len()).filter(|p| !is_taken[*p][1]) {
                let end = fragments[from].frames.end;
                let first = starts.partition_point(|s| *s < end + gaps.start);
                let next = by_start[first..]
                    .iter()
                    .take_while(|p| fragments[**p].frames.start < end + gaps.end);
                for &to in next.filter(|p| !is_taken[**p][0]) {
                    let gap = fragments[to].frames.start - end;
                    let cost = link_cost(&ends[from][1], &ends[to][0], gap, rate);
                    if cost <= HIGHEST + CHEAPER {
                        found.push((Link { from, to }, cost));
                    }
                }
            }
            // Across a gap, only evidence joins a fragment without a label.
            let is_allowed = |link: &Link| {
                let tracks = [link.from, link.to].map(|p| fragments[p].track);
                gaps.start == 0 || tracks[0] == tracks[1] || tracks.iter().all(|t| *t < labels)
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
        Links { links, ends }
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

//! The fragment in which another goes on soon, labels or not, and the gaps that are closed so.
//!
//! A point that is lost and found without its label leaves a gap that a fragment without one fills
//! nearly from end to end. What starts where a point went and ends where it comes back is that
//! point, however its distances to others spread: a reflection is farther away at one end at least.

use super::fragments::{Fragment, Link};
use super::tuning::links::{CHEAPER, CLOSED};
use std::collections::{HashMap, HashSet};

/// The fragment in which each goes on soon.
pub(crate) struct NextFragments {
    /// In the order of where they come from.
    links: Vec<Link>,
    /// Where each goes that comes to these.
    before: HashMap<usize, usize>,
}

impl NextFragments {
    /// Chooses among `found` links and their costs, all over so short a time: those that are cheap,
    /// and far cheaper than each other that would be there at the same time; of these the one to
    /// the nearest fragment.
    pub(crate) fn new(found: &[(Link, f64)], fragments: &[Fragment]) -> NextFragments {
        let frames = |p: usize| &fragments[p].frames;
        let gap = |link: &Link| frames(link.to).start - frames(link.from).end;
        let are_at_once =
            |a: usize, b: usize| frames(a).start < frames(b).end && frames(b).start < frames(a).end;
        let mut of = vec![[const { Vec::new() }; 2]; fragments.len()];
        for (n, (link, _)) in found.iter().enumerate() {
            of[link.from][1].push(n);
            of[link.to][0].push(n);
        }
        let is_clear = |n: usize| {
            let (link, cost) = found[n];
            let is_no_rival = |other: &usize| {
                let (other, its_cost) = found[*other];
                let is_at_once = if other.from == link.from {
                    other.to != link.to && are_at_once(other.to, link.to)
                } else {
                    are_at_once(other.from, link.from)
                };
                !is_at_once || its_cost >= cost + CHEAPER
            };
            let mut others = of[link.from][1].iter().chain(&of[link.to][0]);
            cost <= CLOSED && others.all(is_no_rival)
        };
        let clear: Vec<bool> = (0..found.len()).map(is_clear).collect();
        let best = |p: usize, end: usize| {
            let all = of[p][end].iter().copied().filter(|n| clear[*n]);
            all.min_by_key(|n| gap(&found[*n].0))
        };
        let links = (0..fragments.len()).filter_map(|from| {
            let n = best(from, 1)?;
            let link = found[n].0;
            (best(link.to, 0) == Some(n)).then_some(link)
        });
        let links: Vec<Link> = links.collect();
        NextFragments {
            before: links.iter().map(|link| (link.to, link.from)).collect(),
            links,
        }
    }

    /// The link that leaves a fragment.
    fn after(&self, from: usize) -> Option<Link> {
        let n = self.links.binary_search_by_key(&from, |link| link.from);
        n.ok().map(|n| self.links[n])
    }

    /// The links that leave and reach the fragments of a link.
    pub(crate) fn beside(&self, link: &Link) -> impl Iterator<Item = Link> {
        let to = link.to;
        let reaching = self.before.get(&to).map(|&from| Link { from, to });
        self.after(link.from).into_iter().chain(reaching)
    }

    /// Whether one of the fragments of a link goes on in another, or comes from another.
    pub(crate) fn is_elsewhere(&self, link: &Link) -> bool {
        self.beside(link).any(|other| other != *link)
    }

    /// The links that, beside some others, lead from a label to itself by fragments without one.
    pub(crate) fn closing(
        &self,
        links: &[Link],
        label: impl Fn(usize) -> Option<usize>,
    ) -> Vec<Link> {
        let linked: HashMap<usize, usize> = links.iter().map(|link| (link.from, link.to)).collect();
        let is_begun: HashSet<usize> = links.iter().map(|link| link.to).collect();
        let open = |from: usize| {
            let link = self.after(from)?;
            (!linked.contains_key(&from) && !is_begun.contains(&link.to)).then_some(link)
        };
        let mut out = Vec::new();
        let is_first = |link: &&Link| label(link.from).is_some() && label(link.to).is_none();
        for first in self.links.iter().filter(is_first) {
            let (mut at, mut chain) = (first.from, Vec::new());
            while at == first.from || label(at).is_none() {
                let link = open(at);
                let Some(to) = link.map(|l| l.to).or(linked.get(&at).copied()) else {
                    break;
                };
                chain.extend(link);
                at = to;
            }
            if at != first.from && label(at) == label(first.from) {
                out.extend(chain);
            }
        }
        out
    }
}

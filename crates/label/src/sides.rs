//! Which side of an exchange is right: the longer one, of long exchanges the one that fits the
//! body's mirror image.

use super::body_evidence::BodyEvidence;
use super::fragments::Fragment;
use super::identities::{Course, Exchange, Followed};
use super::labeled_take::LabeledTake;
use super::mirror::Mirror;
use super::tuning::body_evidence::TOLD;
use super::tuning::sides::*;
use crate::pose::point_at;
use ndarray::ArrayView2;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;

/// Labels of which one side of an exchange is right and nothing says which.
#[derive(Debug, Clone, PartialEq)]
pub struct Unsure {
    pub labels: Vec<usize>,
    pub frames: Vec<Range<usize>>,
    /// Whether it is not known if they are exchanged in these frames; else they are there, or in
    /// all others.
    pub is_part: bool,
}

/// What decides which side of an exchange is right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SideBy {
    /// More frames have the names.
    Length,
    /// The body's mirror image.
    Mirror,
    /// A labeled take.
    Template,
    /// The places of labels on bodies.
    Body,
    /// Somebody said so.
    Given,
}

impl SideBy {
    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            SideBy::Length => "length",
            SideBy::Mirror => "mirror image",
            SideBy::Template => "labeled take",
            SideBy::Body => "body",
            SideBy::Given => "option",
        }
    }
}

/// Where labels stand under each other's names: the point of `labels[k]` is in the track of `to[k]`
/// meanwhile.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Exchanged {
    pub labels: Vec<usize>,
    pub to: Vec<usize>,
    pub frames: Range<usize>,
}

/// The stretches in which labels stand under each other's names, and how that was decided.
#[derive(Debug, Default)]
pub(crate) struct Sides {
    /// In the order of their frames.
    pub exchanged: Vec<Exchanged>,
    /// What decides, by the labels that are exchanged.
    pub decided: Vec<(Vec<usize>, SideBy)>,
    pub unsure: Vec<Unsure>,
}

/// The frames of a state of some labels, and how many of them these are seen in.
struct Group {
    state: usize,
    frames: Vec<Range<usize>>,
    seen: usize,
}

impl LabeledTake<'_> {
    /// The stretches in which labels stand under each other's names, those aside of which nothing
    /// says which side is right.
    pub(crate) fn sides(
        &self,
        found: &[Exchange],
        named: ArrayView2<'_, f64>,
        fragments: &[Fragment],
    ) -> Sides {
        let course = Course {
            positions: named,
            fragments,
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
        let mut out = Sides::default();
        for (labels, exchanges) in by_labels {
            let followed = course.follow(&exchanges);
            let groups = self.groups(labels, &followed);
            let side = self.right_side(labels, &groups, &mirror);
            let side = side.or_else(|| self.side_by_body(labels, &groups, &followed));
            // The side that has fewer frames; where nothing is known, all.
            let open: Vec<Range<usize>> = match side {
                Some(_) => of_state(&followed, None),
                None => groups
                    .iter()
                    .skip(1)
                    .flat_map(|g| g.frames.clone())
                    .collect(),
            };
            if side.is_none() || self.seen(labels, &open) > 0 {
                let all = || of_state(&followed, None);
                out.unsure.push(Unsure {
                    labels: labels.to_vec(),
                    is_part: side.is_some() || open.is_empty(),
                    frames: if open.is_empty() { all() } else { open },
                });
            }
            if let Some((right, by)) = side {
                out.decided.push((labels.to_vec(), by));
                out.exchanged.extend(exchanged(labels, &followed, right));
            }
        }
        out.exchanged.sort_by_key(|s| s.frames.start);
        out
    }

    /// The state in which the names of labels that were exchanged fit the body best.
    fn side_by_body(
        &self,
        labels: &[usize],
        groups: &[Group],
        followed: &Followed,
    ) -> Option<(usize, SideBy)> {
        let own: Vec<usize> = (0..self.labels).collect();
        let evidence = BodyEvidence::new(self.body?, self.names, &own, self.xyz)?;
        let cost = |group: &Group| {
            let wrong = exchanged(labels, followed, group.state);
            let from = |t: usize, point: usize| {
                let at = wrong.iter().find(|e| e.frames.contains(&t));
                let to = at.and_then(|e| Some(e.to[e.labels.iter().position(|l| *l == point)?]));
                to.unwrap_or(point)
            };
            Some((evidence.cost(&from)?, group.state))
        };
        let mut costs = groups.iter().map(cost).collect::<Option<Vec<_>>>()?;
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_clear = costs.get(1)?.0 - costs[0].0 >= TOLD;
        is_clear.then_some((costs[0].1, SideBy::Body))
    }

    /// In how many frames any of some labels is seen.
    fn seen(&self, labels: &[usize], frames: &[Range<usize>]) -> usize {
        let is_seen = |t: &usize| {
            let mut all = labels.iter();
            all.any(|l| point_at(self.xyz, *t, *l).is_finite())
        };
        frames.iter().cloned().flatten().filter(is_seen).count()
    }

    /// The frames of each state of some labels, that of the most frames first.
    fn groups(&self, labels: &[usize], followed: &Followed) -> Vec<Group> {
        let of = |state: usize| {
            let frames = of_state(followed, Some(state));
            let seen = self.seen(labels, &frames);
            Group {
                state,
                frames,
                seen,
            }
        };
        let mut all: Vec<Group> = (0..followed.states.len()).map(of).collect();
        all.retain(|group| group.seen > 0);
        all.sort_by_key(|group| std::cmp::Reverse(group.seen));
        all
    }

    /// The state in which the names of labels that were exchanged are right.
    fn right_side(
        &self,
        labels: &[usize],
        groups: &[Group],
        mirror: &Mirror<'_>,
    ) -> Option<(usize, SideBy)> {
        let longest = groups.first()?;
        let all: usize = groups.iter().map(|group| group.seen).sum();
        let share = |group: &Group| group.seen as f64 / all as f64;
        let shorter = 1.0 - share(longest);
        let clearest = |among: &[&Group], cost: &dyn Fn(&[Range<usize>]) -> Option<f64>| {
            let costs = among.iter().map(|g| Some((cost(&g.frames)?, g.state)));
            let mut costs: Vec<(f64, usize)> = costs.collect::<Option<_>>()?;
            costs.sort_by(|a, b| a.0.total_cmp(&b.0));
            let is_clear = costs.get(1)?.0 - costs[0].0 > CLEAR;
            is_clear.then_some(costs[0].1)
        };
        let long: Vec<&Group> = groups.iter().filter(|g| share(g) >= LONG).collect();
        let by_mirror = || clearest(&long, &|frames| mirror.cost(labels, frames));
        let (names, positions) = (&self.names[..self.labels], self.xyz);
        let like = |frames: &[Range<usize>]| {
            (self.like).cost(self.person, names, positions, labels, frames)
        };
        // Another person's take says nothing against most frames.
        let among = if self.like.are_same_person() {
            groups.iter().collect()
        } else {
            long.clone()
        };
        if let Some(state) = clearest(&among, &like) {
            // Nor does one take against most frames or the sides of the body.
            let is_doubtful = by_mirror().map_or(shorter <= OPEN, |other| other != state);
            return (state == longest.state || !is_doubtful).then_some((state, SideBy::Template));
        }
        if shorter < LONG {
            return Some((longest.state, SideBy::Length));
        }
        match by_mirror() {
            Some(state) if state == longest.state || shorter > OPEN => {
                Some((state, SideBy::Mirror))
            }
            Some(_) => None,
            None if shorter > OPEN => None,
            None => Some((longest.state, SideBy::Length)),
        }
    }
}

/// The frames of a state.
fn of_state(followed: &Followed, state: Option<usize>) -> Vec<Range<usize>> {
    let own = followed.stretches.iter().filter(|(_, of)| *of == state);
    own.map(|(frames, _)| frames.clone()).collect()
}

/// Where some labels stand under each other's names, if these are right in one state.
fn exchanged(labels: &[usize], followed: &Followed, right: usize) -> Vec<Exchanged> {
    let right = &followed.states[right];
    let known = followed.stretches.iter();
    let known = known.filter_map(|(frames, state)| {
        let mut to = labels.to_vec();
        for (point, track) in right.iter().zip(&followed.states[(*state)?]) {
            to[*point] = labels[*track];
        }
        let frames = frames.clone();
        let labels = labels.to_vec();
        (to != labels).then_some(Exchanged { labels, to, frames })
    });
    known.collect()
}

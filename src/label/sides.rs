//! Which side of an exchange is right: the longer one, of long exchanges the one that fits the
//! body's mirror image.

use super::evidence::Evidence;
use super::identities::{Course, Exchange, Exchanged};
use super::labeled_take::LabeledTake;
use super::mirror::Mirror;
use super::tuning::sides::*;
use crate::pose::point_at;
use ndarray::ArrayView2;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;

/// Labels of which one side of an exchange is right and nothing says which.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unsure {
    pub labels: Vec<usize>,
    pub frames: Vec<Range<usize>>,
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
}

impl SideBy {
    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            SideBy::Length => "length",
            SideBy::Mirror => "mirror image",
            SideBy::Template => "labeled take",
        }
    }
}

/// On which side of an exchange the names are right.
enum Side {
    Named,
    Exchanged,
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

impl LabeledTake<'_> {
    /// The stretches in which labels stand under each other's names, those aside of which nothing
    /// says which side is right.
    pub(crate) fn sides(&self, found: &[Exchange], named: ArrayView2<'_, f64>) -> Sides {
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
        let mut out = Sides::default();
        for (labels, exchanges) in by_labels {
            let stretches = course.stretches(&exchanges);
            let Some((side, by)) = self.right_side(labels, &stretches, &mirror) else {
                out.unsure.push(Unsure {
                    labels: labels.to_vec(),
                    frames: stretches.into_iter().map(|s| s.frames).collect(),
                });
                continue;
            };
            out.decided.push((labels.to_vec(), by));
            match side {
                Side::Named => out.exchanged.extend(stretches),
                Side::Exchanged => out.exchanged.extend(self.others(labels, &stretches)),
            }
        }
        out.exchanged.sort_by_key(|s| s.frames.start);
        out
    }

    /// Where the names of labels that were exchanged are right.
    fn right_side(
        &self,
        labels: &[usize],
        stretches: &[Exchanged],
        mirror: &Mirror<'_>,
    ) -> Option<(Side, SideBy)> {
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
        let side = |named: Option<f64>, exchanged: Option<f64>| match exchanged? - named? {
            better if better > CLEAR => Some(Side::Named),
            // Labels in a ring are not put back by its inverse.
            better if better < -CLEAR && labels.len() == 2 => Some(Side::Exchanged),
            _ => None,
        };
        let (names, places) = (&self.names[..self.labels], self.xyz);
        let like =
            |frames: &[Range<usize>]| (self.like).cost(self.person, names, places, labels, frames);
        // Another person's take says nothing against most frames.
        if (shorter >= LONG || self.like.are_same_person())
            && let Some(side) = side(like(&rest), like(&exchanged))
        {
            return Some((side, SideBy::Template));
        }
        if shorter < LONG {
            return Some((Side::Named, SideBy::Length));
        }
        let mirrored = |frames: &[Range<usize>]| mirror.cost(labels, frames);
        match side(mirrored(&rest), mirrored(&exchanged)) {
            Some(side) => Some((side, SideBy::Mirror)),
            None if shorter > OPEN => None,
            None => Some((Side::Named, SideBy::Length)),
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

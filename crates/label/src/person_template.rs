//! What a labeled take of a person says of the labels of another take: a distance within the body
//! is the same, or in another person one in proportion.
//!
//! ```text
//! z = min(((μ − c μ′)² + (s − c s′)²) / (min(s, c s′)² + w² + (k c μ′)²), 9)
//! ```
//!
//! with the median μ and the spread s of a distance in the take, μ′ and s′ in the template, and the
//! ratio c of their sizes, 1 for the same person. Spreads count as well: else a loose distance fits
//! any. Another person's postures differ, so that only the most rigid neighbors count there.
//!
//! A body that stands still keeps all its distances, so that its spreads are worth nothing: where
//! one of both moves far less, a distance is some times as loose as it is in the other, as nobody
//! walks as he stands; where both stand, their postures differ by a share of it.

use super::handedness::Hand;
use super::marker_distances::{Distance, Distances};
use super::tuning::person_template::*;
use super::tuning::whole_take::NEAR;
use super::unlabeled::own_name;
use super::whole_take::exchanged;
use crate::numeric::statistics::median;
use ndarray::ArrayView2;
use std::ops::Range;

/// What is learned of the labels of a person in a take.
pub(crate) struct Template {
    /// The labels, without the subject's prefix.
    labels: Vec<String>,
    distances: Distances,
    hand: Hand,
    /// Standard deviations between a distance here and there: cm, and share of it; and whether
    /// bodies are of one size.
    unlike: [f64; 2],
    is_same_person: bool,
}

/// The labels of one person in a take.
#[derive(Clone, Copy)]
pub(crate) struct Labels<'a> {
    /// Their names, with or without the subject's prefix.
    pub names: &'a [String],
    /// Where they are (frames, 3 L), cm; NaN is missing.
    pub positions: ArrayView2<'a, f64>,
    /// The distances between them.
    pub distances: &'a Distances,
}

/// What a template says of the labels of a take.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Unlike {
    /// Pairs of labels that are exchanged, the clearest first.
    pub pairs: Vec<[usize; 2]>,
    /// Whether left and right are exchanged altogether.
    pub other_hand: bool,
    /// The labels that both have.
    pub known: Vec<usize>,
}

impl Template {
    /// Learns from the labels of a person.
    pub(crate) fn learn(
        names: &[String],
        positions: ArrayView2<'_, f64>,
        is_same_person: bool,
    ) -> Template {
        Template {
            labels: names.iter().map(|n| own_name(n).to_string()).collect(),
            distances: Distances::measure(positions),
            hand: Hand::learn(positions),
            unlike: if is_same_person {
                SAME_PERSON
            } else {
                OTHER_PERSON
            },
            is_same_person,
        }
    }

    /// Which labels of a take are exchanged in every frame, by this template; `mirrored` is the
    /// mirror image of each of its labels, itself where it has none.
    pub(crate) fn compare(&self, take: Labels<'_>, mirrored: &[usize]) -> Unlike {
        let find = |own: &String| take.names.iter().position(|n| own_name(n) == own);
        let here: Vec<Option<usize>> = self.labels.iter().map(find).collect();
        // The labels that both have, here and in the template.
        let both: Vec<[usize; 2]> = (0..here.len())
            .filter_map(|l| Some([here[l]?, l]))
            .collect();
        let known: Vec<usize> = both.iter().map(|[l, _]| *l).collect();
        if known.len() < FEWEST_LABELS {
            return Unlike {
                known,
                ..Unlike::default()
            };
        }
        let has_sides = known.iter().any(|l| mirrored[*l] != *l);
        let other_hand = has_sides && self.hand.is_other(&here, take.positions) == Some(true);
        let of = |k: usize| {
            if other_hand {
                mirrored[both[k][0]]
            } else {
                both[k][0]
            }
        };
        let tracks: Vec<usize> = (0..both.len()).map(of).collect();
        let own = |a: usize, b: usize| take.distances.between(tracks[a], tracks[b]);
        let there = |a: usize, b: usize| self.distances.between(both[a][1], both[b][1]);
        let pairs = (0..both.len()).flat_map(|a| {
            (a + 1..both.len()).filter_map(move |b| Some([own(a, b)?, there(a, b)?]))
        });
        let beside = self.beside(pairs.collect());
        let weights = self.weights(&both.iter().map(|both| both[1]).collect::<Vec<_>>());
        let gain = |tracks: &[usize], [a, b]: [usize; 2]| {
            if own(tracks[a], tracks[b]).is_none_or(|d| d.median > NEAR[1]) {
                return 0.0;
            }
            let others = (0..both.len()).filter(|j| *j != a && *j != b);
            let of = |j: usize| {
                let (of_a, of_b) = (own(tracks[a], tracks[j])?, own(tracks[b], tracks[j])?);
                let better = |label: usize, of_label: &Distance, of_other: &Distance| {
                    let weight = Some(weights[label][j]).filter(|w| *w > 0.0)?;
                    let there = there(label, j)?;
                    let cost = |own: &Distance| beside.cost_of(own, &there);
                    Some(weight * (cost(of_label) - cost(of_other)))
                };
                let both = [better(a, &of_a, &of_b), better(b, &of_b, &of_a)];
                Some(both.into_iter().flatten().sum::<f64>())
            };
            others.filter_map(of).sum::<f64>()
        };
        let pairs = exchanged(both.len(), gain);
        Unlike {
            pairs: pairs
                .into_iter()
                .map(|pair| pair.map(|k| tracks[k]))
                .collect(),
            other_hand,
            known,
        }
    }

    /// How badly the distances of some labels, which were exchanged with each other, fit those of
    /// the template in some frames, χ²; `None` where these say nothing.
    pub(crate) fn cost(
        &self,
        names: &[String],
        positions: ArrayView2<'_, f64>,
        labels: &[usize],
        frames: &[Range<usize>],
    ) -> Option<f64> {
        let here = |l: usize| names.iter().position(|n| own_name(n) == self.labels[l]);
        let there = |l: usize| self.labels.iter().position(|n| *n == own_name(&names[l]));
        let whole = |a: usize, b: usize| Distance::measure(positions, [a, b]);
        let mut steady: Vec<[usize; 2]> = (0..self.labels.len())
            .flat_map(|a| (a + 1..self.labels.len()).map(move |b| [a, b]))
            .filter(|[a, b]| {
                self.distances
                    .between(*a, *b)
                    .is_some_and(|d| is_steady(&d))
            })
            .collect();
        // Every so many of them.
        let step = steady.len().div_ceil(MOST_STEADY).max(1);
        steady = steady.into_iter().step_by(step).collect();
        let pairs = steady.iter().filter_map(|[a, b]| {
            let own = whole(here(*a)?, here(*b)?)?;
            Some([own, self.distances.between(*a, *b)?])
        });
        let beside = self.beside(pairs.collect());
        let of_label = |label: &usize| {
            let all = there(*label).map_or_else(Vec::new, |l| self.distances.most_rigid(l));
            let seen = all.into_iter().filter_map(|(other, distance)| {
                let other = here(other).filter(|o| !labels.contains(o))?;
                let own = Distance::within(positions, [*label, other], frames)?;
                Some(beside.cost_of(&own, &distance))
            });
            seen.take(NEIGHBORS).collect::<Vec<f64>>()
        };
        let terms: Vec<f64> = labels.iter().flat_map(of_label).collect();
        (!terms.is_empty()).then(|| terms.iter().sum())
    }

    /// How far apart the steady distances of a person are from those of some labels of a take, cm,
    /// in the median; `None` where both know few.
    pub(crate) fn off(&self, labels: &[String], distances: &Distances) -> Option<f64> {
        let here = |l: &String| labels.iter().position(|name| own_name(name) == l);
        let here: Vec<Option<usize>> = self.labels.iter().map(here).collect();
        self.distances
            .off(|a, b| distances.between(here[a]?, here[b]?))
    }

    /// How much the distance of each two of some labels counts: for each of which it is one of the
    /// most rigid; once within the same person.
    fn weights(&self, labels: &[usize]) -> Vec<Vec<f64>> {
        if self.is_same_person {
            return vec![vec![1.0; labels.len()]; labels.len()];
        }
        let mut weights = vec![vec![0.0; labels.len()]; labels.len()];
        for (k, label) in labels.iter().enumerate() {
            let all = self.distances.most_rigid(*label).into_iter();
            let known = all.filter_map(|(other, _)| labels.iter().position(|l| *l == other));
            for other in known.take(MOST_RIGID) {
                weights[k][other] += 1.0;
                weights[other][k] += 1.0;
            }
        }
        weights
    }

    /// How the template and a take compare, some of whose distances these are, each with its own in
    /// the template.
    fn beside(&self, pairs: Vec<[Distance; 2]>) -> Beside {
        let middle = |k: usize| median(pairs.iter().map(|both| both[k].spread).collect());
        let [own, there] = [0, 1].map(|k| middle(k).unwrap_or(0.0));
        let spreads = match (
            own.max(there) < STANDING,
            own < STILLER * there,
            there < STILLER * own,
        ) {
            (true, ..) => Spreads::None,
            (_, true, _) => Spreads::Theirs,
            (.., true) => Spreads::Own,
            _ => Spreads::Both,
        };
        let steady = pairs.iter().filter(|both| both.iter().all(is_steady));
        let ratios = steady.map(|[own, there]| own.median / there.median);
        Beside {
            size: if self.is_same_person {
                1.0
            } else {
                median(ratios.collect()).unwrap_or(1.0)
            },
            unlike: self.unlike,
            spreads,
        }
    }
}

/// How a take and a template compare.
struct Beside {
    /// How many times as large the body is as that of the template, by distances in both.
    size: f64,
    unlike: [f64; 2],
    spreads: Spreads,
}

/// Whose spreads tell how loose a distance is.
#[derive(Clone, Copy)]
enum Spreads {
    Both,
    /// The template stands still.
    Own,
    /// The take does.
    Theirs,
    /// Both do.
    None,
}

impl Beside {
    /// z of a distance in a take and in the template.
    fn cost_of(&self, own: &Distance, there: &Distance) -> f64 {
        let [fixed, share] = self.unlike;
        let want = self.size * there.median;
        let (spread, want_spread) = (own.spread, self.size * there.spread);
        let (loose, differs) = match self.spreads {
            Spreads::Both => (spread.min(want_spread), spread - want_spread),
            Spreads::Own => (STANDS_OFF * spread, 0.0),
            Spreads::Theirs => (STANDS_OFF * want_spread, 0.0),
            Spreads::None => (POSTURE * want, 0.0),
        };
        let off = (own.median - want).powi(2) + differs.powi(2);
        let variance = loose.powi(2) + fixed.powi(2) + (share * want).powi(2);
        (off / variance).min(HIGHEST)
    }
}

fn is_steady(distance: &Distance) -> bool {
    distance.spread < STEADY * distance.median
}

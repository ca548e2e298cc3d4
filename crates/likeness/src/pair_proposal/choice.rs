//! The choice among candidates: spread over takes and distances, no near copies.

use super::candidates::{CLASSES, Candidate, Found, Sample};
use super::{NEAR_COPY, PairRules, ProposedPair, TIME_EPSILON};
use crate::numeric::parallel;
use rand::seq::SliceRandom;
use std::collections::HashMap;

/// The classes are taken in turn, in steps of this size, so that few pairs are spread over the
/// distances too.
const TURN: usize = 3;

/// Chooses up to `rules.count` pairs. Each turn takes, from the next class of distances, the
/// candidate whose takes were chosen least; of several the one of the lowest rank.
pub(crate) fn choose(sample: &Sample, found: &Found, rules: &PairRules) -> Vec<ProposedPair> {
    let mut open = found.classes.clone();
    let mut chosen = Chosen {
        sample,
        uses: vec![0; sample.counts.len()],
        times: HashMap::new(),
    };
    let mut pairs = Vec::new();
    let mut class = CLASSES / 2;
    while pairs.len() < rules.count && open.iter().any(|class| !class.is_empty()) {
        if let Some(next) = chosen.take_from(&mut open[class]) {
            pairs.push(ProposedPair {
                a: sample.poses[next.a as usize].at,
                b: sample.poses[next.b as usize].at,
                distance: next.distance,
            });
        }
        class = (class + TURN) % CLASSES;
    }
    pairs.shuffle(&mut parallel::rng(rules.seed, 0));
    pairs
}

/// The pairs chosen so far.
struct Chosen<'a> {
    sample: &'a Sample,
    /// How often each take was chosen.
    uses: Vec<usize>,
    /// The times of the pairs of two takes.
    times: HashMap<(usize, usize), Vec<[f64; 2]>>,
}

impl Chosen<'_> {
    fn takes(&self, pair: &Candidate) -> (usize, usize) {
        let take = |pose: u32| self.sample.poses[pose as usize].at.take;
        (take(pair.a), take(pair.b))
    }

    fn times(&self, pair: &Candidate) -> [f64; 2] {
        [pair.a, pair.b].map(|pose| self.sample.poses[pose as usize].time)
    }

    /// Removes the next candidate from its class, and all before it that are near copies of chosen
    /// pairs.
    fn take_from(&mut self, class: &mut Vec<Candidate>) -> Option<Candidate> {
        let mut best: Option<(usize, usize)> = None;
        let mut copies = Vec::new();
        for (i, pair) in class.iter().enumerate() {
            let (a, b) = self.takes(pair);
            let uses = self.uses[a] + self.uses[b];
            if best.is_some_and(|(least, _)| uses >= least) {
                continue;
            }
            if self.is_copy(pair) {
                copies.push(i)
            } else {
                best = Some((uses, i))
            }
        }
        let next = best.map(|(_, i)| (i, class[i]));
        copies.extend(next.map(|(i, _)| i));
        copies.sort_unstable();
        let mut index = 0;
        class.retain(|_| {
            index += 1;
            copies.binary_search(&(index - 1)).is_err()
        });
        let (_, pair) = next?;
        let takes = self.takes(&pair);
        self.uses[takes.0] += 1;
        self.uses[takes.1] += 1;
        let times = self.times(&pair);
        self.times.entry(takes).or_default().push(times);
        Some(pair)
    }

    /// Whether a chosen pair is within [`NEAR_COPY`] on both sides.
    fn is_copy(&self, pair: &Candidate) -> bool {
        let [a, b] = self.times(pair);
        let close = |s: f64, t: f64| (s - t).abs() <= NEAR_COPY + TIME_EPSILON;
        let others = self.times.get(&self.takes(pair));
        others.is_some_and(|all| all.iter().any(|[s, t]| close(a, *s) && close(b, *t)))
    }
}

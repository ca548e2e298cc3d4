//! What an observation is by all parts of a body, and the ways to make a body of them.

use super::Blocks;
use super::answer::{Answer, Told};
use super::explained::Explained;
use super::part::View;
use super::search::{Desk, Search};
use crate::numeric::parallel;
use crate::numeric::small_linalg::{add, log_sum};
use crate::prior::{Belief, Posterior};
use std::sync::Arc;

/// Ways of making a body of parts that weigh less for an observation do not answer it; those that by their cells alone
/// weigh less than this share of the first are not looked at any further.
const LEAST_WEIGHT: f64 = 0.01;
/// Ways that weigh less than this share of the first before any observation are not looked at.
const LEAST_WAY: f64 = 0.002;

/// What all parts make of an observation.
pub struct Considered {
    pub views: Vec<Arc<View>>,
    pub observed: Vec<Vec<f64>>,
    pub explained: Vec<Explained>,
    /// The log evidence of each way, its weight included.
    pub ways: Vec<f64>,
}

impl Blocks {
    /// The parts of the ways whose log is not less than that share of the most likely one's.
    fn wanted(&self, logs: &[f64], share: f64) -> Vec<bool> {
        let mut wanted = vec![false; self.parts.len()];
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (way, log) in self.ways.iter().zip(logs) {
            if *log >= most + share.ln() {
                way.iter().for_each(|&p| wanted[p] = true);
            }
        }
        wanted
    }

    /// The log evidence of each way, its weight included, by those of the parts.
    fn ways_of(&self, evidences: impl Iterator<Item = f64>) -> Vec<f64> {
        let evidences: Vec<f64> = evidences.collect();
        let ways = self.ways.iter().zip(&self.log_ways);
        ways.map(|(way, log)| log + way.iter().map(|&p| evidences[p]).sum::<f64>())
            .collect()
    }

    /// The logs of what the ways weigh where they are averaged: their evidences are surer of their order than they should
    /// be, as there are few ways, and all are wrong.
    fn tempered(&self, ways: &[f64]) -> Vec<f64> {
        let ways = ways.iter().zip(&self.log_ways);
        ways.map(|(all, weight)| weight + self.temperature * (all - weight))
            .collect()
    }

    /// What all parts make of an observation (3 J) through its noise.
    pub fn consider(&self, y: &[f64], noise: &[f64]) -> Considered {
        self.consider_ways(y, noise, LEAST_WEIGHT)
    }

    /// Ways that weigh less than `least` by their cells alone are not worth a look at their leaves.
    pub fn consider_ways(&self, y: &[f64], noise: &[f64], least: f64) -> Considered {
        let views = self.views(noise);
        let observed: Vec<Vec<f64>> = (self.parts.iter())
            .map(|p| p.coordinates.iter().map(|&i| y[i]).collect())
            .collect();
        // The parts side by side: a frame that comes alone is answered sooner, and among others it costs next to nothing.
        let parts = self.parts.iter().zip(&views).zip(&observed);
        let parts = parts.zip(self.wanted(&self.log_ways, LEAST_WAY));
        let searches: Vec<Option<Search<'_>>> = parallel::map_each(
            parts.collect(),
            Desk::default,
            |desk, (((part, view), y), wanted)| wanted.then(|| part.search(view, y, desk)),
        );
        let by_cells = self.ways_of(searches.iter().map(|s| match s {
            Some(search) => search.evidence(),
            None => f64::NEG_INFINITY,
        }));
        let wanted = self.wanted(&self.tempered(&by_cells), least);
        let searches = searches.into_iter().zip(wanted);
        let explained: Vec<Explained> = parallel::map_each(
            searches.collect(),
            Desk::default,
            |desk, (search, wanted)| match search {
                Some(mut search) if wanted => {
                    search.open(desk);
                    search.end()
                }
                _ => Explained::nothing(),
            },
        );
        let ways = self.ways_of(explained.iter().map(|e| e.evidence));
        Considered {
            views,
            observed,
            explained,
            ways,
        }
    }

    /// The answers of all ways, averaged by evidence.
    pub fn join(&self, seen: &Considered, told: Told) -> Answer {
        let ways = self.tempered(&seen.ways);
        let evidence = log_sum(&ways);
        let shares = ways.iter().map(|log| (log - evidence).exp());
        let heard: Vec<(&Vec<usize>, f64)> = (self.ways.iter().zip(shares))
            .filter(|(_, share)| *share >= LEAST_WEIGHT)
            .collect();
        if heard.is_empty() {
            // What is no number explains nothing.
            return Answer::unknown(self.width, told);
        }
        let total: f64 = heard.iter().map(|w| w.1).sum();
        let mut answers: Vec<Option<Answer>> = vec![None; self.parts.len()];
        let mut out = Answer::new(self.width, told);
        let mut means = Vec::with_capacity(heard.len());
        for (way, share) in heard {
            let weight = share / total;
            let mut mean = vec![0.0; self.width];
            for &p in way {
                let part = &self.parts[p];
                let answer = answers[p].get_or_insert_with(|| {
                    part.answer(&seen.views[p], &seen.observed[p], &seen.explained[p], told)
                });
                for (&to, m) in part.coordinates.iter().zip(&answer.mean) {
                    mean[to] = *m;
                }
                out.add_spread(weight, answer, &part.coordinates, told);
            }
            add(&mut out.mean, weight, &mean);
            means.push((weight, mean));
        }
        if told != Told::Mean && means.len() > 1 {
            for (weight, mut off) in means {
                add(&mut off, -1.0, &out.mean);
                out.add_outer(weight, &off, told);
            }
        }
        out
    }
}

impl Answer {
    /// Where the covariance is told.
    pub fn belief(self, seen: &Considered) -> Belief {
        Belief {
            mean: self.mean,
            covariance: self.spread,
            evidence: log_sum(&seen.ways),
        }
    }

    /// Where variances are.
    pub fn posterior(self) -> Posterior {
        Posterior {
            mean: self.mean,
            variance: self.spread.into_iter().collect(),
        }
    }
}

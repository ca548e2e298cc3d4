//! What an observation is by all parts of a body, and the ways to make a body of them.

use super::MultiscaleMixture;
use super::candidates::Candidates;
use super::part_mixture::ConditionedPart;
use super::posterior::{Detail, PartialPosterior};
use super::search::{ComponentSearch, SearchScratch};
use crate::numeric::parallel;
use crate::numeric::small_linalg::{add, log_sum};
use crate::prior::Posterior;
use std::sync::Arc;

/// Ways of making a body of parts that weigh less for an observation do not answer it; those that by their cells alone
/// weigh less than this share of the first are not looked at any further.
const MIN_WEIGHT: f64 = 0.01;
/// Ways that weigh less than this share of the first before any observation are not looked at.
const MIN_PRIOR_WEIGHT: f64 = 0.002;

/// What all parts make of an observation.
pub struct EvaluatedParts {
    pub conditioned_parts: Vec<Arc<ConditionedPart>>,
    pub observed: Vec<Vec<f64>>,
    pub candidates: Vec<Candidates>,
    /// The log evidence of each way, its weight included.
    pub factorizations: Vec<f64>,
}

impl MultiscaleMixture {
    /// The parts of the ways whose log is not less than that share of the most likely one's.
    fn needed(&self, log_evidences: &[f64], share: f64) -> Vec<bool> {
        let mut needed = vec![false; self.parts.len()];
        let most = log_evidences
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        for (factorization, log) in self.factorizations.iter().zip(log_evidences) {
            if *log >= most + share.ln() {
                factorization.iter().for_each(|&p| needed[p] = true);
            }
        }
        needed
    }

    /// The log evidence of each way, its weight included, by those of the parts.
    fn factorization_evidences(&self, evidences: impl Iterator<Item = f64>) -> Vec<f64> {
        let evidences: Vec<f64> = evidences.collect();
        let factorizations = self
            .factorizations
            .iter()
            .zip(&self.log_factorization_weights);
        factorizations
            .map(|(factorization, log)| {
                log + factorization.iter().map(|&p| evidences[p]).sum::<f64>()
            })
            .collect()
    }

    /// The logs of what the ways weigh where they are averaged: their evidences are surer of their order than they should
    /// be, as there are few ways, and all are wrong.
    fn tempered(&self, factorizations: &[f64]) -> Vec<f64> {
        let factorizations = factorizations.iter().zip(&self.log_factorization_weights);
        factorizations
            .map(|(all, weight)| weight + self.temperature * (all - weight))
            .collect()
    }

    /// What all parts make of an observation (3 J) through its noise.
    pub fn evaluate_parts(&self, y: &[f64], noise: &[f64]) -> EvaluatedParts {
        self.evaluate_parts_above(y, noise, MIN_WEIGHT)
    }

    /// Ways that weigh less than `least` by their cells alone are not worth a look at their leaves.
    pub fn evaluate_parts_above(&self, y: &[f64], noise: &[f64], least: f64) -> EvaluatedParts {
        let conditioned_parts = self.conditioned_parts(noise);
        let observed: Vec<Vec<f64>> = (self.parts.iter())
            .map(|p| p.coordinates.iter().map(|&i| y[i]).collect())
            .collect();
        // The parts side by side: a frame that comes alone is answered sooner, and among others it costs next to nothing.
        let parts = self.parts.iter().zip(&conditioned_parts).zip(&observed);
        let parts = parts.zip(self.needed(&self.log_factorization_weights, MIN_PRIOR_WEIGHT));
        let searches: Vec<Option<ComponentSearch<'_>>> = parallel::map_each(
            parts.collect(),
            SearchScratch::default,
            |scratch, (((part, conditioned), y), needed)| {
                needed.then(|| part.search(conditioned, y, scratch))
            },
        );
        let by_cells = self.factorization_evidences(searches.iter().map(|s| match s {
            Some(search) => search.evidence(),
            None => f64::NEG_INFINITY,
        }));
        let needed = self.needed(&self.tempered(&by_cells), least);
        let searches = searches.into_iter().zip(needed);
        let candidates: Vec<Candidates> = parallel::map_each(
            searches.collect(),
            SearchScratch::default,
            |scratch, (search, needed)| match search {
                Some(mut search) if needed => {
                    search.open(scratch);
                    search.end()
                }
                _ => Candidates::nothing(),
            },
        );
        let factorizations = self.factorization_evidences(candidates.iter().map(|e| e.evidence));
        EvaluatedParts {
            conditioned_parts,
            observed,
            candidates,
            factorizations,
        }
    }

    /// The answers of all ways, averaged by evidence.
    pub fn average_factorizations(
        &self,
        evaluated: &EvaluatedParts,
        detail: Detail,
    ) -> PartialPosterior {
        let factorizations = self.tempered(&evaluated.factorizations);
        let evidence = log_sum(&factorizations);
        let shares = factorizations.iter().map(|log| (log - evidence).exp());
        let heavy: Vec<(&Vec<usize>, f64)> = (self.factorizations.iter().zip(shares))
            .filter(|(_, share)| *share >= MIN_WEIGHT)
            .collect();
        if heavy.is_empty() {
            // What is no number explains nothing.
            return PartialPosterior::unknown(self.width, detail);
        }
        let total: f64 = heavy.iter().map(|w| w.1).sum();
        let mut answers: Vec<Option<PartialPosterior>> = vec![None; self.parts.len()];
        let mut out = PartialPosterior::new(self.width, detail);
        let mut means = Vec::with_capacity(heavy.len());
        for (factorization, share) in heavy {
            let weight = share / total;
            let mut mean = vec![0.0; self.width];
            for &p in factorization {
                let part = &self.parts[p];
                let answer = answers[p].get_or_insert_with(|| {
                    part.answer(
                        &evaluated.conditioned_parts[p],
                        &evaluated.observed[p],
                        &evaluated.candidates[p],
                        detail,
                    )
                });
                for (&to, m) in part.coordinates.iter().zip(&answer.mean) {
                    mean[to] = *m;
                }
                out.add_spread(weight, answer, &part.coordinates, detail);
            }
            add(&mut out.mean, weight, &mean);
            means.push((weight, mean));
        }
        if detail != Detail::Mean && means.len() > 1 {
            for (weight, mut off) in means {
                add(&mut off, -1.0, &out.mean);
                out.add_outer(weight, &off, detail);
            }
        }
        out
    }
}

impl PartialPosterior {
    /// The posterior of a whole pose that was averaged at this level of detail.
    pub fn posterior(self, evaluated: &EvaluatedParts, detail: Detail) -> Posterior {
        let log_evidence = log_sum(&evaluated.factorizations);
        match detail {
            Detail::Covariance => Posterior::full(self.mean, self.spread, log_evidence),
            Detail::Mean | Detail::Variances => Posterior {
                mean: self.mean,
                variance: self.spread.into_iter().collect(),
                log_evidence,
                ..Posterior::default()
            },
        }
    }
}

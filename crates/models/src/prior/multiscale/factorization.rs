//! Evaluation of an observation by all parts of the body, and the average over the factorizations
//! into parts.

use super::MultiscaleMixture;
use super::candidates::Candidates;
use super::conditioned::ConditionedPart;
use super::posterior::{Moments, add_outer};
use super::search::ComponentSearch;
use crate::numeric::parallel;
use crate::numeric::small_linalg::{add, log_sum};
use std::sync::Arc;

/// Factorizations of less posterior weight than this do not count; those below this share of the
/// best by the clusters alone are not searched for exemplars.
const MIN_WEIGHT: f64 = 0.01;
/// Factorizations below this share of the best prior weight are not evaluated.
const MIN_PRIOR_WEIGHT: f64 = 0.002;

/// An observation evaluated by all parts.
pub(crate) struct EvaluatedParts {
    conditioned: Vec<Arc<ConditionedPart>>,
    /// The part's coordinates of the observation (d).
    observations: Vec<Vec<f64>>,
    /// The components found for each part.
    pub candidates: Vec<Candidates>,
    /// log (weight × evidence) of each factorization, nats.
    log_evidences: Vec<f64>,
}

impl EvaluatedParts {
    /// log p(y), nats.
    pub(crate) fn evidence(&self) -> f64 {
        log_sum(&self.log_evidences)
    }
}

impl MultiscaleMixture {
    /// Which parts occur in factorizations whose `logs` are within the log of `share` of the
    /// largest.
    fn needed_parts(&self, logs: &[f64], share: f64) -> Vec<bool> {
        let mut needed = vec![false; self.parts.len()];
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for (factorization, log) in self.factorizations.iter().zip(logs) {
            if *log >= most + share.ln() {
                factorization.iter().for_each(|&p| needed[p] = true);
            }
        }
        needed
    }

    /// log (weight × evidence) of each factorization, from the log evidences of the parts.
    fn factorization_evidences(&self, parts: impl Iterator<Item = f64>) -> Vec<f64> {
        let parts: Vec<f64> = parts.collect();
        let evidence =
            |factorization: &Vec<usize>| factorization.iter().map(|&p| parts[p]).sum::<f64>();
        let each = self
            .factorizations
            .iter()
            .zip(&self.log_factorization_weights);
        each.map(|(factorization, log)| log + evidence(factorization))
            .collect()
    }

    /// log (weight × evidence^temperature) of each factorization: as there are few, and all are
    /// approximate, their plain evidences differ by more than they should.
    fn tempered(&self, log_evidences: &[f64]) -> Vec<f64> {
        let each = log_evidences.iter().zip(&self.log_factorization_weights);
        each.map(|(all, weight)| weight + self.temperature * (all - weight))
            .collect()
    }

    /// Evaluates an observation: `y` and the noise variances (3 J each).
    pub(crate) fn evaluate(&self, y: &[f64], noise: &[f64]) -> EvaluatedParts {
        self.evaluate_above(y, noise, MIN_WEIGHT)
    }

    /// Evaluates an observation; factorizations below the share `least` of the best by their
    /// clusters alone are not searched for exemplars.
    pub(crate) fn evaluate_above(&self, y: &[f64], noise: &[f64], least: f64) -> EvaluatedParts {
        let conditioned = self.conditioned_parts(noise);
        let observations: Vec<Vec<f64>> = (self.parts.iter())
            .map(|p| p.coordinates.iter().map(|&i| y[i]).collect())
            .collect();
        // Parts in parallel: a single frame is answered sooner, and among many frames it costs next
        // to nothing.
        let parts = self.parts.iter().zip(&conditioned).zip(&observations);
        let parts = parts.zip(self.needed_parts(&self.log_factorization_weights, MIN_PRIOR_WEIGHT));
        let searches: Vec<Option<ComponentSearch<'_>>> = parallel::map_each(
            parts.collect(),
            || (),
            |(), (((part, conditioned), y), needed)| needed.then(|| part.search(conditioned, y)),
        );
        let evidence = |search: &Option<ComponentSearch<'_>>| {
            search
                .as_ref()
                .map_or(f64::NEG_INFINITY, ComponentSearch::evidence)
        };
        let by_clusters = self.factorization_evidences(searches.iter().map(evidence));
        let needed = self.needed_parts(&self.tempered(&by_clusters), least);
        let candidates: Vec<Candidates> = parallel::map_each(
            searches.into_iter().zip(needed).collect(),
            || (),
            |(), (search, needed)| match search {
                Some(mut search) if needed => {
                    search.evaluate_exemplars();
                    search.finish()
                }
                _ => Candidates::none(),
            },
        );
        EvaluatedParts {
            log_evidences: self.factorization_evidences(candidates.iter().map(|c| c.evidence)),
            conditioned,
            observations,
            candidates,
        }
    }

    /// The posterior over whole poses (3 J): the average over the factorizations. NaN where the
    /// observation has no finite evidence.
    pub(crate) fn average(&self, evaluated: &EvaluatedParts, with_covariance: bool) -> Moments {
        let logs = self.tempered(&evaluated.log_evidences);
        let total = log_sum(&logs);
        let shares = logs.iter().map(|log| (log - total).exp());
        let heavy: Vec<(&Vec<usize>, f64)> = (self.factorizations.iter().zip(shares))
            .filter(|(_, share)| *share >= MIN_WEIGHT)
            .collect();
        if heavy.is_empty() {
            return Moments::new(self.width, with_covariance, f64::NAN);
        }
        let total: f64 = heavy.iter().map(|f| f.1).sum();
        let mut of_parts: Vec<Option<Moments>> = vec![None; self.parts.len()];
        let mut out = Moments::new(self.width, with_covariance, 0.0);
        let mut means = Vec::with_capacity(heavy.len());
        for (factorization, share) in heavy {
            let weight = share / total;
            let mut mean = vec![0.0; self.width];
            for &p in factorization {
                let part = &self.parts[p];
                let moments = of_parts[p].get_or_insert_with(|| {
                    let (conditioned, y) = (&evaluated.conditioned[p], &evaluated.observations[p]);
                    part.posterior(conditioned, y, &evaluated.candidates[p], with_covariance)
                });
                for (&to, m) in part.coordinates.iter().zip(&moments.mean) {
                    mean[to] = *m;
                }
                let Some((to, from)) = out.covariance.as_mut().zip(moments.covariance.as_ref())
                else {
                    continue;
                };
                for (row, &r) in from.rows().into_iter().zip(&part.coordinates) {
                    let mut to = to.row_mut(r);
                    let both = part.coordinates.iter().zip(row);
                    both.for_each(|(&c, v)| to[c] += weight * v);
                }
            }
            add(&mut out.mean, weight, &mean);
            means.push((weight, mean));
        }
        if let Some(covariance) = out.covariance.as_mut().filter(|_| means.len() > 1) {
            for (weight, mut off) in means {
                add(&mut off, -1.0, &out.mean);
                add_outer(covariance, weight, &off);
            }
        }
        out
    }
}

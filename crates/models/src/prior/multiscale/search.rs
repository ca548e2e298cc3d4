//! Search for the components of a part that explain an observation.
//!
//! Every level is ranked by a cheap distance, Σ w (y − mean)² with w = 1 / (variance within
//! clusters + noise), and only the nearest clusters are evaluated. Around the likely ones of the
//! finest level the nearest exemplars are evaluated. What is left out would weigh little; the last
//! that are kept fade out, so that the evidence has no jumps.
//!
//! Cost: about 20 clusters and up to 128 exemplars a part, O(d²) a cluster and O(d) an exemplar.

use super::candidates::{Candidate, Candidates, NEGLIGIBLE};
use super::conditioned::ConditionedPart;
use super::exemplars::ClusterExemplars;
use super::noisy_covariance::NoisyCovariance;
use super::part_mixture::PartMixture;
use super::scaled_precision::{ScaledPrecisions, StepForms};
use super::top_k::nearest;
use crate::numeric::small_linalg::LogSum;

/// At most this many components are kept.
const MAX_CANDIDATES: usize = 96;
/// At most this many clusters of a level are evaluated.
const CLUSTERS_PER_LEVEL: usize = 5;
/// Exemplars are evaluated of clusters at most this much (nats) below the best of the finest level.
const OPEN_MARGIN: f64 = 6.0;
/// Where most coordinates are observed, a level ends with the first cluster this much (nats) below
/// the best.
const CLUSTER_STOP_MARGIN: f64 = 10.0;
/// At most this many exemplars are evaluated.
const MAX_EXEMPLARS: usize = 128;
/// Exemplars evaluated between two looks at [`EXEMPLAR_STOP_MARGIN`].
const EXEMPLAR_BATCH: usize = 8;
/// Exemplars end with the first batch this much (nats) below the best component.
const EXEMPLAR_STOP_MARGIN: f64 = 9.0;

impl PartMixture {
    /// Evaluates the clusters for `y` (d; read where observed);
    /// [`ComponentSearch::evaluate_exemplars`] goes on.
    pub(crate) fn search<'a>(
        &'a self,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
    ) -> ComponentSearch<'a> {
        let exemplars = self.sub_mixtures_of(None).next().is_some();
        self.search_clusters(conditioned, y, exemplars)
    }

    /// The candidates among the clusters alone: good enough to place a pose.
    pub(crate) fn cluster_candidates(
        &self,
        conditioned: &ConditionedPart,
        y: &[f64],
    ) -> Candidates {
        self.search_clusters(conditioned, y, false).finish()
    }

    fn search_clusters<'a>(
        &'a self,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
        exemplars: bool,
    ) -> ComponentSearch<'a> {
        let mut search = ComponentSearch::new(self, conditioned, y);
        if conditioned.observes_any() {
            // The finest level first: what it explains much better makes the coarser ones short.
            for level in (0..self.levels.len()).rev() {
                let needed = exemplars && level + 1 == self.levels.len();
                if needed || self.sub_mixtures_of(Some(level)).next().is_some() {
                    search.evaluate_level(level);
                }
            }
        }
        search
    }
}

/// A search under way.
pub(crate) struct ComponentSearch<'a> {
    part: &'a PartMixture,
    conditioned: &'a ConditionedPart,
    y: &'a [f64],
    /// y in single precision, 0 where missing, padded.
    masked: Vec<f32>,
    found: Candidates,
    /// The log sum over the components of each sub-mixture.
    sums: Vec<LogSum>,
    /// The log that a component must reach to be kept.
    worst: f64,
    /// The best log evidence of a cluster.
    best_cluster: f64,
    /// The best log of a component, its weight included.
    best: f64,
}

/// A cluster of the finest level whose exemplars are evaluated.
#[derive(Clone, Copy)]
struct OpenCluster<'a> {
    /// Its index among the evaluated clusters.
    index: usize,
    noisy: &'a NoisyCovariance,
    exemplars: &'a ClusterExemplars,
    precisions: &'a ScaledPrecisions,
}

/// One of the nearest exemplars.
struct NearExemplar {
    /// Added to its log evidence, at most 0.
    fade: f64,
    /// Its cluster among the open ones.
    open: usize,
    exemplar: usize,
}

impl<'a> ComponentSearch<'a> {
    fn new(
        part: &'a PartMixture,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
    ) -> ComponentSearch<'a> {
        ComponentSearch {
            found: Candidates::default(),
            sums: vec![LogSum::default(); part.sub_mixtures.len()],
            worst: f64::NEG_INFINITY,
            best_cluster: f64::NEG_INFINITY,
            best: f64::NEG_INFINITY,
            part,
            conditioned,
            y,
            masked: conditioned.masked(y),
        }
    }

    /// Evaluates the nearest clusters of one level at all its scales.
    fn evaluate_level(&mut self, level: usize) {
        let (part, conditioned) = (self.part, self.conditioned);
        let clusters = &part.levels[level];
        let mut distances = clusters.distances(&self.masked, &conditioned.distance_weights[level]);
        let both = distances.iter_mut().zip(&clusters.log_proportions);
        both.for_each(|(distance, log)| *distance -= 2.0 * *log as f32);
        let (mut off, mut z) = (vec![0.0; self.y.len()], Vec::new());
        for (index, fade) in nearest(&distances, CLUSTERS_PER_LEVEL) {
            let cluster = conditioned.cluster(part, level, index);
            let residual = self.y.iter().zip(clusters.mean(index));
            let both = off.iter_mut().zip(residual);
            both.for_each(|(o, (y, m))| *o = (y - m) as f32);
            cluster.noisy.project(&off, &mut z);
            let logs = cluster.precisions.log_evidences(&z);
            let log_proportion = clusters.log_proportions[index] + fade;
            let best = logs.iter().fold(f64::NEG_INFINITY, |best, log| {
                best.max(log + log_proportion)
            });
            let evaluated = self.found.clusters.len();
            for (sub_mixture, scale) in part.sub_mixtures_of(Some(level)) {
                self.add(Candidate {
                    log: logs[cluster.precisions.at(scale.scale)] + log_proportion,
                    cluster: evaluated,
                    exemplar: None,
                    sub_mixture,
                });
                // A finest cluster may be evaluated for its exemplars' sake alone.
                self.best_cluster = self.best_cluster.max(best);
            }
            self.found.push_cluster(level, index, best, &z);
            // Further clusters are farther off; but where much is missing, being near says too
            // little.
            if conditioned.observes_most() && best < self.best_cluster - CLUSTER_STOP_MARGIN {
                break;
            }
        }
    }

    /// log p(y) by the components evaluated so far; 0 where nothing is observed.
    pub(crate) fn evidence(&self) -> f64 {
        if !self.conditioned.observes_any() {
            return 0.0;
        }
        let mut all = LogSum::default();
        for (sum, sub_mixture) in self.sums.iter().zip(&self.part.sub_mixtures) {
            all.add(sum.log() + sub_mixture.log_weight);
        }
        all.log()
    }

    /// Evaluates the nearest exemplars of the likely clusters.
    pub(crate) fn evaluate_exemplars(&mut self) {
        let part = self.part;
        if part.sub_mixtures_of(None).next().is_none() {
            return;
        }
        let open = self.likely_clusters();
        let near = self.near_exemplars(&open);
        let log_proportion = -(part.exemplars.len() as f64).ln();
        let mut residual = ExemplarResidual::default();
        let mut step_forms = StepForms::default();
        for batch in near.chunks(EXEMPLAR_BATCH) {
            let mut best = f64::NEG_INFINITY;
            for near in batch {
                let OpenCluster {
                    index,
                    noisy,
                    exemplars,
                    precisions,
                } = open[near.open];
                residual.set(noisy, exemplars, &self.masked, near.exemplar);
                precisions.step_forms(&residual.z, &residual.step, &mut step_forms);
                for (sub_mixture, s) in part.sub_mixtures_of(None) {
                    let at = precisions.at(s.scale);
                    let log =
                        precisions.log_evidence_along_step(at, step_forms.forms[at], s.step_scale);
                    best = best.max(self.add(Candidate {
                        log: log_proportion + near.fade + log,
                        cluster: index,
                        exemplar: Some(near.exemplar),
                        sub_mixture,
                    }));
                }
            }
            // Further exemplars are farther off.
            if best < self.best - EXEMPLAR_STOP_MARGIN {
                break;
            }
        }
    }

    /// The clusters of the finest level whose exemplars are evaluated.
    fn likely_clusters(&self) -> Vec<OpenCluster<'a>> {
        let (part, conditioned) = (self.part, self.conditioned);
        let finest = part.levels.len() - 1;
        let evaluated = self.found.clusters.iter().enumerate();
        let evaluated = || evaluated.clone().filter(|(_, c)| c.level == finest);
        let best = evaluated().fold(f64::NEG_INFINITY, |best, (_, c)| best.max(c.best));
        let likely = evaluated().filter(|(_, c)| c.best >= best - OPEN_MARGIN);
        let open = likely.map(|(index, cluster)| OpenCluster {
            index,
            noisy: &conditioned.cluster(part, finest, cluster.index).noisy,
            exemplars: part.exemplars_of(cluster.index),
            precisions: conditioned.exemplar_precisions(part, cluster.index),
        });
        open.collect()
    }

    /// The nearest exemplars of the open clusters, the nearest first.
    fn near_exemplars(&self, open: &[OpenCluster<'_>]) -> Vec<NearExemplar> {
        let weights = &self.conditioned.distance_weights[self.part.levels.len() - 1];
        let mut starts = vec![0];
        let mut distances = Vec::new();
        for cluster in open {
            distances.extend(cluster.exemplars.distances(&self.masked, weights));
            starts.push(distances.len());
        }
        let near = nearest(&distances, MAX_EXEMPLARS).into_iter();
        let near = near.map(|(index, fade)| {
            let open = starts.partition_point(|s| *s <= index) - 1;
            NearExemplar {
                fade,
                exemplar: index - starts[open],
                open,
            }
        });
        near.collect()
    }

    /// Counts a component whose log evidence is given, and keeps it if it is among the best;
    /// returns the log of its weight times its evidence.
    fn add(&mut self, candidate: Candidate) -> f64 {
        self.sums[candidate.sub_mixture].add(candidate.log);
        let log = candidate.log + self.part.sub_mixtures[candidate.sub_mixture].log_weight;
        self.best = self.best.max(log);
        if log > self.worst.max(self.best - NEGLIGIBLE) {
            self.found.best.push(Candidate { log, ..candidate });
            if self.found.best.len() == 4 * MAX_CANDIDATES {
                self.trim();
            }
        }
        log
    }

    /// Leaves the best [`MAX_CANDIDATES`], in no order.
    fn trim(&mut self) {
        let best = &mut self.found.best;
        if best.len() > MAX_CANDIDATES {
            best.select_nth_unstable_by(MAX_CANDIDATES - 1, |a, b| {
                b.log
                    .total_cmp(&a.log)
                    .then_with(|| a.indices().cmp(&b.indices()))
            });
            best.truncate(MAX_CANDIDATES);
            self.worst = best[MAX_CANDIDATES - 1].log;
        }
    }

    /// What was found.
    pub(crate) fn finish(mut self) -> Candidates {
        self.found.evidence = self.evidence();
        let any = self.conditioned.observes_any();
        let logs = self.sums.iter().map(|s| if any { s.log() } else { 0.0 });
        self.found.sub_mixture_evidences = logs.collect();
        self.trim();
        let logs = self.found.best.iter().map(|c| c.log);
        let top = logs.fold(f64::NEG_INFINITY, f64::max);
        self.found.best.retain(|c| c.log >= top - NEGLIGIBLE);
        self.found
    }
}

/// An observation less an exemplar's pose, and the exemplar's step, along the axes of a noisy
/// covariance.
#[derive(Default)]
pub(crate) struct ExemplarResidual {
    /// z of the residual.
    pub z: Vec<f32>,
    /// z of the step.
    pub step: Vec<f32>,
    off: Vec<f32>,
}

impl ExemplarResidual {
    /// For an exemplar of a cluster, whose noisy covariance is given, and the observation `y`
    /// (masked, padded).
    pub(crate) fn set(
        &mut self,
        noisy: &NoisyCovariance,
        exemplars: &ClusterExemplars,
        y: &[f32],
        exemplar: usize,
    ) {
        let residual = y.iter().zip(exemplars.pose(exemplar));
        self.off.clear();
        self.off.extend(residual.map(|(y, x)| y - x));
        noisy.project(&self.off, &mut self.z);
        noisy.project(exemplars.step(exemplar), &mut self.step);
    }
}

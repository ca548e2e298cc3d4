//! Search for the components of a part that explain an observation.
//!
//! Every level is ranked by a cheap distance, Σ w (y − mean)² with w = 1 / (variance within clusters + noise), and only the
//! nearest clusters are evaluated. Around the likely ones of the finest level the nearest exemplars are evaluated. What is
//! left out would weigh little; the last that are kept fade out, so that the evidence has no jumps.
//!
//! Cost: about 20 clusters and up to 128 exemplars a part, O(d²) a cluster and O(d) an exemplar.

use super::candidates::{Candidate, Candidates, NEGLIGIBLE};
use super::conditioned::{ConditionedCluster, ConditionedPart};
use super::exemplars::ClusterExemplars;
use super::part_mixture::{ActiveSubMixture, PartMixture};
use super::scaled_precision::{ScaledPrecisions, Scratch};
use super::top_k::TopK;
use crate::numeric::simd::{self, padded};
use crate::numeric::small_linalg::LogSum;

/// At most this many components are kept.
const MAX_CANDIDATES: usize = 96;
/// At most this many clusters of a level are evaluated.
const CLUSTERS_PER_LEVEL: usize = 5;
/// Room for the clusters that are usually evaluated.
const TYPICAL_CLUSTERS: usize = 20;
/// Exemplars are evaluated of clusters at most this much (nats) below the best of the finest level.
const OPEN_MARGIN: f64 = 6.0;
/// Where most coordinates are observed, a level ends with the first cluster this much (nats) below the best.
const CLUSTER_STOP_MARGIN: f64 = 10.0;
/// At most this many exemplars are evaluated.
const MAX_EXEMPLARS: usize = 128;
/// Exemplars evaluated between two looks at [`EXEMPLAR_STOP_MARGIN`].
const EXEMPLAR_BATCH: usize = 8;
/// Exemplars end with the first batch this much (nats) below the best component.
const EXEMPLAR_STOP_MARGIN: f64 = 9.0;

impl PartMixture {
    /// Evaluates the clusters for `y` (d; read where observed); [`ComponentSearch::evaluate_exemplars`] goes on.
    pub fn search<'a>(
        &'a self,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
        scratch: &mut SearchScratch,
    ) -> ComponentSearch<'a> {
        self.search_clusters(conditioned, y, !self.active_exemplars().is_empty(), scratch)
    }

    /// The candidates among the clusters alone: good enough to place a pose.
    pub fn cluster_candidates(&self, conditioned: &ConditionedPart, y: &[f64]) -> Candidates {
        let scratch = &mut SearchScratch::default();
        self.search_clusters(conditioned, y, false, scratch)
            .finish()
    }

    fn search_clusters<'a>(
        &'a self,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
        exemplars: bool,
        scratch: &mut SearchScratch,
    ) -> ComponentSearch<'a> {
        let mut search = ComponentSearch::new(self, conditioned, y);
        if conditioned.observes_any() {
            // The finest level first: what it explains much better makes the coarser ones short.
            for level in (0..self.levels.len()).rev() {
                let needed = exemplars && level + 1 == self.levels.len();
                if needed || !self.active(level).is_empty() {
                    search.evaluate_level(level, scratch);
                }
            }
        }
        search
    }
}

/// Buffers kept from one search to the next.
#[derive(Default)]
pub struct SearchScratch {
    nearest: TopK,
    distances: Vec<f32>,
    off: Vec<f32>,
    z: Vec<f32>,
    log_evidences: Vec<f64>,
    forms: Vec<[f64; 3]>,
    residual: ExemplarResidual,
    products: Scratch,
}

/// A search under way.
pub struct ComponentSearch<'a> {
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
    /// Its place among the evaluated clusters.
    place: usize,
    conditioned: &'a ConditionedCluster,
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
        let stride = padded(part.coordinates.len());
        ComponentSearch {
            found: Candidates::with_capacity(MAX_CANDIDATES, TYPICAL_CLUSTERS, stride),
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
    fn evaluate_level(&mut self, level: usize, scratch: &mut SearchScratch) {
        let (part, conditioned) = (self.part, self.conditioned);
        let clusters = &part.levels[level];
        let active = part.active(level);
        scratch.off.clear();
        scratch.off.resize(self.masked.len(), 0.0);
        let weights = &conditioned.distance_weights[level];
        clusters.distances(&self.masked, weights, &mut scratch.distances);
        scratch.nearest.clear();
        for (distance, log) in scratch.distances.iter().zip(&clusters.log_proportions) {
            scratch.nearest.push(distance - 2.0 * *log as f32);
        }
        for (index, fade) in scratch.nearest.nearest(CLUSTERS_PER_LEVEL) {
            let cluster = conditioned.cluster(part, level, index);
            let residual = self.y.iter().zip(clusters.mean(index));
            let off = scratch.off.iter_mut().zip(residual);
            off.for_each(|(o, (y, m))| *o = (y - m) as f32);
            cluster.noisy.project(&scratch.off, &mut scratch.z);
            let logs = &mut scratch.log_evidences;
            (cluster.precisions).log_evidences(&scratch.z, &mut scratch.products, logs);
            let log_proportion = clusters.log_proportions[index] + fade;
            let best = logs.iter().fold(f64::NEG_INFINITY, |best, log| {
                best.max(log + log_proportion)
            });
            let place = self.found.clusters.len();
            for sub_mixture in active {
                let at = sub_mixture.scale_index;
                let log = scratch.log_evidences[at] + log_proportion;
                self.add(
                    sub_mixture,
                    Candidate {
                        log,
                        cluster: place,
                        exemplar: None,
                        at,
                    },
                );
            }
            self.found.push_cluster(level, index, best, &scratch.z);
            // A finest cluster may be evaluated for its exemplars' sake alone.
            if !active.is_empty() {
                self.best_cluster = self.best_cluster.max(best);
            }
            // Further clusters are farther off; but where much is missing, being near says too little.
            if conditioned.observes_most() && best < self.best_cluster - CLUSTER_STOP_MARGIN {
                break;
            }
        }
    }

    /// log p(y) by the components evaluated so far; 0 where nothing is observed.
    pub fn evidence(&self) -> f64 {
        if !self.conditioned.observes_any() {
            return 0.0;
        }
        let mut all = LogSum::default();
        for (sum, weight) in self.sums.iter().zip(&self.part.log_weights) {
            all.add(sum.log() + weight);
        }
        all.log()
    }

    /// Evaluates the nearest exemplars of the likely clusters.
    pub fn evaluate_exemplars(&mut self, scratch: &mut SearchScratch) {
        let part = self.part;
        let active = part.active_exemplars();
        if active.is_empty() {
            return;
        }
        let open = self.likely_clusters();
        let near = self.near_exemplars(&open, scratch);
        let log_proportion = -(part.exemplars.len() as f64).ln();
        for batch in near.chunks(EXEMPLAR_BATCH) {
            let mut best = f64::NEG_INFINITY;
            for near in batch {
                let OpenCluster {
                    place,
                    conditioned,
                    exemplars,
                    precisions,
                } = open[near.open];
                let residual = &mut scratch.residual;
                let z = self.found.z(place, conditioned);
                residual.set_exemplar(conditioned, z, exemplars, &self.masked, near.exemplar);
                let forms = &mut scratch.forms;
                precisions.step_forms(&residual.z, &residual.step, &mut scratch.products, forms);
                for (at, sub_mixture) in active.iter().enumerate() {
                    let scale = sub_mixture.scale_index;
                    let log = precisions.log_evidence_along_step(
                        scale,
                        scratch.forms[scale],
                        sub_mixture.step_scale,
                    );
                    let candidate = Candidate {
                        log: log_proportion + near.fade + log,
                        cluster: place,
                        exemplar: Some(near.exemplar),
                        at,
                    };
                    best = best.max(self.add(sub_mixture, candidate));
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
        let open = likely.map(|(place, cluster)| OpenCluster {
            place,
            conditioned: conditioned.cluster(part, finest, cluster.index),
            exemplars: part.exemplars_of(cluster.index),
            precisions: conditioned.exemplar_precisions(part, cluster.index),
        });
        open.collect()
    }

    /// The nearest exemplars of the open clusters, the nearest first.
    fn near_exemplars(
        &self,
        open: &[OpenCluster<'_>],
        scratch: &mut SearchScratch,
    ) -> Vec<NearExemplar> {
        let weights = &self.conditioned.distance_weights[self.part.levels.len() - 1];
        let mut starts = vec![0];
        scratch.nearest.clear();
        for cluster in open {
            (cluster.exemplars).distances(&self.masked, weights, &mut scratch.distances);
            scratch
                .distances
                .iter()
                .for_each(|d| scratch.nearest.push(*d));
            starts.push(scratch.nearest.len());
        }
        let near = scratch.nearest.nearest(MAX_EXEMPLARS).map(|(place, fade)| {
            let open = starts.partition_point(|s| *s <= place) - 1;
            NearExemplar {
                fade,
                exemplar: place - starts[open],
                open,
            }
        });
        near.collect()
    }

    /// Counts a component whose log evidence is given, and keeps it if it is among the best; returns the log of its weight
    /// times its evidence.
    fn add(&mut self, sub_mixture: &ActiveSubMixture, candidate: Candidate) -> f64 {
        self.sums[sub_mixture.index].add(candidate.log);
        let log = candidate.log + self.part.log_weights[sub_mixture.index];
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
            let place = |c: &Candidate| (c.cluster, c.exemplar, c.at);
            best.select_nth_unstable_by(MAX_CANDIDATES - 1, |a, b| {
                b.log
                    .total_cmp(&a.log)
                    .then_with(|| place(a).cmp(&place(b)))
            });
            best.truncate(MAX_CANDIDATES);
            self.worst = best[MAX_CANDIDATES - 1].log;
        }
    }

    /// What was found.
    pub fn finish(mut self) -> Candidates {
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

/// An observation less an exemplar's pose, and the exemplar's step, along the axes of a noisy covariance.
#[derive(Default)]
pub struct ExemplarResidual {
    /// z of the residual.
    pub z: Vec<f32>,
    /// z of the step.
    pub step: Vec<f32>,
    off: Vec<f32>,
}

impl ExemplarResidual {
    /// For an exemplar of a cluster; `cluster_z` is z of the observation less the cluster's mean, `y` (masked, padded) the
    /// observation.
    pub fn set_exemplar(
        &mut self,
        cluster: &ConditionedCluster,
        cluster_z: &[f32],
        exemplars: &ClusterExemplars,
        y: &[f32],
        exemplar: usize,
    ) {
        if cluster.noisy.uses_eigenvectors() {
            // A missing coordinate counts as the cluster's mean here: with infinite noise its value does not matter.
            self.z.clear();
            let shifted = cluster_z.iter().zip(exemplars.eigen_pose(exemplar));
            self.z.extend(shifted.map(|(z, e)| z - e));
            self.step.clear();
            let step = &exemplars.eigen_step(exemplar)[..cluster_z.len()];
            self.step.extend_from_slice(step);
            if let Some(last) = cluster.noisy.shared_axis() {
                let squared_length = simd::distance(y, exemplars.pose(exemplar));
                cluster
                    .noisy
                    .complete_shared_axis(squared_length, &mut self.z);
                self.step[last..].fill(0.0);
            }
        } else {
            self.off.clear();
            let residual = y.iter().zip(exemplars.pose(exemplar));
            self.off.extend(residual.map(|(y, x)| y - x));
            cluster.noisy.project(&self.off, &mut self.z);
            cluster
                .noisy
                .project(exemplars.step(exemplar), &mut self.step);
        }
    }
}

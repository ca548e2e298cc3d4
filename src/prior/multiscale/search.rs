//! Which blocks explain an observation.

use super::candidates::{Candidate, Candidates, NEGLIGIBLE, ScoredCluster};
use super::exemplars::ClusterExemplars;
use super::part_mixture::{ActiveSubMixture, ConditionedCluster, ConditionedPart, PartMixture};
use super::scaled_precision::{ScaledPrecisions, Scratch};
use super::top_k::TopK;
use crate::numeric::simd::padded;
use crate::numeric::small_linalg::LogSum;

/// So many blocks answer.
const MAX_CANDIDATES: usize = 96;
/// So many cells of a level are looked at.
const CLUSTERS_PER_LEVEL: usize = 5;
/// So many cells are usually looked at in all.
const TYPICAL_CLUSTERS: usize = 20;
/// The leaves of cells this much less likely (nats) than the best are not looked at.
const OPEN_MARGIN: f64 = 6.0;
/// Where most is seen no further cell is looked at after the first that is this much less likely (nats) than the best.
const CLUSTER_STOP_MARGIN: f64 = 10.0;
/// So many of the nearest leaves are weighed at most.
const MAX_EXEMPLARS: usize = 128;
/// So many of them at a time; where all of these are this much less likely (nats) than the best block, no further ones are.
const EXEMPLAR_BATCH: usize = 8;
const EXEMPLAR_STOP_MARGIN: f64 = 9.0;

impl PartMixture {
    /// How well the cells explain `y` (d; read where observed): the leaves of some are to be looked at.
    pub fn search<'a>(
        &'a self,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
        scratch: &mut SearchScratch,
    ) -> ComponentSearch<'a> {
        let exemplars = !self.exemplar_sub_mixtures().is_empty();
        self.search_by(conditioned, y, exemplars, scratch)
    }

    /// How well the cells alone do: good enough to place a pose.
    pub fn candidates_among_clusters(
        &self,
        conditioned: &ConditionedPart,
        y: &[f64],
    ) -> Candidates {
        self.search_by(conditioned, y, false, &mut SearchScratch::default())
            .end()
    }

    fn search_by<'a>(
        &'a self,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
        exemplars: bool,
        scratch: &mut SearchScratch,
    ) -> ComponentSearch<'a> {
        let mut search = ComponentSearch::new(self, conditioned, y);
        if !conditioned.observes_any() {
            // Nothing observed: the prior itself, by its coarsest cell.
            return search;
        }
        // The finest first: what they explain much better needs no other.
        for index in (0..self.cluster_levels.len()).rev() {
            let finest = exemplars && index + 1 == self.cluster_levels.len();
            if finest || !self.active(index).is_empty() {
                search.score_clusters(index, scratch);
            }
        }
        search
    }
}

/// What searches work with, kept from one to the next.
#[derive(Default)]
pub struct SearchScratch {
    near: TopK,
    distances: Vec<f32>,
    off: Vec<f32>,
    z: Vec<f32>,
    each: Vec<f64>,
    state: ExemplarResidual,
    scratch: Scratch,
}

/// The best blocks so far.
pub struct ComponentSearch<'a> {
    part: &'a PartMixture,
    conditioned: &'a ConditionedPart,
    y: &'a [f64],
    single: Vec<f32>,
    candidates: Candidates,
    /// Of the blocks of each level.
    sums: Vec<LogSum>,
    /// The log that a block must reach.
    worst: f64,
    /// The best log of a cell.
    top: f64,
    /// The best log of a block, its level's weight included.
    best: f64,
}

/// A finest cell whose leaves are looked at.
#[derive(Clone, Copy)]
struct OpenedCluster<'a> {
    scored: usize,
    cluster_conditioned: &'a ConditionedCluster,
    opened: &'a ClusterExemplars,
    scales: &'a ScaledPrecisions,
}

/// One of the nearest leaves.
struct NearExemplar {
    /// What its log is to be added.
    fade: f64,
    /// Which of the likely cells.
    of: usize,
    exemplar: usize,
}

impl<'a> ComponentSearch<'a> {
    fn new(
        part: &'a PartMixture,
        conditioned: &'a ConditionedPart,
        y: &'a [f64],
    ) -> ComponentSearch<'a> {
        ComponentSearch {
            candidates: Candidates {
                best: Vec::with_capacity(MAX_CANDIDATES),
                scored: Vec::with_capacity(TYPICAL_CLUSTERS),
                zs: Vec::with_capacity(TYPICAL_CLUSTERS * padded(part.coordinates.len())),
                ..Candidates::default()
            },
            sums: vec![LogSum::default(); part.levels.len()],
            worst: f64::NEG_INFINITY,
            top: f64::NEG_INFINITY,
            best: f64::NEG_INFINITY,
            part,
            conditioned,
            y,
            single: conditioned.single(y),
        }
    }

    /// Evaluates the nearest cells of one level at all its scales.
    fn score_clusters(&mut self, index: usize, scratch: &mut SearchScratch) {
        let (part, conditioned) = (self.part, self.conditioned);
        let clusters = &part.cluster_levels[index];
        let levels = part.active(index);
        scratch.off.clear();
        scratch.off.resize(self.single.len(), 0.0);
        clusters.distances(
            &self.single,
            &conditioned.distance_weights[index],
            &mut scratch.distances,
        );
        scratch.near.clear();
        for (distances, log) in scratch.distances.iter().zip(&clusters.log_proportions) {
            scratch.near.push(distances - 2.0 * *log as f32);
        }
        for (cluster, fade) in scratch.near.quantize(CLUSTERS_PER_LEVEL) {
            let cluster_conditioned = conditioned.cluster_conditioned(part, index, cluster);
            let means = self.y.iter().zip(clusters.mean(cluster));
            let rest = scratch.off.iter_mut().zip(means);
            rest.for_each(|(o, (y, m))| *o = (y - m) as f32);
            cluster_conditioned
                .noisy
                .project(&scratch.off, &mut scratch.z);
            (cluster_conditioned.scales).log_evidences(
                &scratch.z,
                &mut scratch.scratch,
                &mut scratch.each,
            );
            let share = clusters.log_proportions[cluster] + fade;
            let scored = self.candidates.scored.len();
            let mut most = f64::NEG_INFINITY;
            for log in &scratch.each {
                most = most.max(log + share);
            }
            for level in levels {
                self.add(
                    level,
                    Candidate {
                        log: scratch.each[level.at] + share,
                        scored,
                        exemplar: None,
                        at: level.at,
                    },
                );
            }
            self.candidates.scored.push(ScoredCluster {
                index,
                cluster,
                most,
                start: self.candidates.zs.len(),
            });
            self.candidates.zs.extend_from_slice(&scratch.z);
            // A finest cell may be looked at for its leaves' sake alone.
            if !levels.is_empty() {
                self.top = self.top.max(most);
            }
            // Further ones are farther off; but where much is missing, being near says too little.
            if conditioned.observes_most() && most < self.top - CLUSTER_STOP_MARGIN {
                break;
            }
        }
    }

    /// log Σ over the levels and blocks that were looked at.
    pub fn evidence(&self) -> f64 {
        if !self.conditioned.observes_any() {
            return 0.0;
        }
        let mut all = LogSum::default();
        for (level, weight) in self.sums.iter().zip(&self.part.log_weights) {
            all.add(level.log() + weight);
        }
        all.log()
    }

    /// Evaluates the nearest leaves of the cells that may hold the pose.
    pub fn open(&mut self, scratch: &mut SearchScratch) {
        let part = self.part;
        let levels = part.exemplar_sub_mixtures();
        if levels.is_empty() {
            return;
        }
        let clusters = self.likely();
        let near = self.near(&clusters, scratch);
        let share = -(part.exemplars.len() as f64).ln();
        for some in near.chunks(EXEMPLAR_BATCH) {
            let mut best = f64::NEG_INFINITY;
            for &NearExemplar { fade, of, exemplar } in some {
                let OpenedCluster {
                    scored,
                    cluster_conditioned,
                    opened,
                    scales,
                } = clusters[of];
                let (state, each) = (&mut scratch.state, &mut scratch.each);
                state.set_exemplar(
                    cluster_conditioned,
                    self.candidates.z(scored, cluster_conditioned),
                    opened,
                    &self.single,
                    exemplar,
                );
                scales.exemplar_log_evidences(
                    (&state.z, &state.step),
                    levels,
                    &mut scratch.scratch,
                    each,
                );
                for (at, (level, log)) in levels.iter().zip(each).enumerate() {
                    let candidate = Candidate {
                        log: share + fade + *log,
                        scored,
                        exemplar: Some(exemplar),
                        at,
                    };
                    best = best.max(self.add(level, candidate));
                }
            }
            // Further ones are farther off.
            if best < self.best - EXEMPLAR_STOP_MARGIN {
                break;
            }
        }
    }

    /// The cells whose leaves are looked at.
    fn likely(&self) -> Vec<OpenedCluster<'a>> {
        let (part, conditioned) = (self.part, self.conditioned);
        let finest = part.cluster_levels.len() - 1;
        let scored = self.candidates.scored.iter().enumerate();
        let scored: Vec<(f64, usize)> = scored
            .filter(|(_, s)| s.index == finest)
            .map(|(i, s)| (s.most, i))
            .collect();
        let most = scored.iter().fold(f64::NEG_INFINITY, |a, s| a.max(s.0));
        let likely = scored.into_iter().filter(|s| s.0 >= most - OPEN_MARGIN);
        let of = |(_, scored): (f64, usize)| {
            let cluster = self.candidates.scored[scored].cluster;
            OpenedCluster {
                scored,
                cluster_conditioned: conditioned.cluster_conditioned(part, finest, cluster),
                opened: part.opened(cluster),
                scales: conditioned.exemplars(part, cluster),
            }
        };
        likely.map(of).collect()
    }

    /// The nearest leaves of some cells, the nearest first.
    fn near(
        &self,
        clusters: &[OpenedCluster<'_>],
        scratch: &mut SearchScratch,
    ) -> Vec<NearExemplar> {
        let distance_weights =
            &self.conditioned.distance_weights[self.part.cluster_levels.len() - 1];
        let mut starts = vec![0];
        scratch.near.clear();
        for cluster in clusters {
            cluster
                .opened
                .distances(&self.single, distance_weights, &mut scratch.distances);
            scratch
                .distances
                .iter()
                .for_each(|distances| scratch.near.push(*distances));
            starts.push(scratch.near.len());
        }
        let of = |(place, fade): (usize, f64)| {
            let of = starts.partition_point(|s| *s <= place) - 1;
            NearExemplar {
                fade,
                exemplar: place - starts[of],
                of,
            }
        };
        scratch.near.quantize(MAX_EXEMPLARS).map(of).collect()
    }

    /// Counts a block of a level, whose log evidence is told, and keeps it if it is among the best; gives the log of its
    /// weight times its evidence.
    fn add(&mut self, level: &ActiveSubMixture, candidate: Candidate) -> f64 {
        self.sums[level.level].add(candidate.log);
        let log = candidate.log + self.part.log_weights[level.level];
        self.best = self.best.max(log);
        if log > self.worst.max(self.best - NEGLIGIBLE) {
            self.candidates.best.push(Candidate { log, ..candidate });
            if self.candidates.best.len() == 4 * MAX_CANDIDATES {
                self.trim();
            }
        }
        log
    }

    /// Leaves the best few, in no order.
    fn trim(&mut self) {
        let best = &mut self.candidates.best;
        if best.len() > MAX_CANDIDATES {
            let place = |h: &Candidate| (h.scored, h.exemplar, h.at);
            let order = |a: &Candidate, b: &Candidate| {
                let log_evidences = b.log.total_cmp(&a.log);
                log_evidences.then_with(|| place(a).cmp(&place(b)))
            };
            best.select_nth_unstable_by(MAX_CANDIDATES - 1, order);
            best.truncate(MAX_CANDIDATES);
            self.worst = best[MAX_CANDIDATES - 1].log;
        }
    }

    /// What was found.
    pub fn end(mut self) -> Candidates {
        self.candidates.evidence = self.evidence();
        let observes_any = self.conditioned.observes_any();
        let levels = self
            .sums
            .iter()
            .map(|s| if observes_any { s.log() } else { 0.0 });
        self.candidates.levels = levels.collect();
        self.trim();
        let log_evidences = self.candidates.best.iter().map(|h| h.log);
        let top = log_evidences.fold(f64::NEG_INFINITY, f64::max);
        self.candidates.best.retain(|h| h.log >= top - NEGLIGIBLE);
        self.candidates
    }
}

/// What is left of an observation beside a leaf, in the directions of a lens.
#[derive(Default)]
pub struct ExemplarResidual {
    /// Of the observation less the leaf's pose.
    pub z: Vec<f32>,
    /// Of the leaf's step.
    pub step: Vec<f32>,
    off: Vec<f32>,
}

impl ExemplarResidual {
    /// Of one of a finest cell's leaves; `of_cell` is what is left beside the cell's mean, `y` (padded) the observation.
    pub fn set_exemplar(
        &mut self,
        cluster_conditioned: &ConditionedCluster,
        of_cell: &[f32],
        opened: &ClusterExemplars,
        y: &[f32],
        exemplar: usize,
    ) {
        let (noisy, pose) = (&cluster_conditioned.noisy, opened.pose(exemplar));
        if noisy.uses_eigenvectors() {
            // A coordinate that is missing counts as the cell's mean here: what stands there makes no difference.
            noisy.shift(of_cell, opened.code(exemplar), y, pose, &mut self.z);
            noisy.step_coordinates(opened.step_coordinates(exemplar), &mut self.step);
        } else {
            self.off.clear();
            self.off.extend(y.iter().zip(pose).map(|(y, x)| y - x));
            noisy.project(&self.off, &mut self.z);
            noisy.project(opened.step(exemplar), &mut self.step);
        }
    }
}

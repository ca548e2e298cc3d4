//! The posterior of a part, given the components that explain an observation.
//!
//! With the responsibilities ρ of the candidates and each one's posterior mean μ and covariance Σ:
//!
//! ```text
//! mean        μ̄ = Σ ρ μ
//! covariance    = Σ ρ Σ  +  Σ ρ (μ − μ̄)(μ − μ̄)ᵀ
//! ```
//!
//! The covariance is summed over the heavy clusters and candidates only, whose weights are
//! normalized again: the light ones cost as much each and change little.
//!
//! An exemplar x with step v has the covariance a C + b v vᵀ. With S = (a C_oo + R)⁻¹ the distance
//! t along the step has the posterior variance b / (1 + b vᵀ S v) and mean t = variance · vᵀ S (y −
//! x); the rest follows for the residual y − x − t v.

use super::candidates::{Candidate, Candidates};
use super::conditioned::{ConditionedCluster, ConditionedPart};
use super::noisy_covariance::WeightedScale;
use super::part_mixture::PartMixture;
use super::scaled_precision::ScaledPrecisions;
use super::search::ExemplarResidual;
use crate::numeric::simd;
use crate::numeric::small_linalg::add;
use ndarray::Array2;
use std::ops::Range;

/// Candidates below this responsibility do not count in the spread of the means.
const MIN_RESPONSIBILITY: f64 = 0.06;
/// Clusters whose candidates have less responsibility together do not count in the mean of the
/// covariances.
const MIN_CLUSTER_RESPONSIBILITY: f64 = 0.2;

/// A mean (d), cm, and a covariance (d, d), cm², where it is wanted.
#[derive(Debug, Clone)]
pub(crate) struct Moments {
    /// The mean.
    pub mean: Vec<f64>,
    /// The covariance.
    pub covariance: Option<Array2<f64>>,
}

impl Moments {
    /// Zeros, or whatever `value` is.
    pub(crate) fn new(d: usize, with_covariance: bool, value: f64) -> Moments {
        Moments {
            mean: vec![value; d],
            covariance: with_covariance.then(|| Array2::from_elem((d, d), value)),
        }
    }
}

/// One candidate's posterior mean: `base` plus the gain of `product`.
struct MeanTerm {
    /// (d), cm.
    base: Vec<f64>,
    /// a S r along the axes of the cluster's noisy covariance.
    product: Vec<f32>,
    /// For an exemplar with a step: the posterior variance along it, and a S v.
    step: Option<(f64, Vec<f32>)>,
}

impl MeanTerm {
    fn zero(d: usize, cluster: &ConditionedCluster) -> MeanTerm {
        MeanTerm {
            base: vec![0.0; d],
            product: vec![0.0; cluster.noisy.stride()],
            step: None,
        }
    }
}

/// The sums over the candidates for one observation.
struct PosteriorSum<'a> {
    part: &'a PartMixture,
    conditioned: &'a ConditionedPart,
    /// The observation, masked and padded.
    y: Vec<f32>,
    candidates: &'a Candidates,
    /// In the order of [`Candidates::best`].
    responsibilities: Vec<f64>,
    /// The candidates, cluster by cluster and exemplar by exemplar.
    order: Vec<usize>,
    /// The residual of the last exemplar, and which that is (cluster, exemplar).
    residual: ExemplarResidual,
    last_exemplar: Option<(usize, usize)>,
}

impl PartMixture {
    /// The posterior of the part, given `y` (d; read where observed) and the candidates for it.
    pub(crate) fn posterior(
        &self,
        conditioned: &ConditionedPart,
        y: &[f64],
        candidates: &Candidates,
        with_covariance: bool,
    ) -> Moments {
        if !conditioned.observes_any() {
            // The prior, as the single coarsest cluster knows it.
            let covariance = self.levels[0].covariance(0, &self.coordinates);
            return Moments {
                mean: self.levels[0].mean(0).to_vec(),
                covariance: with_covariance.then(|| covariance.covariance()),
            };
        }
        let mut out = Moments::new(self.coordinates.len(), with_covariance, 0.0);
        let mut sum = PosteriorSum {
            y: conditioned.masked(y),
            responsibilities: candidates.responsibilities(),
            order: candidates.by_cluster(),
            residual: ExemplarResidual::default(),
            last_exemplar: None,
            part: self,
            conditioned,
            candidates,
        };
        sum.add_means(&mut out.mean);
        if let Some(covariance) = &mut out.covariance {
            sum.add_covariances(covariance);
            sum.add_spread_of_means(&out.mean, covariance);
        }
        out
    }
}

impl<'a> PosteriorSum<'a> {
    fn conditioned(&self, cluster: usize) -> &'a ConditionedCluster {
        let cluster = self.candidates.clusters[cluster];
        (self.conditioned).cluster(self.part, cluster.level, cluster.index)
    }

    /// The precisions of a candidate's cluster or exemplar, and the index of its scale.
    fn precisions(&self, candidate: &Candidate) -> (&'a ScaledPrecisions, usize) {
        let conditioned = self.conditioned(candidate.cluster);
        let precisions = match candidate.exemplar {
            None => &conditioned.precisions,
            Some(_) => {
                let index = self.candidates.clusters[candidate.cluster].index;
                self.conditioned.exemplar_precisions(self.part, index)
            }
        };
        let scale = self.part.sub_mixtures[candidate.sub_mixture].scale;
        (precisions, precisions.at(scale))
    }

    /// Each cluster of the candidates, with the range of its candidates in the order.
    fn clusters(&self) -> Vec<(usize, Range<usize>)> {
        let best = &self.candidates.best;
        let same = |a: &usize, b: &usize| best[*a].cluster == best[*b].cluster;
        let (mut start, mut clusters) = (0, Vec::with_capacity(self.candidates.clusters.len()));
        for candidates in self.order.chunk_by(same) {
            clusters.push((best[candidates[0]].cluster, start..start + candidates.len()));
            start += candidates.len();
        }
        clusters
    }

    /// Adds `weight` times a candidate's posterior mean to `term`; keeps its step where that is
    /// wanted.
    fn add(&mut self, candidate: usize, weight: f64, term: &mut MeanTerm, with_step: bool) {
        let candidate = self.candidates.best[candidate];
        let conditioned = self.conditioned(candidate.cluster);
        let cluster = self.candidates.clusters[candidate.cluster];
        let (precisions, at) = self.precisions(&candidate);
        let scale = precisions.scales[at];
        let Some(exemplar) = candidate.exemplar else {
            let mean = self.part.levels[cluster.level].mean(cluster.index);
            add(&mut term.base, weight, mean);
            let z = self.candidates.z(candidate.cluster, conditioned);
            precisions.add_product(at, z, weight * scale, &mut term.product);
            return;
        };
        let exemplars = self.part.exemplars_of(cluster.index);
        let index = Some((candidate.cluster, exemplar));
        if self.last_exemplar != index {
            self.last_exemplar = index;
            self.residual
                .set(&conditioned.noisy, exemplars, &self.y, exemplar);
        }
        let residual = &self.residual;
        add_single(&mut term.base, weight, exemplars.pose(exemplar));
        precisions.add_product(at, &residual.z, weight * scale, &mut term.product);
        let step_scale = self.part.sub_mixtures[candidate.sub_mixture].step_scale;
        if step_scale > 0.0 {
            let mut product = vec![0.0; residual.step.len()];
            precisions.add_product(at, &residual.step, scale, &mut product);
            let form = |z: &[f32]| f64::from(simd::dot(&product, z)) / scale;
            let variance = step_scale / (1.0 + step_scale * form(&residual.step));
            let distance = weight * variance * form(&residual.z);
            add_single(&mut term.base, distance, exemplars.step(exemplar));
            let both = term.product.iter_mut().zip(&product);
            both.for_each(|(p, s)| *p -= distance as f32 * s);
            term.step = with_step.then_some((variance, product));
        }
    }

    /// μ̄. The gain is linear and the cluster's: it is applied once to the sum over a cluster's
    /// candidates.
    fn add_means(&mut self, mean: &mut [f64]) {
        for (cluster, candidates) in self.clusters() {
            let conditioned = self.conditioned(cluster);
            let mut term = MeanTerm::zero(mean.len(), conditioned);
            for at in candidates {
                let candidate = self.order[at];
                self.add(
                    candidate,
                    self.responsibilities[candidate],
                    &mut term,
                    false,
                );
            }
            add(mean, 1.0, &term.base);
            conditioned.noisy.add_gain(&term.product, mean);
        }
    }

    /// Σ ρ Σ, over the heavy clusters, without the variance along steps.
    fn add_covariances(&self, covariance: &mut Array2<f64>) {
        let clusters = self.clusters();
        let weight = |range: &Range<usize>| {
            let candidates = self.order[range.clone()].iter();
            candidates.map(|c| self.responsibilities[*c]).sum::<f64>()
        };
        let most = clusters.iter().map(|c| weight(&c.1)).fold(0.0, f64::max);
        let least = MIN_CLUSTER_RESPONSIBILITY.min(most);
        let heavy = || clusters.iter().filter(|c| weight(&c.1) >= least);
        let total: f64 = heavy().map(|c| weight(&c.1)).sum();
        for (cluster, candidates) in heavy() {
            let conditioned = self.conditioned(*cluster);
            let mut weights: Vec<WeightedScale<'_>> = Vec::new();
            for &candidate in &self.order[candidates.clone()] {
                let responsibility = self.responsibilities[candidate] / total;
                let (precisions, at) = self.precisions(&self.candidates.best[candidate]);
                let same = |w: &&mut WeightedScale<'_>| std::ptr::eq(w.0, precisions) && w.1 == at;
                match weights.iter_mut().find(same) {
                    Some(weight) => weight.2 += responsibility,
                    None => weights.push((precisions, at, responsibility)),
                }
            }
            conditioned
                .noisy
                .add_posterior_covariance(&weights, covariance);
        }
    }

    /// Σ ρ (μ − μ̄)(μ − μ̄)ᵀ, over the heavy candidates, and the variance along their steps.
    fn add_spread_of_means(&mut self, mean: &[f64], covariance: &mut Array2<f64>) {
        let most = self.responsibilities.iter().copied().fold(0.0, f64::max);
        let least = MIN_RESPONSIBILITY.min(most);
        let order = self.order.iter().copied();
        let heavy: Vec<usize> = order
            .filter(|c| self.responsibilities[*c] >= least)
            .collect();
        let total: f64 = heavy.iter().map(|c| self.responsibilities[*c]).sum();
        for candidate in heavy {
            let share = self.responsibilities[candidate] / total;
            let Candidate {
                cluster, exemplar, ..
            } = self.candidates.best[candidate];
            let noisy = &self.conditioned(cluster).noisy;
            let mut term = MeanTerm::zero(mean.len(), self.conditioned(cluster));
            self.add(candidate, 1.0, &mut term, true);
            let mut off = term.base;
            noisy.add_gain(&term.product, &mut off);
            add(&mut off, -1.0, mean);
            add_outer(covariance, share, &off);
            if let (Some((variance, product)), Some(exemplar)) = (term.step, exemplar) {
                // The step, less what the covariance with the observation takes back of it.
                let exemplars = self
                    .part
                    .exemplars_of(self.candidates.clusters[cluster].index);
                let mut along = vec![0.0; off.len()];
                noisy.add_gain(&product, &mut along);
                along.iter_mut().for_each(|l| *l = -*l);
                add_single(&mut along, 1.0, exemplars.step(exemplar));
                add_outer(covariance, share * variance, &along);
            }
        }
    }
}

/// `to` += `scale` `from`.
fn add_single(to: &mut [f64], scale: f64, from: &[f32]) {
    let both = to.iter_mut().zip(from);
    both.for_each(|(t, f)| *t += scale * f64::from(*f));
}

/// `to` += `weight` x xᵀ.
pub(crate) fn add_outer(to: &mut Array2<f64>, weight: f64, x: &[f64]) {
    debug_assert!(to.is_standard_layout());
    let Some(to) = to.as_slice_mut() else { return };
    simd::dispatch8(
        #[inline(always)]
        || {
            for (row, a) in to.chunks_exact_mut(x.len().max(1)).zip(x) {
                add(row, weight * a, x);
            }
        },
    );
}

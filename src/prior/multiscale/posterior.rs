//! What the blocks that explain an observation answer together.

use super::candidates::Candidates;
use super::part_mixture::{
    ActiveSubMixture, ConditionedCluster, ConditionedPart, PartMixture, add_outer,
};
use super::scaled_precision::{ScaledPrecisions, Scratch, WeightedScale};
use super::search::ExemplarResidual;
use crate::numeric::simd;
use crate::numeric::small_linalg::add;
use ndarray::Array2;
use std::ops::Range;

/// Blocks that weigh less than this share do not tell how far the answers are apart.
const LEAST_SHARE: f64 = 0.06;
/// Cells whose blocks weigh less than this share together do not tell what is left open.
const LEAST_CELL: f64 = 0.2;

/// How sure the answer is to be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// Not at all.
    Mean,
    /// The variance of each coordinate.
    Variances,
    /// All of the covariance.
    Covariance,
}

/// A mean (d), and how sure it is.
#[derive(Debug, Clone)]
pub struct PartialPosterior {
    /// d numbers, cm.
    pub mean: Vec<f64>,
    /// (d, d) where the covariance is told, (1, d) where variances are, empty else, cm².
    pub spread: Array2<f64>,
}

impl PartialPosterior {
    /// Of d numbers, nothing added yet.
    pub fn new(d: usize, detail: Detail) -> PartialPosterior {
        let rows = match detail {
            Detail::Mean => 0,
            Detail::Variances => 1,
            Detail::Covariance => d,
        };
        PartialPosterior {
            mean: vec![0.0; d],
            spread: Array2::zeros((rows, if rows == 0 { 0 } else { d })),
        }
    }

    /// Where nothing can be told: no numbers.
    pub fn unknown(d: usize, detail: Detail) -> PartialPosterior {
        let mut out = PartialPosterior::new(d, detail);
        out.mean.fill(f64::NAN);
        out.spread.fill(f64::NAN);
        out
    }

    /// Adds `weight` times what a part's answer leaves open; its coordinates are among those here.
    pub fn add_spread(
        &mut self,
        weight: f64,
        part: &PartialPosterior,
        coordinates: &[usize],
        detail: Detail,
    ) {
        for (r, row) in part.spread.rows().into_iter().enumerate() {
            let to = if detail == Detail::Covariance {
                coordinates[r]
            } else {
                r
            };
            let mut to = self.spread.row_mut(to);
            let both = coordinates.iter().zip(row);
            both.for_each(|(&c, v)| to[c] += weight * v);
        }
    }

    /// Adds `weight` x xᵀ, as far as it is told.
    pub fn add_outer(&mut self, weight: f64, x: &[f64], detail: Detail) {
        match detail {
            Detail::Mean => {}
            Detail::Variances => {
                let spread = self.spread.iter_mut().zip(x);
                spread.for_each(|(s, x)| *s += weight * x * x);
            }
            Detail::Covariance => add_outer(&mut self.spread, weight, x),
        }
    }
}

/// What one block adds to the sum: `base` and the gain of `w`.
#[derive(Default)]
struct MeanTerm {
    base: Vec<f64>,
    /// a w.
    w: Vec<f32>,
    /// What is not known along a leaf's step: (its variance, a w of the step).
    step_scale: Option<(f64, Vec<f32>)>,
}

impl MeanTerm {
    fn zero(d: usize, stride: usize) -> MeanTerm {
        MeanTerm {
            base: vec![0.0; d],
            w: vec![0.0; stride],
            step_scale: None,
        }
    }
}

/// The blocks that explain an observation, asked one after another.
struct PosteriorSum<'a> {
    part: &'a PartMixture,
    conditioned: &'a ConditionedPart,
    /// The observation, padded.
    y: Vec<f32>,
    candidates: &'a Candidates,
    /// Each block's share, in the order of [`Candidates::best`].
    responsibilities: Vec<f64>,
    /// The blocks, cell by cell and leaf by leaf.
    order: Vec<usize>,
    /// Of the leaf that is asked: its own.
    state: ExemplarResidual,
    asked: Option<(usize, usize)>,
    step: Vec<f32>,
    scratch: Scratch,
}

impl PartMixture {
    /// What the explaining blocks say together.
    pub fn answer(
        &self,
        conditioned: &ConditionedPart,
        y: &[f64],
        candidates: &Candidates,
        detail: Detail,
    ) -> PartialPosterior {
        if !conditioned.observes_any() {
            return self.unseen(detail);
        }
        let mut out = PartialPosterior::new(self.coordinates.len(), detail);
        let mut sum = PosteriorSum::of(self, conditioned, y, candidates);
        sum.mean(&mut out.mean);
        if detail != Detail::Mean {
            sum.within(&mut out, detail);
            sum.add_spread_of_means(&mut out, detail);
        }
        out
    }

    /// Where nothing is observed: what the coarsest cell knows.
    fn unseen(&self, detail: Detail) -> PartialPosterior {
        let coarsest = &self.cluster_levels[0];
        let basis = coarsest.basis(0, &self.coordinates);
        let d = self.coordinates.len();
        PartialPosterior {
            mean: coarsest.means.row(0).to_vec(),
            spread: match detail {
                Detail::Mean => Array2::zeros((0, 0)),
                Detail::Variances => {
                    Array2::from_shape_vec((1, d), basis.diagonal()).unwrap_or_default()
                }
                Detail::Covariance => basis.covariance(),
            },
        }
    }
}

impl<'a> PosteriorSum<'a> {
    fn of(
        part: &'a PartMixture,
        conditioned: &'a ConditionedPart,
        y: &[f64],
        candidates: &'a Candidates,
    ) -> PosteriorSum<'a> {
        let best = &candidates.best;
        let mut order: Vec<usize> = (0..best.len()).collect();
        order.sort_unstable_by_key(|&i| (best[i].scored, best[i].exemplar, best[i].at));
        PosteriorSum {
            y: conditioned.single(y),
            responsibilities: candidates.responsibilities(),
            order,
            state: ExemplarResidual::default(),
            asked: None,
            step: Vec::new(),
            scratch: Scratch::default(),
            part,
            conditioned,
            candidates,
        }
    }

    fn cluster_conditioned(&self, scored: usize) -> &'a ConditionedCluster {
        let scored = self.candidates.scored[scored];
        self.conditioned
            .cluster_conditioned(self.part, scored.index, scored.cluster)
    }

    /// The blocks of one cell after another: (which of the cells seen, where its blocks begin and end in the order).
    fn clusters(&self) -> Vec<(usize, Range<usize>)> {
        let best = &self.candidates.best;
        let same = |a: &usize, b: &usize| best[*a].scored == best[*b].scored;
        let (mut start, mut clusters) = (0, Vec::with_capacity(self.candidates.scored.len()));
        for of in self.order.chunk_by(same) {
            clusters.push((best[of[0]].scored, start..start + of.len()));
            start += of.len();
        }
        clusters
    }

    /// Adds a block's answer times `weight` to a voice; `step_scale` where what its step leaves open is to be told.
    fn add(&mut self, candidate: usize, weight: f64, to: &mut MeanTerm, step_scale: bool) {
        let h = self.candidates.best[candidate];
        let cluster_conditioned = self.cluster_conditioned(h.scored);
        let z = self.candidates.z(h.scored, cluster_conditioned);
        let cluster = self.candidates.scored[h.scored];
        let Some(exemplar) = h.exemplar else {
            add(
                &mut to.base,
                weight,
                self.part.cluster_levels[cluster.index].mean(cluster.cluster),
            );
            return (cluster_conditioned.scales).add_precision_product(
                h.at,
                z,
                weight,
                &mut self.scratch,
                &mut to.w,
            );
        };
        let opened = self.part.opened(cluster.cluster);
        if self.asked != Some((h.scored, exemplar)) {
            self.asked = Some((h.scored, exemplar));
            self.state
                .set_exemplar(cluster_conditioned, z, opened, &self.y, exemplar);
        }
        let scales = self.conditioned.exemplars(self.part, cluster.cluster);
        add_single(&mut to.base, weight, opened.pose(exemplar));
        let ActiveSubMixture {
            at,
            step_scale: reach,
            ..
        } = self.part.exemplar_sub_mixtures()[h.at];
        scales.add_precision_product(at, &self.state.z, weight, &mut self.scratch, &mut to.w);
        if reach > 0.0 {
            let state = &self.state;
            self.step.clear();
            self.step.resize(state.step.len(), 0.0);
            scales.add_precision_product(at, &state.step, 1.0, &mut self.scratch, &mut self.step);
            let of = |z: &[f32]| f64::from(simd::dot(&self.step, z)) / scales.scales[at];
            let variance = reach / (1.0 + reach * of(&state.step));
            let how_far = variance * of(&state.z);
            // Along the step first, then what the cell's covariance makes of the rest.
            add_single(&mut to.base, weight * how_far, opened.step(exemplar));
            let by = (weight * how_far) as f32;
            to.w.iter_mut()
                .zip(&self.step)
                .for_each(|(w, s)| *w -= by * s);
            if step_scale {
                to.step_scale = Some((variance, self.step.clone()));
            }
        }
    }

    fn mean(&mut self, mean: &mut [f64]) {
        for (scored, candidates) in self.clusters() {
            // The gain is linear and the cell's: once for all its blocks.
            let noisy = &self.cluster_conditioned(scored).noisy;
            let mut term = MeanTerm::zero(mean.len(), noisy.stride());
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
            noisy.add_gain(&term.w, mean);
        }
    }

    /// What the heavy cells leave open.
    fn within(&self, out: &mut PartialPosterior, detail: Detail) {
        let clusters = self.clusters();
        let weight = |of: &Range<usize>| {
            let of = &self.order[of.clone()];
            of.iter().map(|b| self.responsibilities[*b]).sum::<f64>()
        };
        let most = clusters.iter().map(|c| weight(&c.1)).fold(0.0, f64::max);
        let heavy = || {
            clusters
                .iter()
                .filter(|c| weight(&c.1) >= LEAST_CELL.min(most))
        };
        let total: f64 = heavy().map(|c| weight(&c.1)).sum();
        for (scored, candidates) in heavy() {
            let cluster_conditioned = self.cluster_conditioned(*scored);
            let of = |b: &usize| -> WeightedScale<'a> {
                let h = self.candidates.best[*b];
                let (scales, at): (&ScaledPrecisions, usize) = match h.exemplar {
                    Some(_) => {
                        let cluster = self.candidates.scored[*scored].cluster;
                        let levels = self.part.exemplar_sub_mixtures();
                        (
                            self.conditioned.exemplars(self.part, cluster),
                            levels[h.at].at,
                        )
                    }
                    None => (&cluster_conditioned.scales, h.at),
                };
                (scales, at, self.responsibilities[*b] / total)
            };
            let candidates = &self.order[candidates.clone()];
            let weighed: Vec<WeightedScale<'_>> = candidates.iter().map(of).collect();
            match (detail, out.spread.as_slice_mut()) {
                (Detail::Variances, Some(spread)) => {
                    cluster_conditioned.noisy.add_variances(&weighed, spread)
                }
                _ => cluster_conditioned
                    .noisy
                    .add_covariance(&weighed, &mut out.spread),
            }
        }
    }

    /// How far the heavy blocks' answers are apart, and what is open along their steps.
    fn add_spread_of_means(&mut self, out: &mut PartialPosterior, detail: Detail) {
        let weight = |b: &usize| self.responsibilities[*b];
        let order = self.order.iter().copied();
        let most = order
            .clone()
            .map(|b| self.responsibilities[b])
            .fold(0.0, f64::max);
        let heavy: Vec<usize> = order
            .filter(|b| weight(b) >= LEAST_SHARE.min(most))
            .collect();
        let total: f64 = heavy.iter().map(|b| self.responsibilities[*b]).sum();
        for candidate in heavy {
            let h = self.candidates.best[candidate];
            let noisy = &self.cluster_conditioned(h.scored).noisy;
            let mut term = MeanTerm::zero(out.mean.len(), noisy.stride());
            self.add(candidate, 1.0, &mut term, true);
            let share = self.responsibilities[candidate] / total;
            let mut off = term.base;
            noisy.add_gain(&term.w, &mut off);
            add(&mut off, -1.0, &out.mean);
            out.add_outer(share, &off, detail);
            if let (Some((variance, w)), Some(exemplar)) = (term.step_scale, h.exemplar) {
                let opened = self.part.opened(self.candidates.scored[h.scored].cluster);
                let mut left = vec![0.0; off.len()];
                noisy.add_gain(&w, &mut left);
                left.iter_mut().for_each(|l| *l = -*l);
                add_single(&mut left, 1.0, opened.step(exemplar));
                out.add_outer(share * variance, &left, detail);
            }
        }
    }
}

/// `to` += `scale` `from`.
fn add_single(to: &mut [f64], scale: f64, from: &[f32]) {
    let both = to.iter_mut().zip(from);
    both.for_each(|(t, f)| *t += scale * f64::from(*f));
}

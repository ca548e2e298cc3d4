//! How the evidence changes as an observation moves: what a placement climbs by.
//!
//! With p the shares of the blocks that explain y, S = (aC_oo + R)⁻¹ of each, d_i the ways y may move:
//!
//! ```text
//! ∂ log p(y) / ∂θ_i       = − Σ p d_iᵀ S (y − m)
//! −∂² log p(y) / ∂θ_i ∂θ_j ≈ Σ p d_iᵀ S d_j        (less, where blocks compete: the spread of what they pull)
//! ```

use super::candidates::Candidates;
use super::noisy_covariance::WeightedPrecision;
use super::part_mixture::{ConditionedPart, PartMixture};
use crate::prior::EvidenceGradient;

/// What a gradient is summed from.
struct GradientSum<'a> {
    part: &'a PartMixture,
    conditioned: &'a ConditionedPart,
    /// The observation and its moves, padded.
    y: Vec<f32>,
    moves: Vec<Vec<f32>>,
    candidates: &'a Candidates,
    /// Of each block.
    responsibilities: Vec<f64>,
}

impl PartMixture {
    /// Of `y` (d), along moves of it (each d; what is missing is not read), by the cells alone.
    pub fn evidence_gradient(
        &self,
        conditioned: &ConditionedPart,
        y: &[f64],
        moves: &[Vec<f64>],
    ) -> EvidenceGradient {
        let candidates = &self.candidates_among_clusters(conditioned, y);
        let n = moves.len();
        let mut gradient = EvidenceGradient {
            log_evidence: candidates.evidence,
            gradient: vec![0.0; n],
            curvature: vec![0.0; n * n],
        };
        if !conditioned.observes_any() || n == 0 {
            return gradient;
        }
        let sum = GradientSum {
            part: self,
            conditioned,
            y: conditioned.single(y),
            moves: moves.iter().map(|m| conditioned.single(m)).collect(),
            candidates,
            responsibilities: candidates.responsibilities(),
        };
        let best = &candidates.best;
        let mut order: Vec<usize> = (0..best.len()).collect();
        order.sort_unstable_by_key(|&i| (best[i].scored, best[i].at));
        for of_cell in order.chunk_by(|a, b| best[*a].scored == best[*b].scored) {
            sum.add(of_cell, &mut gradient);
        }
        gradient
    }
}

impl GradientSum<'_> {
    /// Adds what the blocks of one cell pull.
    fn add(&self, candidates: &[usize], gradient: &mut EvidenceGradient) {
        let (n, best) = (self.moves.len(), &self.candidates.best);
        let scored = self.candidates.scored[best[candidates[0]].scored];
        let cluster_conditioned =
            self.conditioned
                .cluster_conditioned(self.part, scored.index, scored.cluster);
        let mean = self.part.cluster_levels[scored.index].mean(scored.cluster);
        let mut off = self.y.clone();
        for ((o, m), noise) in off.iter_mut().zip(mean).zip(&self.conditioned.noise) {
            if noise.is_finite() {
                *o -= *m as f32;
            }
        }
        let mut weights = vec![0.0; cluster_conditioned.scales.scales.len()];
        candidates
            .iter()
            .for_each(|&i| weights[best[i].at] += self.responsibilities[i]);
        let through = WeightedPrecision::of(
            &cluster_conditioned.noisy,
            &cluster_conditioned.scales,
            &weights,
        );
        let rest = through.project(&off);
        let projected: Vec<_> = self.moves.iter().map(|m| through.project(m)).collect();
        for i in 0..n {
            gradient.gradient[i] -= projected[i].form(&rest);
            for j in 0..=i {
                let v = projected[i].form(&projected[j]);
                gradient.curvature[i * n + j] += v;
                if i != j {
                    gradient.curvature[j * n + i] += v;
                }
            }
        }
    }
}

//! How the evidence changes as an observation moves: what a placement climbs by.
//!
//! With p the shares of the blocks that explain y, S = (aC_oo + R)⁻¹ of each, d_i the ways y may move:
//!
//! ```text
//! ∂ log p(y) / ∂θ_i       = − Σ p d_iᵀ S (y − m)
//! −∂² log p(y) / ∂θ_i ∂θ_j ≈ Σ p d_iᵀ S d_j        (less, where blocks compete: the spread of what they pull)
//! ```

use super::explained::Explained;
use super::lens::Blend;
use super::part::{Part, View};
use crate::prior::Slope;

/// What a slope is summed from.
struct Pull<'a> {
    part: &'a Part,
    view: &'a View,
    /// The observation and its moves, padded.
    y: Vec<f32>,
    moves: Vec<Vec<f32>>,
    found: &'a Explained,
    /// Of each block.
    shares: Vec<f64>,
}

impl Part {
    /// Of `y` (d), along moves of it (each d; what is missing is not read), by the cells alone.
    pub fn slope(&self, view: &View, y: &[f64], moves: &[Vec<f64>]) -> Slope {
        let found = &self.explain_by_cells(view, y);
        let n = moves.len();
        let mut slope = Slope {
            evidence: found.evidence,
            gradient: vec![0.0; n],
            curvature: vec![0.0; n * n],
        };
        if !view.sees() || n == 0 {
            return slope;
        }
        let pull = Pull {
            part: self,
            view,
            y: view.short(y),
            moves: moves.iter().map(|m| view.short(m)).collect(),
            found,
            shares: found.shares(),
        };
        let best = &found.best;
        let mut order: Vec<usize> = (0..best.len()).collect();
        order.sort_unstable_by_key(|&i| (best[i].seen, best[i].at));
        for of_cell in order.chunk_by(|a, b| best[*a].seen == best[*b].seen) {
            pull.add(of_cell, &mut slope);
        }
        slope
    }
}

impl Pull<'_> {
    /// Adds what the blocks of one cell pull.
    fn add(&self, blocks: &[usize], slope: &mut Slope) {
        let (n, best) = (self.moves.len(), &self.found.best);
        let seen = self.found.seen[best[blocks[0]].seen];
        let sight = self.view.sight(self.part, seen.index, seen.cell);
        let mean = self.part.cells[seen.index].mean(seen.cell);
        let mut off = self.y.clone();
        for ((o, m), noise) in off.iter_mut().zip(mean).zip(&self.view.noise) {
            if noise.is_finite() {
                *o -= *m as f32;
            }
        }
        let mut weights = vec![0.0; sight.scales.scales.len()];
        blocks
            .iter()
            .for_each(|&i| weights[best[i].at] += self.shares[i]);
        let through = Blend::of(&sight.lens, &sight.scales, &weights);
        let rest = through.aside(&off);
        let ways: Vec<_> = self.moves.iter().map(|m| through.aside(m)).collect();
        for i in 0..n {
            slope.gradient[i] -= ways[i].form(&rest);
            for j in 0..=i {
                let v = ways[i].form(&ways[j]);
                slope.curvature[i * n + j] += v;
                if i != j {
                    slope.curvature[j * n + i] += v;
                }
            }
        }
    }
}

//! How the evidence changes as an observation moves: what a placement climbs by.
//!
//! With p the shares of the blocks that explain y, S = (aC_oo + R)⁻¹ of each, d_i the ways y may move:
//!
//! ```text
//! ∂ log p(y) / ∂θ_i       = − Σ p d_iᵀ S (y − m)
//! −∂² log p(y) / ∂θ_i ∂θ_j ≈ Σ p d_iᵀ S d_j        (less, where blocks compete: the spread of what they pull)
//! ```

use super::lens::Aside;
use super::part::{Part, View};
use super::search::Explained;
use crate::prior::Slope;

impl Part {
    /// Of `y` (d), along moves of it (each d; what is missing is not read), by the cells alone.
    pub fn slope(&self, view: &View, y: &[f64], moves: &[Vec<f64>]) -> Slope {
        let found = self.explain_by_cells(view, y);
        let n = moves.len();
        let mut slope = Slope {
            evidence: found.evidence,
            gradient: vec![0.0; n],
            curvature: vec![0.0; n * n],
        };
        if !view.sees() {
            return slope;
        }
        let moves: Vec<Vec<f32>> = moves.iter().map(|m| view.short(m)).collect();
        let shares = found.shares();
        let mut order: Vec<usize> = (0..found.best.len()).collect();
        order.sort_unstable_by_key(|&i| (found.best[i].seen, found.best[i].at));
        for of_cell in order.chunk_by(|a, b| found.best[*a].seen == found.best[*b].seen) {
            self.add_slope(view, y, &moves, &found, of_cell, &shares, &mut slope);
        }
        slope
    }

    /// What the blocks of one cell add.
    #[allow(clippy::too_many_arguments)]
    fn add_slope(
        &self,
        view: &View,
        y: &[f64],
        moves: &[Vec<f32>],
        found: &Explained,
        blocks: &[usize],
        shares: &[f64],
        slope: &mut Slope,
    ) {
        let n = moves.len();
        let seen = found.seen[found.best[blocks[0]].seen];
        let sight = view.sight(self, seen.index, seen.cell);
        let mean = self.cells[seen.index].mean(seen.cell);
        let mut off = view.short(y);
        let pairs = off.iter_mut().zip(mean).zip(&view.noise);
        for ((o, m), noise) in pairs {
            if noise.is_finite() {
                *o -= *m as f32;
            }
        }
        let rest = Aside::of(&sight.lens, &sight.scales, &off);
        let ways: Vec<Aside<'_>> = moves
            .iter()
            .map(|m| Aside::of(&sight.lens, &sight.scales, m))
            .collect();
        let mut forms = Vec::new();
        let mut sum = |a: &Aside<'_>, b: &Aside<'_>| -> f64 {
            a.forms(b, &mut forms);
            blocks
                .iter()
                .map(|&i| shares[i] * forms[found.best[i].at])
                .sum()
        };
        for i in 0..n {
            slope.gradient[i] -= sum(&ways[i], &rest);
            for j in 0..=i {
                let v = sum(&ways[i], &ways[j]);
                slope.curvature[i * n + j] += v;
                if i != j {
                    slope.curvature[j * n + i] += v;
                }
            }
        }
    }
}

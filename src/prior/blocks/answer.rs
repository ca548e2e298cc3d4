//! What the blocks that explain an observation answer together.

use super::lens::Scaled;
use super::part::{Explained, Hypothesis, Part, Residual, Sight, View, add_outer};
use crate::prior::small::{add, dot};
use ndarray::Array2;

/// Blocks that weigh less than this share do not tell the covariance.
const LEAST_SHARE: f64 = 0.02;

/// One block's answer: its mean is `base` and the gain of `w`.
struct Voice<'a> {
    weight: f64,
    base: Vec<f64>,
    w: Vec<f64>,
    sight: &'a Sight,
    /// (level of the cells, cell): whose covariance.
    cell: (usize, usize),
    /// At which scale.
    scaled: &'a Scaled,
    /// What is not known along a leaf's step: (variance, the step, w of it).
    along: Option<(f64, Vec<f64>, Vec<f64>)>,
}

impl Part {
    /// The mean (d), and where `unsure` is asked for the covariance (d, d), that the explaining blocks give together.
    pub fn answer(
        &self,
        view: &View,
        y: &[f64],
        explained: &Explained,
        unsure: bool,
    ) -> (Vec<f64>, Array2<f64>) {
        let d = self.coordinates.len();
        if !view.sees() {
            let coarsest = &self.cells[0];
            let covariance = coarsest.basis(0, &self.coordinates).covariance();
            return (coarsest.means.row(0).to_vec(), covariance);
        }
        let top = explained.best[0].log;
        let weights = explained.best.iter().map(|h| (h.log - top).exp());
        let total: f64 = weights.clone().sum();
        let voices = explained.best.iter().zip(weights);
        let mut voices: Vec<Voice<'_>> = voices
            .map(|(h, w)| self.voice(view, y, h, w / total))
            .collect();
        voices.sort_by_key(|v| v.cell);
        let mut mean = vec![0.0; d];
        for same in voices.chunk_by(|a, b| a.cell == b.cell) {
            // The gain is linear and the cell's: once for all its blocks.
            let mut w = vec![0.0; same[0].w.len()];
            for v in same {
                add(&mut mean, v.weight, &v.base);
                add(&mut w, v.weight * v.scaled.scale, &v.w);
            }
            same[0].sight.lens.add_gain(1.0, &w, 1.0, &mut mean);
        }
        let covariance = if unsure {
            voices.retain(|v| v.weight >= LEAST_SHARE);
            self.covariance(&voices, &mean)
        } else {
            Array2::zeros((0, 0))
        };
        (mean, covariance)
    }

    fn voice<'a>(&'a self, view: &'a View, y: &[f64], h: &Hypothesis, weight: f64) -> Voice<'a> {
        let finest = self.cells.len() - 1;
        let index = h.index.min(finest);
        let sight = view.sight(self, index, h.cell);
        if h.index <= finest {
            let scaled = &sight.scales[h.at];
            let base = self.cells[index].means.row(h.cell).to_vec();
            let mut z = Vec::new();
            sight.lens.project(|i| y[i] - base[i], &mut z);
            return Voice {
                weight,
                w: scaled.solve(&z),
                base,
                cell: (index, h.cell),
                along: None,
                scaled,
                sight,
            };
        }
        let opened = self.opened(h.cell);
        let mut state = Residual::default();
        state.of_cell(self, sight, y, h.cell);
        state.of_leaf(sight, opened, y, h.leaf);
        let scaled = &sight.leaves(self)[h.at];
        let along = self.along(h.at);
        let wide = |row: &[f32]| row.iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
        let (mut base, mut z) = (wide(opened.pose(h.leaf)), state.z);
        let mut left = None;
        if along > 0.0 {
            let way = wide(opened.step(h.leaf));
            let w = scaled.solve(&state.step);
            let variance = along / (1.0 + along * dot(&w, &state.step));
            let how_far = variance * dot(&w, &z);
            // Along the step first, then what the cell's covariance makes of the rest.
            add(&mut base, how_far, &way);
            add(&mut z, -how_far, &state.step);
            left = Some((variance, way, w));
        }
        Voice {
            weight,
            w: scaled.solve(&z),
            base,
            cell: (finest, h.cell),
            along: left,
            scaled,
            sight,
        }
    }

    /// What each block leaves open, and how far they are apart.
    fn covariance(&self, voices: &[Voice<'_>], mean: &[f64]) -> Array2<f64> {
        let d = mean.len();
        let mut out = Array2::zeros((d, d));
        let total: f64 = voices.iter().map(|v| v.weight).sum();
        for same in voices.chunk_by(|a, b| a.cell == b.cell) {
            let scales: Vec<(&Scaled, f64)> =
                same.iter().map(|v| (v.scaled, v.weight / total)).collect();
            out += &same[0].sight.lens.covariance(&scales);
        }
        for v in voices {
            let (lens, scale) = (&v.sight.lens, v.scaled.scale);
            let mut off = v.base.clone();
            lens.add_gain(scale, &v.w, 1.0, &mut off);
            add(&mut off, -1.0, mean);
            add_outer(&mut out, v.weight / total, &off);
            if let Some((variance, way, w)) = &v.along {
                let mut left = way.clone();
                lens.add_gain(scale, w, -1.0, &mut left);
                add_outer(&mut out, v.weight / total * variance, &left);
            }
        }
        out
    }
}

//! What the blocks that explain an observation answer together.

use super::lens::Scaled;
use super::part::{Explained, Hypothesis, Part, Residual, Sight, View, add_outer};
use crate::prior::small::{add, dot};
use ndarray::Array2;

/// Blocks that weigh less than this share do not tell the covariance.
const LEAST_SHARE: f64 = 0.02;

/// One block's answer.
struct Voice<'a> {
    weight: f64,
    mean: Vec<f64>,
    sight: &'a Sight,
    /// (level of the cells, cell): whose covariance.
    cell: (usize, usize),
    /// At which scale.
    scaled: &'a Scaled,
    /// What is not known along a leaf's step: (variance, direction).
    along: Option<(f64, Vec<f64>)>,
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
        let voices: Vec<Voice<'_>> = voices
            .map(|(h, w)| self.voice(view, y, h, w / total, unsure))
            .collect();
        let mut mean = vec![0.0; d];
        voices
            .iter()
            .for_each(|v| add(&mut mean, v.weight, &v.mean));
        let covariance = if unsure {
            self.covariance(&voices, &mean)
        } else {
            Array2::zeros((0, 0))
        };
        (mean, covariance)
    }

    fn voice<'a>(
        &'a self,
        view: &'a View,
        y: &[f64],
        h: &Hypothesis,
        weight: f64,
        unsure: bool,
    ) -> Voice<'a> {
        let finest = self.cells.len() - 1;
        let index = h.index.min(finest);
        let sight = view.sight(self, index, h.cell);
        if h.index <= finest {
            let scaled = &sight.scales[h.at];
            let mut mean = self.cells[index].means.row(h.cell).to_vec();
            let mut z = Vec::new();
            sight.lens.project(|i| y[i] - mean[i], &mut z);
            sight
                .lens
                .add_gain(scaled.scale, &scaled.solve(&z), 1.0, &mut mean);
            return Voice {
                weight,
                mean,
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
        let (mut mean, mut z) = (wide(opened.pose(h.leaf)), state.z);
        let mut left = None;
        if along > 0.0 {
            let way = wide(opened.step(h.leaf));
            let w = scaled.solve(&state.step);
            let variance = along / (1.0 + along * dot(&w, &state.step));
            let how_far = variance * dot(&w, &z);
            // Along the step first, then what the cell's covariance makes of the rest.
            add(&mut mean, how_far, &way);
            add(&mut z, -how_far, &state.step);
            if unsure {
                let mut rest = way;
                sight.lens.add_gain(scaled.scale, &w, -1.0, &mut rest);
                left = Some((variance, rest));
            }
        }
        sight
            .lens
            .add_gain(scaled.scale, &scaled.solve(&z), 1.0, &mut mean);
        Voice {
            weight,
            mean,
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
        let heard: Vec<&Voice<'_>> = voices.iter().filter(|v| v.weight >= LEAST_SHARE).collect();
        let total: f64 = heard.iter().map(|v| v.weight).sum();
        let mut cells: Vec<(usize, usize)> = heard.iter().map(|v| v.cell).collect();
        cells.sort_unstable();
        cells.dedup();
        for cell in cells {
            let own = heard.iter().filter(|v| v.cell == cell);
            let scales: Vec<(&Scaled, f64)> =
                own.clone().map(|v| (v.scaled, v.weight / total)).collect();
            if let Some(v) = own.clone().next() {
                out += &v.sight.lens.covariance(&scales);
            }
        }
        for v in &heard {
            let off: Vec<f64> = v.mean.iter().zip(mean).map(|(x, m)| x - m).collect();
            add_outer(&mut out, v.weight / total, &off);
            if let Some((variance, way)) = &v.along {
                add_outer(&mut out, v.weight / total * variance, way);
            }
        }
        out
    }
}

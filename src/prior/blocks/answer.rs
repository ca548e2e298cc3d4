//! What the blocks that explain an observation answer together.

use super::lens::Scaled;
use super::part::{Explained, Hypothesis, Level, Part, Residual, Sight, View, add_outer};
use crate::prior::small::{add, dot};
use ndarray::Array2;
use std::sync::Arc;

/// Blocks that weigh less than this share do not tell the covariance.
const LEAST_SHARE: f64 = 0.005;

/// One block's answer.
struct Voice {
    weight: f64,
    mean: Vec<f64>,
    sight: Arc<Sight>,
    /// (level of the cells, cell): whose covariance.
    cell: (usize, usize),
    /// Which of the sight's scales; leaves' scales come after the cells'.
    scale: usize,
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
        let voices: Vec<Voice> = voices
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

    fn voice(&self, view: &View, y: &[f64], h: &Hypothesis, weight: f64, unsure: bool) -> Voice {
        match self.levels[h.level] {
            Level::Cells { index, .. } => {
                let sight = view.sight(self, index, h.cell);
                let first = self
                    .levels
                    .iter()
                    .position(|l| matches!(l, Level::Cells { index: i, .. } if *i == index));
                let scale = h.level - first.unwrap_or(h.level);
                let mut mean = self.cells[index].means.row(h.cell).to_vec();
                let mut z = Vec::new();
                sight.lens.project(|i| y[i] - mean[i], &mut z);
                let scaled = &sight.scales[scale];
                sight
                    .lens
                    .add_gain(scaled.scale, &scaled.solve(&z), 1.0, &mut mean);
                Voice {
                    weight,
                    mean,
                    cell: (index, h.cell),
                    scale,
                    along: None,
                    sight,
                }
            }
            Level::Leaves { along, .. } => {
                let finest = self.cells.len() - 1;
                let sight = view.sight(self, finest, h.cell);
                let first = self.leaf_levels().next().map_or(h.level, |l| l.0);
                let opened = self.opened(h.cell);
                let mut state = Residual::default();
                state.of_cell(self, &sight, y, h.cell);
                state.of_leaf(&sight, opened, y, h.leaf);
                let scaled = &sight.leaves(self)[h.level - first];
                let mut mean: Vec<f64> =
                    opened.pose(h.leaf).iter().map(|v| f64::from(*v)).collect();
                let mut z = state.z;
                let mut left = None;
                if along > 0.0 {
                    let way: Vec<f64> = opened.step(h.leaf).iter().map(|v| f64::from(*v)).collect();
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
                    scale: sight.scales.len() + h.level - first,
                    along: left,
                    sight,
                }
            }
        }
    }

    /// What each block leaves open, and how far they are apart.
    fn covariance(&self, voices: &[Voice], mean: &[f64]) -> Array2<f64> {
        let d = mean.len();
        let mut out = Array2::zeros((d, d));
        let heard: Vec<&Voice> = voices.iter().filter(|v| v.weight >= LEAST_SHARE).collect();
        let total: f64 = heard.iter().map(|v| v.weight).sum();
        let mut cells: Vec<(usize, usize)> = heard.iter().map(|v| v.cell).collect();
        cells.sort_unstable();
        cells.dedup();
        for cell in cells {
            let mut scales: Vec<(usize, f64)> = Vec::new();
            let mut sight = None;
            for v in heard.iter().filter(|v| v.cell == cell) {
                sight = Some(&v.sight);
                match scales.iter_mut().find(|(s, _)| *s == v.scale) {
                    Some((_, weight)) => *weight += v.weight / total,
                    None => scales.push((v.scale, v.weight / total)),
                }
            }
            if let Some(sight) = sight {
                let of = |&(s, weight): &(usize, f64)| -> (&Scaled, f64) {
                    let own = sight.scales.len();
                    let scaled = if s < own {
                        &sight.scales[s]
                    } else {
                        &sight.leaves(self)[s - own]
                    };
                    (scaled, weight)
                };
                let scales: Vec<(&Scaled, f64)> = scales.iter().map(of).collect();
                out += &sight.lens.covariance(&scales);
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

//! What the blocks that explain an observation answer together.

use super::lens::{Scales, Weighed};
use super::part::{Part, Sight, View, add_outer};
use super::search::{Explained, Hypothesis, Residual};
use crate::prior::small::add;
use crate::simd;
use ndarray::Array2;

/// Blocks that weigh less than this share do not tell how far the answers are apart.
const LEAST_SHARE: f64 = 0.02;
/// Cells whose blocks weigh less than this share together do not tell what is left open.
const LEAST_CELL: f64 = 0.2;

/// How sure the answer is to be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// Not at all.
    Mean,
    /// The variance of each coordinate.
    Variances,
    /// All of the covariance.
    Covariance,
}

/// A mean (d), and how sure it is.
#[derive(Debug, Clone)]
pub struct Answer {
    /// d numbers, cm.
    pub mean: Vec<f64>,
    /// (d, d) where the covariance is told, (1, d) where variances are, empty else, cm².
    pub spread: Array2<f64>,
}

impl Answer {
    /// Of d numbers, nothing added yet.
    pub fn new(d: usize, told: Told) -> Answer {
        let rows = match told {
            Told::Mean => 0,
            Told::Variances => 1,
            Told::Covariance => d,
        };
        Answer {
            mean: vec![0.0; d],
            spread: Array2::zeros((rows, if rows == 0 { 0 } else { d })),
        }
    }

    /// Adds `weight` x xᵀ, as far as it is told.
    pub fn add_outer(&mut self, weight: f64, x: &[f64], told: Told) {
        match told {
            Told::Mean => {}
            Told::Variances => {
                let spread = self.spread.iter_mut().zip(x);
                spread.for_each(|(s, x)| *s += weight * x * x);
            }
            Told::Covariance => add_outer(&mut self.spread, weight, x),
        }
    }
}

/// One block's answer: its mean is `base` and the gain of `w`.
struct Voice<'a> {
    weight: f64,
    base: Vec<f64>,
    /// a w.
    w: Vec<f32>,
    sight: &'a Sight,
    /// Which of the cells seen: whose covariance.
    seen: usize,
    /// At which scale.
    scales: &'a Scales,
    at: usize,
    /// What is not known along a leaf's step: (variance, the step, a w of it).
    along: Option<(f64, Vec<f64>, Vec<f32>)>,
}

impl Part {
    /// What the explaining blocks say together.
    pub fn answer(&self, view: &View, y: &[f64], explained: &Explained, told: Told) -> Answer {
        let d = self.coordinates.len();
        let mut out = Answer::new(d, told);
        if !view.sees() {
            let coarsest = &self.cells[0];
            out.mean = coarsest.means.row(0).to_vec();
            let basis = coarsest.basis(0, &self.coordinates);
            match told {
                Told::Mean => {}
                Told::Variances => {
                    let spread = out.spread.iter_mut().zip(basis.diagonal());
                    spread.for_each(|(s, v)| *s = v);
                }
                Told::Covariance => out.spread = basis.covariance(),
            }
            return out;
        }
        let top = explained.best[0].log;
        let weights = explained.best.iter().map(|h| (h.log - top).exp());
        let total: f64 = weights.clone().sum();
        let short = view.short(y);
        let voices = explained.best.iter().zip(weights);
        let mut voices: Vec<Voice<'_>> = voices
            .map(|(h, w)| self.voice(view, &short, explained, h, w / total))
            .collect();
        voices.sort_by_key(|v| v.seen);
        for same in voices.chunk_by(|a, b| a.seen == b.seen) {
            // The gain is linear and the cell's: once for all its blocks.
            let mut w = vec![0.0; same[0].w.len()];
            for v in same {
                add(&mut out.mean, v.weight, &v.base);
                let weight = v.weight as f32;
                w.iter_mut().zip(&v.w).for_each(|(w, v)| *w += weight * v);
            }
            same[0].sight.lens.add_gain(&w, &mut out.mean);
        }
        if told != Told::Mean {
            tell(&voices, &mut out, told);
        }
        out
    }

    fn voice<'a>(
        &'a self,
        view: &'a View,
        y: &[f32],
        explained: &Explained,
        h: &Hypothesis,
        weight: f64,
    ) -> Voice<'a> {
        let seen = explained.seen[h.seen];
        let sight = view.sight(self, seen.index, seen.cell);
        let z = explained.z(h.seen, sight);
        let Some(leaf) = h.leaf else {
            return Voice {
                weight,
                w: solved(&sight.scales, h.at, z),
                base: self.cells[seen.index].means.row(seen.cell).to_vec(),
                seen: h.seen,
                along: None,
                scales: &sight.scales,
                at: h.at,
                sight,
            };
        };
        let opened = self.opened(seen.cell);
        let mut state = Residual::default();
        state.of_leaf(sight, z, opened, y, leaf);
        let scales = sight.leaves(self);
        let along = self.active(self.cells.len())[h.at].along;
        let d = self.coordinates.len();
        let wide = |row: &[f32]| row[..d].iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
        let (mut base, mut z) = (wide(opened.pose(leaf)), state.z);
        let mut left = None;
        if along > 0.0 {
            let way = wide(opened.step(leaf));
            let scale = scales.scales[h.at];
            let w = solved(scales, h.at, &state.step);
            let of = |z: &[f32]| f64::from(simd::dot(&w, z)) / scale;
            let variance = along / (1.0 + along * of(&state.step));
            let how_far = variance * of(&z);
            // Along the step first, then what the cell's covariance makes of the rest.
            add(&mut base, how_far, &way);
            for (z, step) in z.iter_mut().zip(&state.step) {
                *z -= how_far as f32 * step;
            }
            left = Some((variance, way, w));
        }
        Voice {
            weight,
            w: solved(scales, h.at, &z),
            base,
            seen: h.seen,
            along: left,
            scales,
            at: h.at,
            sight,
        }
    }
}

/// a w of a residual.
fn solved(scales: &Scales, at: usize, z: &[f32]) -> Vec<f32> {
    let mut w = scales.solve(at, z);
    let scale = scales.scales[at] as f32;
    w.iter_mut().for_each(|w| *w *= scale);
    w
}

/// What each block leaves open, and how far they are apart.
fn tell(voices: &[Voice<'_>], out: &mut Answer, told: Told) {
    let weight = |of: &[Voice<'_>]| of.iter().map(|v| v.weight).sum::<f64>();
    let cells = || voices.chunk_by(|a, b| a.seen == b.seen);
    let most = cells().map(weight).fold(0.0, f64::max);
    let heard = |of: &&[Voice<'_>]| weight(of) >= LEAST_CELL.min(most);
    let total: f64 = cells().filter(heard).map(weight).sum();
    for same in cells().filter(heard) {
        let scales: Vec<Weighed<'_>> = (same.iter())
            .map(|v| (v.scales, v.at, v.weight / total))
            .collect();
        let lens = &same[0].sight.lens;
        match (told, out.spread.as_slice_mut()) {
            (Told::Variances, Some(spread)) => lens.add_variances(&scales, spread),
            _ => lens.add_covariance(&scales, &mut out.spread),
        }
    }
    let apart = voices.iter().filter(|v| v.weight >= LEAST_SHARE);
    let total: f64 = apart.clone().map(|v| v.weight).sum();
    for v in apart {
        let lens = &v.sight.lens;
        let mut off = v.base.clone();
        lens.add_gain(&v.w, &mut off);
        add(&mut off, -1.0, &out.mean);
        out.add_outer(v.weight / total, &off, told);
        if let Some((variance, way, w)) = &v.along {
            let mut gained = vec![0.0; way.len()];
            lens.add_gain(w, &mut gained);
            let left: Vec<f64> = way.iter().zip(&gained).map(|(w, g)| w - g).collect();
            out.add_outer(v.weight / total * variance, &left, told);
        }
    }
}

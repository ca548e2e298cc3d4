//! What the blocks that explain an observation answer together.

use super::explained::Explained;
use super::part::{Active, Part, Sight, View, add_outer};
use super::scales::{Room, Scales, Weighed};
use super::search::Residual;
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

    /// Where nothing can be told: no numbers.
    pub fn unknown(d: usize, told: Told) -> Answer {
        let mut out = Answer::new(d, told);
        out.mean.fill(f64::NAN);
        out.spread.fill(f64::NAN);
        out
    }

    /// Adds `weight` times what a part's answer leaves open; its coordinates are among those here.
    pub fn add_spread(&mut self, weight: f64, part: &Answer, coordinates: &[usize], told: Told) {
        for (r, row) in part.spread.rows().into_iter().enumerate() {
            let to = if told == Told::Covariance {
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

/// What one block adds to the sum: `base` and the gain of `w`.
#[derive(Default)]
struct Voice {
    base: Vec<f64>,
    /// a w.
    w: Vec<f32>,
    /// What is not known along a leaf's step: (its variance, a w of the step).
    along: Option<(f64, Vec<f32>)>,
}

impl Voice {
    fn silent(d: usize, stride: usize) -> Voice {
        Voice {
            base: vec![0.0; d],
            w: vec![0.0; stride],
            along: None,
        }
    }
}

/// The blocks that explain an observation, asked one after another.
struct Chorus<'a> {
    part: &'a Part,
    view: &'a View,
    /// The observation, padded.
    y: Vec<f32>,
    explained: &'a Explained,
    /// Each block's share, in the order of [`Explained::best`].
    shares: Vec<f64>,
    /// The blocks, cell by cell and leaf by leaf.
    order: Vec<usize>,
    /// Of the leaf that is asked: its own.
    state: Residual,
    asked: Option<(usize, usize)>,
    step: Vec<f32>,
    room: Room,
}

impl Part {
    /// What the explaining blocks say together.
    pub fn answer(&self, view: &View, y: &[f64], explained: &Explained, told: Told) -> Answer {
        if !view.sees() {
            return self.unseen(told);
        }
        let mut out = Answer::new(self.coordinates.len(), told);
        let mut chorus = Chorus::of(self, view, y, explained);
        chorus.mean(&mut out.mean);
        if told != Told::Mean {
            chorus.within(&mut out, told);
            chorus.apart(&mut out, told);
        }
        out
    }

    /// Where nothing is observed: what the coarsest cell knows.
    fn unseen(&self, told: Told) -> Answer {
        let coarsest = &self.cells[0];
        let basis = coarsest.basis(0, &self.coordinates);
        let d = self.coordinates.len();
        Answer {
            mean: coarsest.means.row(0).to_vec(),
            spread: match told {
                Told::Mean => Array2::zeros((0, 0)),
                Told::Variances => {
                    Array2::from_shape_vec((1, d), basis.diagonal()).unwrap_or_default()
                }
                Told::Covariance => basis.covariance(),
            },
        }
    }
}

impl<'a> Chorus<'a> {
    fn of(part: &'a Part, view: &'a View, y: &[f64], explained: &'a Explained) -> Chorus<'a> {
        let best = &explained.best;
        let mut order: Vec<usize> = (0..best.len()).collect();
        order.sort_unstable_by_key(|&i| (best[i].seen, best[i].leaf, best[i].at));
        Chorus {
            y: view.short(y),
            shares: explained.shares(),
            order,
            state: Residual::default(),
            asked: None,
            step: Vec::new(),
            room: Room::default(),
            part,
            view,
            explained,
        }
    }

    fn sight(&self, seen: usize) -> &'a Sight {
        let seen = self.explained.seen[seen];
        self.view.sight(self.part, seen.index, seen.cell)
    }

    /// The blocks of one cell after another: (which of the cells seen, where its blocks begin and end in the order).
    fn cells(&self) -> Vec<(usize, Range<usize>)> {
        let best = &self.explained.best;
        let same = |a: &usize, b: &usize| best[*a].seen == best[*b].seen;
        let (mut start, mut cells) = (0, Vec::with_capacity(self.explained.seen.len()));
        for of in self.order.chunk_by(same) {
            cells.push((best[of[0]].seen, start..start + of.len()));
            start += of.len();
        }
        cells
    }

    /// Adds a block's answer times `weight` to a voice; `along` where what its step leaves open is to be told.
    fn add(&mut self, block: usize, weight: f64, to: &mut Voice, along: bool) {
        let h = self.explained.best[block];
        let sight = self.sight(h.seen);
        let z = self.explained.z(h.seen, sight);
        let cell = self.explained.seen[h.seen];
        let Some(leaf) = h.leaf else {
            add(
                &mut to.base,
                weight,
                self.part.cells[cell.index].mean(cell.cell),
            );
            return (sight.scales).add_solved(h.at, z, weight, &mut self.room, &mut to.w);
        };
        let opened = self.part.opened(cell.cell);
        if self.asked != Some((h.seen, leaf)) {
            self.asked = Some((h.seen, leaf));
            self.state.of_leaf(sight, z, opened, &self.y, leaf);
        }
        let scales = self.view.leaves(self.part, cell.cell);
        add_wide(&mut to.base, weight, opened.pose(leaf));
        let Active {
            at, along: reach, ..
        } = self.part.of_leaves()[h.at];
        scales.add_solved(at, &self.state.z, weight, &mut self.room, &mut to.w);
        if reach > 0.0 {
            let state = &self.state;
            self.step.clear();
            self.step.resize(state.step.len(), 0.0);
            scales.add_solved(at, &state.step, 1.0, &mut self.room, &mut self.step);
            let of = |z: &[f32]| f64::from(simd::dot(&self.step, z)) / scales.scales[at];
            let variance = reach / (1.0 + reach * of(&state.step));
            let how_far = variance * of(&state.z);
            // Along the step first, then what the cell's covariance makes of the rest.
            add_wide(&mut to.base, weight * how_far, opened.step(leaf));
            let by = (weight * how_far) as f32;
            to.w.iter_mut()
                .zip(&self.step)
                .for_each(|(w, s)| *w -= by * s);
            if along {
                to.along = Some((variance, self.step.clone()));
            }
        }
    }

    fn mean(&mut self, mean: &mut [f64]) {
        for (seen, blocks) in self.cells() {
            // The gain is linear and the cell's: once for all its blocks.
            let lens = &self.sight(seen).lens;
            let mut voice = Voice::silent(mean.len(), lens.stride());
            for at in blocks {
                let block = self.order[at];
                self.add(block, self.shares[block], &mut voice, false);
            }
            add(mean, 1.0, &voice.base);
            lens.add_gain(&voice.w, mean);
        }
    }

    /// What the heavy cells leave open.
    fn within(&self, out: &mut Answer, told: Told) {
        let cells = self.cells();
        let weight = |of: &Range<usize>| {
            let of = &self.order[of.clone()];
            of.iter().map(|b| self.shares[*b]).sum::<f64>()
        };
        let most = cells.iter().map(|c| weight(&c.1)).fold(0.0, f64::max);
        let heard = || {
            cells
                .iter()
                .filter(|c| weight(&c.1) >= LEAST_CELL.min(most))
        };
        let total: f64 = heard().map(|c| weight(&c.1)).sum();
        for (seen, blocks) in heard() {
            let sight = self.sight(*seen);
            let of = |b: &usize| -> Weighed<'a> {
                let h = self.explained.best[*b];
                let (scales, at): (&Scales, usize) = match h.leaf {
                    Some(_) => {
                        let cell = self.explained.seen[*seen].cell;
                        let levels = self.part.of_leaves();
                        (self.view.leaves(self.part, cell), levels[h.at].at)
                    }
                    None => (&sight.scales, h.at),
                };
                (scales, at, self.shares[*b] / total)
            };
            let blocks = &self.order[blocks.clone()];
            let weighed: Vec<Weighed<'_>> = blocks.iter().map(of).collect();
            match (told, out.spread.as_slice_mut()) {
                (Told::Variances, Some(spread)) => sight.lens.add_variances(&weighed, spread),
                _ => sight.lens.add_covariance(&weighed, &mut out.spread),
            }
        }
    }

    /// How far the heavy blocks' answers are apart, and what is open along their steps.
    fn apart(&mut self, out: &mut Answer, told: Told) {
        let weight = |b: &usize| self.shares[*b];
        let order = self.order.iter().copied();
        let most = order.clone().map(|b| self.shares[b]).fold(0.0, f64::max);
        let heavy: Vec<usize> = order
            .filter(|b| weight(b) >= LEAST_SHARE.min(most))
            .collect();
        let total: f64 = heavy.iter().map(|b| self.shares[*b]).sum();
        for block in heavy {
            let h = self.explained.best[block];
            let lens = &self.sight(h.seen).lens;
            let mut voice = Voice::silent(out.mean.len(), lens.stride());
            self.add(block, 1.0, &mut voice, true);
            let share = self.shares[block] / total;
            let mut off = voice.base;
            lens.add_gain(&voice.w, &mut off);
            add(&mut off, -1.0, &out.mean);
            out.add_outer(share, &off, told);
            if let (Some((variance, w)), Some(leaf)) = (voice.along, h.leaf) {
                let opened = self.part.opened(self.explained.seen[h.seen].cell);
                let mut left = vec![0.0; off.len()];
                lens.add_gain(&w, &mut left);
                left.iter_mut().for_each(|l| *l = -*l);
                add_wide(&mut left, 1.0, opened.step(leaf));
                out.add_outer(share * variance, &left, told);
            }
        }
    }
}

/// `to` += `scale` `from`.
fn add_wide(to: &mut [f64], scale: f64, from: &[f32]) {
    let both = to.iter_mut().zip(from);
    both.for_each(|(t, f)| *t += scale * f64::from(*f));
}

//! What any prior's answer gains from knowing two things more: points that are corrupt, and distances that are rigid.
//!
//! ```text
//! observation ── bones: which points are in doubt ── prior, without them ── assignments, weighed ── prior ── average
//!                                                                                                             │
//! answer <───────────────────── rigid distances kept <─────────────────────────────────────────────────────────┘
//! ```

pub mod bones;
pub mod outliers;
pub mod rigid;

use crate::Result;
use crate::io::Model;
use crate::par;
use crate::prior::pairs::RigidPairs;
use crate::prior::tuning::Task;
use crate::prior::{Belief, EXACT, Prior};
use ndarray::{ArrayView2, s};
use rigid::Bodies;
use std::ops::Range;

/// Frames treated by one piece of parallel work.
const CHUNK: usize = 16;
/// Points a bit mask can hold.
const MOST_POINTS: usize = 128;

/// Whether corrupt points are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seek {
    /// The noise that is told is the noise there is.
    Nothing,
    /// The noise that is told is that of clean points; any may be corrupt.
    Outliers,
}

impl Seek {
    /// What to look for where this noise is told: corrupt points where everything is seen, and nearly clean.
    pub fn by(told: &[f64]) -> Seek {
        match Task::of(told) {
            Task::Sparse => Seek::Outliers,
            _ => Seek::Nothing,
        }
    }
}

/// A treated answer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Treated {
    /// The pose.
    pub belief: Belief,
    /// The probability that each point is corrupt (J); none where they were not looked for.
    pub corrupt: Vec<f64>,
}

/// What is known of the rigid distances of some points.
#[derive(Debug, Clone, Default)]
pub struct Treatment {
    pairs: RigidPairs,
    bodies: Bodies,
}

impl Treatment {
    /// Learns the rigid pairs of poses (m, 3 J), cm.
    pub fn learn(xyz: ArrayView2<'_, f32>, takes: &[Range<usize>]) -> Treatment {
        Treatment::of(RigidPairs::learn(xyz, takes))
    }

    /// With pairs that are known.
    pub fn of(pairs: RigidPairs) -> Treatment {
        if pairs.is_empty() {
            return Treatment::default();
        }
        Treatment {
            bodies: Bodies::of(&pairs),
            pairs,
        }
    }

    /// With the pairs that a model holds; a model without any treats nothing.
    ///
    /// # Errors
    /// As [`RigidPairs::read`].
    pub fn read(model: &Model, source: &str) -> Result<Treatment> {
        RigidPairs::read(model, source).map(Treatment::of)
    }

    /// The same for another body: `from` and `to` (t, 3 J) are poses before and after they were carried to it. `unsure`
    /// tells of two points and their distance how far that may be off: a standard deviation, cm.
    pub fn mapped(
        &self,
        from: ArrayView2<'_, f64>,
        to: ArrayView2<'_, f64>,
        unsure: impl Fn([usize; 2], f64) -> f64,
    ) -> Treatment {
        let mut pairs = self.pairs.mapped(from, to);
        for (k, pair) in pairs.pairs.iter_mut().enumerate() {
            let length = pairs.bodies[[0, k]];
            pair.sd = pair.sd.hypot(unsure(pair.ends, length));
        }
        Treatment::of(pairs)
    }

    /// Whether there is nothing it knows.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The base noise of a frame (3 J numbers, cm; NaN missing) by its rigid distances: the standard deviation of a
    /// coordinate, cm, outliers aside. `None` where too few distances are seen.
    pub fn base_noise(&self, y: &[f64]) -> Option<f64> {
        bones::base(&self.pairs, &self.bodies, y)
    }

    /// The probability that each point (J) is corrupt by the distances alone; `noise` is the variance of clean
    /// coordinates, infinite where missing. Needs no placement.
    pub fn doubts(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        if !self.can_seek(y.len() / 3) {
            return vec![0.0; y.len() / 3];
        }
        bones::look(&self.pairs, &self.bodies, y, noise).corrupt
    }

    /// Distances must hang most points together before corrupt ones can be told.
    fn can_seek(&self, points: usize) -> bool {
        let mut tied = vec![false; points];
        let ends = self.pairs.pairs.iter().flat_map(|p| p.ends);
        ends.for_each(|p| tied[p] = true);
        points <= MOST_POINTS && 2 * tied.iter().filter(|t| **t).count() > points
    }

    /// Restores poses in the prior's space: rows of `y` (cm) with the variance of each number's noise (cm²; infinite
    /// missing), as [`Prior::believe_all`] takes them. Numbers told to be exact stay as they are, unless their point is
    /// found to be corrupt.
    pub fn answer(
        &self,
        prior: &dyn Prior,
        y: ArrayView2<'_, f64>,
        told: ArrayView2<'_, f64>,
        seek: Seek,
    ) -> Vec<Treated> {
        if seek == Seek::Outliers && self.can_seek(y.ncols() / 3) {
            let found = outliers::restore(prior, &self.pairs, &self.bodies, y, told);
            return self.settle(found, |pairs, bodies, mut found| {
                rigid::keep(
                    pairs,
                    bodies,
                    Some(&found.lengths),
                    &mut found.belief,
                    &found.noise,
                );
                Treated {
                    belief: found.belief,
                    corrupt: found.corrupt,
                }
            });
        }
        let beliefs = prior.believe_all(y, told);
        let rows: Vec<(usize, Belief)> = beliefs.into_iter().enumerate().collect();
        self.settle(rows, |pairs, bodies, (t, mut belief)| {
            let told = told.slice(s![t, ..]).to_vec();
            fix(&mut belief, &y.row(t).to_vec(), &told);
            rigid::keep(pairs, bodies, None, &mut belief, &told);
            Treated {
                belief,
                corrupt: Vec::new(),
            }
        })
    }

    fn settle<T: Send + Sync + Clone>(
        &self,
        rows: Vec<T>,
        keep: impl Fn(&RigidPairs, &Bodies, T) -> Treated + Sync,
    ) -> Vec<Treated> {
        let parts = par::map_chunks(rows.len(), CHUNK, |range| {
            let all = rows[range].iter().cloned();
            all.map(|row| keep(&self.pairs, &self.bodies, row))
                .collect::<Vec<_>>()
        });
        parts.into_iter().flatten().collect()
    }
}

/// Numbers that are exact are believed as they are.
fn fix(belief: &mut Belief, y: &[f64], noise: &[f64]) {
    for (i, r) in noise.iter().enumerate() {
        if *r <= EXACT && y[i].is_finite() {
            belief.mean[i] = y[i];
            belief.covariance.row_mut(i).fill(0.0);
            belief.covariance.column_mut(i).fill(0.0);
            belief.covariance[[i, i]] = EXACT;
        }
    }
}

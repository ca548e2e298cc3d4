//! What the distances to its most rigid neighbors say of a point: how much likelier a position is
//! as that of a label than as any, in nats.
//!
//! ```text
//! e(x, t) = ½ Σⱼ log(.97 N(|x − xⱼ|; μ, s) + .03 / 60) + log 60,   times 10 / (neighbors seen)
//! ```
//!
//! over the ten neighbors with the least s + .004 μ. Half, since neighbors are not independent; one
//! that is itself wrong costs at most 3.5 nats. It is judged for whole fragments, never for a
//! frame.

use super::marker_distances::{Distance, Distances, log_likelihood};
use super::tuning::evidence::*;
use super::tuning::marker_distances::FEWEST_FRAMES;
use crate::numeric::parallel;
use crate::numeric::statistics::quantile;
use crate::pose::point_at;
use glam::DVec3;
use ndarray::ArrayView2;

/// The distances within a take.
pub(crate) struct Evidence {
    /// The most rigid neighbors of each label.
    neighbors: Vec<Vec<(usize, Distance)>>,
    /// The nats of each label's own positions: the median, and what few have less than.
    pub own: Vec<[f64; 2]>,
}

impl Evidence {
    /// Learns them from the `positions` of labels (frames, 3 L; cm, NaN missing).
    pub(crate) fn learn(positions: ArrayView2<'_, f64>) -> Evidence {
        let labels = positions.ncols() / 3;
        let distances = Distances::measure(positions);
        let of = |label: usize| {
            let mut all = distances.most_rigid(label);
            all.truncate(NEIGHBORS + SPARE);
            all
        };
        let mut evidence = Evidence {
            neighbors: (0..labels).map(of).collect(),
            own: Vec::new(),
        };
        evidence.own =
            parallel::map_chunks(labels, 1, |range| evidence.typical(positions, range.start));
        evidence
    }

    /// Learns those of some labels to all others.
    pub(crate) fn of(positions: ArrayView2<'_, f64>, labels: &[usize]) -> Evidence {
        let count = positions.ncols() / 3;
        let mut neighbors = vec![Vec::new(); count];
        for label in labels {
            let others = (0..count).filter(|other| !labels.contains(other));
            let known = others.filter_map(|other| {
                let distance = Distance::measure(positions, [*label, other])?;
                (distance.frames >= FEWEST_FRAMES).then_some((other, distance))
            });
            let mut known: Vec<(usize, Distance)> = known.collect();
            known.sort_by(|a, b| a.1.looseness().total_cmp(&b.1.looseness()));
            known.truncate(NEIGHBORS + SPARE);
            neighbors[*label] = known;
        }
        Evidence {
            neighbors,
            own: Vec::new(),
        }
    }

    fn typical(&self, positions: ArrayView2<'_, f64>, label: usize) -> [f64; 2] {
        let step = positions.nrows().div_ceil(OWN_FRAMES).max(1);
        let own = (0..positions.nrows()).step_by(step);
        let own =
            own.filter_map(|t| self.at(label, point_at(positions, t, label), t, positions, &[]));
        let own: Vec<f64> = own.collect();
        [0.5, FEW].map(|share| quantile(own.clone(), share).unwrap_or(0.0))
    }

    /// How much likelier a position in frame `t` is as that of a label; `None` where too few of its
    /// neighbors are seen, those in `without` left out.
    pub(crate) fn at(
        &self,
        label: usize,
        position: DVec3,
        t: usize,
        positions: ArrayView2<'_, f64>,
        without: &[usize],
    ) -> Option<f64> {
        if !position.is_finite() {
            return None;
        }
        let (mut sum, mut seen) = (0.0, 0);
        for (other, distance) in &self.neighbors[label] {
            let there = point_at(positions, t, *other);
            if !there.is_finite() || without.contains(other) {
                continue;
            }
            sum += log_likelihood(position.distance(there), distance);
            seen += 1;
            if seen == NEIGHBORS {
                break;
            }
        }
        (seen >= FEWEST_SEEN).then(|| 0.5 * sum * NEIGHBORS as f64 / seen as f64)
    }
}

/// How many frames that say something of their own an interval of so many has: those nearby say
/// the same.
pub(crate) fn independent_frames(frames: usize, rate: f64) -> f64 {
    1.0 + frames as f64 / (APART * rate)
}

//! Left and right of a whole body, exchanged with each other: no distance shows it, but the volumes
//! that four labels span have the other sign.

use super::tuning::handedness::*;
use crate::numeric::parallel;
use crate::pose::point_at;
use ndarray::ArrayView2;
use rand::seq::index;
use std::collections::BTreeSet;

/// The signs of volumes that keep theirs throughout a take.
pub(crate) struct Hand {
    /// Four labels, and whether their volume is positive.
    quadruples: Vec<([usize; 4], bool)>,
}

impl Hand {
    /// Learns them from the `positions` of labels (frames, 3 L; cm, NaN missing).
    pub(crate) fn learn(positions: ArrayView2<'_, f64>) -> Hand {
        let labels = positions.ncols() / 3;
        if labels < 4 {
            return Hand {
                quadruples: Vec::new(),
            };
        }
        let mut rng = parallel::rng(SEED, 0);
        let draws = (0..QUADRUPLES).map(|_| {
            let four = index::sample(&mut rng, labels, 4);
            let mut four = [0, 1, 2, 3].map(|k| four.index(k));
            four.sort_unstable();
            four
        });
        let drawn: BTreeSet<[usize; 4]> = draws.collect();
        let signed = |four: &[usize; 4]| {
            let [positive, all] = signs(positions, four);
            let share = positive as f64 / all.max(1) as f64;
            let is_one = share >= ONE_SIGN || share <= 1.0 - ONE_SIGN;
            (all >= FEWEST_FRAMES && is_one).then_some((*four, share > 0.5))
        };
        Hand {
            quadruples: drawn.iter().filter_map(signed).collect(),
        }
    }

    /// Whether left and right are exchanged in a take; `labels` are its labels by those that the
    /// signs were learned of. `None` where too little is seen to say it.
    pub(crate) fn is_other(
        &self,
        labels: &[Option<usize>],
        positions: ArrayView2<'_, f64>,
    ) -> Option<bool> {
        let (mut alike, mut all, mut seen) = (0, 0, 0);
        for (four, is_positive) in &self.quadruples {
            let [Some(a), Some(b), Some(c), Some(d)] = four.map(|l| labels[l]) else {
                continue;
            };
            let [positive, frames] = signs(positions, &[a, b, c, d]);
            alike += if *is_positive {
                positive
            } else {
                frames - positive
            };
            all += frames;
            seen += usize::from(frames > 0);
        }
        (seen >= FEWEST).then_some((alike as f64) < LEAST * all as f64)
    }
}

/// In how many frames the volume of four points is positive, and in how many they are seen.
fn signs(positions: ArrayView2<'_, f64>, four: &[usize; 4]) -> [usize; 2] {
    let step = positions.nrows().div_ceil(MOST_FRAMES).max(1);
    let volume = |t: usize| {
        let [a, b, c, d] = four.map(|point| point_at(positions, t, point));
        (b - a).cross(c - a).dot(d - a)
    };
    let frames = (0..positions.nrows()).step_by(step).map(volume);
    frames
        .filter(|v| v.is_finite())
        .fold([0, 0], |[p, n], v| [p + usize::from(v > 0.0), n + 1])
}

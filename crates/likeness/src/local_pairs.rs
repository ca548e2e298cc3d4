//! From labeled pairs to pairs of poses that should be near: the moments around an alike pair,
//! matched to each other.
//!
//! A label says that two clips show the same around two frames. Within `reach` seconds of these
//! frames each pose of one clip is paired with its nearest poses in all clips that are linked to
//! it, whoever moves there. A few hundred labels thus give tens of thousands of differences between
//! people that are to be ignored, and phases that are off in the labels do no harm. With a reach of
//! 0 the pairs are those of the labels.

use super::pairs::{FrameRef, LabeledPair};
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView2};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

/// Poses that a pose is paired with.
const NEAREST: usize = 5;
/// Poses among which the nearest are looked for, a second; each of how many of them is paired.
const SEARCHED_RATE: f64 = 30.0;
const PAIRED: usize = 3;

/// Frames of a clip about a labeled one.
#[derive(Debug, Clone)]
struct Around {
    label: FrameRef,
    frames: RangeInclusive<usize>,
}

/// The parts of clips that labels link.
pub(super) struct Links {
    /// Each label in both directions: what is paired, and among what the nearest are looked for.
    links: Vec<[Around; 2]>,
    /// Frames a second of each take.
    rates: Vec<f64>,
}

impl Links {
    /// The links of the alike pairs among `pairs`; takes have `frames` at `rates`.
    pub(crate) fn new(pairs: &[LabeledPair], frames: &[usize], rates: &[f64], reach: f64) -> Links {
        let around = |label: FrameRef, other: FrameRef| {
            let reach = (reach * rates[label.take]).round() as usize;
            // Within one take the moments stay apart, or each pose would be its own nearest.
            let reach = if label.take == other.take {
                reach.min(label.frame.abs_diff(other.frame) / 4)
            } else {
                reach
            };
            let last = frames[label.take] - 1;
            Around {
                label,
                frames: label.frame.saturating_sub(reach)..=(label.frame + reach).min(last),
            }
        };
        let both = pairs.iter().filter(|p| p.is_alike).flat_map(|pair| {
            let [a, b] = pair.ends;
            let [a, b] = [around(a, b), around(b, a)];
            [[a.clone(), b.clone()], [b, a]]
        });
        Links {
            links: both.collect(),
            rates: rates.to_vec(),
        }
    }

    /// The frames of all links, in order, thinned to the rate at which they are searched.
    pub(crate) fn frames(&self) -> Vec<FrameRef> {
        let frames = self.links.iter().flat_map(|[own, _]| self.thinned(own, 1));
        frames.collect::<BTreeSet<_>>().into_iter().collect()
    }

    /// The labeled frame, and every `nth` of the searched ones about it, which are the same for all
    /// labels.
    fn thinned(&self, around: &Around, nth: usize) -> impl Iterator<Item = FrameRef> + use<> {
        let FrameRef { take, frame } = around.label;
        let step = nth * (self.rates[take] / SEARCHED_RATE).round().max(1.0) as usize;
        let first = around.frames.start().next_multiple_of(step);
        (first..=*around.frames.end())
            .step_by(step)
            .chain([frame])
            .map(move |frame| FrameRef { take, frame })
    }

    /// Pairs of rows of `x`, the poses of [`Links::frames`], that are to be near. Poses that are
    /// not finite are left out.
    pub(crate) fn pair(&self, frames: &[FrameRef], x: ArrayView2<'_, f64>) -> Vec<[usize; 2]> {
        let row = |frame: FrameRef| frames.binary_search(&frame).ok();
        let mut linked: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
        for [own, other] in &self.links {
            let searched: Vec<usize> = self.thinned(other, 1).filter_map(row).collect();
            for row in self.thinned(own, PAIRED).filter_map(row) {
                linked.entry(row).or_default().extend(&searched);
            }
        }
        let linked: Vec<(usize, BTreeSet<usize>)> = linked.into_iter().collect();
        let is_finite: Vec<bool> = (x.rows().into_iter())
            .map(|r| r.iter().all(|v| v.is_finite()))
            .collect();
        let pairs = parallel::map_chunks(linked.len(), 64, |range| {
            let mut pairs = Vec::new();
            for (own, others) in linked[range].iter().filter(|(own, _)| is_finite[*own]) {
                let mut near: Vec<(f64, usize)> = (others.iter().filter(|o| is_finite[**o]))
                    .map(|o| (square_distance(x, *own, *o), *o))
                    .collect();
                near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                pairs.extend(near.iter().take(NEAREST).map(|(_, o)| [*own, *o]));
            }
            pairs
        });
        pairs.concat()
    }
}

fn square_distance(x: ArrayView2<'_, f64>, a: usize, b: usize) -> f64 {
    (x.row(a).iter().zip(x.row(b)))
        .map(|(a, b)| (a - b).powi(2))
        .sum()
}

/// The mean scatter of the differences of pairs of rows (d, d); 0 without pairs.
pub(super) fn scatter_of_pairs(x: ArrayView2<'_, f64>, pairs: &[[usize; 2]]) -> Array2<f64> {
    let differences = Array2::from_shape_fn((pairs.len(), x.ncols()), |(k, j)| {
        x[[pairs[k][0], j]] - x[[pairs[k][1], j]]
    });
    crate::numeric::product::gram(differences.view()) / pairs.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_around_a_pair_are_matched_by_their_nearest() {
        let frame = |take, frame| FrameRef { take, frame };
        let pairs = [LabeledPair {
            ends: [frame(0, 10), frame(1, 12)],
            is_alike: true,
        }];
        let links = Links::new(&pairs, &[21, 40], &[10.0, 10.0], 1.0);
        let frames = links.frames();
        assert_eq!(frames.len(), 21 + 21);
        // Take 1 does the same 3 frames later.
        let x = Array2::from_shape_fn((frames.len(), 1), |(k, _)| {
            frames[k].frame as f64 - 3.0 * frames[k].take as f64
        });
        let near = links.pair(&frames, x.view());
        for [a, b] in &near {
            assert_ne!(frames[*a].take, frames[*b].take);
        }
        let of = |own: FrameRef| {
            let row = frames.binary_search(&own).unwrap();
            let first = near
                .iter()
                .find(|[a, _]| *a == row)
                .map(|[_, b]| frames[*b]);
            first.unwrap()
        };
        assert_eq!(of(frame(0, 9)), frame(1, 12));
        assert!(scatter_of_pairs(x.view(), &near)[[0, 0]] > 0.0);
        let one_take = [LabeledPair {
            ends: [frame(0, 10), frame(0, 18)],
            is_alike: true,
        }];
        let links = Links::new(&one_take, &[40], &[10.0], 1.0);
        let frames = links.frames();
        assert_eq!(frames.len(), 5 + 5);
        let x = Array2::from_shape_fn((frames.len(), 1), |(k, _)| frames[k].frame as f64);
        let found = links.pair(&frames, x.view());
        assert!((found.iter()).all(|[a, b]| frames[*a].frame.abs_diff(frames[*b].frame) >= 4));
        let only = Links::new(&pairs, &[21, 40], &[10.0, 10.0], 0.0);
        let frames = only.frames();
        assert_eq!(frames, [frame(0, 10), frame(1, 12)]);
        let both = only.pair(&frames, Array2::zeros((2, 1)).view());
        assert_eq!(both, [[0, 1], [1, 0]]);
    }
}

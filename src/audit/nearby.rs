//! Pairs of points that may go together. Of many points, those that are near each other in some frame: what goes together is near.

use super::Take;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// Up to this number of points, each is compared with all others.
const FEW: usize = 500;
/// Frames in which points are near, and how many are, the point itself among them.
const FRAMES: usize = 4;
const NEAREST: NonZero<usize> = NonZero::new(9).unwrap();

/// The pairs, the smaller number first, in order.
pub fn pairs(take: &Take<'_>) -> Vec<(usize, usize)> {
    let points = take.points.len();
    if points <= FEW {
        let later = |a: usize| (a + 1..points).map(move |b| (a, b));
        return (0..points).flat_map(later).collect();
    }
    let middle = |k: usize| (2 * k + 1) * take.xyz.nrows() / (2 * FRAMES);
    let mut pairs: Vec<(usize, usize)> = (0..FRAMES)
        .map(middle)
        .flat_map(|frame| near_in(take, frame))
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The pairs that are near each other in a frame.
fn near_in(take: &Take<'_>, frame: usize) -> Vec<(usize, usize)> {
    let seen: Vec<(usize, [f64; 3])> = (0..take.points.len())
        .filter_map(|p| Some((p, take.at(frame, p)?.to_array())))
        .collect();
    let places: Vec<[f64; 3]> = seen.iter().map(|s| s.1).collect();
    if places.is_empty() {
        return Vec::new();
    }
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&places);
    let mut out = Vec::new();
    for (point, at) in &seen {
        let near = tree.nearest_n::<SquaredEuclidean>(at, NEAREST);
        let others = near.iter().map(|n| seen[n.item as usize].0);
        let others = others.filter(|other| other != point);
        out.extend(others.map(|other| (*point.min(&other), *point.max(&other))));
    }
    out
}

//! Pairs of points that may go together. Where there are many points, these are near each other in
//! some frame: what goes together is near.

use super::Take;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// Up to this number of points, each is compared with all others.
const FEW: usize = 500;
/// Frames in which points are near, and how many are, the point itself among them.
const FRAMES: usize = 4;
const NEAREST: NonZero<usize> = NonZero::new(9).unwrap();

/// The pairs, the smaller number first, in order.
pub(crate) fn pairs(take: &Take<'_>) -> Vec<(usize, usize)> {
    let points = take.points.len();
    if points <= FEW {
        let later = |a: usize| (a + 1..points).map(move |b| (a, b));
        return (0..points).flat_map(later).collect();
    }
    let middle = |k: usize| (2 * k + 1) * take.xyz.nrows() / (2 * FRAMES);
    let mut frames: Vec<usize> = (0..FRAMES).map(middle).collect();
    // A point that none of these show is looked for in the middle of the frames that do.
    for point in 0..points {
        if !frames.iter().any(|&t| take.at(t, point).is_some()) {
            let shows = |t: &usize| take.at(*t, point).is_some();
            let seen: Vec<usize> = (0..take.xyz.nrows()).filter(shows).collect();
            frames.extend(seen.get(seen.len() / 2));
        }
    }
    let near = frames.iter().flat_map(|&frame| near_in(take, frame));
    let mut pairs: Vec<(usize, usize)> = near.collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The pairs that are near each other in a frame.
fn near_in(take: &Take<'_>, frame: usize) -> Vec<(usize, usize)> {
    let seen: Vec<(usize, [f64; 3])> = (0..take.points.len())
        .filter_map(|p| Some((p, take.at(frame, p)?.to_array())))
        .collect();
    let positions: Vec<[f64; 3]> = seen.iter().map(|s| s.1).collect();
    if positions.is_empty() {
        return Vec::new();
    }
    let tree: ImmutableKdTree<f64, 3> = ImmutableKdTree::new_from_slice(&positions);
    let mut out = Vec::new();
    for (point, at) in &seen {
        let near = tree.nearest_n::<SquaredEuclidean>(at, NEAREST);
        let others = near.iter().map(|n| seen[n.item as usize].0);
        let others = others.filter(|other| other != point);
        out.extend(others.map(|other| (*point.min(&other), *point.max(&other))));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, s};

    #[test]
    fn points_that_are_seen_for_a_moment_have_pairs() {
        let mut xyz = Array2::from_shape_fn((100, 3 * 600), |(_, c)| match c % 3 {
            0 => 10.0 * (c / 3) as f64,
            _ => 0.0,
        });
        xyz.slice_mut(s![..3, 15..21]).fill(f64::NAN);
        xyz.slice_mut(s![6.., 15..21]).fill(f64::NAN);
        let points: Vec<String> = (0..600).map(|p| format!("p{p}")).collect();
        let take = Take {
            points: &points,
            xyz: xyz.view(),
            with_zeros: xyz.view(),
            time: None,
            runs: std::iter::once(0..100).collect(),
            rate: None,
            are_joints: false,
        };
        let pairs = pairs(&take);
        for pair in [(4, 5), (5, 6), (100, 101)] {
            assert!(pairs.contains(&pair), "{pair:?}");
        }
    }
}

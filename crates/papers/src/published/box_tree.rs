//! Exact nearest neighbors under any weighted distance over any subset of the coordinates, by a
//! tree of boxes.
//!
//! The distance is d²(y, x) = Σ_o w_o (y_o − x_o)²: a weight of 0 leaves a coordinate out, so a
//! pose with missing points is looked up as easily as a whole one. A tree of balls under one metric
//! could not serve another; boxes can: where the poses of a node lie within [lo, hi], Σ_o w_o
//! max(lo_o − y_o, 0, y_o − hi_o)² is a lower bound whatever the weights.
//!
//! Dense noise spoils boxes along the coordinates, as it lies across all of them while poses do
//! not: the bound forgives a little of it in each. When all weights are equal, distances are the
//! same in any rotated frame, and boxes along the poses' principal axes count the noise across the
//! poses in full. So both boxes are kept.
//!
//! Cost: building O(n log n D) and one product of (n, D) with (D, D); a search O(D log n) where few
//! nodes overlap, and at worst (queries far from all poses) that of a scan.

use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::statistics::span;
use crate::pose::PoseTransform;
use ndarray::{Array2, ArrayView2, s};
use std::collections::BinaryHeap;

/// Largest number of poses in a leaf: scanning them costs about as much as bounding their node.
const LEAF: usize = 16;
/// Relative slack put on bounds: far above the rounding of f64 sums, far below what matters.
const SLACK: f64 = 1e-9;
/// Slack of bounds along the principal axes, relative to the largest coordinate.
const ROUNDING: f64 = 1e-12;
/// Largest number of poses from which the principal axes are computed.
const MEASURED: usize = 20_000;

/// A pose found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Neighbor {
    /// Its row in [`BoxTree::poses`].
    pub index: u32,
    /// Σ_o w_o (y_o − x_o)².
    pub squared: f64,
}

impl Eq for Neighbor {}

impl Ord for Neighbor {
    /// By distance, then by row: no two poses rank the same, so that any search finds the same
    /// ones.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.squared
            .total_cmp(&other.squared)
            .then(self.index.cmp(&other.index))
    }
}

impl PartialOrd for Neighbor {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// Poses, and the tree they are found by.
#[derive(Debug, Clone)]
pub(crate) struct BoxTree {
    /// (n, D), so that near ones stand together: the leaves' poses are rows that follow one
    /// another.
    poses: Array2<f32>,
    /// Unit principal axes in columns, the longest first: (D, D).
    axes: Array2<f64>,
    nodes: Vec<Node>,
    /// Two rows per node, the least and the greatest of each coordinate: (2 nodes, D).
    boxes: Array2<f64>,
    /// The boxes along the principal axes: (2 nodes, D).
    turned: Array2<f64>,
    /// The greatest number in `turned`.
    reach: f64,
}

/// A run of poses; the first child follows its parent.
#[derive(Debug, Clone)]
struct Node {
    first: u32,
    end: u32,
    /// The second child; 0 for a leaf.
    second: u32,
}

/// One search.
struct Query<'a> {
    tree: &'a BoxTree,
    /// The observed: coordinate, weight, value.
    terms: Vec<(usize, f64, f64)>,
    /// What nodes are bounded by: the same terms, or those along the axes.
    bounding: Vec<(usize, f64, f64)>,
    boxes: &'a Array2<f64>,
    k: usize,
    /// How far rounding may put a pose outside its box.
    slack: f64,
    /// No pose farther than this is among the answers.
    limit: f64,
    found: BinaryHeap<Neighbor>,
}

impl BoxTree {
    /// Builds the tree of `poses` (n, D), which are re-ordered.
    pub(crate) fn new(poses: ArrayView2<'_, f32>) -> BoxTree {
        let (n, d) = poses.dim();
        let axes = principal_axes(poses);
        let along = poses.mapv(f64::from).dot(&axes);
        let mut order: Vec<u32> = (0..n as u32).collect();
        let mut nodes = Vec::new();
        if n > 0 {
            split(&along, &mut order, 0, &mut nodes);
        }
        let rows: Vec<usize> = order.iter().map(|i| *i as usize).collect();
        let poses = poses.select(ndarray::Axis(0), &rows);
        let along = along.select(ndarray::Axis(0), &rows);
        let mut tree = BoxTree {
            boxes: Array2::zeros((2 * nodes.len(), d)),
            turned: Array2::zeros((2 * nodes.len(), d)),
            reach: along.iter().fold(0.0, |m: f64, v| m.max(v.abs())),
            poses,
            axes,
            nodes,
        };
        for (i, node) in tree.nodes.iter().enumerate() {
            let rows = node.first as usize..node.end as usize;
            for row in rows {
                let pose = tree.poses.row(row);
                widen(&mut tree.boxes, i, row == node.first as usize, |c| {
                    f64::from(pose[c])
                });
                let pose = along.row(row);
                widen(&mut tree.turned, i, row == node.first as usize, |c| pose[c]);
            }
        }
        tree
    }

    /// The poses, in the tree's order: (n, D).
    pub(crate) fn poses(&self) -> ArrayView2<'_, f32> {
        self.poses.view()
    }

    /// The tree of the same poses carried through `map`.
    pub(crate) fn mapped(&self, map: &PoseTransform) -> BoxTree {
        let poses = map.apply_rows(self.poses.mapv(f64::from).view());
        BoxTree::new(poses.mapv(|v| v as f32).view())
    }

    /// The `k` nearest (all when there are fewer), nearest first; `weights` of 0 or less leave
    /// coordinates out, whose `y` is not read.
    pub(crate) fn nearest(&self, y: &[f64], weights: &[f64], k: usize) -> Vec<Neighbor> {
        let k = k.min(self.poses.nrows());
        if k == 0 {
            return Vec::new();
        }
        let terms: Vec<(usize, f64, f64)> = weights
            .iter()
            .zip(y)
            .enumerate()
            .filter(|(_, (w, _))| **w > 0.0)
            .map(|(c, (w, y))| (c, *w, *y))
            .collect();
        let even = terms.len() == self.poses.ncols() && terms.iter().all(|t| t.1 == terms[0].1);
        let (bounding, boxes, slack) = if even {
            let norm: f64 = terms.iter().map(|t| t.2 * t.2).sum();
            let slack = ROUNDING * (self.reach + norm.sqrt());
            (self.along_axes(&terms), &self.turned, slack)
        } else {
            (terms.clone(), &self.boxes, 0.0)
        };
        let mut query = Query {
            tree: self,
            limit: f64::INFINITY,
            found: BinaryHeap::with_capacity(k + 1),
            terms,
            bounding,
            boxes,
            slack,
            k,
        };
        query.descend(0, query.bound(0));
        query.found.into_sorted_vec()
    }

    fn along_axes(&self, terms: &[(usize, f64, f64)]) -> Vec<(usize, f64, f64)> {
        let y: ndarray::Array1<f64> = terms.iter().map(|t| t.2).collect();
        let weight = terms.first().map_or(0.0, |t| t.1);
        let turned = y.dot(&self.axes).into_iter().enumerate();
        turned.map(|(c, v)| (c, weight, v)).collect()
    }
}

impl Query<'_> {
    /// No pose of the node is nearer than this.
    fn bound(&self, node: usize) -> f64 {
        let (low, high) = (self.boxes.row(2 * node), self.boxes.row(2 * node + 1));
        let mut sum = 0.0;
        for &(c, w, y) in &self.bounding {
            let outside = ((low[c] - y).max(y - high[c]) - self.slack).max(0.0);
            sum += w * outside * outside;
        }
        sum * (1.0 - SLACK)
    }

    fn distance(&self, row: usize) -> f64 {
        let pose = self.tree.poses.row(row);
        let squares = self.terms.iter().map(|&(c, w, y)| {
            let d = y - f64::from(pose[c]);
            w * d * d
        });
        squares.sum()
    }

    fn descend(&mut self, node: usize, bound: f64) {
        // `!(a > b)`: a bound that is not a number keeps its node.
        if bound > self.limit {
            return;
        }
        let Node { first, end, second } = self.tree.nodes[node];
        if second == 0 {
            for row in first..end {
                let squared = self.distance(row as usize);
                self.offer(Neighbor {
                    index: row,
                    squared,
                });
            }
            return;
        }
        let (a, b) = (node + 1, second as usize);
        let (of_a, of_b) = (self.bound(a), self.bound(b));
        if of_b < of_a {
            self.descend(b, of_b);
            self.descend(a, of_a);
        } else {
            self.descend(a, of_a);
            self.descend(b, of_b);
        }
    }

    fn offer(&mut self, near: Neighbor) {
        if near.squared > self.limit {
            return;
        }
        self.found.push(near);
        if self.found.len() > self.k {
            self.found.pop();
        }
        if self.found.len() == self.k
            && let Some(worst) = self.found.peek()
        {
            self.limit = self.limit.min(worst.squared);
        }
    }
}

/// Halves `order` along the axis of the widest spread until leaves are left; `first` is where it
/// starts in the whole.
fn split(along: &Array2<f64>, order: &mut [u32], first: usize, nodes: &mut Vec<Node>) {
    let node = nodes.len();
    nodes.push(Node {
        first: first as u32,
        end: (first + order.len()) as u32,
        second: 0,
    });
    if order.len() <= LEAF {
        return;
    }
    let spread = |c: usize| span(order.iter().map(|i| along[[*i as usize, c]]));
    let widest = (0..along.ncols())
        .map(|c| (spread(c), c))
        .fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a })
        .1;
    let middle = order.len() / 2;
    if along.ncols() > 0 {
        order.select_nth_unstable_by(middle, |a, b| {
            let value = |i: &u32| along[[*i as usize, widest]];
            value(a).total_cmp(&value(b)).then(a.cmp(b))
        });
    }
    let (left, right) = order.split_at_mut(middle);
    split(along, left, first, nodes);
    nodes[node].second = nodes.len() as u32;
    split(along, right, first + middle, nodes);
}

/// Widens the box of a node to hold one more pose.
fn widen(boxes: &mut Array2<f64>, node: usize, first: bool, value: impl Fn(usize) -> f64) {
    for c in 0..boxes.ncols() {
        let v = value(c);
        let (low, high) = if first {
            (v, v)
        } else {
            let (low, high) = (boxes[[2 * node, c]], boxes[[2 * node + 1, c]]);
            (low.min(v), high.max(v))
        };
        boxes[[2 * node, c]] = low;
        boxes[[2 * node + 1, c]] = high;
    }
}

/// Unit eigenvectors of the poses' covariance in columns, the greatest first; the coordinates' own
/// axes where there are none (no poses, numbers that are not finite).
fn principal_axes(poses: ArrayView2<'_, f32>) -> Array2<f64> {
    let (n, d) = poses.dim();
    let step = n.div_ceil(MEASURED).max(1);
    let some = poses.slice(s![..;step, ..]).mapv(f64::from);
    let Some(mean) = some.mean_axis(ndarray::Axis(0)) else {
        return Array2::eye(d);
    };
    let centered = some - &mean;
    match symmetric_eigen(&centered.t().dot(&centered)) {
        Some((_, vectors)) => vectors.slice(s![.., ..;-1]).to_owned(),
        None => Array2::eye(d),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use proptest::prelude::*;
    use rand::Rng;

    /// Poses along a few curves, with copies among them.
    fn curves(n: usize, d: usize, seed: u64) -> Array2<f32> {
        let mut g = parallel::rng(seed, 0);
        let mut poses = Array2::from_shape_fn((n, d), |(t, c)| {
            let (curve, t) = (t % 3, (t / 3) as f64 * 0.1);
            (10.0 * (t + (c * (curve + 1)) as f64).sin() + g.random_range(-0.1..0.1)) as f32
        });
        if n > 4 {
            let row = poses.row(1).to_owned();
            poses.row_mut(4).assign(&row);
        }
        poses
    }

    fn brute(tree: &BoxTree, y: &[f64], w: &[f64], k: usize) -> Vec<Neighbor> {
        let mut all: Vec<Neighbor> = (0..tree.poses.nrows())
            .map(|i| Neighbor {
                index: i as u32,
                squared: (0..y.len())
                    .filter(|c| w[*c] > 0.0)
                    .map(|c| (w[c], y[c] - f64::from(tree.poses[[i, c]])))
                    .map(|(w, d)| w * d * d)
                    .sum(),
            })
            .collect();
        all.sort_unstable();
        all.truncate(k);
        all
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            failure_persistence: None,
            ..ProptestConfig::with_cases(200)
        })]
        #[test]
        fn the_tree_finds_what_a_scan_finds(
            n in 0usize..400, k in 0usize..40, seed: u64, mode in 0usize..4, noise in 0.0f64..6.0,
        ) {
            let d = 9;
            let tree = BoxTree::new(curves(n, d, seed).view());
            let mut g = parallel::rng(seed, 1);
            for _ in 0..3 {
                let mut y: Vec<f64> = (0..d).map(|c| {
                    let at = if n > 0 { f64::from(tree.poses[[n / 2, c]]) } else { 0.0 };
                    at + noise * g.random_range(-1.0..1.0)
                }).collect();
                let weights: Vec<f64> = (0..d).map(|_| match mode {
                    0 => 1.0,
                    1 => f64::from(g.random_range(0..2)),
                    2 => g.random_range(-0.5..2.0),
                    _ => 0.0,
                }).collect();
                (0..d).filter(|c| weights[*c] <= 0.0).for_each(|c| y[c] = f64::NAN);
                let found = tree.nearest(&y, &weights, k);
                prop_assert_eq!(&found, &brute(&tree, &y, &weights, k));
            }
        }
    }
}

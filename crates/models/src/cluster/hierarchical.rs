//! A tree of clusters, for large k.
//!
//! Nistér and Stewénius, Scalable recognition with a vocabulary tree, 2006. They split every node
//! into B down to a fixed depth; here the leaf with the largest inertia is split next, until there
//! are K: the same cost where the leaves are alike, and a lower inertia where they are not.
//!
//! A split costs k-means of the leaf's poses only. With halves of about equal size all splits
//! together cost n B log K distances an iteration; at worst (every split cuts off an outlier) n K,
//! which is what flat k-means costs.

use super::clustering::{Clustering, KMeansProgress};
use super::dataset::Dataset;
use super::lloyd::best_run;
use super::parameters::KMeans;
use super::update::{ClusterMembers, distances};
use ndarray::{Array2, ArrayView1};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// A node while the tree grows.
struct GrowingNode {
    centroid: Vec<f64>,
    /// Its poses, ascending; empty once it is split.
    members: Vec<u32>,
    inertia: f64,
    /// Its children among the nodes.
    children: Range<usize>,
}

/// Grows a tree of `parameters.k` leaves, fewer when there are not so many different poses.
///
/// The last split makes as many children as are still wanted, so that k is met whatever B is.
pub(super) fn grow(
    poses: Dataset<'_>,
    parameters: &KMeans,
    branch: usize,
    observer: &mut dyn FnMut(&KMeansProgress),
) -> Clustering {
    let (mean, variance) = poses.moments();
    let inertia = variance * (poses.n * poses.d) as f64;
    let members = (0..poses.n as u32).collect();
    let mut nodes = vec![GrowingNode {
        centroid: mean,
        members,
        inertia,
        children: 0..0,
    }];
    let (mut leaves, mut iterations, mut converged) = (1, 0, true);
    // Not negative, so the order of the bits is that of the numbers; on a tie the older node first.
    let entry = |i: usize, inertia: f64| (inertia.to_bits(), Reverse(i));
    let mut heap = BinaryHeap::from([entry(0, inertia)]);
    while let Some((_, Reverse(i))) = heap.pop().filter(|_| leaves < parameters.k) {
        let k = branch
            .min(parameters.k - leaves + 1)
            .min(nodes[i].members.len());
        if k < 2 {
            continue;
        }
        let members = std::mem::take(&mut nodes[i].members);
        let (found, squares) = split(poses, &members, &KMeans { k, ..*parameters }, i, observer);
        if found.sizes.len() < 2 {
            // All its poses are the same: a leaf for good.
            nodes[i].members = members;
            continue;
        }
        let first = nodes.len();
        let groups = ClusterMembers::new(&found.labels, found.sizes.len());
        for (j, centroid) in found.centroids.rows().into_iter().enumerate() {
            let own = groups.members(j);
            let inertia = own.iter().map(|&at| squares[at as usize]).sum();
            heap.push(entry(nodes.len(), inertia));
            nodes.push(GrowingNode {
                centroid: centroid.to_vec(),
                members: own.iter().map(|&at| members[at as usize]).collect(),
                inertia,
                children: 0..0,
            });
        }
        nodes[i].children = first..nodes.len();
        leaves += found.sizes.len() - 1;
        iterations += found.iterations;
        converged &= found.converged;
        observer(&KMeansProgress::Split { leaves });
    }
    gather(&nodes, poses, iterations, converged)
}

/// The leaves of the tree as clusters, numbered from left to right.
fn gather(
    nodes: &[GrowingNode],
    poses: Dataset<'_>,
    iterations: usize,
    converged: bool,
) -> Clustering {
    let mut leaves = Vec::new();
    let mut stack = vec![0];
    while let Some(i) = stack.pop() {
        if nodes[i].children.is_empty() {
            leaves.push(&nodes[i]);
        }
        stack.extend(nodes[i].children.clone().rev());
    }
    let mut labels = vec![0; poses.n];
    let mut centroids = Array2::zeros((leaves.len(), poses.d));
    for (leaf, node) in leaves.iter().enumerate() {
        for &i in &node.members {
            labels[i as usize] = leaf as u32;
        }
        centroids
            .row_mut(leaf)
            .assign(&ArrayView1::from(&node.centroid));
    }
    Clustering {
        centroids,
        labels,
        sizes: leaves.iter().map(|node| node.members.len()).collect(),
        inertia: leaves.iter().map(|node| node.inertia).sum(),
        iterations,
        converged,
    }
}

/// k-means of some of the poses, and their squared distances to their centroids.
fn split(
    poses: Dataset<'_>,
    members: &[u32],
    parameters: &KMeans,
    stream: usize,
    observer: &mut dyn FnMut(&KMeansProgress),
) -> (Clustering, Vec<f64>) {
    let mut copied = Vec::new();
    let own = poses.subset(members, &mut copied);
    let found = best_run(own, parameters, stream as u64, observer);
    let squares = distances(own, found.centroids.view(), &found.labels);
    (found, squares)
}

#[cfg(test)]
mod tests {
    use super::super::testdata::{blobs, noise, repeated};
    use super::*;

    fn tree_of(table: &Array2<f32>, k: usize, branch: usize) -> Clustering {
        let parameters = KMeans {
            k,
            branch: Some(branch),
            ..KMeans::default()
        };
        parameters.fit(table.view()).unwrap()
    }

    #[test]
    fn leaves_number_k_and_hold_every_pose() {
        let tables = [
            noise(900, 69, 1),
            blobs(900, 4, 30, 2),
            repeated(&noise(70, 3, 3), 5),
        ];
        for table in tables {
            for (k, branch) in [(1, 2), (2, 2), (3, 2), (10, 3), (64, 4), (65, 8), (70, 50)] {
                let found = tree_of(&table, k, branch);
                let centroids = found.centroids.view();
                let poses = table.as_standard_layout();
                let poses = Dataset::check(&poses).unwrap();
                let squares = distances(poses, centroids, &found.labels);
                let total: f64 = squares.iter().sum();
                assert!((total - found.inertia).abs() <= 1e-9 * total + 1e-12);
                assert_eq!(found.sizes, ClusterMembers::new(&found.labels, k).sizes());
                assert_eq!((found.sizes.len(), centroids.nrows()), (k, k));
                assert!(found.sizes.iter().all(|&s| s > 0));
            }
        }
    }

    #[test]
    fn a_tree_of_one_level_is_flat() {
        let table = noise(500, 5, 8);
        let flat = KMeans {
            k: 12,
            ..KMeans::default()
        };
        let flat = flat.fit(table.view()).unwrap();
        let tree = tree_of(&table, 12, 12);
        assert_eq!((flat.labels, flat.centroids), (tree.labels, tree.centroids));
    }

    #[test]
    fn more_leaves_less_inertia() {
        let table = blobs(2000, 7, 60, 9);
        let ends: Vec<f64> = [1, 5, 20, 60]
            .iter()
            .map(|&k| tree_of(&table, k, 4).inertia)
            .collect();
        assert!(ends.windows(2).all(|w| w[1] < w[0]), "{ends:?}");
    }
}

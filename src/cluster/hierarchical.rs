//! A tree of clusters: for large k, and for finding a pose's cluster in about B log K distances.
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
use super::tree::Tree;
use super::update::{ClusterMembers, distances};
use ndarray::Array2;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
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
    let (tree, order) = level_by_level(&nodes);
    let mut grown = Clustering {
        centroids: Array2::zeros((leaves, poses.d)),
        labels: vec![0; poses.n],
        sizes: vec![0; leaves],
        inertia: 0.0,
        iterations,
        converged,
        tree: None,
    };
    for (leaf, &grown_from) in tree
        .nodes()
        .iter()
        .zip(&order)
        .filter(|(n, _)| n.children.is_empty())
    {
        let (leaf, node) = (leaf.leaves.start, &nodes[grown_from]);
        node.members
            .iter()
            .for_each(|&i| grown.labels[i as usize] = leaf as u32);
        grown.sizes[leaf] = node.members.len();
        grown.inertia += node.inertia;
        grown
            .centroids
            .row_mut(leaf)
            .iter_mut()
            .zip(&node.centroid)
            .for_each(|(to, c)| *to = *c);
    }
    Clustering {
        tree: Some(tree),
        ..grown
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

/// The tree with its nodes numbered level by level, and for each of them the index in `nodes`.
fn level_by_level(nodes: &[GrowingNode]) -> (Tree, Vec<usize>) {
    let (mut order, mut children) = (Vec::with_capacity(nodes.len()), Vec::new());
    let mut queue = VecDeque::from([0]);
    let mut next = 1;
    while let Some(i) = queue.pop_front() {
        let count = nodes[i].children.len();
        order.push(i);
        children.push(next..next + count);
        next += count;
        queue.extend(nodes[i].children.clone());
    }
    let mut centroids = Array2::zeros((nodes.len(), nodes[0].centroid.len()));
    for (mut row, &i) in centroids.rows_mut().into_iter().zip(&order) {
        row.iter_mut()
            .zip(&nodes[i].centroid)
            .for_each(|(to, c)| *to = *c);
    }
    let tree =
        Tree::from_parts(centroids, children).expect("every node but the root has one parent");
    (tree, order)
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
    fn leaves_number_k_and_descending_finds_them() {
        let tables = [
            noise(900, 69, 1),
            blobs(900, 4, 30, 2),
            repeated(&noise(70, 3, 3), 5),
        ];
        for table in tables {
            for (k, branch) in [(1, 2), (2, 2), (3, 2), (10, 3), (64, 4), (65, 8), (70, 50)] {
                let found = tree_of(&table, k, branch);
                let tree = found.tree.as_ref().unwrap();
                assert_eq!((tree.leaves(), found.centroids.nrows()), (k, k));
                let (labels, squares) = tree.assign(table.view()).unwrap();
                assert_eq!(labels, found.labels);
                let total: f64 = squares.iter().sum();
                assert!((total - found.inertia).abs() <= 1e-9 * total + 1e-12);
                assert_eq!(found.sizes, ClusterMembers::new(&labels, k).sizes());
                assert!(found.sizes.iter().all(|&s| s > 0));
                assert!(tree.nodes().iter().all(|n| n.children.len() <= branch));
                for (i, node) in tree.nodes().iter().enumerate() {
                    if node.children.is_empty() {
                        let leaf = node.leaves.start;
                        assert_eq!(node.leaves.len(), 1);
                        assert_eq!(tree.centroids().row(i), found.centroids.row(leaf));
                    } else {
                        let mut next = node.leaves.start;
                        for child in node.children.clone() {
                            assert_eq!(tree.nodes()[child].leaves.start, next);
                            next = tree.nodes()[child].leaves.end;
                        }
                        assert_eq!(next, node.leaves.end);
                    }
                }
                let leaf = tree.descend(table.row(5)).unwrap();
                assert_eq!(leaf, found.labels[5] as usize);
                let children = tree.nodes().iter().map(|n| n.children.clone()).collect();
                let again = Tree::from_parts(tree.centroids().to_owned(), children).unwrap();
                assert_eq!(&again, tree);
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

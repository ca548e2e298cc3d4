//! A tree of clusters: for large k, and for finding a pose's cluster in about B log K distances.
//!
//! Nistér and Stewénius, Scalable recognition with a vocabulary tree, 2006. They split every node
//! into B down to a fixed depth; here the leaf with the largest inertia is split next, until there
//! are K: the same cost where the leaves are alike, and a lower inertia where they are not.
//!
//! A split costs k-means of the leaf's poses only. With halves of about equal size all splits
//! together cost n B log K distances an iteration; at worst (every split cuts off an outlier) n K,
//! which is what flat k-means costs.

use super::dataset::{Dataset, NearestCentroid, exact_nearest};
use super::kmeans::{Clustering, Report, best_run};
use super::parameters::Parameters;
use super::update::{ClusterMembers, distances};
use crate::numeric::parallel;
use crate::{Error, Result};
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::ops::Range;

/// A tree of clusters. Node 0 is the root; the nodes are numbered level by level, so that the
/// children of each stand side by side, after those of the node before it.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree {
    centroids: Array2<f64>,
    nodes: Vec<Node>,
}

/// A node of a [`Tree`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// Its children among the nodes; empty for a leaf.
    pub children: Range<usize>,
    /// The leaves below it, numbered from left to right; of a leaf its own number alone.
    pub leaves: Range<usize>,
}

impl Tree {
    /// A tree from the centroids of its nodes (nodes, d) and the children of each (nodes), as
    /// [`Tree::centroids`] and [`Node::children`] tell them; for reading one back from a file.
    ///
    /// # Errors
    /// Usage: not a tree in the order described at [`Tree`].
    pub fn from_parts(centroids: Array2<f64>, children: Vec<Range<usize>>) -> Result<Tree> {
        let count = children.len();
        let mut next = 1;
        let ordered = children.iter().enumerate().all(|(i, range)| {
            let fits = range.is_empty() || range.start == next && range.start > i;
            if !range.is_empty() {
                next = range.end;
            }
            fits
        });
        if count == 0 || !ordered || next != count || centroids.nrows() != count {
            return Err(Error::usage(
                "a tree of clusters whose nodes do not fit together",
            ));
        }
        // Children come after their parents: leaves are counted backwards, numbered forwards.
        let mut below = vec![1usize; count];
        for i in (0..count).rev().filter(|&i| !children[i].is_empty()) {
            below[i] = children[i].clone().map(|child| below[child]).sum();
        }
        let mut first = vec![0usize; count];
        for (i, range) in children.iter().enumerate() {
            let mut leaf = first[i];
            for child in range.clone() {
                first[child] = leaf;
                leaf += below[child];
            }
        }
        let leaves = first.iter().zip(&below).map(|(&f, &b)| f..f + b);
        let nodes = children.into_iter().zip(leaves);
        let nodes = nodes
            .map(|(children, leaves)| Node { children, leaves })
            .collect();
        Ok(Tree {
            centroids: centroids.as_standard_layout().into_owned(),
            nodes,
        })
    }

    /// Centroids of the nodes, (nodes, d).
    pub fn centroids(&self) -> ArrayView2<'_, f64> {
        self.centroids.view()
    }

    /// The nodes.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Number of leaves.
    pub fn leaves(&self) -> usize {
        self.nodes[0].leaves.len()
    }

    /// The leaf of a pose (d): from the root always to the child with the nearest centroid, the first on a tie.
    ///
    /// That need not be the leaf with the nearest centroid of all, which [`super::assign`] finds; for a
    /// pose the tree was grown from it is its label.
    ///
    /// # Errors
    /// Usage: a pose of another width. Data: a pose that is not finite (place: file `poses`, line 1).
    pub fn descend(&self, pose: ArrayView1<'_, f32>) -> Result<usize> {
        let row = pose.insert_axis(ndarray::Axis(0));
        Ok(self.assign(row)?.0[0] as usize)
    }

    /// [`Tree::descend`] for each pose (n, d): leaves (n) and squared distances to their centroids (n).
    ///
    /// # Errors
    /// Usage: poses of another width. Data: a pose that is not finite, its place naming the file
    /// `poses` and, as line, the row counted from 1.
    pub fn assign(&self, poses: ArrayView2<'_, f32>) -> Result<(Vec<u32>, Vec<f64>)> {
        let d = self.centroids.ncols();
        if poses.ncols() != d {
            return Err(Error::usage(format!(
                "poses of {} columns, a tree of {d}",
                poses.ncols()
            )));
        }
        let table = poses.as_standard_layout();
        let poses = Dataset::check(&table)?;
        let found = parallel::map_chunks(poses.n, 1024, |rows| {
            rows.map(|i| self.walk(poses.row(i))).collect::<Vec<_>>()
        });
        Ok(found
            .into_iter()
            .flatten()
            .map(|near| (near.label, near.squared))
            .unzip())
    }

    /// The leaf of one pose, by number.
    fn walk(&self, pose: &[f32]) -> NearestCentroid {
        let rows = self.centroids.as_slice().unwrap_or_default();
        let row = |i: usize| (i as u32, &rows[i * pose.len()..(i + 1) * pose.len()]);
        let mut near = exact_nearest(pose, std::iter::once(row(0)));
        loop {
            let node = &self.nodes[near.label as usize];
            if node.children.is_empty() {
                return NearestCentroid {
                    label: node.leaves.start as u32,
                    ..near
                };
            }
            near = exact_nearest(pose, node.children.clone().map(row));
        }
    }
}

/// A node while the tree grows.
struct GrowingNode {
    centroid: Vec<f64>,
    /// Its poses, ascending; empty once it is split.
    members: Vec<u32>,
    inertia: f64,
    /// Its children among the buds.
    children: Range<usize>,
}

/// Grows a tree of `parameters.k` leaves, fewer when there are not so many different poses.
///
/// The last split makes as many children as are still wanted, so that k is met whatever B is.
pub(super) fn grow(
    poses: Dataset<'_>,
    parameters: &Parameters,
    branch: usize,
    observer: &mut dyn FnMut(&Report),
) -> Clustering {
    let (mean, variance) = poses.moments();
    let inertia = variance * (poses.n * poses.d) as f64;
    let members = (0..poses.n as u32).collect();
    let mut buds = vec![GrowingNode {
        centroid: mean,
        members,
        inertia,
        children: 0..0,
    }];
    let (mut leaves, mut iterations, mut converged) = (1, 0, true);
    // Not negative, so the order of the bits is that of the numbers; on a tie the older bud first.
    let entry = |i: usize, inertia: f64| (inertia.to_bits(), Reverse(i));
    let mut heap = BinaryHeap::from([entry(0, inertia)]);
    while let Some((_, Reverse(i))) = heap.pop().filter(|_| leaves < parameters.k) {
        let k = branch
            .min(parameters.k - leaves + 1)
            .min(buds[i].members.len());
        if k < 2 {
            continue;
        }
        let members = std::mem::take(&mut buds[i].members);
        let (found, squares) = split(
            poses,
            &members,
            &Parameters { k, ..*parameters },
            i,
            observer,
        );
        if found.sizes.len() < 2 {
            // All its poses are the same: a leaf for good.
            buds[i].members = members;
            continue;
        }
        let first = buds.len();
        let groups = ClusterMembers::new(&found.labels, found.sizes.len());
        for (j, centroid) in found.centroids.rows().into_iter().enumerate() {
            let own = groups.members(j);
            let inertia = own.iter().map(|&at| squares[at as usize]).sum();
            heap.push(entry(buds.len(), inertia));
            buds.push(GrowingNode {
                centroid: centroid.to_vec(),
                members: own.iter().map(|&at| members[at as usize]).collect(),
                inertia,
                children: 0..0,
            });
        }
        buds[i].children = first..buds.len();
        leaves += found.sizes.len() - 1;
        iterations += found.iterations;
        converged &= found.converged;
        observer(&Report::Split { leaves });
    }
    let (tree, order) = level_by_level(&buds);
    let mut grown = Clustering {
        centroids: Array2::zeros((leaves, poses.d)),
        labels: vec![0; poses.n],
        sizes: vec![0; leaves],
        inertia: 0.0,
        iterations,
        converged,
        tree: None,
    };
    for (node, &bud) in tree
        .nodes
        .iter()
        .zip(&order)
        .filter(|(n, _)| n.children.is_empty())
    {
        let (leaf, bud) = (node.leaves.start, &buds[bud]);
        bud.members
            .iter()
            .for_each(|&i| grown.labels[i as usize] = leaf as u32);
        grown.sizes[leaf] = bud.members.len();
        grown.inertia += bud.inertia;
        grown
            .centroids
            .row_mut(leaf)
            .iter_mut()
            .zip(&bud.centroid)
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
    parameters: &Parameters,
    stream: usize,
    observer: &mut dyn FnMut(&Report),
) -> (Clustering, Vec<f64>) {
    let copied: Vec<f32>;
    let own = if members.len() == poses.n {
        poses
    } else {
        copied = members
            .iter()
            .flat_map(|&i| poses.row(i as usize))
            .copied()
            .collect();
        Dataset::trusted(&copied, poses.d)
    };
    let found = best_run(own, parameters, stream as u64, observer);
    let squares = distances(own, found.centroids.view(), &found.labels);
    (found, squares)
}

/// The tree of the buds, and for each of its nodes which bud it was.
fn level_by_level(buds: &[GrowingNode]) -> (Tree, Vec<usize>) {
    let (mut order, mut children) = (Vec::with_capacity(buds.len()), Vec::new());
    let mut queue = VecDeque::from([0]);
    let mut next = 1;
    while let Some(i) = queue.pop_front() {
        let count = buds[i].children.len();
        order.push(i);
        children.push(next..next + count);
        next += count;
        queue.extend(buds[i].children.clone());
    }
    let mut centroids = Array2::zeros((buds.len(), buds[0].centroid.len()));
    for (mut row, &i) in centroids.rows_mut().into_iter().zip(&order) {
        row.iter_mut()
            .zip(&buds[i].centroid)
            .for_each(|(to, c)| *to = *c);
    }
    let tree =
        Tree::from_parts(centroids, children).expect("every bud but the root has one parent");
    (tree, order)
}

#[cfg(test)]
mod tests {
    use super::super::fit;
    use super::super::testdata::{blobs, noise, repeated};
    use super::*;

    fn tree_of(table: &Array2<f32>, k: usize, branch: usize) -> Clustering {
        let parameters = Parameters {
            k,
            branch: Some(branch),
            ..Parameters::default()
        };
        fit(table.view(), &parameters, &mut |_| ()).unwrap()
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
        let flat = Parameters {
            k: 12,
            ..Parameters::default()
        };
        let flat = fit(table.view(), &flat, &mut |_| ()).unwrap();
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

    #[test]
    fn trees_that_do_not_fit_together_are_refused() {
        let refused = |rows, children: &[(usize, usize)]| {
            let children = children.iter().map(|&(start, end)| start..end).collect();
            assert!(Tree::from_parts(Array2::zeros((rows, 2)), children).is_err());
        };
        refused(0, &[]);
        refused(2, &[(0, 0)]);
        refused(1, &[(0, 1)]);
        refused(2, &[(0, 0), (0, 0)]);
        refused(3, &[(1, 2), (1, 3), (0, 0)]);
        refused(3, &[(1, 9), (0, 0), (0, 0)]);
        refused(3, &[(2, 3), (0, 0), (0, 0)]);
        let tree = Tree::from_parts(Array2::zeros((3, 2)), vec![1..3, 0..0, 0..0]).unwrap();
        assert!(tree.assign(Array2::zeros((1, 3)).view()).is_err());
        assert!(
            tree.descend(ndarray::arr1(&[0.0, f32::NAN]).view())
                .is_err()
        );
    }
}

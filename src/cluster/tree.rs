//! A tree of cluster centroids, and the leaf of a pose in about B log K distances.

use super::dataset::{Dataset, NearestCentroid, exact_nearest};
use crate::numeric::parallel;
use crate::{Error, Result};
use ndarray::{Array2, ArrayView1, ArrayView2};
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
    /// [`Tree::centroids`] and [`Node::children`] give them; for reading a tree from a file.
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

    /// The leaf of a pose (d): from the root always to the child with the nearest centroid, the
    /// first on a tie.
    ///
    /// That need not be the leaf with the nearest centroid of all, which [`super::assign`] finds;
    /// for a pose the tree was grown from it is its label.
    ///
    /// # Errors
    /// Usage: a pose of another width. Data: a pose that is not finite (place: file `poses`, line
    /// 1).
    pub fn descend(&self, pose: ArrayView1<'_, f32>) -> Result<usize> {
        let row = pose.insert_axis(ndarray::Axis(0));
        Ok(self.assign(row)?.0[0] as usize)
    }

    /// [`Tree::descend`] for each pose (n, d): leaves (n) and squared distances to their centroids
    /// (n).
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

#[cfg(test)]
mod tests {
    use super::*;

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

//! The update step: means of clusters, and poses for those that are empty.

use super::dataset::{Dataset, add, squared_distance};
use super::squared_distances::Centroids;
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView2};
use std::collections::HashSet;

/// Members summed one after another; sums of longer clusters are folded from such pieces.
const PIECE: usize = 4096;

/// Items gathered by label, ascending within each.
pub(super) struct ClusterMembers {
    order: Vec<u32>,
    starts: Vec<usize>,
}

impl ClusterMembers {
    /// Gathers items `0..labels.len()` by label, each label below `k`: a counting sort.
    pub(crate) fn new(labels: &[u32], k: usize) -> Self {
        let mut starts = vec![0usize; k + 1];
        labels.iter().for_each(|&l| starts[l as usize + 1] += 1);
        (0..k).for_each(|j| starts[j + 1] += starts[j]);
        let mut next = starts.clone();
        let mut order = vec![0; labels.len()];
        for (i, &label) in labels.iter().enumerate() {
            order[next[label as usize]] = i as u32;
            next[label as usize] += 1;
        }
        ClusterMembers { order, starts }
    }

    /// The items of label `j`.
    pub(crate) fn members(&self, j: usize) -> &[u32] {
        &self.order[self.starts[j]..self.starts[j + 1]]
    }

    /// How many items each label has.
    pub(crate) fn sizes(&self) -> Vec<usize> {
        self.starts.windows(2).map(|w| w[1] - w[0]).collect()
    }

    /// The groups that `wanted` picks, in order, cut into pieces of at most `len` items.
    pub(crate) fn pieces(&self, len: usize, wanted: impl Fn(usize) -> bool) -> Vec<(u32, &[u32])> {
        (0..self.starts.len() - 1)
            .filter(|&j| wanted(j))
            .flat_map(|j| {
                self.members(j)
                    .chunks(len)
                    .map(move |piece| (j as u32, piece))
            })
            .collect()
    }
}

/// The means of the clusters that `wanted` picks; the other rows are taken from `centroids` (k, d),
/// as are those of empty clusters.
///
/// A mean depends on its members only, not on the path to them: a cluster that did not change need
/// not be summed again, and a pruned run meets the same centroids as a plain one.
pub(super) fn means(
    poses: Dataset<'_>,
    groups: &ClusterMembers,
    centroids: ArrayView2<'_, f64>,
    wanted: impl Fn(usize) -> bool,
) -> Array2<f64> {
    let pieces = groups.pieces(PIECE, wanted);
    let sums = parallel::map_chunks(pieces.len(), 16, |chunk| {
        let mut sums = vec![0.0; chunk.len() * poses.d];
        for (sum, (_, members)) in sums.chunks_mut(poses.d).zip(&pieces[chunk]) {
            members
                .iter()
                .for_each(|&i| add(sum, poses.row(i as usize)));
        }
        sums
    });
    let mut means = centroids.to_owned();
    pieces
        .iter()
        .for_each(|(j, _)| means.row_mut(*j as usize).fill(0.0));
    let sums = sums.iter().flat_map(|chunk| chunk.chunks(poses.d));
    for ((j, members), sum) in pieces.iter().zip(sums) {
        let mut mean = means.row_mut(*j as usize);
        mean.iter_mut().zip(sum).for_each(|(m, s)| *m += s);
        let all = groups.members(*j as usize);
        // The last piece of a group ends where the group does.
        if members.last() == all.last() {
            mean.mapv_inplace(|m| m / all.len() as f64);
        }
    }
    means
}

/// Squared distance of each pose to the centroid of its label, (n).
pub(super) fn distances(
    poses: Dataset<'_>,
    centroids: ArrayView2<'_, f64>,
    labels: &[u32],
) -> Vec<f64> {
    let all = centroids.as_slice().expect("made row by row");
    let squares = parallel::map_chunks(poses.n, 4096, |rows| {
        let centroid = |i: usize| &all[labels[i] as usize * poses.d..][..poses.d];
        rows.map(|i| squared_distance(poses.row(i), centroid(i)))
            .collect::<Vec<f64>>()
    });
    squares.concat()
}

/// At most `count` different poses, the farthest from their centroids first (on a tie the first in
/// the table), none of them on its centroid.
///
/// With `keep`, none is the last one of its cluster, `keep` giving the sizes.
pub(super) fn farthest(
    poses: Dataset<'_>,
    centroids: &Centroids,
    labels: &[u32],
    count: usize,
    mut keep: Option<Vec<usize>>,
) -> Vec<u32> {
    let squares = distances(poses, centroids.exact(), labels);
    let mut order: Vec<u32> = (0..poses.n as u32)
        .filter(|&i| squares[i as usize] > 0.0)
        .collect();
    order.sort_by(|&a, &b| squares[b as usize].total_cmp(&squares[a as usize]));
    let mut seen = HashSet::new();
    let mut chosen = Vec::new();
    for i in order {
        if chosen.len() == count {
            break;
        }
        let size = keep
            .as_mut()
            .map(|sizes| &mut sizes[labels[i as usize] as usize]);
        if size.as_ref().is_some_and(|size| **size < 2) || !seen.insert(key(poses.row(i as usize)))
        {
            continue;
        }
        if let Some(size) = size {
            *size -= 1;
        }
        chosen.push(i);
    }
    chosen
}

/// Bits that are equal for equal poses (zero has two signs).
pub(super) fn key(pose: &[f32]) -> Vec<u32> {
    pose.iter().map(|x| (x + 0.0).to_bits()).collect()
}

//! Clusters of equal size, for parts that are trained on several machines: the largest part is what
//! all wait for.
//!
//! The poses are halved again and again. A half is half of the clusters that are still to be made,
//! and as many of the poses. k-means with two clusters gives centroids a and b; then two steps
//! alternate, neither of which raises the sum of squared distances: the m poses with the least
//!
//! ```text
//! |x - a|² - |x - b|²
//! ```
//!
//! go to a, which is the best assignment of m poses to a and the others to b; a and b move to the
//! means of their poses.
//!
//! A pose may be nearer to the centroid of another cluster. Cost: n log k distances an iteration.

use super::clustering::{Clustering, KMeansProgress};
use super::dataset::{Dataset, squared_distance};
use super::lloyd::best_run;
use super::parameters::KMeans;
use super::update::{ClusterMembers, distances, means};
use crate::numeric::parallel;
use ndarray::{Array2, ArrayView2, Axis};
use std::ops::Range;

/// Clusters `poses` into `parameters.k` clusters whose sizes differ by at most 1.
pub(super) fn halve(
    poses: Dataset<'_>,
    parameters: &KMeans,
    observer: &mut dyn FnMut(&KMeansProgress),
) -> Clustering {
    let mut halving = Halving {
        poses,
        parameters,
        labels: vec![0; poses.n],
        iterations: 0,
        converged: true,
        observer,
    };
    halving.split(
        &(0..poses.n as u32).collect::<Vec<u32>>(),
        0..parameters.k,
        1,
    );
    let Halving {
        labels,
        iterations,
        converged,
        ..
    } = halving;
    let groups = ClusterMembers::new(&labels, parameters.k);
    let none = Array2::zeros((parameters.k, poses.d));
    let centroids = means(poses, &groups, none.view(), |_| true);
    Clustering {
        inertia: distances(poses, centroids.view(), &labels).iter().sum(),
        sizes: groups.sizes(),
        centroids,
        labels,
        iterations,
        converged,
    }
}

/// A clustering that is being made.
struct Halving<'a> {
    poses: Dataset<'a>,
    parameters: &'a KMeans,
    labels: Vec<u32>,
    iterations: usize,
    converged: bool,
    observer: &'a mut dyn FnMut(&KMeansProgress),
}

impl Halving<'_> {
    /// Makes the `clusters` of `members`, which are ascending. `node` counts the nodes of the tree
    /// of halves, from 1.
    fn split(&mut self, members: &[u32], clusters: Range<usize>, node: u64) {
        if clusters.len() == 1 {
            let label = clusters.start as u32;
            members
                .iter()
                .for_each(|&i| self.labels[i as usize] = label);
            (self.observer)(&KMeansProgress::Split {
                leaves: clusters.end,
            });
            return;
        }
        let middle = clusters.start + clusters.len() / 2;
        let before = |cluster: usize| cluster * self.poses.n / self.parameters.k;
        let count = before(middle) - before(clusters.start);
        let mut copied = Vec::new();
        let own = self.poses.subset(members, &mut copied);
        let halves = self.halves(own, count, node);
        drop(copied);
        let both = [clusters.start..middle, middle..clusters.end];
        for (half, clusters) in (0u32..).zip(both) {
            let own = members.iter().zip(&halves).filter(|(_, h)| **h == half);
            let own: Vec<u32> = own.map(|(i, _)| *i).collect();
            self.split(&own, clusters, 2 * node + u64::from(half));
        }
    }

    /// The half of each pose, 0 or 1; `count` poses are in the first.
    fn halves(&mut self, poses: Dataset<'_>, count: usize, node: u64) -> Vec<u32> {
        let two = KMeans {
            k: 2,
            ..*self.parameters
        };
        let found = best_run(poses, &two, node, &mut |_| ());
        if found.sizes.len() < 2 {
            // All poses are the same.
            return (0..poses.n).map(|i| u32::from(i >= count)).collect();
        }
        // The larger half is made of the larger cluster.
        let order = if (found.sizes[0] > found.sizes[1]) == (2 * count > poses.n) {
            [0, 1]
        } else {
            [1, 0]
        };
        let mut centroids = found.centroids.select(Axis(0), &order);
        let mut halves = nearer_first(poses, centroids.view(), count);
        for _ in 0..self.parameters.max_iterations {
            self.iterations += 1;
            let groups = ClusterMembers::new(&halves, 2);
            centroids = means(poses, &groups, centroids.view(), |_| true);
            let next = nearer_first(poses, centroids.view(), count);
            if next == halves {
                return halves;
            }
            halves = next;
        }
        self.converged = false;
        halves
    }
}

/// 0 for the `count` poses that are nearest to the first centroid, compared with the second; 1 for
/// the others.
fn nearer_first(poses: Dataset<'_>, centroids: ArrayView2<'_, f64>, count: usize) -> Vec<u32> {
    let all = centroids.as_slice().expect("made row by row");
    let (a, b) = all.split_at(poses.d);
    let differences = parallel::map_chunks(poses.n, 4096, |rows| {
        let difference =
            |i: usize| squared_distance(poses.row(i), a) - squared_distance(poses.row(i), b);
        rows.map(difference).collect::<Vec<f64>>()
    });
    let differences = differences.concat();
    let mut order: Vec<u32> = (0..poses.n as u32).collect();
    let by_difference = |i: &u32, j: &u32| {
        differences[*i as usize]
            .total_cmp(&differences[*j as usize])
            .then(i.cmp(j))
    };
    if count < order.len() {
        order.select_nth_unstable_by(count, by_difference);
    }
    let mut halves = vec![0; poses.n];
    order[count..].iter().for_each(|&i| halves[i as usize] = 1);
    halves
}

#[cfg(test)]
mod tests {
    use super::super::testdata::{blobs, noise, on_threads, quiet, repeated, with_k};
    use super::*;

    fn balanced(k: usize) -> KMeans {
        KMeans {
            balance: true,
            ..with_k(k)
        }
    }

    #[test]
    fn sizes_differ_by_at_most_one() {
        let tables = [
            noise(901, 7, 1),
            blobs(500, 3, 4, 2),
            repeated(&noise(2, 4, 3), 60),
        ];
        for table in &tables {
            for k in [1, 2, 3, 7, 8, 100] {
                let found = quiet(table, &balanced(k)).unwrap();
                let small = table.nrows() / k;
                let sizes = found.sizes.iter();
                assert!(
                    sizes.clone().all(|s| (small..=small + 1).contains(s)),
                    "{k}: {:?}",
                    found.sizes
                );
                assert_eq!(sizes.sum::<usize>(), table.nrows());
                assert_eq!(found.sizes, ClusterMembers::new(&found.labels, k).sizes());
            }
        }
        let each = quiet(&noise(20, 3, 4), &balanced(20)).unwrap();
        assert_eq!((each.sizes, each.inertia), (vec![1; 20], 0.0));
    }

    #[test]
    fn equal_heaps_are_found() {
        let found = quiet(&blobs(800, 69, 8, 3), &balanced(8)).unwrap();
        let heap = |i: usize| found.labels[i % 8];
        assert!((0..800).all(|i| found.labels[i] == heap(i)));
        assert!(found.converged);
    }

    #[test]
    fn no_exchange_of_two_poses_between_halves_is_better() {
        let table = noise(101, 2, 5);
        let found = quiet(&table, &balanced(2)).unwrap();
        let square = |i: usize, j: usize| {
            let off = table.row(i).mapv(f64::from) - found.centroids.row(j);
            off.dot(&off)
        };
        let (of, n) = (|i: usize| found.labels[i] as usize, table.nrows());
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let now = square(i, of(i)) + square(j, of(j));
            let exchanged = square(i, of(j)) + square(j, of(i));
            assert!(now <= exchanged + 1e-12, "{i} {j}");
        }
    }

    #[test]
    fn threads_change_nothing() {
        let table = blobs(9000, 6, 5, 6);
        let one = on_threads(1, || quiet(&table, &balanced(11)).unwrap());
        assert_eq!(one, on_threads(3, || quiet(&table, &balanced(11)).unwrap()));
    }
}

//! The result of a clustering, and the progress of one that is running.

use ndarray::Array2;

/// Poses parted into clusters.
#[derive(Debug, Clone, PartialEq)]
pub struct Clustering {
    /// The centroids (of the leaves, if there is a tree), (k, d), in the unit of the poses. Within
    /// the tolerance they are the means of their clusters: exactly so when no label changed
    /// any more.
    pub centroids: Array2<f64>,
    /// The cluster of each pose, (n), below k. In a flat clustering its nearest centroid, the
    /// lowest on a tie; in a tree the leaf reached by going from the root to the nearest
    /// child; in a balanced one, not always the nearest.
    pub labels: Vec<u32>,
    /// Poses in each cluster, (k), none of them 0.
    pub sizes: Vec<usize>,
    /// Sum of the squared distances to the centroids, in the poses' unit squared.
    pub inertia: f64,
    /// Updates of the centroids in the kept run; in a tree, of the kept runs of all splits;
    /// in a balanced one, of all halvings.
    pub iterations: usize,
    /// Whether that run (in a tree, every one) met the tolerance before its iterations were used
    /// up.
    pub converged: bool,
}

/// The progress of a clustering that is running.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum KMeansProgress {
    /// Seeds are found.
    Seeds {
        /// Which run, from 0.
        restart: usize,
        /// How many there are so far.
        seeds: usize,
    },
    /// The centroids were updated and the poses assigned.
    Iteration {
        /// Which run, from 0.
        restart: usize,
        /// Which update, from 1.
        iteration: usize,
        /// How many poses changed their cluster.
        moved: usize,
    },
    /// A leaf of the tree was split.
    Split {
        /// Leaves so far.
        leaves: usize,
    },
}

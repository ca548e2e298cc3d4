//! Hierarchical k-means: tables of poses parted into K clusters.
//!
//! Given poses x_1 .. x_n (rows, any unit, usually centimeters), find centroids c_1 .. c_k that
//! make
//!
//! ```text
//! inertia = sum over i of min over j of |x_i - c_j|²
//! ```
//!
//! small. The plain way (Lloyd) alternates two steps, neither of which can raise the inertia: give
//! each pose to its nearest centroid, move each centroid to the mean of its poses. It ends in a
//! local minimum that depends on the seeds, hence [`KMeans::restarts`].
//!
//! | part | what it does |
//! |---|---|
//! | `seeding` | greedy k-means++, with whole cells skipped by the triangle inequality |
//! | `parameters`, `kmeans` | the parameters; flat or as a tree |
//! | `lloyd` | Lloyd's alternation, empty clusters repaired; the best of the restarts |
//! | `assignment` | assignment by Hamerly's bounds, candidates in a ball around each centroid |
//! | `dataset` | the checked table, the exact distance |
//! | `squared_distances` | distances in blocks; exact where rounding could change an answer |
//! | `update` | means, and poses for empty clusters |
//! | `hierarchical` | a tree with branch B: K leaves for about B log K distances per pose |
//! | `balanced` | clusters of equal size |
//!
//! **A label is exact.** Except in balanced clusters, it is the centroid with the least squared
//! distance summed in f64, the lowest number on a tie. Pruning and the f32 products only decide
//! which distances need not be computed, with their rounding bounded; so from the same seeds a
//! pruned run gives the labels of a plain one, at any number of threads. (The seeding weighs
//! candidates by f32 products: another kind of processor may, on a near tie, choose other seeds.)
//!
//! Memory: about 40 bytes a pose besides the table, K x D centroids twice, and a fixed tile a
//! thread. The seeding holds the poses once more, arranged by cell, and up to twice that while
//! cells shrink.
//!
//! ```
//! use ndarray::array;
//! use posing_models::cluster::KMeans;
//!
//! let poses = array![[0.0f32, 0.0], [0.1, 0.0], [5.0, 5.0], [5.1, 5.0]];
//! let found = KMeans { k: 2, ..KMeans::default() }.fit(poses.view())?;
//! assert_eq!(found.sizes, [2, 2]);
//! assert_eq!(found.labels[0], found.labels[1]);
//! # Ok::<(), posing_core::Error>(())
//! ```

mod assignment;
mod balanced;
mod clustering;
mod dataset;
mod hierarchical;
mod kmeans;
mod lloyd;
mod parameters;
mod seeding;
mod squared_distances;
mod update;

pub use clustering::{Clustering, KMeansProgress};
pub use parameters::KMeans;
pub use squared_distances::assign;

#[cfg(test)]
mod testdata {
    //! Tables that several of the tests use.

    use super::{Clustering, KMeans};
    use crate::Result;
    use crate::numeric::parallel;
    use ndarray::{Array2, Axis, concatenate};
    use rand::Rng;

    /// Uniform in the unit cube.
    pub(crate) fn noise(n: usize, d: usize, seed: u64) -> Array2<f32> {
        let mut generator = parallel::rng(seed, 0);
        Array2::from_shape_simple_fn((n, d), || generator.random::<f32>())
    }

    /// `count` tight heaps far from each other; pose i is of heap i modulo `count`.
    pub(crate) fn blobs(n: usize, d: usize, count: usize, seed: u64) -> Array2<f32> {
        let centers = noise(count, d, seed) * 100.0;
        let mut poses = noise(n, d, seed + 1);
        poses
            .rows_mut()
            .into_iter()
            .enumerate()
            .for_each(|(i, mut row)| row += &centers.row(i % count));
        poses
    }

    /// A clustering that nobody listens to.
    pub(crate) fn quiet(poses: &Array2<f32>, parameters: &KMeans) -> Result<Clustering> {
        parameters.fit(poses.view())
    }

    /// The usual parameters for k clusters.
    pub(crate) fn with_k(k: usize) -> KMeans {
        KMeans {
            k,
            ..KMeans::default()
        }
    }

    /// The whole table `times` times over.
    pub(crate) fn repeated(table: &Array2<f32>, times: usize) -> Array2<f32> {
        concatenate(Axis(0), &vec![table.view(); times]).expect("equal widths")
    }

    /// Whole numbers in the plane, where most distances tie.
    pub(crate) fn grid(side: usize) -> Array2<f32> {
        Array2::from_shape_fn((side * side, 2), |(i, j)| {
            if j == 0 {
                (i / side) as f32
            } else {
                (i % side) as f32
            }
        })
    }

    /// What `work` gives on a pool of that many threads.
    pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool")
            .install(work)
    }
}

//! Lloyd's alternation from k-means++ seeds, with restarts.
//!
//! S. Lloyd, Least squares quantization in PCM, 1982. Assignment (`search`) and means (`update`) in
//! turn, until no label changes or the centroids hardly move.

use super::hierarchy::{self, Tree};
use super::nearest::{Centroids, Poses};
use super::search::Search;
use super::seeding;
use super::update::{Groups, distances, farthest, means};
use crate::{Error, Result, par};
use ndarray::{Array2, ArrayView2};

/// How to cluster. The fields are free until [`fit`] checks them.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Number of clusters, from 1 to the number of poses. Default 1.
    pub k: usize,
    /// Seed of the random choices. Default 0.
    pub seed: u64,
    /// Runs from different seeds, at least 1; the one with the least inertia is kept whole. In a
    /// tree, of every split. Default 1.
    pub restarts: usize,
    /// Updates of the centroids a run may take, at least 1. Default 100.
    pub max_iterations: usize,
    /// A run has converged when the squared shifts of its centroids add up to at most this times the
    /// mean variance of a coordinate (scikit-learn's rule). At 0: when no label changes. Default 1e-4.
    pub tolerance: f64,
    /// Children of a node, at least 2, to build a tree in place of a flat clustering. Default `None`.
    pub branch: Option<usize>,
}

impl Default for Parameters {
    fn default() -> Self {
        Parameters {
            k: 1,
            seed: 0,
            restarts: 1,
            max_iterations: 100,
            tolerance: 1e-4,
            branch: None,
        }
    }
}

impl Parameters {
    /// Checks what can be checked without the poses.
    ///
    /// # Errors
    /// Usage, naming the first value that is out of its range, and the range.
    pub fn check(&self) -> Result<()> {
        let what = if self.k == 0 {
            "k = 0 clusters: at least 1 is needed".to_string()
        } else if self.restarts == 0 {
            "0 restarts: at least 1 run is needed".to_string()
        } else if self.max_iterations == 0 {
            "0 iterations: at least 1 is needed".to_string()
        } else if !(self.tolerance >= 0.0 && self.tolerance.is_finite()) {
            format!(
                "a tolerance of {}: it must be a number from 0 on",
                self.tolerance
            )
        } else if let Some(branch @ 0..2) = self.branch {
            format!("branch = {branch}: a node of the tree needs at least 2 children")
        } else {
            return Ok(());
        };
        Err(Error::usage(what))
    }
}

/// Poses parted into clusters.
#[derive(Debug, Clone, PartialEq)]
pub struct Clustering {
    /// The centroids (of the leaves, if there is a tree), (k, d), in the unit of the poses. Within the
    /// tolerance they are the means of their clusters: exactly so when no label changed any more.
    pub centroids: Array2<f64>,
    /// The cluster of each pose, (n), below k. In a flat clustering its nearest centroid, the lowest on a
    /// tie; in a tree the leaf that [`Tree::descend`] finds.
    pub labels: Vec<u32>,
    /// Poses in each cluster, (k), none of them 0.
    pub sizes: Vec<usize>,
    /// Sum of the squared distances to the centroids, in the poses' unit squared.
    pub inertia: f64,
    /// Updates of the centroids in the kept run; in a tree, of the kept runs of all splits.
    pub iterations: usize,
    /// Whether that run (in a tree, every one) met the tolerance before its iterations were used up.
    pub converged: bool,
    /// The tree, where [`Parameters::branch`] asked for one.
    pub tree: Option<Tree>,
}

/// News of a run under way.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Report {
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

/// Clusters `poses` (n, d) as `parameters` ask: flat k-means, or a tree.
///
/// `observer` hears of progress, from the calling thread.
///
/// # Errors
/// Usage: a parameter out of its range; more clusters than poses, or than *different* poses (the
/// message names how many there are: fewer clusters than asked for would surprise whoever reads
/// the result by number); no columns. Data: a pose with NaN, infinity or a value beyond 1e15; the
/// place names the file `poses` and, as line, the row counted from 1.
pub fn fit(
    poses: ArrayView2<'_, f32>,
    parameters: &Parameters,
    observer: &mut dyn FnMut(&Report),
) -> Result<Clustering> {
    parameters.check()?;
    let k = parameters.k;
    if k > poses.nrows() {
        return Err(Error::usage(format!(
            "k = {k} clusters: it must be from 1 to {}, the number of poses",
            poses.nrows()
        )));
    }
    let table = poses.as_standard_layout();
    let poses = Poses::check(&table)?;
    let found = match parameters.branch {
        None => best_run(poses, parameters, 0, observer),
        Some(branch) => hierarchy::grow(poses, parameters, branch, observer),
    };
    if found.sizes.len() < k {
        return Err(Error::usage(format!(
            "k = {k} clusters: it must be from 1 to {}, the number of different poses",
            found.sizes.len()
        )));
    }
    Ok(found)
}

/// The best of the restarts (the first on a tie), whole. Fewer clusters than `k`, one a pose, when
/// there are fewer different poses. `stream` keeps the random choices of several calls apart.
pub(super) fn best_run(
    poses: Poses<'_>,
    parameters: &Parameters,
    stream: u64,
    observer: &mut dyn FnMut(&Report),
) -> Clustering {
    let (mean, variance) = poses.moments();
    let middle: Vec<f32> = mean.iter().map(|&m| m as f32).collect();
    let run = |restart: usize, observer: &mut dyn FnMut(&Report)| {
        let stream = stream
            .wrapping_mul(parameters.restarts as u64)
            .wrapping_add(restart as u64);
        let mut generator = par::generator(parameters.seed, stream);
        let (seeds, labels) =
            seeding::plus_plus(poses, parameters.k, &mut generator, &mut |seeds| {
                observer(&Report::Seeds { restart, seeds })
            });
        let centroids = Array2::from_shape_fn((seeds.len(), poses.d), |(j, i)| {
            f64::from(poses.row(seeds[j] as usize)[i])
        });
        let start = (Centroids::new(centroids, &middle), labels);
        lloyd(
            poses,
            start,
            &middle,
            parameters,
            parameters.tolerance * variance,
            &mut |i, moved| {
                observer(&Report::Iteration {
                    restart,
                    iteration: i,
                    moved,
                })
            },
        )
    };
    let mut best = run(0, observer);
    for restart in 1..parameters.restarts {
        let next = run(restart, observer);
        if next.inertia < best.inertia {
            best = next;
        }
    }
    best
}

/// One run from centroids and labels (hints) until the squared shifts add up to at most `enough`.
fn lloyd(
    poses: Poses<'_>,
    (mut centroids, labels): (Centroids, Vec<u32>),
    middle: &[f32],
    parameters: &Parameters,
    enough: f64,
    observer: &mut dyn FnMut(usize, usize),
) -> Clustering {
    let k = centroids.k();
    let mut search = Search::new(labels, k);
    search.step(poses, &centroids);
    let (mut iterations, mut converged) = (0, false);
    while !converged && iterations < parameters.max_iterations {
        iterations += 1;
        let groups = repaired(poses, &centroids, &mut search);
        let old = centroids.exact();
        let next = means(poses, &groups, old, |j| search.touched[j]);
        let shifts: Vec<f64> = next
            .rows()
            .into_iter()
            .zip(old.rows())
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
            .collect();
        centroids = Centroids::new(next, middle);
        search.moved(&shifts.iter().map(|s| s.sqrt()).collect::<Vec<_>>());
        let moved = search.step(poses, &centroids);
        converged = moved == 0 || shifts.iter().sum::<f64>() <= enough;
        observer(iterations, moved);
    }
    let (centroids, labels) = filled(poses, centroids, middle, search.labels);
    let inertia = distances(poses, centroids.exact(), &labels)
        .chunks(4096)
        .map(|chunk| chunk.iter().sum::<f64>())
        .sum();
    let sizes = Groups::new(&labels, k).sizes();
    let centroids = centroids.into_exact();
    Clustering {
        centroids,
        labels,
        sizes,
        inertia,
        iterations,
        converged,
        tree: None,
    }
}

/// The clusters of `search`; an empty one is first given the pose farthest from its centroid.
fn repaired(poses: Poses<'_>, centroids: &Centroids, search: &mut Search) -> Groups {
    let groups = Groups::new(&search.labels, centroids.k());
    let sizes = groups.sizes();
    let empty: Vec<u32> = (0..centroids.k() as u32)
        .filter(|&j| sizes[j as usize] == 0)
        .collect();
    if empty.is_empty() {
        return groups;
    }
    let far = farthest(poses, centroids, &search.labels, empty.len(), Some(sizes));
    far.into_iter()
        .zip(empty)
        .for_each(|(i, j)| search.put(i, j));
    Groups::new(&search.labels, centroids.k())
}

/// Moves the centroids that the last assignment left empty onto the farthest poses.
///
/// A centroid put there keeps that pose for good, so this ends after at most k rounds; with k
/// different poses none is empty then.
fn filled(
    poses: Poses<'_>,
    mut centroids: Centroids,
    middle: &[f32],
    mut labels: Vec<u32>,
) -> (Centroids, Vec<u32>) {
    let k = centroids.k();
    loop {
        let sizes = Groups::new(&labels, k).sizes();
        let empty: Vec<usize> = (0..k).filter(|&j| sizes[j] == 0).collect();
        if empty.is_empty() {
            return (centroids, labels);
        }
        let far = farthest(poses, &centroids, &labels, empty.len(), None);
        if far.is_empty() {
            return (centroids, labels);
        }
        let mut next = centroids.into_exact();
        for (j, i) in empty.into_iter().zip(far) {
            next.row_mut(j)
                .iter_mut()
                .zip(poses.row(i as usize))
                .for_each(|(c, &x)| *c = x.into());
        }
        centroids = Centroids::new(next, middle);
        let mut search = Search::new(labels, k);
        search.step(poses, &centroids);
        labels = search.labels;
    }
}

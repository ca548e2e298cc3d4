//! Clustering as it is asked for: flat or as a tree, the best of the restarts.

use super::dataset::Dataset;
use super::distances::Centroids;
use super::hierarchical::{self, Tree};
use super::lloyd::lloyd;
use super::parameters::Parameters;
use super::seeding;
use crate::numeric::parallel;
use crate::{Error, Result};
use ndarray::{Array2, ArrayView2};

/// Dataset parted into clusters.
#[derive(Debug, Clone, PartialEq)]
pub struct Clustering {
    /// The centroids (of the leaves, if there is a tree), (k, d), in the unit of the poses. Within the
    /// tolerance they are the means of their clusters: exactly so when no label changed any more.
    pub centroids: Array2<f64>,
    /// The cluster of each pose, (n), below k. In a flat clustering its nearest centroid, the lowest on a
    /// tie; in a tree the leaf that [`Tree::descend`] finds.
    pub labels: Vec<u32>,
    /// Dataset in each cluster, (k), none of them 0.
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
    let k = parameters.k;
    let found = fit_at_most(poses, parameters, observer)?;
    if found.sizes.len() < k {
        return Err(Error::usage(format!(
            "k = {k} clusters: it must be from 1 to {}, the number of different poses",
            found.sizes.len()
        )));
    }
    Ok(found)
}

/// The same, with fewer clusters where there are not so many different poses.
///
/// # Errors
/// As for [`fit`], but for that.
pub fn fit_at_most(
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
    let poses = Dataset::check(&table)?;
    Ok(match parameters.branch {
        None => best_run(poses, parameters, 0, observer),
        Some(branch) => hierarchical::grow(poses, parameters, branch, observer),
    })
}

/// The best of the restarts (the first on a tie), whole. Fewer clusters than `k`, one a pose, when
/// there are fewer different poses. `stream` keeps the random choices of several calls apart.
pub(super) fn best_run(
    poses: Dataset<'_>,
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
        let mut generator = parallel::rng(parameters.seed, stream);
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

#[cfg(test)]
mod tests {
    use super::super::testdata::{blobs, noise, on_threads, quiet, repeated, with_k};
    use super::super::update::ClusterMembers;
    use super::*;
    use ndarray::{Array2, ShapeBuilder, array};

    #[test]
    fn inertia_is_the_sum_of_squares_and_falls() {
        let table = blobs(600, 9, 20, 1);
        let mut last = f64::INFINITY;
        for max_iterations in 1..30 {
            let asked = Parameters {
                max_iterations,
                tolerance: 0.0,
                ..with_k(25)
            };
            let found = quiet(&table, &asked).unwrap();
            let squares = |(row, &label): (ndarray::ArrayView1<f32>, &u32)| -> f64 {
                let c = found.centroids.row(label as usize);
                row.iter()
                    .zip(c)
                    .map(|(&x, c)| (f64::from(x) - c).powi(2))
                    .sum()
            };
            let direct: f64 = table
                .rows()
                .into_iter()
                .zip(&found.labels)
                .map(squares)
                .sum();
            assert!((found.inertia - direct).abs() <= 1e-9 * direct);
            assert!(found.inertia <= last * (1.0 + 1e-12));
            last = found.inertia;
        }
    }

    #[test]
    fn finds_what_was_planted() {
        let found = quiet(&blobs(1000, 69, 8, 3), &with_k(8)).unwrap();
        for j in 0..8u32 {
            let first = found.labels[j as usize];
            assert!(
                (0..1000)
                    .filter(|i| i % 8 == j as usize)
                    .all(|i| found.labels[i] == first)
            );
        }
        assert!(found.converged);
    }

    #[test]
    fn as_many_clusters_as_poses() {
        let found = quiet(&noise(50, 4, 1), &with_k(50)).unwrap();
        assert_eq!(found.sizes, vec![1; 50]);
        assert_eq!(found.inertia, 0.0);
        let one = quiet(&noise(1, 4, 1), &with_k(1)).unwrap();
        assert_eq!((one.labels, one.inertia), (vec![0], 0.0));
    }

    #[test]
    fn one_cluster_is_the_mean() {
        let found = quiet(&array![[1.0f32, 2.0], [3.0, 6.0]], &with_k(1)).unwrap();
        assert_eq!(found.centroids, array![[2.0, 4.0]]);
        assert!(found.converged);
    }

    #[test]
    fn too_many_clusters_are_refused_with_the_limit() {
        let says = |table: &Array2<f32>, k, branch, what: &str| {
            let error = quiet(
                table,
                &Parameters {
                    branch,
                    ..with_k(k)
                },
            )
            .unwrap_err();
            assert_eq!(error.exit_code(), 2);
            assert!(error.to_string().contains(what), "{error}");
        };
        let table = repeated(&noise(3, 5, 1), 20);
        for branch in [None, Some(2), Some(5)] {
            says(&table, 61, branch, "from 1 to 60, the number of poses");
            says(
                &table,
                4,
                branch,
                "from 1 to 3, the number of different poses",
            );
            says(
                &Array2::ones((9, 2)),
                2,
                branch,
                "from 1 to 1, the number of different poses",
            );
            says(&Array2::zeros((0, 2)), 1, branch, "from 1 to 0");
            says(&Array2::zeros((5, 0)), 1, branch, "1 column");
            let found = quiet(
                &table,
                &Parameters {
                    branch,
                    ..with_k(3)
                },
            )
            .unwrap();
            assert_eq!(found.sizes, [20; 3]);
            assert!(found.inertia <= 1e-20);
        }
        // The sign of a zero makes no other pose.
        says(&array![[0.0f32], [-0.0]], 2, None, "different");
    }

    #[test]
    fn poses_apart_by_less_than_f32_can_square() {
        let table = array![[0.0f32, 0.0], [0.0, 1e-30], [0.0, 2e-30], [0.0, 1e-30]];
        let found = quiet(&table, &with_k(3)).unwrap();
        assert_eq!(found.inertia, 0.0);
        assert_eq!(found.labels[1], found.labels[3]);
    }

    #[test]
    fn what_is_not_finite_is_placed() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e20] {
            let mut table = noise(30, 3, 1);
            table[[17, 2]] = bad;
            table[[20, 0]] = f32::NAN;
            let error = quiet(&table, &with_k(2)).unwrap_err();
            assert_eq!(error.exit_code(), 1);
            assert!(error.to_string().starts_with("poses:18: "), "{error}");
        }
    }

    #[test]
    fn the_same_at_any_number_of_threads_and_in_either_layout() {
        let table = blobs(9000, 11, 40, 2);
        for branch in [None, Some(3)] {
            let asked = Parameters {
                k: 37,
                seed: 5,
                restarts: 2,
                branch,
                ..with_k(37)
            };
            let first = quiet(&table, &asked).unwrap();
            for threads in [1, 2, 7] {
                assert_eq!(
                    on_threads(threads, || quiet(&table, &asked).unwrap()),
                    first
                );
            }
            let mut columns = Array2::zeros(table.dim().f());
            columns.assign(&table);
            assert_eq!(quiet(&columns, &asked).unwrap(), first);
        }
    }

    #[test]
    fn the_best_restart_is_kept_whole() {
        let table = noise(800, 3, 4);
        let mut ends = Vec::new();
        for restarts in 1..6 {
            let mut runs = Vec::new();
            let asked = Parameters {
                restarts,
                ..with_k(30)
            };
            let found = fit(table.view(), &asked, &mut |report| {
                if let Report::Iteration {
                    restart, iteration, ..
                } = report
                {
                    runs.resize(restart + 1, 0);
                    runs[*restart] = *iteration;
                }
            })
            .unwrap();
            assert_eq!(runs.len(), restarts);
            assert!(runs.contains(&found.iterations));
            assert_eq!(found.sizes, ClusterMembers::new(&found.labels, 30).sizes());
            let (labels, _) = super::super::assign(table.view(), found.centroids.view()).unwrap();
            assert_eq!(labels, found.labels);
            ends.push(found.inertia);
        }
        assert!(ends.windows(2).all(|w| w[1] <= w[0]), "{ends:?}");
    }
}

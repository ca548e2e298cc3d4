//! k-means as a caller uses it: flat, as a tree or balanced, the best of the restarts.

use super::clustering::{Clustering, KMeansProgress};
use super::dataset::Dataset;
use super::lloyd::best_run;
use super::parameters::KMeans;
use super::{balanced, hierarchical};
use crate::{Error, Result};
use ndarray::ArrayView2;

impl KMeans {
    /// Clusters `poses` (n, d).
    ///
    /// ```
    /// use posing_models::cluster::KMeans;
    ///
    /// let poses = ndarray::array![[0.0_f32, 0.0], [0.0, 2.0], [9.0, 0.0], [9.0, 2.0]];
    /// let clustering = KMeans { k: 2, ..KMeans::default() }.fit(poses.view())?;
    /// assert_eq!(clustering.sizes, [2, 2]);
    /// assert_eq!(clustering.labels[0], clustering.labels[1]);
    /// assert_eq!(clustering.inertia, 4.0); // each pose is 1 from its centroid
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Usage`]: a parameter out of its range; more clusters than poses, or than
    /// *different* poses (the
    /// message gives their number, because a result with fewer clusters would surprise a caller
    /// that reads it by number); no columns. [`Error::Data`]: a pose with NaN, infinity or a
    /// value beyond 1e15. The place of that error names the file `poses` and, as line, the row
    /// counted from 1.
    pub fn fit(&self, poses: ArrayView2<'_, f32>) -> Result<Clustering> {
        self.fit_with_progress(poses, &mut |_| ())
    }

    /// [`KMeans::fit`], and calls `observer` with the progress, from the calling thread.
    ///
    /// # Errors
    /// Those of [`KMeans::fit`].
    pub fn fit_with_progress(
        &self,
        poses: ArrayView2<'_, f32>,
        observer: &mut dyn FnMut(&KMeansProgress),
    ) -> Result<Clustering> {
        let found = self.fit_at_most(poses, observer)?;
        if found.sizes.len() < self.k {
            return Err(Error::usage(format!(
                "k = {} clusters: it must be from 1 to {}, the number of different poses",
                self.k,
                found.sizes.len()
            )));
        }
        Ok(found)
    }

    /// [`KMeans::fit_with_progress`], but with fewer than `k` clusters where there are fewer
    /// different poses.
    ///
    /// # Errors
    /// Those of [`KMeans::fit`], except that for too few different poses.
    pub(crate) fn fit_at_most(
        &self,
        poses: ArrayView2<'_, f32>,
        observer: &mut dyn FnMut(&KMeansProgress),
    ) -> Result<Clustering> {
        self.check()?;
        if self.k > poses.nrows() {
            return Err(Error::usage(format!(
                "k = {} clusters: it must be from 1 to {}, the number of poses",
                self.k,
                poses.nrows()
            )));
        }
        let table = poses.as_standard_layout();
        let poses = Dataset::check(&table)?;
        Ok(match self.branch {
            None if self.balance => balanced::halve(poses, self, observer),
            None => best_run(poses, self, 0, observer),
            Some(branch) => hierarchical::grow(poses, self, branch, observer),
        })
    }
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
            let settings = KMeans {
                max_iterations,
                tolerance: 0.0,
                ..with_k(25)
            };
            let found = quiet(&table, &settings).unwrap();
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
                &KMeans {
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
                &KMeans {
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
            let settings = KMeans {
                k: 37,
                seed: 5,
                restarts: 2,
                branch,
                ..with_k(37)
            };
            let first = quiet(&table, &settings).unwrap();
            for threads in [1, 2, 7] {
                assert_eq!(
                    on_threads(threads, || quiet(&table, &settings).unwrap()),
                    first
                );
            }
            let mut columns = Array2::zeros(table.dim().f());
            columns.assign(&table);
            assert_eq!(quiet(&columns, &settings).unwrap(), first);
        }
    }

    #[test]
    fn the_best_restart_is_kept_whole() {
        let table = noise(800, 3, 4);
        let mut ends = Vec::new();
        for restarts in 1..6 {
            let mut runs = Vec::new();
            let settings = KMeans {
                restarts,
                ..with_k(30)
            };
            let found = settings
                .fit_with_progress(table.view(), &mut |report| {
                    if let KMeansProgress::Iteration {
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

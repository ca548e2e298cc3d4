//! Lloyd's alternation from given centroids, empty clusters repaired.
//!
//! S. Lloyd, Least squares quantization in PCM, 1982. Assignment (`search`) and means (`update`) in
//! turn, until no label changes or the centroids hardly move.

use super::assignment::BoundedAssignment;
use super::clustering::{Clustering, KMeansProgress};
use super::dataset::Dataset;
use super::parameters::KMeans;
use super::seeding;
use super::squared_distances::Centroids;
use super::update::{ClusterMembers, distances, farthest, means};
use crate::numeric::parallel;
use ndarray::Array2;

/// One run from centroids and labels (hints) until the squared shifts add up to at most `enough`.
fn lloyd(
    poses: Dataset<'_>,
    (mut centroids, labels): (Centroids, Vec<u32>),
    middle: &[f32],
    parameters: &KMeans,
    enough: f64,
    observer: &mut dyn FnMut(usize, usize),
) -> Clustering {
    let k = centroids.k();
    let mut search = BoundedAssignment::new(labels, k);
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
        search.move_centroids(&shifts.iter().map(|s| s.sqrt()).collect::<Vec<_>>());
        let moved = search.step(poses, &centroids);
        converged = moved == 0 || shifts.iter().sum::<f64>() <= enough;
        observer(iterations, moved);
    }
    let (centroids, labels) = filled(poses, centroids, middle, search.labels);
    let inertia = distances(poses, centroids.exact(), &labels)
        .chunks(4096)
        .map(|chunk| chunk.iter().sum::<f64>())
        .sum();
    let sizes = ClusterMembers::new(&labels, k).sizes();
    let centroids = centroids.into_exact();
    Clustering {
        centroids,
        labels,
        sizes,
        inertia,
        iterations,
        converged,
    }
}

/// The clusters of `search`; an empty one is first given the pose farthest from its centroid.
fn repaired(
    poses: Dataset<'_>,
    centroids: &Centroids,
    search: &mut BoundedAssignment,
) -> ClusterMembers {
    let groups = ClusterMembers::new(&search.labels, centroids.k());
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
        .for_each(|(i, j)| search.assign_to(i, j));
    ClusterMembers::new(&search.labels, centroids.k())
}

/// Moves the centroids that the last assignment left empty onto the farthest poses.
///
/// A centroid put there keeps that pose for good, so this ends after at most k rounds; with k
/// different poses none is empty then.
fn filled(
    poses: Dataset<'_>,
    mut centroids: Centroids,
    middle: &[f32],
    mut labels: Vec<u32>,
) -> (Centroids, Vec<u32>) {
    let k = centroids.k();
    loop {
        let sizes = ClusterMembers::new(&labels, k).sizes();
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
        let mut search = BoundedAssignment::new(labels, k);
        search.step(poses, &centroids);
        labels = search.labels;
    }
}

/// The best of the restarts (the first on a tie), whole. Fewer clusters than `k`, one per pose,
/// when there are fewer different poses. `stream` keeps the random choices of several calls apart.
pub(super) fn best_run(
    poses: Dataset<'_>,
    parameters: &KMeans,
    stream: u64,
    observer: &mut dyn FnMut(&KMeansProgress),
) -> Clustering {
    let (mean, variance) = poses.moments();
    let middle: Vec<f32> = mean.iter().map(|&m| m as f32).collect();
    let run = |restart: usize, observer: &mut dyn FnMut(&KMeansProgress)| {
        let stream = stream
            .wrapping_mul(parameters.restarts as u64)
            .wrapping_add(restart as u64);
        let mut generator = parallel::rng(parameters.seed, stream);
        let (seeds, labels) =
            seeding::kmeans_plus_plus(poses, parameters.k, &mut generator, &mut |seeds| {
                observer(&KMeansProgress::Seeds { restart, seeds })
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
                observer(&KMeansProgress::Iteration {
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
    use super::super::dataset::exact_nearest;
    use super::super::seeding;
    use super::super::testdata::{blobs, grid, noise, quiet, repeated, with_k};
    use super::*;
    use crate::numeric::parallel;
    use ndarray::Array2;

    /// Lloyd without any pruning, from the same seeds.
    fn plain(poses: Dataset<'_>, parameters: &KMeans) -> (Array2<f64>, Vec<u32>, usize) {
        let mut generator = parallel::rng(parameters.seed, 0);
        let (seeds, _) =
            seeding::kmeans_plus_plus(poses, parameters.k, &mut generator, &mut |_| ());
        let mut centroids = Array2::from_shape_fn((parameters.k, poses.d), |(j, i)| {
            f64::from(poses.row(seeds[j] as usize)[i])
        });
        let assign = |centroids: &Array2<f64>| -> Vec<u32> {
            let rows: Vec<&[f64]> = centroids.as_slice().unwrap().chunks(poses.d).collect();
            let all = || (0u32..).zip(rows.iter().copied());
            (0..poses.n)
                .map(|i| exact_nearest(poses.row(i), all()).label)
                .collect()
        };
        let mut labels = assign(&centroids);
        for iteration in 1..=parameters.max_iterations {
            let groups = ClusterMembers::new(&labels, parameters.k);
            assert!(
                groups.sizes().iter().all(|&s| s > 0),
                "the reference knows no repair"
            );
            centroids = means(poses, &groups, centroids.view(), |_| true);
            let old = std::mem::replace(&mut labels, assign(&centroids));
            if old == labels {
                return (centroids, labels, iteration);
            }
        }
        (centroids, labels, parameters.max_iterations)
    }

    #[test]
    fn pruning_changes_no_label() {
        let tables = [
            noise(700, 69, 1),
            noise(900, 3, 2),
            noise(500, 1, 3),
            blobs(900, 69, 12, 4),
            blobs(900, 5, 30, 5) + 1e4f32,
            repeated(&noise(60, 7, 6), 9),
            grid(12) * 3.0,
            noise(400, 10, 7) * 1e-22f32,
            noise(400, 10, 8) * 1e14f32,
        ];
        for (t, table) in tables.iter().enumerate() {
            for k in [1, 2, 7, 40] {
                for max_iterations in [1, 3, 60] {
                    let settings = KMeans {
                        k,
                        max_iterations,
                        tolerance: 0.0,
                        ..with_k(k)
                    };
                    let found = quiet(table, &settings).unwrap();
                    let standard = table.as_standard_layout();
                    let (centroids, labels, iterations) =
                        plain(Dataset::check(&standard).unwrap(), &settings);
                    assert_eq!(found.labels, labels, "table {t}, k {k}");
                    assert_eq!(found.centroids, centroids, "table {t}, k {k}");
                    assert_eq!(found.iterations, iterations, "table {t}, k {k}");
                }
            }
        }
    }

    #[test]
    fn empty_clusters_are_repaired() {
        let table = repeated(&noise(50, 4, 9), 3);
        let poses = Dataset::trusted(table.as_slice().unwrap(), 4);
        let mut start = Array2::from_elem((20, 4), 1e6);
        start.row_mut(0).fill(0.0);
        for max_iterations in [1, 2, 100] {
            let centroids = Centroids::new(start.clone(), &[0.0; 4]);
            let settings = KMeans {
                max_iterations,
                ..with_k(20)
            };
            let start = (centroids, vec![0; 150]);
            let found = lloyd(poses, start, &[0.0; 4], &settings, 0.0, &mut |_, _| ());
            assert!(found.sizes.iter().all(|&s| s > 0), "{:?}", found.sizes);
            let one = quiet(&table, &with_k(1)).unwrap();
            assert!(found.inertia < one.inertia);
        }
    }

    #[test]
    fn centroids_left_empty_at_the_end_are_put_on_poses() {
        let table = noise(40, 4, 2);
        let poses = Dataset::trusted(table.as_slice().unwrap(), 4);
        let start = Centroids::new(Array2::from_elem((10, 4), 1e3), &[0.0; 4]);
        let (_, labels) = filled(poses, start, &[0.0; 4], vec![0; 40]);
        assert!(
            ClusterMembers::new(&labels, 10)
                .sizes()
                .iter()
                .all(|&s| s > 0)
        );
    }
}

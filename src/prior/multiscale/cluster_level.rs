//! The cells of one level of the hierarchy: a mean, a covariance and a share of the training poses each.

use super::eigen_covariance::{EigenCovariance, add_diagonal};
use crate::io::model::Matrix;
use crate::numeric::simd::{self, distances};
use crate::pose::PoseTransform;
use ndarray::{Array2, Axis};
use std::sync::{Arc, OnceLock};

/// Cells of one part.
#[derive(Debug, Clone)]
pub struct ClusterLevel {
    /// The means of whole poses, (K, 3 J), cm: what the part hangs on is needed to carry it to another body.
    pub full_means: Array2<f64>,
    /// The means of the part, (K, d), cm.
    pub means: Array2<f64>,
    /// The same for the search, rows padded.
    single: Vec<f32>,
    /// log(n / N).
    pub log_proportions: Vec<f64>,
    /// The variance of each coordinate within the cells, their mean, cm².
    pub within: Vec<f64>,
    bases: Vec<OnceLock<Arc<EigenCovariance>>>,
    /// What the bases are made from when they are first asked for.
    origin: CovarianceSource,
}

#[derive(Debug, Clone)]
enum CovarianceSource {
    /// All are made.
    Made,
    /// As a file keeps them.
    StoredCovariances(Arc<StoredCovariances>),
    /// The cells as another body has them.
    Mapped(Arc<ClusterLevel>, Arc<PoseTransform>),
}

/// The sub-dictionaries as a file keeps them: see [`ClusterLevel::parts`].
#[derive(Debug)]
pub struct StoredCovariances {
    /// (K d, d), one a column.
    pub directions: Matrix,
    /// Along each, cm (K, d).
    pub deviations: Matrix,
}

impl StoredCovariances {
    /// The directions (d, d) of a cell, and the deviation (d) along each.
    fn cluster(&self, cluster: usize) -> (Vec<f32>, Vec<f32>) {
        let d = self.deviations.ncols();
        let (mut directions, mut deviations) = (Vec::with_capacity(d * d), Vec::with_capacity(d));
        (self.directions).extend_with(cluster * d..(cluster + 1) * d, &mut directions);
        (self.deviations).extend_with(cluster..cluster + 1, &mut deviations);
        (directions, deviations)
    }

    /// The variance of each coordinate within the cells, their mean.
    fn within(&self, log_proportions: &[f64]) -> Vec<f64> {
        let mut within = vec![0.0; self.deviations.ncols()];
        for (cluster, log) in log_proportions.iter().enumerate() {
            let (directions, deviations) = self.cluster(cluster);
            add_diagonal(log.exp(), &directions, &deviations, &mut within);
        }
        within
    }
}

impl ClusterLevel {
    /// Cells of the means of whole poses (K, 3 J), log(n / N), and directions; `coordinates` are the part's.
    pub fn new(
        full_means: Array2<f64>,
        log_proportions: Vec<f64>,
        bases: Vec<EigenCovariance>,
        coordinates: &[usize],
    ) -> ClusterLevel {
        let mut within = vec![0.0; coordinates.len()];
        for (basis, log) in bases.iter().zip(&log_proportions) {
            let share = log.exp();
            let both = within.iter_mut().zip(basis.diagonal());
            both.for_each(|(w, v)| *w += share * v);
        }
        let bases = bases.into_iter().map(|b| OnceLock::from(Arc::new(b)));
        let bases = bases.collect();
        ClusterLevel::with(
            full_means,
            log_proportions,
            within,
            bases,
            CovarianceSource::Made,
            coordinates,
        )
    }

    /// The same of sub-dictionaries in a file, and perhaps the variances within the cells.
    pub fn stored(
        full_means: Array2<f64>,
        log_proportions: Vec<f64>,
        stored: StoredCovariances,
        within: Option<Vec<f64>>,
        coordinates: &[usize],
    ) -> ClusterLevel {
        let within = within.unwrap_or_else(|| stored.within(&log_proportions));
        let bases = log_proportions.iter().map(|_| OnceLock::new()).collect();
        let origin = CovarianceSource::StoredCovariances(Arc::new(stored));
        ClusterLevel::with(
            full_means,
            log_proportions,
            within,
            bases,
            origin,
            coordinates,
        )
    }

    fn with(
        full_means: Array2<f64>,
        log_proportions: Vec<f64>,
        within: Vec<f64>,
        bases: Vec<OnceLock<Arc<EigenCovariance>>>,
        origin: CovarianceSource,
        coordinates: &[usize],
    ) -> ClusterLevel {
        let means = full_means.select(Axis(1), coordinates);
        let means = means.as_standard_layout().into_owned();
        ClusterLevel {
            single: simd::rows(&means),
            means,
            full_means,
            log_proportions,
            within,
            bases,
            origin,
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.log_proportions.len()
    }

    /// The mean of a cell.
    pub fn mean(&self, cluster: usize) -> &[f64] {
        let d = self.means.ncols();
        self.means
            .as_slice()
            .map_or(&[], |all| &all[cluster * d..(cluster + 1) * d])
    }

    /// The directions of a cell.
    pub fn basis(&self, cluster: usize, coordinates: &[usize]) -> Arc<EigenCovariance> {
        let d = coordinates.len();
        let make = || match &self.origin {
            CovarianceSource::StoredCovariances(stored) => {
                let (directions, deviations) = stored.cluster(cluster);
                EigenCovariance::from_parts(&directions, &deviations)
            }
            CovarianceSource::Mapped(origin, map) => {
                let own = origin.basis(cluster, coordinates);
                match &**map {
                    // Directions turn with their poses.
                    PoseTransform::Rotate(step_coordinates) => own.turned(step_coordinates),
                    map => {
                        let width = self.full_means.ncols();
                        let own = own.covariance();
                        EigenCovariance::of(map_covariance(&own, map, coordinates, width).view())
                    }
                }
            }
            // Never met: those that are made are there.
            CovarianceSource::Made => EigenCovariance::of(Array2::zeros((d, d)).view()),
        };
        let make = || Arc::new(make());
        self.bases[cluster].get_or_init(make).clone()
    }

    /// All sub-dictionaries: the directions (K d, d), one a column, and the deviation along each, cm (K, d).
    pub fn parts(&self, coordinates: &[usize]) -> (Array2<f32>, Array2<f32>) {
        let d = coordinates.len();
        let mut directions = Array2::zeros((self.len() * d, d));
        let mut deviations = Array2::zeros((self.len(), d));
        for cluster in 0..self.len() {
            let basis = self.basis(cluster, coordinates);
            for i in 0..d {
                let mut row = directions.row_mut(cluster * d + i);
                row.iter_mut().zip(basis.row(i)).for_each(|(r, u)| *r = *u);
                deviations[[cluster, i]] = basis.values[i].sqrt() as f32;
            }
        }
        (directions, deviations)
    }

    /// The same cells of poses that went through `map`; of the covariance with the rest of the body nothing is known.
    pub fn mapped(&self, map: &Arc<PoseTransform>, coordinates: &[usize]) -> ClusterLevel {
        ClusterLevel::with(
            map.apply_rows(self.full_means.view()),
            self.log_proportions.clone(),
            // Good enough for the search; a body's size is nothing beside what poses do.
            self.within.clone(),
            self.bases.iter().map(|_| OnceLock::new()).collect(),
            CovarianceSource::Mapped(Arc::new(self.clone()), map.clone()),
            coordinates,
        )
    }

    /// Σ w (y − mean)² of every cell, into `out`; all padded.
    pub fn distances(&self, y: &[f32], w: &[f32], out: &mut Vec<f32>) {
        distances(&self.single, y, w, out);
    }
}

/// The covariance (d, d) of a part of poses that went through `map`.
fn map_covariance(
    own: &Array2<f64>,
    map: &PoseTransform,
    coordinates: &[usize],
    width: usize,
) -> Array2<f64> {
    let mut whole = Array2::zeros((width, width));
    for (i, &to) in coordinates.iter().enumerate() {
        for (j, &other) in coordinates.iter().enumerate() {
            whole[[to, other]] = own[[i, j]];
        }
    }
    let whole = map.apply_covariance(whole.view());
    whole
        .select(Axis(0), coordinates)
        .select(Axis(1), coordinates)
}

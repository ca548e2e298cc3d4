//! One level of clusters: a mean, a covariance and a proportion of the training poses each.

use super::eigen_covariance::EigenCovariance;
use crate::numeric::simd::{self, distances};
use crate::pose::PoseTransform;
use ndarray::{Array2, Axis, s};
use std::sync::{Arc, OnceLock};

/// The K clusters of one level, of one part with d coordinates.
#[derive(Debug, Clone)]
pub(crate) struct ClusterLevel {
    /// The means of whole poses, (K, 3 J), cm: a transform of a part's mean may need the rest of
    /// the pose.
    pub full_means: Array2<f64>,
    /// The means of the part, (K, d), cm.
    means: Array2<f64>,
    /// The means in single precision, rows padded.
    single_means: Vec<f32>,
    /// log (poses of the cluster / all poses).
    pub log_proportions: Vec<f64>,
    /// The mean over the clusters of each coordinate's variance, cm².
    pub within: Vec<f64>,
    /// The covariances as a model file keeps them, before any transform.
    pub stored: Arc<StoredCovariances>,
    /// The clusters before the last transform, and the transform.
    origin: Option<(Arc<ClusterLevel>, Arc<PoseTransform>)>,
    /// The covariances that were asked for; clones share them.
    covariances: Arc<Vec<OnceLock<Arc<EigenCovariance>>>>,
}

/// The covariances of K clusters as a model file keeps them.
#[derive(Debug, Clone)]
pub(crate) struct StoredCovariances {
    /// The eigenvectors of each, one per column, (K d, d).
    pub directions: Array2<f32>,
    /// The standard deviation along each, cm, (K, d).
    pub deviations: Array2<f32>,
}

impl StoredCovariances {
    /// Stores decompositions of d coordinates.
    pub(crate) fn of(covariances: &[EigenCovariance], d: usize) -> StoredCovariances {
        let k = covariances.len();
        StoredCovariances {
            directions: Array2::from_shape_fn((k * d, d), |(i, j)| {
                covariances[i / d].row(i % d)[j]
            }),
            deviations: Array2::from_shape_fn((k, d), |(c, i)| {
                covariances[c].values[i].sqrt() as f32
            }),
        }
    }

    /// The mean over the clusters, in these proportions, of each coordinate's variance (d), cm².
    pub(crate) fn mean_variances(&self, log_proportions: &[f64]) -> Vec<f64> {
        let mut mean = vec![0.0; self.deviations.ncols()];
        for (cluster, log) in log_proportions.iter().enumerate() {
            let variances = self.get(cluster).diagonal();
            let both = mean.iter_mut().zip(variances);
            both.for_each(|(m, v)| *m += log.exp() * v);
        }
        mean
    }

    fn get(&self, cluster: usize) -> EigenCovariance {
        let d = self.deviations.ncols();
        let directions = self
            .directions
            .slice(s![cluster * d..(cluster + 1) * d, ..]);
        EigenCovariance::from_parts(directions, self.deviations.row(cluster))
    }
}

impl ClusterLevel {
    /// Clusters of the part with these coordinates.
    pub(crate) fn new(
        full_means: Array2<f64>,
        log_proportions: Vec<f64>,
        stored: Arc<StoredCovariances>,
        within: Vec<f64>,
        coordinates: &[usize],
    ) -> ClusterLevel {
        let means = full_means.select(Axis(1), coordinates);
        let means = means.as_standard_layout().into_owned();
        ClusterLevel {
            single_means: simd::rows(&means),
            means,
            full_means,
            covariances: Arc::new(log_proportions.iter().map(|_| OnceLock::new()).collect()),
            log_proportions,
            within,
            stored,
            origin: None,
        }
    }

    /// The number of clusters, K.
    pub(crate) fn len(&self) -> usize {
        self.log_proportions.len()
    }

    /// The mean of a cluster (d), cm.
    pub(crate) fn mean(&self, cluster: usize) -> &[f64] {
        let d = self.means.ncols();
        let means = self.means.as_slice();
        means.map_or(&[], |means| &means[cluster * d..(cluster + 1) * d])
    }

    /// The covariance of a cluster.
    pub(crate) fn covariance(&self, cluster: usize, coordinates: &[usize]) -> Arc<EigenCovariance> {
        let make = || {
            let Some((origin, map)) = &self.origin else {
                return self.stored.get(cluster).into();
            };
            let covariance = origin.covariance(cluster, coordinates);
            let mapped = match &**map {
                PoseTransform::Rotate(rotation) => covariance.rotated(rotation),
                map => {
                    let width = self.full_means.ncols();
                    let mapped = map_covariance(&covariance.covariance(), map, coordinates, width);
                    EigenCovariance::of(mapped.view())
                }
            };
            mapped.into()
        };
        self.covariances[cluster].get_or_init(make).clone()
    }

    /// The clusters of poses transformed by `map`. The covariance of the part with the rest of the
    /// body counts as 0.
    pub(crate) fn mapped(&self, map: &Arc<PoseTransform>, coordinates: &[usize]) -> ClusterLevel {
        ClusterLevel {
            origin: Some((Arc::new(self.clone()), map.clone())),
            ..ClusterLevel::new(
                map.apply_rows(self.full_means.view()),
                self.log_proportions.clone(),
                self.stored.clone(),
                // Good enough to rank clusters by: bodies differ less than poses.
                self.within.clone(),
                coordinates,
            )
        }
    }

    /// Σ w (y − mean)² of every cluster; `y` and `w` are padded.
    pub(crate) fn distances(&self, y: &[f32], w: &[f32]) -> Vec<f32> {
        let mut out = Vec::new();
        distances(&self.single_means, y, w, &mut out);
        out
    }
}

/// The covariance (d, d) of a part of poses transformed by `map`.
fn map_covariance(
    own: &Array2<f64>,
    map: &PoseTransform,
    coordinates: &[usize],
    width: usize,
) -> Array2<f64> {
    let mut full = Array2::zeros((width, width));
    for (i, &to) in coordinates.iter().enumerate() {
        for (j, &other) in coordinates.iter().enumerate() {
            full[[to, other]] = own[[i, j]];
        }
    }
    let full = map.apply_covariance(full.view());
    full.select(Axis(0), coordinates)
        .select(Axis(1), coordinates)
}

//! Exemplars: every training pose is a component of its own, with a share of its cluster's covariance.
//!
//! An exemplar also has a step, half the way from the pose before it to the pose after it in its take: its component may be
//! wider along the step, since a pose between two known ones is likely.
//!
//! A frame needs few exemplars of few clusters. All values are therefore worked out when they are first asked for, in small
//! groups, and kept.

use super::eigen_covariance::EigenCovariance;
use crate::io::model::Matrix;
use crate::numeric::simd::{combine, distances, padded};
use crate::pose::PoseTransform;
use ndarray::Array2;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Poses that are unpacked and transformed together.
const CHUNK: usize = 32;
/// Exemplars of a cluster whose coordinates are worked out together.
const GROUP: usize = 16;

/// The training poses (N, 3 J), take after take: all parts share them.
#[derive(Debug)]
pub struct ExemplarPoses {
    /// As a model file keeps them, cm, before any transform.
    stored: Matrix,
    /// The poses before the last transform, and the transform.
    origin: Option<(Arc<ExemplarPoses>, Arc<PoseTransform>)>,
    /// [`CHUNK`] poses each.
    chunks: Vec<OnceLock<Box<[f32]>>>,
    /// The rows of each take.
    pub takes: Vec<Range<usize>>,
}

impl ExemplarPoses {
    /// Poses (N, 3 J), cm.
    pub fn new(stored: Matrix, takes: Vec<Range<usize>>) -> ExemplarPoses {
        ExemplarPoses {
            chunks: (0..stored.nrows().div_ceil(CHUNK))
                .map(|_| OnceLock::new())
                .collect(),
            origin: None,
            stored,
            takes,
        }
    }

    /// The poses transformed by `map`.
    pub fn mapped(self: &Arc<ExemplarPoses>, map: &Arc<PoseTransform>) -> ExemplarPoses {
        ExemplarPoses {
            origin: Some((self.clone(), map.clone())),
            ..ExemplarPoses::new(self.stored.clone(), self.takes.clone())
        }
    }

    /// The number of poses, N.
    pub fn len(&self) -> usize {
        self.stored.nrows()
    }

    /// One pose (3 J), cm.
    pub fn pose(&self, row: usize) -> &[f32] {
        let width = self.stored.ncols();
        &self.chunk(row / CHUNK)[row % CHUNK * width..][..width]
    }

    fn chunk(&self, chunk: usize) -> &[f32] {
        self.chunks[chunk].get_or_init(|| {
            let Some((origin, map)) = &self.origin else {
                let first = chunk * CHUNK;
                let mut poses = Vec::new();
                (self.stored).extend_with(first..(first + CHUNK).min(self.len()), &mut poses);
                return poses.into();
            };
            let mut poses: Box<[f32]> = origin.chunk(chunk).into();
            let width = self.stored.ncols();
            let mut mapped = vec![0.0; width];
            for pose in poses.chunks_exact_mut(width) {
                let before: Vec<f64> = pose.iter().map(|v| f64::from(*v)).collect();
                map.apply(&before, &mut mapped);
                pose.iter_mut()
                    .zip(&mapped)
                    .for_each(|(p, m)| *p = *m as f32);
            }
            poses
        })
    }

    /// All poses (N, 3 J), cm.
    pub fn xyz(&self) -> Array2<f32> {
        let all = (0..self.len()).flat_map(|row| self.pose(row)).copied();
        Array2::from_shape_vec(self.stored.dim(), all.collect()).unwrap_or_default()
    }

    /// Appends a pose's step in some coordinates.
    fn extend_with_step(&self, row: usize, coordinates: &[usize], out: &mut Vec<f32>) {
        let take = &self.takes[self.takes.partition_point(|t| t.end <= row)];
        let before = self.pose(row.saturating_sub(1).max(take.start));
        let after = self.pose((row + 1).min(take.end - 1));
        out.extend(coordinates.iter().map(|&c| 0.5 * (after[c] - before[c])));
    }
}

/// The exemplars of one part, by the clusters of its finest level.
#[derive(Debug, Clone)]
pub struct Exemplars {
    poses: Arc<ExemplarPoses>,
    /// The training pose of each exemplar, sorted by cluster.
    rows: Arc<[u32]>,
    /// Where each cluster's exemplars begin in `rows`; one more at the end.
    starts: Arc<[u32]>,
    opened: Arc<Vec<OnceLock<ClusterExemplars>>>,
}

/// The n exemplars of one cluster, of a part with d coordinates.
#[derive(Debug)]
pub struct ClusterExemplars {
    /// The length of a padded row.
    stride: usize,
    /// (n, stride), cm.
    poses: Vec<f32>,
    /// The training pose of each exemplar.
    rows: Box<[u32]>,
    all: Arc<ExemplarPoses>,
    coordinates: Box<[usize]>,
    /// The cluster's mean (d), cm.
    mean: Vec<f32>,
    covariance: Arc<EigenCovariance>,
    /// [`GROUP`] exemplars each.
    steps: Vec<OnceLock<Box<[f32]>>>,
    eigen_coordinates: Vec<OnceLock<EigenCoordinates>>,
}

/// Some exemplars along their cluster's eigenvectors.
#[derive(Debug)]
struct EigenCoordinates {
    /// The poses less the cluster's mean, (n, stride), cm.
    poses: Box<[f32]>,
    /// The steps, (n, stride), cm.
    steps: Box<[f32]>,
}

impl Exemplars {
    /// `labels` gives the cluster of each training pose.
    pub fn new(poses: Arc<ExemplarPoses>, labels: &[u32], clusters: usize) -> Exemplars {
        let mut starts = vec![0u32; clusters + 1];
        labels.iter().for_each(|l| starts[*l as usize + 1] += 1);
        (0..clusters).for_each(|c| starts[c + 1] += starts[c]);
        let mut rows: Vec<u32> = (0..labels.len() as u32).collect();
        rows.sort_by_key(|row| labels[*row as usize]);
        Exemplars {
            starts: starts.into(),
            opened: Arc::new((0..clusters).map(|_| OnceLock::new()).collect()),
            poses,
            rows: rows.into(),
        }
    }

    /// The number of exemplars.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    fn rows_of(&self, cluster: usize) -> &[u32] {
        &self.rows[self.starts[cluster] as usize..self.starts[cluster + 1] as usize]
    }

    /// The exemplars of transformed poses.
    pub fn mapped(&self, poses: Arc<ExemplarPoses>) -> Exemplars {
        Exemplars {
            poses,
            opened: Arc::new(self.opened.iter().map(|_| OnceLock::new()).collect()),
            ..self.clone()
        }
    }

    /// The cluster of each training pose.
    pub fn labels(&self) -> Vec<usize> {
        let mut labels = vec![0; self.rows.len()];
        for cluster in 0..self.opened.len() {
            for &row in self.rows_of(cluster) {
                labels[row as usize] = cluster;
            }
        }
        labels
    }

    /// The exemplars of a cluster with the given mean and covariance.
    pub fn open(
        &self,
        cluster: usize,
        coordinates: &[usize],
        mean: &[f64],
        covariance: impl FnOnce() -> Arc<EigenCovariance>,
    ) -> &ClusterExemplars {
        self.opened[cluster].get_or_init(|| {
            let stride = padded(coordinates.len());
            let rows = self.rows_of(cluster);
            let mut poses = Vec::with_capacity(rows.len() * stride);
            for &row in rows {
                let pose = self.poses.pose(row as usize);
                poses.extend(coordinates.iter().map(|&c| pose[c]));
                poses.resize(poses.len().next_multiple_of(stride), 0.0);
            }
            let groups = rows.len().div_ceil(GROUP);
            ClusterExemplars {
                stride,
                poses,
                rows: rows.into(),
                all: self.poses.clone(),
                coordinates: coordinates.into(),
                mean: mean.iter().map(|v| *v as f32).collect(),
                covariance: covariance(),
                steps: (0..groups).map(|_| OnceLock::new()).collect(),
                eigen_coordinates: (0..groups).map(|_| OnceLock::new()).collect(),
            }
        })
    }
}

impl ClusterExemplars {
    fn row<'a>(&self, rows: &'a [f32], exemplar: usize) -> &'a [f32] {
        &rows[exemplar * self.stride..(exemplar + 1) * self.stride]
    }

    /// An exemplar's pose, cm, padded.
    pub fn pose(&self, exemplar: usize) -> &[f32] {
        self.row(&self.poses, exemplar)
    }

    /// An exemplar's step, cm, padded.
    pub fn step(&self, exemplar: usize) -> &[f32] {
        self.row(self.steps(exemplar / GROUP), exemplar % GROUP)
    }

    /// An exemplar's pose less the cluster's mean, along the cluster's eigenvectors.
    pub fn eigen_pose(&self, exemplar: usize) -> &[f32] {
        self.row(
            &self.eigen_coordinates(exemplar / GROUP).poses,
            exemplar % GROUP,
        )
    }

    /// An exemplar's step along the cluster's eigenvectors.
    pub fn eigen_step(&self, exemplar: usize) -> &[f32] {
        self.row(
            &self.eigen_coordinates(exemplar / GROUP).steps,
            exemplar % GROUP,
        )
    }

    fn group(&self, group: usize) -> Range<usize> {
        group * GROUP..((group + 1) * GROUP).min(self.rows.len())
    }

    fn steps(&self, group: usize) -> &[f32] {
        self.steps[group].get_or_init(|| {
            let mut steps = Vec::with_capacity(GROUP * self.stride);
            for &row in &self.rows[self.group(group)] {
                (self.all).extend_with_step(row as usize, &self.coordinates, &mut steps);
                steps.resize(steps.len().next_multiple_of(self.stride), 0.0);
            }
            steps.into()
        })
    }

    fn eigen_coordinates(&self, group: usize) -> &EigenCoordinates {
        self.eigen_coordinates[group].get_or_init(|| {
            let range = self.group(group);
            let poses = &self.poses[range.start * self.stride..range.end * self.stride];
            let origin = vec![0.0; self.mean.len()];
            EigenCoordinates {
                poses: self.project(poses, &self.mean),
                steps: self.project(self.steps(group), &origin),
            }
        })
    }

    /// Rows less `origin` (d) along the eigenvectors; rows are padded.
    fn project(&self, rows: &[f32], origin: &[f32]) -> Box<[f32]> {
        let mut out = vec![0.0; rows.len()];
        for (row, out) in rows.chunks(self.stride).zip(out.chunks_mut(self.stride)) {
            let off: Vec<f32> = row.iter().zip(origin).map(|(r, o)| r - o).collect();
            combine(self.covariance.vectors(), self.stride, &off, out);
        }
        out.into()
    }

    /// Σ w (y − pose)² of every exemplar, into `out`; `y` and `w` are padded.
    pub fn distances(&self, y: &[f32], w: &[f32], out: &mut Vec<f32>) {
        distances(&self.poses, y, w, out);
    }
}

//! Exemplars: every training pose is a component of its own, with a share of its cluster's
//! covariance.
//!
//! An exemplar also has a step, half the way from the pose before it to the pose after it in its
//! take: its component may be wider along the step, since a pose between two known ones is likely.

use crate::numeric::simd::{distances, padded};
use crate::pose::PoseTransform;
use ndarray::{Array2, ArrayView1};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// The training poses (N, 3 J), take after take: all parts share them.
#[derive(Debug)]
pub(crate) struct ExemplarPoses {
    /// (N, 3 J), cm; empty for transformed poses.
    xyz: Array2<f32>,
    mapped: Option<MappedPoses>,
    /// The rows of each take.
    pub takes: Vec<Range<usize>>,
}

/// Transformed poses; a frame needs few, which are transformed when they are first asked for.
#[derive(Debug)]
struct MappedPoses {
    origin: Arc<ExemplarPoses>,
    map: Arc<PoseTransform>,
    poses: Vec<OnceLock<Box<[f32]>>>,
}

impl ExemplarPoses {
    /// Poses (N, 3 J), cm.
    pub(crate) fn new(xyz: Array2<f32>, takes: Vec<Range<usize>>) -> ExemplarPoses {
        ExemplarPoses {
            xyz,
            mapped: None,
            takes,
        }
    }

    /// The poses transformed by `map`.
    pub(crate) fn mapped(self: &Arc<ExemplarPoses>, map: &Arc<PoseTransform>) -> ExemplarPoses {
        let poses = self.takes.last().map_or(0, |t| t.end);
        let poses = (0..poses).map(|_| OnceLock::new()).collect();
        ExemplarPoses {
            xyz: Array2::zeros((0, 0)),
            mapped: Some(MappedPoses {
                origin: self.clone(),
                map: map.clone(),
                poses,
            }),
            takes: self.takes.clone(),
        }
    }

    /// All poses (N, 3 J), cm; empty for transformed poses.
    pub(crate) fn xyz(&self) -> &Array2<f32> {
        &self.xyz
    }

    /// Copies of all poses (N, 3 J), cm, transformed or not.
    pub(crate) fn all(&self) -> Array2<f64> {
        match &self.mapped {
            Some(MappedPoses { origin, map, .. }) => map.apply_rows(origin.all().view()),
            None => self.xyz.mapv(f64::from),
        }
    }

    /// A pose (3 J), cm.
    fn pose(&self, row: usize) -> ArrayView1<'_, f32> {
        let Some(MappedPoses { origin, map, poses }) = &self.mapped else {
            return self.xyz.row(row);
        };
        let pose = poses[row].get_or_init(|| {
            let before: Vec<f64> = origin.pose(row).iter().map(|v| f64::from(*v)).collect();
            let mut after = before.clone();
            map.apply(&before, &mut after);
            after.iter().map(|v| *v as f32).collect()
        });
        ArrayView1::from(&pose[..])
    }

    /// The step of a pose, cm, in some coordinates.
    fn step(&self, row: usize, coordinates: &[usize]) -> impl Iterator<Item = f32> {
        let take = &self.takes[self.takes.partition_point(|t| t.end <= row)];
        let before = self.pose(row.saturating_sub(1).max(take.start));
        let after = self.pose((row + 1).min(take.end - 1));
        coordinates
            .iter()
            .map(move |&c| 0.5 * (after[c] - before[c]))
    }
}

/// The exemplars of one part, by the clusters of its finest level.
#[derive(Debug, Clone)]
pub(crate) struct Exemplars {
    poses: Arc<ExemplarPoses>,
    /// The training pose of each exemplar, sorted by cluster.
    rows: Arc<[u32]>,
    /// Where each cluster's exemplars begin in `rows`; one more at the end.
    starts: Arc<[u32]>,
    /// A frame needs few clusters: their exemplars are gathered when they are first asked for.
    opened: Arc<Vec<OnceLock<ClusterExemplars>>>,
}

/// The n exemplars of one cluster, of a part with d coordinates.
#[derive(Debug)]
pub(crate) struct ClusterExemplars {
    /// The length of a padded row.
    stride: usize,
    /// (n, stride), cm.
    poses: Vec<f32>,
    /// (n, stride), cm.
    steps: Vec<f32>,
}

impl Exemplars {
    /// `labels` gives the cluster of each training pose.
    pub(crate) fn new(poses: Arc<ExemplarPoses>, labels: &[u32], clusters: usize) -> Exemplars {
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
    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    fn rows_of(&self, cluster: usize) -> &[u32] {
        &self.rows[self.starts[cluster] as usize..self.starts[cluster + 1] as usize]
    }

    /// The exemplars of transformed poses.
    pub(crate) fn mapped(&self, poses: Arc<ExemplarPoses>) -> Exemplars {
        Exemplars {
            poses,
            opened: Arc::new(self.opened.iter().map(|_| OnceLock::new()).collect()),
            ..self.clone()
        }
    }

    /// The cluster of each training pose.
    pub(crate) fn labels(&self) -> Vec<usize> {
        let mut labels = vec![0; self.rows.len()];
        for cluster in 0..self.opened.len() {
            for &row in self.rows_of(cluster) {
                labels[row as usize] = cluster;
            }
        }
        labels
    }

    /// The exemplars of a cluster, in these coordinates.
    pub(crate) fn of_cluster(&self, cluster: usize, coordinates: &[usize]) -> &ClusterExemplars {
        self.opened[cluster].get_or_init(|| {
            let stride = padded(coordinates.len());
            let rows = self.rows_of(cluster);
            let mut poses = Vec::with_capacity(rows.len() * stride);
            let mut steps = Vec::with_capacity(rows.len() * stride);
            for (end, &row) in (stride..).step_by(stride).zip(rows) {
                let pose = self.poses.pose(row as usize);
                poses.extend(coordinates.iter().map(|&c| pose[c]));
                poses.resize(end, 0.0);
                steps.extend(self.poses.step(row as usize, coordinates));
                steps.resize(end, 0.0);
            }
            ClusterExemplars {
                stride,
                poses,
                steps,
            }
        })
    }
}

impl ClusterExemplars {
    /// An exemplar's pose, cm, padded.
    pub(crate) fn pose(&self, exemplar: usize) -> &[f32] {
        &self.poses[exemplar * self.stride..(exemplar + 1) * self.stride]
    }

    /// An exemplar's step, cm, padded.
    pub(crate) fn step(&self, exemplar: usize) -> &[f32] {
        &self.steps[exemplar * self.stride..(exemplar + 1) * self.stride]
    }

    /// Σ w (y − pose)² of every exemplar; `y` and `w` are padded.
    pub(crate) fn distances(&self, y: &[f32], w: &[f32]) -> Vec<f32> {
        let mut out = Vec::new();
        distances(&self.poses, y, w, &mut out);
        out
    }
}

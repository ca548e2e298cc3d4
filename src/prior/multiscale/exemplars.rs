//! Every training pose as a block of its own, as wide as a share of its cell.

use super::eigen_covariance::EigenCovariance;
use crate::io::model::Matrix;
use crate::numeric::simd::{combine, distances, padded};
use crate::pose::PoseTransform;
use ndarray::{Array2, ArrayView1};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// So many poses are carried through a map at a time.
const CHUNK: usize = 32;

/// The training poses and how they move: shared by all parts. One frame asks for few of them, so they are unpacked when they
/// are asked for, and carried through a map a few at a time.
#[derive(Debug)]
pub struct ExemplarPoses {
    source: PoseSource,
    /// (N, 3 J).
    shape: (usize, usize),
    /// The rows of each take.
    pub takes: Vec<Range<usize>>,
}

#[derive(Debug)]
enum PoseSource {
    Own(Matrix),
    Mapped {
        origin: Arc<ExemplarPoses>,
        map: Arc<PoseTransform>,
        /// [`CHUNK`] rows each.
        chunks: Vec<OnceLock<Box<[f32]>>>,
    },
}

impl ExemplarPoses {
    /// Poses (N, 3 J), cm, take after take.
    pub fn new(xyz: Matrix, takes: Vec<Range<usize>>) -> ExemplarPoses {
        ExemplarPoses {
            shape: xyz.dim(),
            source: PoseSource::Own(xyz),
            takes,
        }
    }

    /// The same carried through a map.
    pub fn mapped(self: &Arc<ExemplarPoses>, map: &Arc<PoseTransform>) -> ExemplarPoses {
        let chunks = (0..self.len().div_ceil(CHUNK)).map(|_| OnceLock::new());
        ExemplarPoses {
            source: PoseSource::Mapped {
                origin: self.clone(),
                map: map.clone(),
                chunks: chunks.collect(),
            },
            shape: self.shape,
            takes: self.takes.clone(),
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.shape.0
    }

    /// Appends some coordinates of a pose, cm.
    pub fn extend_with(&self, row: usize, coordinates: &[usize], out: &mut Vec<f32>) {
        match &self.source {
            PoseSource::Own(xyz) => xyz.gather(row, coordinates, out),
            PoseSource::Mapped { chunks, .. } => {
                let chunk = chunks[row / CHUNK].get_or_init(|| {
                    let first = row / CHUNK * CHUNK;
                    self.map_covariance(first..(first + CHUNK).min(self.len()))
                });
                let pose = &chunk[row % CHUNK * self.shape.1..];
                out.extend(coordinates.iter().map(|&c| pose[c]));
            }
        }
    }

    /// Some poses as they are once they went through the map.
    fn map_covariance(&self, rows: Range<usize>) -> Box<[f32]> {
        let PoseSource::Mapped { origin, map, .. } = &self.source else {
            return Box::default();
        };
        let all: Vec<usize> = (0..self.shape.1).collect();
        let mut out = Vec::with_capacity(rows.len() * all.len());
        let (mut single, mut mapped) = (Vec::new(), vec![0.0; all.len()]);
        for row in rows {
            single.clear();
            origin.extend_with(row, &all, &mut single);
            let pose: Vec<f64> = single.iter().map(|v| f64::from(*v)).collect();
            map.apply(&pose, &mut mapped);
            out.extend(mapped.iter().map(|v| *v as f32));
        }
        out.into()
    }

    /// All, (N, 3 J), cm.
    pub fn xyz(&self) -> Array2<f32> {
        let all: Vec<usize> = (0..self.shape.1).collect();
        let mut out = Vec::with_capacity(self.len() * all.len());
        (0..self.len()).for_each(|row| self.extend_with(row, &all, &mut out));
        // As many as there are: cannot fail.
        Array2::from_shape_vec(self.shape, out).unwrap_or_default()
    }

    /// Appends half the step from the pose before to the one after in the same take, of some coordinates.
    pub fn step(&self, row: usize, coordinates: &[usize], out: &mut Vec<f32>) {
        let take = &self.takes[self.takes.partition_point(|t| t.end <= row)];
        let before = row.saturating_sub(1).max(take.start);
        let (start, d) = (out.len(), coordinates.len());
        self.extend_with(before, coordinates, out);
        self.extend_with((row + 1).min(take.end - 1), coordinates, out);
        for c in start..start + d {
            out[c] = 0.5 * (out[c + d] - out[c]);
        }
        out.truncate(start + d);
    }
}

/// The leaves of one part, by their cells.
#[derive(Debug, Clone)]
pub struct Exemplars {
    poses: Arc<ExemplarPoses>,
    /// Which training pose each leaf is, sorted by cell.
    rows: Arc<[u32]>,
    /// Where the leaves of each cell begin; one more at the end.
    starts: Arc<[u32]>,
    /// What is made of a cell's leaves when it is first opened.
    opened: Arc<Vec<OnceLock<ClusterExemplars>>>,
}

/// So many leaves of a cell are turned at a time.
const GROUP: usize = 16;

/// The leaves of one cell. What only the nearest are asked for is made a few at a time: one frame asks for few of them.
#[derive(Debug)]
pub struct ClusterExemplars {
    /// Rows are padded.
    stride: usize,
    /// (n, d), cm.
    poses: Vec<f32>,
    /// Which training pose each leaf is.
    rows: Box<[u32]>,
    all: Arc<ExemplarPoses>,
    coordinates: Box<[usize]>,
    /// (d), cm.
    mean: Vec<f32>,
    basis: Arc<EigenCovariance>,
    /// (n, d), cm, [`GROUP`] rows each: half the step from the pose before to the one after.
    steps: Vec<OnceLock<Box<[f32]>>>,
    /// [`GROUP`] rows each.
    turned: Vec<OnceLock<EigenCoordinates>>,
}

/// Some leaves in their cell's directions.
#[derive(Debug)]
struct EigenCoordinates {
    /// The poses less the cell's mean, (n, d).
    pose_coordinates: Box<[f32]>,
    /// The steps, (n, d).
    step_coordinates: Box<[f32]>,
}

impl Exemplars {
    /// Leaves by the cell that each training pose belongs to.
    pub fn new(poses: Arc<ExemplarPoses>, labels: &[u32], clusters: usize) -> Exemplars {
        let mut starts = vec![0u32; clusters + 1];
        labels.iter().for_each(|l| starts[*l as usize + 1] += 1);
        (0..clusters).for_each(|c| starts[c + 1] += starts[c]);
        let (mut next, mut rows) = (starts.clone(), vec![0; labels.len()]);
        for (row, label) in (0..).zip(labels) {
            let next = &mut next[*label as usize];
            rows[*next as usize] = row;
            *next += 1;
        }
        Exemplars {
            starts: starts.into(),
            opened: Arc::new((0..clusters).map(|_| OnceLock::new()).collect()),
            poses,
            rows: rows.into(),
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    fn cluster(&self, cluster: usize) -> &[u32] {
        &self.rows[self.starts[cluster] as usize..self.starts[cluster + 1] as usize]
    }

    /// The same of poses that went through a map.
    pub fn mapped(&self, poses: Arc<ExemplarPoses>) -> Exemplars {
        Exemplars {
            poses,
            opened: Arc::new(self.opened.iter().map(|_| OnceLock::new()).collect()),
            ..self.clone()
        }
    }

    /// The cell of each training pose, in their own order.
    pub fn labels(&self) -> Vec<usize> {
        let mut labels = vec![0; self.rows.len()];
        for cluster in 0..self.opened.len() {
            for &row in self.cluster(cluster) {
                labels[row as usize] = cluster;
            }
        }
        labels
    }

    /// The leaves of a cell, whose mean and directions are given.
    pub fn open(
        &self,
        cluster: usize,
        coordinates: &[usize],
        mean: ArrayView1<'_, f64>,
        basis: impl FnOnce() -> Arc<EigenCovariance>,
    ) -> &ClusterExemplars {
        self.opened[cluster].get_or_init(|| {
            let stride = padded(coordinates.len());
            let rows = self.cluster(cluster);
            let mut poses = Vec::with_capacity(rows.len() * stride);
            for &row in rows {
                self.poses
                    .extend_with(row as usize, coordinates, &mut poses);
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
                basis: basis(),
                steps: (0..groups).map(|_| OnceLock::new()).collect(),
                turned: (0..groups).map(|_| OnceLock::new()).collect(),
            }
        })
    }
}

impl ClusterExemplars {
    fn row<'a>(&self, of: &'a [f32], exemplar: usize) -> &'a [f32] {
        &of[exemplar * self.stride..(exemplar + 1) * self.stride]
    }

    /// A leaf's pose, cm.
    pub fn pose(&self, exemplar: usize) -> &[f32] {
        self.row(&self.poses, exemplar)
    }

    /// A leaf's step, cm.
    pub fn step(&self, exemplar: usize) -> &[f32] {
        self.row(self.steps(exemplar / GROUP), exemplar % GROUP)
    }

    /// A leaf's pose less the cell's mean, in the cell's directions.
    pub fn code(&self, exemplar: usize) -> &[f32] {
        self.row(
            &self.turned(exemplar / GROUP).pose_coordinates,
            exemplar % GROUP,
        )
    }

    /// A leaf's step in the cell's directions.
    pub fn step_coordinates(&self, exemplar: usize) -> &[f32] {
        self.row(
            &self.turned(exemplar / GROUP).step_coordinates,
            exemplar % GROUP,
        )
    }

    fn group(&self, group: usize) -> Range<usize> {
        group * GROUP..((group + 1) * GROUP).min(self.rows.len())
    }

    fn steps(&self, group: usize) -> &[f32] {
        self.steps[group].get_or_init(|| {
            // One row more: a step is worked out beside the last.
            let mut steps = Vec::with_capacity((GROUP + 1) * self.stride);
            for &row in &self.rows[self.group(group)] {
                self.all.step(row as usize, &self.coordinates, &mut steps);
                steps.resize(steps.len().next_multiple_of(self.stride), 0.0);
            }
            steps.into()
        })
    }

    fn turned(&self, group: usize) -> &EigenCoordinates {
        self.turned[group].get_or_init(|| {
            let exemplars = self.group(group);
            let poses = &self.poses[exemplars.start * self.stride..exemplars.end * self.stride];
            EigenCoordinates {
                pose_coordinates: self.project_rows(poses, Some(&self.mean)),
                step_coordinates: self.project_rows(self.steps(group), None),
            }
        })
    }

    /// Padded rows, less the mean where one is given, in the cell's directions.
    fn project_rows(&self, rows: &[f32], mean: Option<&[f32]>) -> Box<[f32]> {
        let mut out = vec![0.0; rows.len()];
        let mut off = Vec::with_capacity(self.coordinates.len());
        let both = rows.chunks(self.stride).zip(out.chunks_mut(self.stride));
        for (from, out) in both {
            let row = &mut off;
            row.clear();
            row.extend_from_slice(&from[..self.coordinates.len()]);
            for (r, m) in row.iter_mut().zip(mean.unwrap_or_default()) {
                *r -= m;
            }
            combine(self.basis.vectors(), self.stride, row, out);
        }
        out.into()
    }

    /// Σ w (y − pose)² of every leaf, into `out`; all padded.
    pub fn distances(&self, y: &[f32], w: &[f32], out: &mut Vec<f32>) {
        distances(&self.poses, y, w, out);
    }
}

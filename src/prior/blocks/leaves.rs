//! Every training pose as a block of its own, as wide as a share of its cell.

use super::basis::Basis;
use crate::pose::PoseMap;
use crate::simd::{combine, distances, padded};
use ndarray::{Array2, ArrayView1};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// The training poses and how they move: shared by all parts.
#[derive(Debug)]
pub struct Poses {
    xyz: OnceLock<Array2<f32>>,
    /// The rows of each take.
    pub takes: Vec<Range<usize>>,
    /// What they are made from when first asked for, where they went through a map.
    origin: Option<(Arc<Poses>, Arc<PoseMap>)>,
}

impl Poses {
    /// Poses (N, 3 J), cm, take after take.
    pub fn new(xyz: Array2<f32>, takes: Vec<Range<usize>>) -> Poses {
        Poses {
            xyz: xyz.into(),
            takes,
            origin: None,
        }
    }

    /// The same carried through a map, once they are asked for.
    pub fn mapped(self: &Arc<Poses>, map: &Arc<PoseMap>) -> Poses {
        Poses {
            xyz: OnceLock::new(),
            takes: self.takes.clone(),
            origin: Some((self.clone(), map.clone())),
        }
    }

    /// (N, 3 J), cm, take after take.
    pub fn xyz(&self) -> &Array2<f32> {
        self.xyz.get_or_init(|| match &self.origin {
            Some((origin, map)) => {
                let from = origin.xyz().mapv(f64::from);
                map.apply_rows(from.view()).mapv(|v| v as f32)
            }
            None => Array2::zeros((0, 0)),
        })
    }

    /// Half the step from the pose before to the one after in the same take, of some coordinates.
    pub fn step(&self, row: usize, coordinates: &[usize], out: &mut Vec<f32>) {
        let take = &self.takes[self.takes.partition_point(|t| t.end <= row)];
        let before = self.xyz().row(row.saturating_sub(1).max(take.start));
        let after = self.xyz().row((row + 1).min(take.end - 1));
        out.extend(coordinates.iter().map(|&c| 0.5 * (after[c] - before[c])));
    }
}

/// The leaves of one part, by their cells.
#[derive(Debug, Clone)]
pub struct Leaves {
    poses: Arc<Poses>,
    /// Which training pose each leaf is, sorted by cell.
    pub rows: Vec<usize>,
    /// Where the leaves of each cell begin; one more at the end.
    pub starts: Vec<usize>,
    /// What is made of a cell's leaves when it is first opened.
    opened: Arc<Vec<OnceLock<Opened>>>,
}

/// The leaves of one cell.
#[derive(Debug)]
pub struct Opened {
    /// Rows are padded.
    stride: usize,
    /// (n, d), cm.
    poses: Vec<f32>,
    /// (n, d), cm: half the step from the pose before to the one after.
    steps: Vec<f32>,
    /// (n, d): the poses less the cell's mean, in the cell's directions.
    codes: Vec<f32>,
    /// (n, d): the steps in the cell's directions.
    turns: Vec<f32>,
}

impl Leaves {
    /// Leaves by the cell that each training pose belongs to.
    pub fn new(poses: Arc<Poses>, labels: &[usize], cells: usize) -> Leaves {
        let mut starts = vec![0; cells + 1];
        labels.iter().for_each(|l| starts[l + 1] += 1);
        (0..cells).for_each(|c| starts[c + 1] += starts[c]);
        let (mut next, mut rows) = (starts.clone(), vec![0; labels.len()]);
        for (row, label) in labels.iter().enumerate() {
            rows[next[*label]] = row;
            next[*label] += 1;
        }
        Leaves {
            starts,
            opened: Arc::new((0..cells).map(|_| OnceLock::new()).collect()),
            poses,
            rows,
        }
    }

    /// The same of poses that went through a map.
    pub fn mapped(&self, poses: Arc<Poses>) -> Leaves {
        Leaves {
            poses,
            opened: Arc::new(self.opened.iter().map(|_| OnceLock::new()).collect()),
            ..self.clone()
        }
    }

    /// The cell of each training pose, in their own order.
    pub fn labels(&self) -> Vec<usize> {
        let mut labels = vec![0; self.rows.len()];
        for (cell, range) in self.starts.windows(2).enumerate() {
            for &row in &self.rows[range[0]..range[1]] {
                labels[row] = cell;
            }
        }
        labels
    }

    /// The leaves of a cell, whose mean and directions are given.
    pub fn open(
        &self,
        cell: usize,
        coordinates: &[usize],
        mean: ArrayView1<'_, f64>,
        basis: impl FnOnce() -> Arc<Basis>,
    ) -> &Opened {
        self.opened[cell].get_or_init(|| {
            let basis = basis();
            let d = coordinates.len();
            let stride = padded(d);
            let rows = &self.rows[self.starts[cell]..self.starts[cell + 1]];
            let mut poses = Vec::with_capacity(rows.len() * stride);
            let mut steps = Vec::with_capacity(rows.len() * stride);
            for &row in rows {
                let pose = self.poses.xyz().row(row);
                poses.extend(coordinates.iter().map(|&c| pose[c]));
                self.poses.step(row, coordinates, &mut steps);
                let end = poses.len().next_multiple_of(stride);
                poses.resize(end, 0.0);
                steps.resize(end, 0.0);
            }
            let mean: Vec<f32> = mean.iter().map(|v| *v as f32).collect();
            let turned = |flat: &[f32], mean: Option<&[f32]>| {
                let mut out = vec![0.0; flat.len()];
                for (row, out) in flat.chunks(stride).zip(out.chunks_mut(stride)) {
                    let mut row = row[..d].to_vec();
                    for (r, m) in row.iter_mut().zip(mean.unwrap_or_default()) {
                        *r -= m;
                    }
                    combine(basis.vectors(), stride, &row, out);
                }
                out
            };
            Opened {
                codes: turned(&poses, Some(&mean)),
                turns: turned(&steps, None),
                stride,
                poses,
                steps,
            }
        })
    }
}

impl Opened {
    fn row<'a>(&self, of: &'a [f32], leaf: usize) -> &'a [f32] {
        &of[leaf * self.stride..(leaf + 1) * self.stride]
    }

    /// A leaf's pose, cm.
    pub fn pose(&self, leaf: usize) -> &[f32] {
        self.row(&self.poses, leaf)
    }

    /// A leaf's step, cm.
    pub fn step(&self, leaf: usize) -> &[f32] {
        self.row(&self.steps, leaf)
    }

    /// A leaf's pose less the cell's mean, in the cell's directions.
    pub fn code(&self, leaf: usize) -> &[f32] {
        self.row(&self.codes, leaf)
    }

    /// A leaf's step in the cell's directions.
    pub fn turn(&self, leaf: usize) -> &[f32] {
        self.row(&self.turns, leaf)
    }

    /// Σ w (y − pose)² of every leaf, into `out`; all padded.
    pub fn distances(&self, y: &[f32], w: &[f32], out: &mut Vec<f32>) {
        distances(&self.poses, y, w, out);
    }
}

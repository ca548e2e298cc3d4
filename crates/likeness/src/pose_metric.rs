//! A distance of poses: features, scaled, of a frame or of a window in time, projected to vectors
//! whose distance is the answer.

use super::body_frame::BodyFramePoses;
use super::features::PoseFeatures;
use super::joint_map::JointMap;
use super::pairs::FrameRef;
use super::scaling::Scaling;
use crate::numeric::product::product;
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, s};
use std::ops::Range;

/// Frames that are described together.
const BATCH: usize = 4096;

/// What scaled features are multiplied with.
#[derive(Debug, Clone, PartialEq)]
pub enum Projection {
    /// A weight for each feature of each part of the window (parts x features).
    Weights(Vec<f32>),
    /// W (parts x features, rank).
    Matrix(Array2<f32>),
}

/// The length of a difference of projected poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Norm {
    /// The root of the sum of squares: (11).
    Euclidean,
    /// The sum of magnitudes: (44) and (45).
    City,
}

names!(Norm {
    Euclidean = "euclidean",
    City = "city",
});

impl Norm {
    /// The distance of two projected poses.
    ///
    /// ```
    /// use posing_likeness::pose_metric::Norm;
    ///
    /// let (a, b) = (ndarray::array![0.0, 0.0], ndarray::array![3.0, 4.0]);
    /// assert_eq!(Norm::Euclidean.distance(a.view(), b.view()), 5.0);
    /// assert_eq!(Norm::City.distance(a.view(), b.view()), 7.0);
    /// ```
    pub fn distance(self, a: ArrayView1<'_, f32>, b: ArrayView1<'_, f32>) -> f32 {
        let differences = a.iter().zip(b).map(|(a, b)| a - b);
        match self {
            Norm::Euclidean => differences.map(|d| d * d).sum::<f32>().sqrt(),
            Norm::City => differences.map(f32::abs).sum(),
        }
    }
}

/// A distance of poses.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseMetric {
    /// Which points the joints are.
    pub map: JointMap,
    /// What describes a frame.
    pub features: PoseFeatures,
    /// How features are scaled.
    pub scaling: Scaling,
    /// Seconds from a frame to the frames before and after it that are described with it; 0: the
    /// frame alone. Frames beyond the ends of a run are its first and last.
    pub window: f64,
    /// The projection; its first features are those of the frame before, where there is a window.
    pub projection: Projection,
    /// The norm of differences.
    pub norm: Norm,
}

/// Seconds to the frames before and after that are described with a frame, unless one says
/// otherwise.
pub(super) const WINDOW: f64 = 0.2;

impl PoseMetric {
    /// The metric that needs no training: coordinates in body heights and their velocities as the
    /// way of .2 seconds, of a frame and of those .2 seconds before and after it.
    pub fn of_coordinates(map: JointMap) -> PoseMetric {
        let scaling = Scaling::of_coordinates();
        PoseMetric {
            map,
            features: PoseFeatures::Coordinates,
            window: WINDOW,
            projection: Projection::Weights(vec![1.0; 3 * scaling.scale.len()]),
            scaling,
            norm: Norm::Euclidean,
        }
    }

    /// Whether this is [`PoseMetric::of_coordinates`], of whatever joints.
    pub fn is_of_coordinates(&self) -> bool {
        *self == PoseMetric::of_coordinates(self.map.clone())
    }

    /// The metric of one frame of which this one compares three side by side; `None` where that is
    /// not what it does.
    pub(crate) fn of_one_frame(&self) -> Option<PoseMetric> {
        let Projection::Weights(weights) = &self.projection else {
            return None;
        };
        let parts: Vec<&[f32]> = weights.chunks_exact(self.scaling.scale.len()).collect();
        let is_window = parts.len() == 3 && parts.iter().all(|p| *p == parts[0]);
        is_window.then(|| PoseMetric {
            window: 0.0,
            projection: Projection::Weights(parts[0].to_vec()),
            ..self.clone()
        })
    }

    /// This metric, followed by the linear map W (dimensions, rank); weights are left as they are.
    #[doc(hidden)]
    pub fn projected(&self, w: ArrayView2<'_, f64>) -> PoseMetric {
        let Projection::Matrix(matrix) = &self.projection else {
            return self.clone();
        };
        let projection = product(matrix.mapv(f64::from).view(), w);
        PoseMetric {
            projection: Projection::Matrix(projection.mapv(|v| v as f32)),
            ..self.clone()
        }
    }

    /// The length of a vector.
    pub(crate) fn dimensions(&self) -> usize {
        match &self.projection {
            Projection::Weights(weights) => weights.iter().filter(|w| **w != 0.0).count(),
            Projection::Matrix(matrix) => matrix.ncols(),
        }
    }

    /// Whether takes need a frame rate.
    pub fn needs_rate(&self) -> bool {
        self.window > 0.0 || self.features.needs_rate()
    }

    /// All frames of a take as vectors (frames, dimensions), whose distances by
    /// [`PoseMetric::norm`] are those of the poses. Rows of frames whose window lacks a joint
    /// that is needed are NaN.
    pub fn embed(&self, take: &BodyFramePoses) -> Array2<f32> {
        self.embed_frames(take, &(0..take.frames()).collect::<Vec<_>>())
    }

    /// Some frames of a take, like [`PoseMetric::embed`].
    #[doc(hidden)]
    pub fn embed_frames(&self, take: &BodyFramePoses, frames: &[usize]) -> Array2<f32> {
        let windows: Vec<Vec<usize>> = (frames.iter())
            .map(|t| window_frames(&take.run_of(*t), take.rate, *t, self.window))
            .collect();
        let mut described: Vec<usize> = windows.concat();
        described.sort_unstable();
        described.dedup();
        let parts = self.project(take, &described);
        let widths = parts.iter().map(Array2::ncols);
        let width = match self.projection {
            Projection::Weights(_) => widths.sum(),
            Projection::Matrix(_) => widths.max().unwrap_or(0),
        };
        let mut out = Array2::zeros((frames.len(), width));
        for (mut row, window) in out.rows_mut().into_iter().zip(&windows) {
            let mut start = 0;
            for (part, frame) in parts.iter().zip(window) {
                // Each frame of a window is among those described.
                let at = described.binary_search(frame).unwrap_or(0);
                let mut to = row.slice_mut(s![start..start + part.ncols()]);
                to += &part.row(at);
                if matches!(self.projection, Projection::Weights(_)) {
                    start += part.ncols();
                }
            }
        }
        out
    }

    /// Some frames of each take, one after another: which they are, and their vectors. `step` says
    /// how many frames of a take lie from one to the next, at least 1.
    pub fn embed_takes(
        &self,
        takes: &[BodyFramePoses],
        step: impl Fn(&BodyFramePoses) -> usize,
    ) -> (Vec<FrameRef>, Array2<f32>) {
        let (mut rows, mut parts) = (Vec::new(), Vec::new());
        for (take, poses) in takes.iter().enumerate() {
            let frames: Vec<usize> = (0..poses.frames()).step_by(step(poses)).collect();
            parts.push(self.embed_frames(poses, &frames));
            rows.extend(frames.into_iter().map(|frame| FrameRef { take, frame }));
        }
        let views: Vec<_> = parts.iter().map(|p| p.view()).collect();
        // All have the metric's dimensions.
        let vectors = ndarray::concatenate(Axis(0), &views).unwrap_or_default();
        (rows, vectors)
    }

    /// The scaled features of frames, multiplied with each part of the projection.
    fn project(&self, take: &BodyFramePoses, frames: &[usize]) -> Vec<Array2<f32>> {
        let width = self.scaling.scale.len();
        let mut parts: Vec<Vec<Array2<f32>>> = vec![Vec::new(); window_parts(self.window)];
        for batch in frames.chunks(BATCH) {
            let mut rows = self.features.describe(take, batch);
            self.scaling.apply(&mut rows);
            for (k, part) in parts.iter_mut().enumerate() {
                let range = k * width..(k + 1) * width;
                part.push(match &self.projection {
                    Projection::Weights(weights) => weighted(&rows, &weights[range]),
                    Projection::Matrix(w) => product(rows.view(), w.slice(s![range, ..])),
                });
            }
        }
        let join = |part: Vec<Array2<f32>>| {
            let views: Vec<_> = part.iter().map(|p| p.view()).collect();
            // Batches have equal columns; without frames there are none.
            ndarray::concatenate(Axis(0), &views).unwrap_or_default()
        };
        parts.into_iter().map(join).collect()
    }
}

/// Columns that have a weight, times it.
fn weighted(rows: &Array2<f32>, weights: &[f32]) -> Array2<f32> {
    let kept: Vec<usize> = (0..weights.len()).filter(|k| weights[*k] != 0.0).collect();
    let mut out = rows.select(Axis(1), &kept);
    for (mut column, k) in out.columns_mut().into_iter().zip(kept) {
        column *= weights[k];
    }
    out
}

/// The number of frames that are described together.
pub(super) fn window_parts(window: f64) -> usize {
    if window > 0.0 { 3 } else { 1 }
}

/// The frames of the window about frame `t`, which lies in `run`.
pub(super) fn window_frames(
    run: &Range<usize>,
    rate: Option<f64>,
    t: usize,
    window: f64,
) -> Vec<usize> {
    if window_parts(window) == 1 {
        return vec![t];
    }
    let reach = rate.map_or(0, |rate| (window * rate).round() as usize);
    let before = t.saturating_sub(reach).max(run.start);
    vec![before, t, t.saturating_add(reach).min(run.end - 1)]
}

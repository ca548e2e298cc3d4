//! Poses in a frame of reference of their own, so that where a body stands and which way it looks
//! does not matter.
//!
//! The frame of reference is that of the pelvis where root and hip joints are among the predictors,
//! else a rigid fit of the predictors to their mean shape. It is found from the predictors alone,
//! so that it is known inside a gap too.

use super::tuning::local_poses::*;
use crate::pose::{Anchor, Similarity};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

/// What is known of poses: (n, coordinates), cm.
#[derive(Debug, Clone)]
pub struct LocalPoses {
    /// The predictors' coordinates (n, 3 P); NaN where the pose cannot be placed.
    pub predictors: Array2<f64>,
    /// The targets' coordinates (n, 3 T), NaN where missing.
    pub targets: Array2<f64>,
    /// From the frame of reference to the world; `None` where the predictors do not determine it.
    pub placements: Vec<Option<Similarity>>,
}

impl LocalPoses {
    /// Places the poses in the rows of `xyz` (n, 3 J) by `anchor`.
    #[doc(hidden)]
    pub fn new(
        anchor: &Anchor,
        xyz: ArrayView2<'_, f64>,
        predictors: &[usize],
        targets: &[usize],
    ) -> LocalPoses {
        let n = xyz.nrows();
        let mut out = LocalPoses {
            predictors: Array2::from_elem((n, 3 * predictors.len()), f64::NAN),
            targets: Array2::from_elem((n, 3 * targets.len()), f64::NAN),
            placements: Vec::with_capacity(n),
        };
        let mut only = vec![f64::NAN; xyz.ncols()];
        for (t, row) in xyz.rows().into_iter().enumerate() {
            for i in predictors.iter().flat_map(|p| 3 * p..3 * p + 3) {
                only[i] = row[i];
            }
            let placement = anchor.fit(&only);
            if let Some(placement) = &placement {
                let to = |mut out: ndarray::ArrayViewMut1<'_, f64>, points: &[usize]| {
                    let out = out.as_slice_mut().unwrap_or_default();
                    for (out, p) in out.chunks_exact_mut(3).zip(points) {
                        let at = DVec3::new(row[3 * p], row[3 * p + 1], row[3 * p + 2]);
                        placement.undo(at).write_to_slice(out);
                    }
                };
                to(out.predictors.row_mut(t), predictors);
                to(out.targets.row_mut(t), targets);
            }
            out.placements.push(placement);
        }
        out
    }

    /// Poses in the rows of `xyz` (n, 3 J) that are in the frame of reference already.
    pub(crate) fn in_reference_frame(
        xyz: ArrayView2<'_, f64>,
        predictors: &[usize],
        targets: &[usize],
    ) -> LocalPoses {
        let columns = |points: &[usize]| {
            let columns: Vec<usize> = points.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
            xyz.select(ndarray::Axis(1), &columns)
        };
        LocalPoses {
            predictors: columns(predictors),
            targets: columns(targets),
            placements: vec![Some(Similarity::IDENTITY); xyz.nrows()],
        }
    }

    /// Whether predictors and targets of a pose are all known.
    #[doc(hidden)]
    pub fn is_complete(&self, row: usize) -> bool {
        let is_finite = |values: &Array2<f64>| values.row(row).iter().all(|v| v.is_finite());
        is_finite(&self.predictors) && is_finite(&self.targets)
    }
}

/// The anchor of `predictors`: their pelvis if all of it is among them, else their mean shape over
/// the `complete` frames of `xyz`. `None` where they have no shape: fewer than three points, or all
/// on a line.
pub fn anchor(
    names: &[String],
    xyz: ArrayView2<'_, f64>,
    predictors: &[usize],
    complete: &[usize],
) -> Option<Anchor> {
    let pelvis = Anchor::pelvis(names).map(|a| a.rigid_only());
    // Hip joints on a line with the root, as in some rigs, are no frame of reference.
    let places = |pelvis: &Anchor| {
        let first = complete.first().map(|&t| xyz.row(t).to_vec());
        first.is_some_and(|pose| pelvis.fit(&pose).is_some())
    };
    if let Some(pelvis) = pelvis
        && pelvis.points().all(|p| predictors.contains(&p))
        && places(&pelvis)
    {
        return Some(pelvis);
    }
    if predictors.len() < 3 {
        return None;
    }
    let step = complete.len().div_ceil(SHAPE_FRAMES).max(1);
    let mut shape: Vec<f64> = xyz.row(*complete.first()?).to_vec();
    for _ in 0..SHAPE_ROUNDS {
        let anchor = Anchor::of_points(&shape, predictors);
        let mut sum = vec![0.0; shape.len()];
        let mut count = 0.0;
        for &t in complete.iter().step_by(step) {
            let pose = xyz.row(t).to_vec();
            let mut local = pose.clone();
            anchor.fit(&pose)?.undo_pose(&pose, &mut local);
            sum.iter_mut().zip(&local).for_each(|(s, v)| *s += v);
            count += 1.0;
        }
        shape = sum.into_iter().map(|s| s / count).collect();
    }
    Some(Anchor::of_points(&shape, predictors))
}

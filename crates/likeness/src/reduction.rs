//! Poses reduced to the directions in which they vary most, before a metric is learned: a few
//! hundred numbers in place of thousands.

use super::body_frame::BodyFramePoses;
use super::features::PoseFeatures;
use super::joint_map::JointMap;
use super::pairs::FrameRef;
use super::pose_metric::{Norm, PoseMetric, Projection, window_parts};
use super::scaling::{Scaling, ScalingRule};
use crate::Result;
use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::product::gram;
use ndarray::{Array1, Array2, ArrayView2, Axis, concatenate, s};

/// Principal components of the features of one frame, and of a window, at most.
const COMPONENTS: usize = 200;

/// The features of some poses at once (poses, features); rows of poses that lack a joint are NaN.
pub(super) fn embed(
    metric: &PoseMetric,
    takes: &[BodyFramePoses],
    frames: &[FrameRef],
) -> Array2<f32> {
    let of_takes = frames.chunk_by(|a, b| a.take == b.take);
    let parts: Vec<Array2<f32>> = of_takes
        .map(|part| {
            let frames: Vec<usize> = part.iter().map(|f| f.frame).collect();
            metric.embed_frames(&takes[part[0].take], &frames)
        })
        .collect();
    let views: Vec<_> = parts.iter().map(|p| p.view()).collect();
    concatenate(Axis(0), &views).unwrap_or_default()
}

/// A metric that compares all scaled features of a window, its scaling learned from `frames`; those
/// with missing joints are left out.
///
/// # Errors
/// [`crate::Error::Unfit`]: fewer than two poses are complete.
pub(super) fn all_features(
    map: &JointMap,
    features: PoseFeatures,
    rule: ScalingRule,
    window: f64,
    takes: &[BodyFramePoses],
    frames: &[FrameRef],
) -> Result<PoseMetric> {
    let width = features.feature_names().len();
    let metric = |scaling: Scaling, parts: usize| PoseMetric {
        map: map.clone(),
        features,
        scaling,
        window: if parts > 1 { window } else { 0.0 },
        projection: Projection::Weights(vec![1.0; parts * width]),
        norm: Norm::Euclidean,
    };
    let raw = Scaling {
        rule: ScalingRule::None,
        shift: vec![0.0; width],
        scale: vec![1.0; width],
    };
    let rows = complete_rows(embed(&metric(raw, 1), takes, frames).view());
    if rows.nrows() < 2 {
        return Err(format!(
            "shows all joints in {} of {} poses; features are scaled by two or more",
            rows.nrows(),
            frames.len()
        )
        .into());
    }
    let scaling = Scaling::fit(rule, features, rows.view());
    Ok(metric(scaling, window_parts(window)))
}

/// `full`, reduced to principal components of `frames`: first those of one frame, then those of the
/// window.
///
/// # Errors
/// [`crate::Error::Unfit`]: the poses do not vary.
pub(super) fn principal(
    full: &PoseMetric,
    takes: &[BodyFramePoses],
    frames: &[FrameRef],
) -> Result<PoseMetric> {
    let alone = PoseMetric {
        window: 0.0,
        projection: Projection::Weights(vec![1.0; full.scaling.scale.len()]),
        ..full.clone()
    };
    let rows = complete_rows(embed(&alone, takes, frames).view()).mapv(f64::from);
    let of_frame = components(rows.view(), COMPONENTS, true)?;
    if window_parts(full.window) == 1 {
        return Ok(PoseMetric {
            projection: Projection::Matrix(of_frame.mapv(|v| v as f32)),
            ..full.clone()
        });
    }
    // The window's three frames side by side: a block of columns for each.
    let (width, count) = of_frame.dim();
    let mut blocks = Array2::zeros((3 * width, 3 * count));
    for k in 0..3 {
        let range = s![k * width..(k + 1) * width, k * count..(k + 1) * count];
        blocks.slice_mut(range).assign(&of_frame);
    }
    let side_by_side = PoseMetric {
        projection: Projection::Matrix(blocks.mapv(|v| v as f32)),
        ..full.clone()
    };
    let rows = complete_rows(embed(&side_by_side, takes, frames).view()).mapv(f64::from);
    let of_window = components(rows.view(), COMPONENTS, true)?;
    Ok(PoseMetric {
        projection: Projection::Matrix(blocks.dot(&of_window).mapv(|v| v as f32)),
        ..full.clone()
    })
}

/// `full`, on an orthonormal basis of the range of `frames`: nothing that distinguishes them is
/// lost.
///
/// # Errors
/// [`crate::Error::Unfit`]: the poses do not vary.
pub(super) fn range(
    full: &PoseMetric,
    takes: &[BodyFramePoses],
    frames: &[FrameRef],
) -> Result<PoseMetric> {
    let rows = complete_rows(embed(full, takes, frames).view()).mapv(f64::from);
    let basis = components(rows.view(), usize::MAX, false)?;
    Ok(PoseMetric {
        projection: Projection::Matrix(basis.mapv(|v| v as f32)),
        ..full.clone()
    })
}

/// The rows that are finite.
pub(super) fn complete_rows(rows: ArrayView2<'_, f32>) -> Array2<f32> {
    let is_complete = |k: &usize| rows.row(*k).iter().all(|v| v.is_finite());
    let complete: Vec<usize> = (0..rows.nrows()).filter(is_complete).collect();
    rows.select(Axis(0), &complete)
}

/// The leading right singular vectors of `x` (n, d), about its mean or not, in columns (d, at most
/// `most`). Those with a singular value under 1e-10 of the largest are dropped, or under what
/// double precision tells of the products (d, d).
fn components(x: ArrayView2<'_, f64>, most: usize, centered: bool) -> Result<Array2<f64>> {
    let mean = if centered {
        x.mean_axis(Axis(0)).unwrap_or_default()
    } else {
        Array1::zeros(x.ncols())
    };
    let products = gram((&x - &mean).view());
    let (values, vectors) = symmetric_eigen(&products).ok_or("the poses are not finite")?;
    let largest = values.last().copied().unwrap_or(0.0);
    let least = largest * f64::max(1e-20, x.ncols() as f64 * f64::EPSILON);
    let kept = values.iter().filter(|v| **v > least).count().min(most);
    match kept {
        0 => Err("the poses do not vary".into()),
        _ => Ok(vectors
            .slice(s![.., ..;-1])
            .slice(s![.., ..kept])
            .to_owned()),
    }
}

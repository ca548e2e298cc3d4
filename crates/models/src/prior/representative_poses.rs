//! A few training poses, far apart, from which placements start.

use crate::Result;
use crate::cluster;
use ndarray::{Array2, ArrayView2, Axis};

/// Number of representative poses of a model.
pub(crate) const TYPICAL: usize = 32;
/// Largest number of poses they are chosen from, evenly spaced.
const TYPICAL_FROM: usize = 20_000;

/// The poses nearest to the centroids of 32 clusters: (k, D), cm.
///
/// # Errors
/// Data: no poses.
pub(crate) fn representative_poses(xyz: ArrayView2<'_, f32>) -> Result<Array2<f32>> {
    let step = xyz.nrows().div_ceil(TYPICAL_FROM).max(1);
    let some: Vec<usize> = (0..xyz.nrows()).step_by(step).collect();
    let poses = xyz.select(Axis(0), &some);
    let kmeans = cluster::KMeans {
        k: TYPICAL.min(poses.nrows()),
        max_iterations: 20,
        ..Default::default()
    };
    let clustering = match kmeans.fit(poses.view()) {
        Ok(c) => c,
        // Fewer different poses than clusters: the poses themselves.
        Err(_) => {
            return Ok(poses
                .slice(ndarray::s![..poses.nrows().min(TYPICAL), ..])
                .to_owned());
        }
    };
    let mut best = vec![(f64::INFINITY, 0); clustering.centroids.nrows()];
    for (i, (row, &label)) in poses.rows().into_iter().zip(&clustering.labels).enumerate() {
        let center = clustering.centroids.row(label as usize);
        let d: f64 = row
            .iter()
            .zip(center)
            .map(|(a, b)| (f64::from(*a) - b).powi(2))
            .sum();
        let slot = &mut best[label as usize];
        if d < slot.0 {
            *slot = (d, i);
        }
    }
    let chosen: Vec<usize> = best
        .iter()
        .filter(|b| b.0.is_finite())
        .map(|b| b.1)
        .collect();
    Ok(poses.select(Axis(0), &chosen))
}

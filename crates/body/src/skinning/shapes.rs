//! Corrective shapes: what skinning leaves of the samples, carried back into the rest pose, in
//! principal components.
//!
//! The residual e_v of a sample is carried back through the blended matrix M_v = Σ_b w_vb R_b: d_v
//! = (Mᵀ M + ε I)⁻¹ Mᵀ e_v. The rest pose itself has no residual, so the components are those about
//! zero, not about the mean.

use super::weights::blend;
use super::{Frame, Sample, Skinning};
use crate::Result;
use crate::numeric::linalg::symmetric_eigen;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// Keeps offsets small where opposite rotations cancel in M.
const DAMPING: f64 = 1e-2;

/// The `count` largest components (count, V), scaled so that the weights of the samples have mean
/// square 1.
pub(crate) fn fit(
    skinning: &Skinning,
    samples: &[Sample<'_>],
    count: usize,
) -> Result<Vec<Vec<DVec3>>> {
    let offsets: Result<Vec<Vec<DVec3>>> = (samples.iter())
        .map(|s| Ok(carried_back(skinning, s, &skinning.frame(s)?)))
        .collect();
    let offsets = offsets?;
    let n = samples.len();
    let products = Array2::from_shape_fn((n, n), |(i, j)| {
        let pairs = offsets[i].iter().zip(&offsets[j]);
        pairs.map(|(a, b)| a.dot(*b)).sum::<f64>()
    });
    let (_, vectors) = symmetric_eigen(&products).ok_or("the samples are not finite")?;
    let scale = (n as f64).sqrt();
    let component = |k: usize| {
        let mut shape = vec![DVec3::ZERO; skinning.vertices.len()];
        for (offsets, share) in offsets.iter().zip(vectors.column(n - 1 - k)) {
            for (to, from) in shape.iter_mut().zip(offsets) {
                *to += *from * (share / scale);
            }
        }
        shape
    };
    Ok((0..count).map(component).collect())
}

/// The residual of a frame in the rest pose.
fn carried_back(skinning: &Skinning, sample: &Sample<'_>, frame: &Frame) -> Vec<DVec3> {
    let motions = frame.motions();
    let found = skinning.pose(frame);
    let offset = |v: usize| {
        let m = blend(&skinning.weights[v], &motions).matrix3;
        let normal = m.transpose() * m + DMat3::from_diagonal(DVec3::splat(DAMPING));
        normal.inverse() * (m.transpose() * (sample.vertices[v] - found[v]))
    };
    (0..found.len()).map(offset).collect()
}

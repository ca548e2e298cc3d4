//! Linear transforms of poses and of their covariances: to another body, or rotated.

use super::Body;
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};

/// A linear transform of poses (3 J).
#[derive(Debug, Clone, PartialEq)]
pub enum PoseTransform {
    /// Scales the length of each bone (see [`Body::reshape`]).
    Reshape {
        /// The bones.
        body: Body,
        /// The points, parents first.
        order: Vec<usize>,
        /// The factor of the length of each point's bone.
        ratios: Vec<f64>,
    },
    /// Rotates all points about the origin.
    Rotate(DMat3),
}

impl PoseTransform {
    /// The transform from one body to another.
    #[doc(hidden)]
    pub fn reshape(from: &Body, to: &Body) -> PoseTransform {
        PoseTransform::Reshape {
            order: from.order(),
            ratios: from.ratios_to(to),
            body: from.clone(),
        }
    }

    /// Whether the transform changes nothing.
    #[doc(hidden)]
    pub fn is_identity(&self) -> bool {
        match self {
            PoseTransform::Reshape { ratios, .. } => ratios.iter().all(|r| *r == 1.0),
            PoseTransform::Rotate(r) => *r == DMat3::IDENTITY,
        }
    }

    /// The inverse transform.
    #[doc(hidden)]
    pub fn inverse(&self) -> PoseTransform {
        match self {
            PoseTransform::Reshape {
                body,
                order,
                ratios,
            } => PoseTransform::Reshape {
                body: body.clone(),
                order: order.clone(),
                ratios: ratios.iter().map(|r| 1.0 / r).collect(),
            },
            PoseTransform::Rotate(r) => PoseTransform::Rotate(r.transpose()),
        }
    }

    /// Transforms a pose (3 J) into `out` (3 J).
    #[doc(hidden)]
    pub fn apply(&self, pose: &[f64], out: &mut [f64]) {
        match self {
            PoseTransform::Reshape {
                body,
                order,
                ratios,
            } => body.reshape(order, ratios, pose, out),
            PoseTransform::Rotate(r) => {
                for (x, y) in pose.chunks_exact(3).zip(out.chunks_exact_mut(3)) {
                    y.copy_from_slice(&(*r * DVec3::from_slice(x)).to_array());
                }
            }
        }
    }

    /// Transforms each row of (poses, 3 J).
    #[doc(hidden)]
    pub fn apply_rows(&self, poses: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = Array2::zeros(poses.dim());
        let mut pose = vec![0.0; poses.ncols()];
        let mut mapped = pose.clone();
        for (row, mut to) in poses.rows().into_iter().zip(out.rows_mut()) {
            pose.iter_mut().zip(row).for_each(|(p, r)| *p = *r);
            self.apply(&pose, &mut mapped);
            to.iter_mut().zip(&mapped).for_each(|(t, m)| *t = *m);
        }
        out
    }

    /// Transforms a covariance (3 J, 3 J): `T Σ Tᵀ`.
    #[doc(hidden)]
    pub fn apply_covariance(&self, covariance: ArrayView2<'_, f64>) -> Array2<f64> {
        let half = self.apply_rows(covariance);
        self.apply_rows(half.t()).reversed_axes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;

    #[test]
    fn covariances_follow_their_poses() {
        let body = Body {
            parents: vec![None, Some(0), Some(1)],
            lengths: vec![f64::NAN, 2.0, 3.0],
        };
        let to = Body {
            lengths: vec![f64::NAN, 4.0, 2.0],
            ..body.clone()
        };
        for map in [
            PoseTransform::reshape(&body, &to),
            PoseTransform::Rotate(from_rotation_vector(DVec3::new(0.3, 1.0, -0.2))),
        ] {
            assert!(!map.is_identity());
            // The covariance of outer products is the outer product of what they become.
            let x = Array2::from_shape_fn((1, 9), |(_, i)| (i as f64 * 0.9).sin());
            let y = map.apply_rows(x.view());
            let want = y.t().dot(&y);
            let got = map.apply_covariance(x.t().dot(&x).view());
            assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() <= 1e-12));
            let back = map.inverse().apply_rows(y.view());
            assert!(back.iter().zip(&x).all(|(a, b)| (a - b).abs() <= 1e-12));
        }
        assert!(PoseTransform::reshape(&body, &body).is_identity());
    }
}

//! How sure the joints of a frame are: by its own markers, and by what is known of bones and
//! markers.

use super::body::Body;
use super::calibration::coupled;
use super::tuning::*;
use crate::ik::frame_solver::{FrameSolver, Linearized, Scratch};
use crate::numeric::linalg::Cholesky;
use glam::DVec3;
use ndarray::{Array2, s};

/// Deviations of joints, once the body is fitted.
pub(super) struct Deviations<'a> {
    pub body: &'a Body,
    pub solver: &'a FrameSolver<'a>,
    /// The factor of the precision of the body's numbers.
    pub numbers: &'a Cholesky,
    /// The bones whose ends are asked for.
    pub bones: &'a [usize],
}

impl Deviations<'_> {
    /// The standard deviation of a coordinate of each joint in a frame, cm: with J and K by how
    /// much pose and numbers move the joint, and X by how much the pose gives way to the numbers,
    /// that of `(K − J X) S⁻¹ (K − J X)ᵀ + J H⁻¹ Jᵀ`. `None` where nothing tells.
    pub(super) fn of(&self, at: &Linearized, scratch: &Scratch) -> Option<Vec<f64>> {
        let (n, count) = (at.gradient.len(), self.body.mean.len());
        let (factor, coupling) = coupled(self.body, at)?;
        let rows = 3 * self.bones.len();
        let mut pose: Array2<f64> = Array2::zeros((n, rows));
        let mut own: Array2<f64> = Array2::zeros((count, rows));
        for (j, &bone) in self.bones.iter().enumerate() {
            let moved: Vec<DVec3> = self.solver.equations.derivatives(bone, at, scratch);
            for (column, moved) in moved.iter().enumerate() {
                (0..3).for_each(|c| pose[[column, 3 * j + c]] = moved[c]);
            }
            for part in self.body.moved(bone, 1.0, &at.posture.rotations) {
                for (k, c) in (0..3).flat_map(|k| (0..3).map(move |c| (k, c))) {
                    own[[part.first + k, 3 * j + c]] += part.turn.col(k)[c];
                }
            }
        }
        let pose = factor.half_solve(&pose)?;
        let own = self.numbers.half_solve(&(own - coupling.t().dot(&pose)))?;
        let variance = |j: usize| {
            let part = s![.., 3 * j..3 * j + 3];
            let both = [&pose, &own].map(|m| m.slice(part).mapv(|v| v * v).sum());
            (both[0] + both[1]) / 3.0
        };
        Some((0..self.bones.len()).map(|j| variance(j).sqrt()).collect())
    }

    /// By how much more a joint may be off than the fit tells.
    pub(super) fn factor_of(name: &str) -> f64 {
        if name.ends_with("SJC") || name.ends_with("clavicle") {
            SHOULDER
        } else {
            1.0
        }
    }
}

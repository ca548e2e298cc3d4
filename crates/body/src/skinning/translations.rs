//! The translations of the bones, free in each mesh.
//!
//! ```text
//! min Σ_v |Σ_b w_vb t_b - r_v|²,   r_v = y_v - Σ_b w_vb R_b x_v
//! ```
//!
//! The matrix Wᵀ W (B, B) depends on the weights alone: it is factored once for all meshes.

use super::weights::{BoneWeights, used};
use crate::Result;
use crate::numeric::linalg::Cholesky;
use ndarray::{Array2, ArrayView2};

/// What is added to the diagonal, so that a bone that no vertex follows stays where it is.
const RIDGE: f64 = 1e-9;

/// Solves for translations.
#[derive(Debug, Clone)]
pub(crate) struct Solver(Cholesky);

impl Solver {
    /// Factors Wᵀ W for `bones` bones.
    pub(crate) fn new(weights: &[BoneWeights], bones: usize) -> Result<Solver> {
        let mut normal = Array2::zeros((bones, bones));
        for weights in weights {
            for (a, wa) in used(weights) {
                for (b, wb) in used(weights) {
                    normal[[a, b]] += wa * wb;
                }
            }
        }
        normal.diag_mut().mapv_inplace(|v| v + RIDGE);
        let factor = Cholesky::new(normal).ok_or("the weights of the bones are not finite")?;
        Ok(Solver(factor))
    }

    /// (Wᵀ W)⁻¹ Wᵀ `r` (B, n) for r (V, n), and Wᵀ `r` (B, n).
    pub(crate) fn solve(
        &self,
        weights: &[BoneWeights],
        bones: usize,
        r: ArrayView2<'_, f64>,
    ) -> Option<(Array2<f64>, Array2<f64>)> {
        let mut right = Array2::zeros((bones, r.ncols()));
        for (weights, r) in weights.iter().zip(r.rows()) {
            for (bone, weight) in used(weights) {
                right.row_mut(bone).scaled_add(weight, &r);
            }
        }
        Some((self.0.solve(&right)?, right))
    }
}

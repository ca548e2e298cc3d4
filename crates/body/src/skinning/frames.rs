//! The fit of a skin to one mesh: translations of the bones and weights of the corrective shapes,
//! together by least squares.
//!
//! With u_vk = Σ_b w_vb R_b s_vk the vertices are Σ_b w_vb (R_b x_v + t_b) + Σ_k c_k u_vk. For any
//! c the best t is (Wᵀ W)⁻¹ Wᵀ (r - U c); what is left of the normal equations has K unknowns.

use super::weights::blend;
use super::{Frame, Sample, Skinning};
use crate::numeric::linalg::cholesky_solve;
use crate::{Error, Result};
use glam::{DAffine3, DMat3, DVec3};
use ndarray::{Array1, Array2};

/// What is added to the normal matrix of the shapes' weights, in shares of its mean diagonal.
const RIDGE: f64 = 1e-6;

impl Skinning {
    /// Fits the translations of the bones and the weights of the corrective shapes to a mesh. O(V
    /// (K² + B)).
    ///
    /// # Errors
    /// [`Error::Unfit`]: sizes that differ from the skin's, or numbers that are not finite.
    pub fn frame(&self, sample: &Sample<'_>) -> Result<Frame> {
        super::check_sizes(self.vertices.len(), self.parents.len(), sample)?;
        let fail = || Error::unfit("the mesh or its rotations are not finite");
        let bones: Vec<DAffine3> = sample
            .rotations
            .iter()
            .map(|r| DAffine3::from_mat3(*r))
            .collect();
        let n = self.vertices.len();
        let (mut r, mut u) = (
            Array2::zeros((n, 3)),
            Array2::zeros((n, 3 * self.shapes.len())),
        );
        for v in 0..n {
            let matrix = blend(&self.weights[v], &bones).matrix3;
            let rest = sample.vertices[v] - matrix * self.vertices[v];
            for a in 0..3 {
                r[[v, a]] = rest[a];
            }
            for (k, shape) in self.shapes.iter().enumerate() {
                let moved = matrix * shape[v];
                for a in 0..3 {
                    u[[v, a * self.shapes.len() + k]] = moved[a];
                }
            }
        }
        let (translations, weights) = self.solve(r, u).ok_or_else(fail)?;
        let mut frame = Frame {
            rotations: sample.rotations.to_vec(),
            translations,
            weights,
            error_mm: 0.0,
        };
        let found = self.pose(&frame);
        let far = found
            .iter()
            .zip(sample.vertices)
            .map(|(a, b)| (*a - *b).length());
        frame.error_mm = 10.0 * far.sum::<f64>() / n as f64;
        frame.error_mm.is_finite().then_some(frame).ok_or_else(fail)
    }

    /// The translations t and the weights c for r (V, 3) and u (V, 3 K), of which the columns run
    /// over the axes, then the shapes.
    fn solve(&self, r: Array2<f64>, u: Array2<f64>) -> Option<(Vec<DVec3>, Vec<f64>)> {
        let (count, bones) = (self.shapes.len(), self.parents.len());
        // Rows over bones (or vertices) and axes; LAPACK answers in columns.
        let by_shape = |m: Array2<f64>| {
            let m = m.as_standard_layout().into_owned();
            let rows = m.nrows() * 3;
            m.into_shape_with_order((rows, count)).ok()
        };
        let (mut t, _) = self.solver.solve(&self.weights, bones, r.view())?;
        let mut weights = Array1::zeros(count);
        if count > 0 {
            let (of_shapes, sums) = self.solver.solve(&self.weights, bones, u.view())?;
            let (of_shapes, sums, u) = (by_shape(of_shapes)?, by_shape(sums)?, by_shape(u)?);
            let flat = Array1::from_iter(t.iter().copied());
            let right = u.t().dot(&Array1::from_iter(r.iter().copied())) - sums.t().dot(&flat);
            let mut normal = u.t().dot(&u) - sums.t().dot(&of_shapes);
            let ridge = RIDGE * normal.diag().mean()? + f64::MIN_POSITIVE;
            normal.diag_mut().mapv_inplace(|v| v + ridge);
            weights = cholesky_solve(normal, right)?;
            let used = of_shapes
                .dot(&weights)
                .into_shape_with_order((bones, 3))
                .ok()?;
            t -= &used;
        }
        let translations = t.rows().into_iter().map(|t| DVec3::new(t[0], t[1], t[2]));
        Some((translations.collect(), weights.to_vec()))
    }

    /// The vertices (V) of a frame, centimeters.
    pub fn pose(&self, frame: &Frame) -> Vec<DVec3> {
        let motions = frame.motions();
        let vertex = |v: usize| {
            let corrected = (frame.weights.iter().zip(&self.shapes))
                .fold(self.vertices[v], |x, (c, shape)| x + *c * shape[v]);
            blend(&self.weights[v], &motions).transform_point3(corrected)
        };
        (0..self.vertices.len()).map(vertex).collect()
    }
}

impl Frame {
    /// The motion of each bone (B) from the rest pose, centimeters.
    pub(crate) fn motions(&self) -> Vec<DAffine3> {
        let motion = |(r, t): (&DMat3, &DVec3)| DAffine3::from_mat3_translation(*r, *t);
        self.rotations
            .iter()
            .zip(&self.translations)
            .map(motion)
            .collect()
    }
}

//! The whole model of a body: a template, how it follows its joints, and how people differ.

use super::decomposition::synthesize;
use super::fit_prior::{FitPrior, NOISE};
use super::pose_model::{PoseModel, twists};
use super::shape_model::ShapeModel;
use super::template::Template;
use crate::numeric::linalg::cholesky_solve;
use crate::numeric::product::gram;
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2};

/// The least standard deviation of a component of a twist, radians: a joint that no training pose
/// turns may turn after all.
const LEAST_DEVIATION: f64 = 0.2;

/// A body whose pose and shape are learned from meshes.
#[derive(Debug, Clone)]
pub struct BodyModel {
    /// The mesh and its parts.
    pub template: Template,
    /// The matrix Q of each triangle, from the rotations.
    pub pose: PoseModel,
    /// The matrix S of each triangle, from the shape.
    pub shape: ShapeModel,
    /// The rotations of the parts in the poses that it was learned from.
    pub training_rotations: Vec<Vec<DMat3>>,
    /// Points of a pose table and the parts they belong to: the first point of a part where it
    /// begins, a second at its far end.
    pub joint_names: Vec<(usize, String)>,
    /// How well it makes meshes that it does not know, where that was measured.
    pub errors: Option<HeldOutErrors>,
}

/// Mean distances of vertices, cm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOutErrors {
    /// Training poses, each by its own matrices.
    pub decomposed: f64,
    /// Poses that are left out, by the rotations of their parts; `None` where there are too
    /// few.
    pub poses: Option<f64>,
    /// People who are left out, by their rotations and the shape that is nearest to them.
    pub people: Option<f64>,
}

impl BodyModel {
    /// The vertices, about their mean, of a body with these rotations of its parts and this shape
    /// (numbers that are left out are 0).
    ///
    /// The vertices minimize E_H(y) = Σ_k Σ_j |R_k S_k Q_k v̂_kj - (y_kj - y_k1)|².
    pub fn synthesize(&self, rotations: &[DMat3], shape: &[f64]) -> Vec<DVec3> {
        self.synthesize_shaped(rotations, &self.shape.matrices(shape))
    }

    /// [`BodyModel::synthesize`] with the S of [`ShapeModel::matrices`], for many poses of one
    /// shape.
    pub(crate) fn synthesize_shaped(&self, rotations: &[DMat3], shape: &[DMat3]) -> Vec<DVec3> {
        let q = self.pose.deformations(&self.template, rotations);
        let deformations: Vec<DMat3> = shape.iter().zip(&q).map(|(s, q)| *s * *q).collect();
        synthesize(&self.template, rotations, &deformations)
    }

    /// The first `count` numbers of the shape whose vertices are nearest to those of a mesh, given
    /// the rotations of its parts.
    pub fn shape_of(&self, vertices: &[DVec3], rotations: &[DMat3], count: usize) -> Vec<f64> {
        let count = count.min(self.shape.len());
        let mean = self.synthesize(rotations, &[]);
        let middle = vertices.iter().sum::<DVec3>() / vertices.len() as f64;
        let mut directions = Array2::zeros((3 * vertices.len(), count));
        for (k, mut column) in directions.columns_mut().into_iter().enumerate() {
            let mut unit = vec![0.0; count];
            unit[k] = 1.0;
            let moved = self.synthesize(rotations, &unit);
            let difference = moved
                .iter()
                .zip(&mean)
                .flat_map(|(a, b)| (*a - *b).to_array());
            column
                .iter_mut()
                .zip(difference)
                .for_each(|(to, v)| *to = v);
        }
        let left: Vec<f64> = (vertices.iter().zip(&mean))
            .flat_map(|(v, m)| (*v - middle - *m).to_array())
            .collect();
        let right = directions.t().dot(&Array1::from(left));
        cholesky_solve(gram(directions.view()), right).map_or(vec![0.0; count], |b| b.to_vec())
    }

    /// What is known of a pose and a shape before a marker is seen.
    pub fn fit_prior(&self) -> FitPrior {
        FitPrior {
            twists: self.twist_prior(),
            noise: NOISE,
        }
    }

    /// The mean and the standard deviation of each component of the joints' twists in the training
    /// poses, radians.
    pub(crate) fn twist_prior(&self) -> Vec<(DVec3, DVec3)> {
        let poses: Vec<Vec<DVec3>> = (self.training_rotations.iter())
            .map(|r| twists(&self.template.joint_parts(), r))
            .collect();
        let n = poses.len().max(1) as f64;
        let prior = |j: usize| {
            let mean = poses.iter().map(|p| p[j]).sum::<DVec3>() / n;
            let square = |p: &Vec<DVec3>| (p[j] - mean) * (p[j] - mean);
            let variance = poses.iter().map(square).sum::<DVec3>() / n;
            let sd = DVec3::from_array(variance.to_array().map(f64::sqrt));
            let sd = sd.max(DVec3::splat(LEAST_DEVIATION));
            (mean, sd)
        };
        (0..self.template.joints.len()).map(prior).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::testdata::bending_body;
    use glam::{DMat3, DVec3};

    #[test]
    fn a_shape_is_found_again_in_its_vertices() {
        let body = bending_body();
        let rotations = body.training_rotations[3].clone();
        let shape = [0.7, -0.4];
        let mesh: Vec<DVec3> = (body.synthesize(&rotations, &shape).into_iter())
            .map(|v| v + DVec3::new(3.0, 1.0, 2.0))
            .collect();
        let found = body.shape_of(&mesh, &rotations, 2);
        assert!(
            (found[0] - 0.7).abs() < 1e-6 && (found[1] + 0.4).abs() < 1e-6,
            "{found:?}"
        );
    }

    #[test]
    fn turning_all_parts_turns_the_body() {
        let body = bending_body();
        let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 2.0);
        let rotations = &body.training_rotations[4];
        let turned: Vec<DMat3> = rotations.iter().map(|r| turn * *r).collect();
        let (a, b) = (
            body.synthesize(rotations, &[0.3]),
            body.synthesize(&turned, &[0.3]),
        );
        assert!(
            a.iter()
                .zip(&b)
                .all(|(a, b)| (turn * *a - *b).length() < 1e-9)
        );
    }
}

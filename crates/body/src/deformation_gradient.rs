//! Deformation gradients of triangles: linear in the deformed vertices and normals; and the
//! rotations nearest to them.
//!
//! R. W. Sumner, J. Popović: Deformation Transfer for Triangle Meshes, SIGGRAPH 2004, equations 3
//! to 6.

use crate::numeric::parallel::map_chunks;
use crate::pose::similarity::nearest_rotation;
use glam::{DMat3, DVec3};

/// A triangle whose area is less than this part of the square of its longest edge has no gradient.
const FLAT: f64 = 1e-7;

/// A triangle with an area.
pub(crate) struct Triangle {
    /// The corners, and V + k for its normal.
    pub nodes: [usize; 4],
    /// The share of each node in each column of T.
    pub shares: [[f64; 4]; 3],
    /// The area at rest, cm².
    pub area: f64,
}

impl Triangle {
    /// A triangle of vertices at rest, cm, and the index of its normal among the unknowns. `None`
    /// for one without area.
    pub(crate) fn new(face: [usize; 3], rest: &[DVec3], normal_node: usize) -> Option<Triangle> {
        let [a, b, c] = face.map(|v| rest[v]);
        let cross = (b - a).cross(c - a);
        let longest = [b - a, c - b, a - c].map(DVec3::length_squared);
        let longest = longest.into_iter().fold(0.0, f64::max);
        if !(cross.length() > FLAT * longest) {
            return None;
        }
        let back = DMat3::from_cols(b - a, c - a, cross.normalize()).inverse();
        let shares = |a: usize| {
            let column = back.col(a);
            [-column.x - column.y, column.x, column.y, column.z]
        };
        Some(Triangle {
            nodes: [face[0], face[1], face[2], normal_node],
            shares: [0, 1, 2].map(shares),
            area: cross.length() / 2.0,
        })
    }

    /// T, of all unknowns (3, 3).
    pub(crate) fn gradient(&self, unknowns: &[DVec3]) -> DMat3 {
        let column = |shares: [f64; 4]| {
            let parts = (0..4).map(|j| unknowns[self.nodes[j]] * shares[j]);
            parts.sum::<DVec3>()
        };
        let [a, b, c] = self.shares.map(column);
        DMat3::from_cols(a, b, c)
    }

    /// The nodes, each with its share.
    pub(crate) fn terms(&self, shares: [f64; 4]) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.nodes.iter().copied().zip(shares)
    }

    /// The weight of the difference of the gradients of two triangles with a common edge: the
    /// squared length of the edge by the areas, so that sums of squared differences are
    /// integrals of the gradient's derivative.
    pub(crate) fn weight_beside(&self, other: &Triangle, rest: &[DVec3]) -> f64 {
        let common: Vec<usize> = (self.nodes[..3].iter().copied())
            .filter(|v| other.nodes[..3].contains(v))
            .collect();
        let edge = rest[common[0]] - rest[common[1]];
        1.5 * edge.length_squared() / (self.area + other.area)
    }
}

/// The rotation nearest to each gradient (3, 3), times the scale that is best for all, given the
/// areas.
pub(crate) fn rotations(gradients: &[(DMat3, f64)]) -> Vec<DMat3> {
    let nearest = |(gradient, area): &(DMat3, f64)| {
        let rotation = polar(gradient);
        let gain: f64 = (0..3).map(|a| rotation.col(a).dot(gradient.col(a))).sum();
        (rotation, gain * area, 3.0 * area)
    };
    let chunks = map_chunks(gradients.len(), 512, |range| {
        gradients[range].iter().map(nearest).collect::<Vec<_>>()
    });
    let all = || chunks.iter().flatten();
    let gain: f64 = all().map(|(_, gain, _)| gain).sum();
    let area: f64 = all().map(|(.., area)| area).sum();
    all().map(|(r, ..)| *r * (gain / area)).collect()
}

/// The rotation nearest to a matrix: by Newton's method for the polar factor (N. Higham: Computing
/// the Polar Decomposition, 1986), which is ten times as fast as eigenvectors for the matrices near
/// rotations that most gradients are.
fn polar(matrix: &DMat3) -> DMat3 {
    let mut rotation = *matrix;
    for _ in 0..10 {
        if !(rotation.determinant() > 0.1) {
            break;
        }
        let next = (rotation + rotation.inverse().transpose()) * 0.5;
        if next.abs_diff_eq(rotation, 1e-10) {
            return next;
        }
        rotation = next;
    }
    nearest_rotation(&matrix.transpose()).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;

    #[test]
    fn the_nearest_rotation_is_found_for_all_matrices() {
        let turn = from_rotation_vector(DVec3::new(0.4, -1.3, 2.0));
        let stretch = DMat3::from_cols_array(&[1.3, 0.2, 0.0, 0.2, 0.8, -0.1, 0.0, -0.1, 1.1]);
        assert!(polar(&(turn * stretch)).abs_diff_eq(turn, 1e-9));
        let flat = DMat3::from_diagonal(DVec3::new(1.0, 2.0, 0.0));
        assert!(polar(&(turn * flat)).abs_diff_eq(turn, 1e-9));
        let mirror = DMat3::from_diagonal(DVec3::new(1.0, 2.0, -0.1));
        assert!(polar(&(turn * mirror)).abs_diff_eq(turn, 1e-9));
        let all = rotations(&[(2.0 * turn, 1.0), (4.0 * turn, 1.0)]);
        assert!(all[0].abs_diff_eq(3.0 * turn, 1e-9));
    }

    #[test]
    fn a_triangle_without_area_has_no_gradient() {
        let rest = [DVec3::ZERO, DVec3::X, 3.0 * DVec3::X, DVec3::Y];
        assert!(Triangle::new([0, 1, 2], &rest, 4).is_none());
        assert!(Triangle::new([0, 1, 1], &rest, 4).is_none());
        assert_eq!(Triangle::new([0, 1, 3], &rest, 4).unwrap().area, 0.5);
    }
}

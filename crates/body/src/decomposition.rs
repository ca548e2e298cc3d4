//! How a mesh differs from the template: a rotation for each part, and a matrix for each triangle.
//!
//! The edges v_kj of triangle k of an instance are R_l Q_k v̂_kj, with R_l the rotation of its part
//! l and Q_k what is not rigid. Rotations are fitted to the vertices of each part (Kabsch). The Q
//! minimize
//!
//! ```text
//! Σ_k Σ_j |R_k Q_k v̂_kj - v_kj|² + w_s Σ |Q_k1 - Q_k2|²
//!     over triangles k1, k2 of one part that share an edge
//! ```
//!
//! with w_s = c ρ², ρ the mean length of the template's edges: 0.001 ρ, as Anguelov et al. have
//! it, depends on the unit. c = 0.007 leaves some 0.02 mm of a body. A term 10⁻⁶ ρ² |Q_k - I|²
//! holds what edges leave open, as those of a flat part do. The matrix depends on the template
//! alone; it is factored once, and the three rows of all Q are solved for at once.

use super::template::Template;
use crate::numeric::parallel;
use crate::numeric::sparse_cholesky::SparseCholesky;
use crate::pose::similarity::nearest_rotation;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// The weight of smoothness, in squared mean edge lengths.
pub const SMOOTHNESS: f64 = 0.007;
/// The weight that draws Q to the identity, in squared mean edge lengths.
const TOWARD_IDENTITY: f64 = 1e-6;

/// Decomposes meshes of a template.
#[derive(Debug, Clone)]
pub struct Decomposer<'a> {
    template: &'a Template,
    factor: SparseCholesky,
}

impl<'a> Decomposer<'a> {
    /// Factors the template's matrix, with the weight `c` of smoothness. `None` if it is not
    /// positive definite.
    pub fn new(template: &'a Template, c: f64) -> Option<Decomposer<'a>> {
        let square = template.resolution().powi(2);
        let (weight, hold) = (c * square, TOWARD_IDENTITY * square);
        let mut entries = Vec::with_capacity(12 * template.faces.len());
        for (k, edges) in template.edges.iter().enumerate() {
            for a in 0..3 {
                for b in 0..=a {
                    let hold = if a == b { hold } else { 0.0 };
                    let value = edges[0][a] * edges[0][b] + edges[1][a] * edges[1][b] + hold;
                    entries.push((3 * k + a, 3 * k + b, value));
                }
            }
        }
        for [p, q] in &template.neighbors {
            if template.face_parts[*p] == template.face_parts[*q] {
                for a in 0..3 {
                    entries.push((3 * p + a, 3 * p + a, weight));
                    entries.push((3 * q + a, 3 * q + a, weight));
                    entries.push((3 * p + a, 3 * q + a, -weight));
                }
            }
        }
        let factor = SparseCholesky::new(3 * template.faces.len(), &entries)?;
        Some(Decomposer { template, factor })
    }

    /// The Q of each triangle of a mesh, given the rotation of each part.
    pub fn deformations(&self, vertices: &[DVec3], rotations: &[DMat3]) -> Vec<DMat3> {
        let template = self.template;
        let hold = TOWARD_IDENTITY * template.resolution().powi(2);
        let identity = |(row, column)| if row % 3 == column { hold } else { 0.0 };
        let mut right = Array2::from_shape_fn((3 * template.faces.len(), 3), identity);
        let edges = template.edges_of(vertices);
        for (k, (edges, rest)) in edges.iter().zip(&template.edges).enumerate() {
            let back = rotations[template.face_parts[k]].transpose();
            for (edge, rest) in edges.iter().zip(rest) {
                let edge = back * *edge;
                for a in 0..3 {
                    for row in 0..3 {
                        right[[3 * k + a, row]] += rest[a] * edge[row];
                    }
                }
            }
        }
        let x = self.factor.solve(right.view());
        let matrix = |k: usize| {
            let column =
                |a: usize| DVec3::new(x[[3 * k + a, 0]], x[[3 * k + a, 1]], x[[3 * k + a, 2]]);
            DMat3::from_cols(column(0), column(1), column(2))
        };
        (0..template.faces.len()).map(matrix).collect()
    }
}

/// The rotation of each part, fitted to its vertices (Kabsch).
///
/// ```
/// use glam::{DMat3, DVec3};
/// use posing_body::{Template, decomposition::fit_rotations};
///
/// let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
/// let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
/// let template = Template::new(vertices, faces, vec![0; 4])?;
/// let turn = DMat3::from_rotation_y(0.5);
/// let turned: Vec<DVec3> = template.vertices.iter().map(|v| turn * *v).collect();
/// assert!(fit_rotations(&template, &turned)[0].abs_diff_eq(turn, 1e-9));
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn fit_rotations(template: &Template, vertices: &[DVec3]) -> Vec<DMat3> {
    let each = || (template.vertices.iter().zip(vertices)).zip(&template.vertex_parts);
    let mut means = vec![(DVec3::ZERO, DVec3::ZERO, 0.0); template.parts()];
    for ((x, y), part) in each() {
        let mean = &mut means[*part];
        *mean = (mean.0 + *x, mean.1 + *y, mean.2 + 1.0);
    }
    let mut moments = vec![DMat3::ZERO; template.parts()];
    for ((x, y), part) in each() {
        let (sum_x, sum_y, count) = means[*part];
        let (x, y) = (*x - sum_x / count, *y - sum_y / count);
        // x yᵀ.
        moments[*part] += DMat3::from_cols(x * y.x, x * y.y, x * y.z);
    }
    moments.iter().map(|m| nearest_rotation(m).0).collect()
}

/// The vertices, about their mean, that rotations of the parts and matrices of the triangles give.
pub fn synthesize(template: &Template, rotations: &[DMat3], deformations: &[DMat3]) -> Vec<DVec3> {
    let edges = parallel::map_chunks(deformations.len(), 4096, |range| {
        let edges = |k: usize| {
            let matrix = rotations[template.face_parts[k]] * deformations[k];
            template.edges[k].map(|e| matrix * e)
        };
        range.map(edges).collect::<Vec<_>>()
    });
    template.vertices_of(&edges.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;
    use crate::template::tests::column;

    #[test]
    fn a_bent_column_is_given_back_and_turning_it_turns_its_parts() {
        let template = column(12);
        let bend = from_rotation_vector(DVec3::new(0.0, 0.0, 0.6));
        let bent: Vec<DVec3> = (template.vertices.iter())
            .map(|v| {
                if v.y > 5.5 {
                    bend * (*v - DVec3::new(0.0, 5.5, 0.0)) + DVec3::new(0.0, 5.5, 0.0)
                } else {
                    *v
                }
            })
            .collect();
        let decomposer = Decomposer::new(&template, 1e-6).unwrap();
        let rotations = fit_rotations(&template, &bent);
        assert!(rotations[0].abs_diff_eq(DMat3::IDENTITY, 1e-9));
        assert!(rotations[1].abs_diff_eq(bend, 1e-9));
        let q = decomposer.deformations(&bent, &rotations);
        let mean = bent.iter().sum::<DVec3>() / bent.len() as f64;
        let found = synthesize(&template, &rotations, &q);
        let worst = bent
            .iter()
            .zip(&found)
            .map(|(a, b)| (*a - mean - *b).length());
        assert!(worst.fold(0.0, f64::max) < 1e-3);
        let turn = from_rotation_vector(DVec3::new(0.3, -1.0, 0.5));
        let turned: Vec<DVec3> = bent.iter().map(|v| turn * *v + DVec3::X).collect();
        let again = fit_rotations(&template, &turned);
        assert!(again[1].abs_diff_eq(turn * bend, 1e-9));
        let same = decomposer.deformations(&turned, &again);
        assert!(q.iter().zip(&same).all(|(a, b)| a.abs_diff_eq(*b, 1e-8)));
    }

    #[test]
    fn the_gradient_vanishes_at_the_solution() {
        let template = column(8);
        let c = 0.05;
        let decomposer = Decomposer::new(&template, c).unwrap();
        let moved: Vec<DVec3> = (template.vertices.iter())
            .map(|v| *v + 0.2 * DVec3::new((3.0 * v.y).sin(), v.x * v.z, (v.y + v.x).cos()))
            .collect();
        let rotations = fit_rotations(&template, &moved);
        let q = decomposer.deformations(&moved, &rotations);
        let weight = c * template.resolution().powi(2);
        let edges = template.edges_of(&moved);
        let hold = TOWARD_IDENTITY * template.resolution().powi(2);
        let mut gradient: Vec<DMat3> = q.iter().map(|q| (*q - DMat3::IDENTITY) * hold).collect();
        for k in 0..q.len() {
            let r = rotations[template.face_parts[k]];
            for (edge, rest) in edges[k].iter().zip(&template.edges[k]) {
                let miss = q[k] * *rest - r.transpose() * *edge;
                gradient[k] += DMat3::from_cols(miss * rest.x, miss * rest.y, miss * rest.z);
            }
        }
        for [a, b] in &template.neighbors {
            if template.face_parts[*a] == template.face_parts[*b] {
                let pull = (q[*a] - q[*b]) * weight;
                gradient[*a] += pull;
                gradient[*b] -= pull;
            }
        }
        assert!(gradient.iter().all(|g| g.abs_diff_eq(DMat3::ZERO, 1e-10)));
    }
}

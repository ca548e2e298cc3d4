//! How much a deformed mesh bends and stretches, by the deformation gradients of its triangles, and
//! the mesh that least does so.
//!
//! The gradient of triangle k is T_k = [y_2 - y_1, y_3 - y_1, m_k] [x_2 - x_1, x_3 - x_1, n_k]⁻¹
//! (3, 3), with the corners x of the triangle, its unit normal n_k, the deformed corners y, and a
//! free vector m_k, the deformed normal (R. W. Sumner, J. Popović: Deformation Transfer for
//! Triangle Meshes, SIGGRAPH 2004, equations 3 to 6). T is linear in the unknowns y and m. With the
//! area A_k of a triangle and w_ab = l² / ((A_a + A_b) / 1.5) for neighbors with a common edge of
//! length l, the energy is
//!
//! ```text
//! E(y, m) = Σ_v w_v |y_v - c_v|² + b⁴ Σ_ab w_ab |T_a - T_b|² + s² Σ_k A_k |T_k - R_k|²
//! ```
//!
//! The sums are integrals over the surface, so b and s are lengths, cm, and mean the same on fine
//! and coarse meshes. Bending costs nothing for an affine deformation. The targets R_k are
//! rotations times one scale.
//!
//! Loose pieces of the surface hang on the largest at one vertex each, by [`Template`]'s bridges.

use super::deformation_gradient::Triangle;
use super::template::Template;
use crate::numeric::sparse_cholesky::SparseCholesky;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// The weights of an energy, besides those of the data.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stiffness {
    /// b: the length over which bending is resisted, cm.
    pub bend: f64,
    /// s: the length over which stretching is resisted, cm.
    pub stretch: f64,
}

/// What the vertices are drawn to: Σ_v weight_v |y_v - target_v|².
#[derive(Debug, Clone)]
pub(crate) struct Targets {
    /// c, cm (V).
    pub targets: Vec<DVec3>,
    /// w, cm²; 0 where there is none (V).
    pub weights: Vec<f64>,
}

/// The energy of a template of V vertices and P triangles that have an area; its matrix is (V + P,
/// V + P).
pub(crate) struct GradientEnergy {
    vertices: usize,
    triangles: Vec<Triangle>,
    /// Two triangles, as indices in `triangles`, and w_ab.
    pairs: Vec<([usize; 2], f64)>,
    ties: Vec<Tie>,
    /// The matrices of bending and stretching: row, column, and both values.
    entries: Vec<(usize, usize, [f64; 2])>,
}

/// y_to - y_from follows x_to - x_from by the gradient of a triangle: how a loose piece hangs on
/// the largest.
struct Tie {
    from: usize,
    to: usize,
    triangle: usize,
    rest: DVec3,
}

/// The factored matrix of an energy.
pub(crate) struct Factored<'a> {
    energy: &'a GradientEnergy,
    stiffness: Stiffness,
    factor: SparseCholesky,
}

impl GradientEnergy {
    /// The energy of a template at rest at `rest`, cm (V).
    pub(crate) fn new(template: &Template, rest: &[DVec3]) -> GradientEnergy {
        let faces = template.surface();
        let mut index = vec![None; faces.len()];
        let mut triangles = Vec::with_capacity(faces.len());
        for (k, face) in faces.iter().enumerate() {
            let own = rest.len() + triangles.len();
            if let Some(triangle) = Triangle::new(*face, rest, own) {
                index[k] = Some(triangles.len());
                triangles.push(triangle);
            }
        }
        let mut pairs = Vec::with_capacity(template.neighbors.len());
        for [a, b] in &template.neighbors {
            if *a.max(b) < faces.len()
                && let (Some(p), Some(q)) = (index[*a], index[*b])
            {
                let (p, q) = (p.min(q), p.max(q));
                let weight = triangles[p].weight_beside(&triangles[q], rest);
                pairs.push(([p, q], weight));
            }
        }
        let first = |v: usize| triangles.iter().position(|t| t.nodes[..3].contains(&v));
        let mut ties = Vec::new();
        for [from, to, _] in &template.faces[faces.len()..] {
            if let (Some(a), Some(b)) = (first(*from), first(*to)) {
                pairs.push(([a, b], 1.0));
                ties.push(Tie {
                    from: *from,
                    to: *to,
                    triangle: b,
                    rest: rest[*to] - rest[*from],
                });
            }
        }
        let mut energy = GradientEnergy {
            vertices: rest.len(),
            triangles,
            pairs,
            ties,
            entries: Vec::new(),
        };
        energy.entries = energy.matrices();
        energy
    }

    /// The unknowns of a mesh of the template's topology: its vertices, then the unit normals of
    /// its triangles (V + P).
    pub(crate) fn unknowns(&self, vertices: &[DVec3]) -> Vec<DVec3> {
        let normal = |t: &Triangle| {
            let [a, b, c] = [0, 1, 2].map(|j| vertices[t.nodes[j]]);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let normals = self.triangles.iter().map(normal);
        vertices.iter().copied().chain(normals).collect()
    }

    /// The gradients of the triangles, and the areas of these at rest, cm² (P).
    pub(crate) fn gradients(&self, unknowns: &[DVec3]) -> Vec<(DMat3, f64)> {
        let of = |t: &Triangle| (t.gradient(unknowns), t.area);
        self.triangles.iter().map(of).collect()
    }

    /// The vertex areas, a third of each triangle for each corner, cm² (V).
    pub(crate) fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.vertices];
        for t in &self.triangles {
            t.nodes[..3].iter().for_each(|v| areas[*v] += t.area / 3.0);
        }
        areas
    }

    /// Half the derivative of the energy by each unknown (V + P); `rotations` are the R (P).
    pub(crate) fn derivative(
        &self,
        stiffness: Stiffness,
        targets: &Targets,
        rotations: &[DMat3],
        unknowns: &[DVec3],
    ) -> Vec<DVec3> {
        let (bend, stretch) = (stiffness.bend.powi(4), stiffness.stretch.powi(2));
        let gradients: Vec<DMat3> = (self.triangles.iter())
            .map(|t| t.gradient(unknowns))
            .collect();
        let mut by_gradient: Vec<DMat3> = (gradients.iter().zip(rotations))
            .zip(&self.triangles)
            .map(|((t, r), triangle)| (*t - *r) * (stretch * triangle.area))
            .collect();
        for ([a, b], weight) in &self.pairs {
            let pull = (gradients[*a] - gradients[*b]) * (bend * weight);
            by_gradient[*a] += pull;
            by_gradient[*b] -= pull;
        }
        let mut derivative = vec![DVec3::ZERO; unknowns.len()];
        for tie in &self.ties {
            let gap = unknowns[tie.to] - unknowns[tie.from] - gradients[tie.triangle] * tie.rest;
            let pull = stretch * gap;
            derivative[tie.to] += pull;
            derivative[tie.from] -= pull;
            let d = tie.rest;
            by_gradient[tie.triangle] -= DMat3::from_cols(pull * d.x, pull * d.y, pull * d.z);
        }
        for (triangle, pull) in self.triangles.iter().zip(&by_gradient) {
            for (a, shares) in triangle.shares.iter().enumerate() {
                for (node, share) in triangle.nodes.iter().zip(shares) {
                    derivative[*node] += pull.col(a) * *share;
                }
            }
        }
        for v in 0..self.vertices {
            derivative[v] += targets.weights[v] * (unknowns[v] - targets.targets[v]);
        }
        derivative
    }

    /// Factors the matrix of an energy, of which only the weights of the targets matter. `None`: it
    /// is not positive definite, because no target holds the mesh, or only triangles without
    /// area hold a vertex.
    pub(crate) fn factor(&self, stiffness: Stiffness, weights: &[f64]) -> Option<Factored<'_>> {
        let (bend, stretch) = (stiffness.bend.powi(4), stiffness.stretch.powi(2));
        let mut entries: Vec<(usize, usize, f64)> = (self.entries.iter())
            .map(|(row, column, [b, s])| (*row, *column, bend * b + stretch * s))
            .collect();
        entries.extend(weights.iter().enumerate().map(|(v, w)| (v, v, *w)));
        Some(Factored {
            energy: self,
            stiffness,
            factor: SparseCholesky::new(self.size(), &entries)?,
        })
    }

    fn size(&self) -> usize {
        self.vertices + self.triangles.len()
    }

    /// The lower triangles of the matrices of bending and stretching, entries of one row and column
    /// added.
    fn matrices(&self) -> Vec<(usize, usize, [f64; 2])> {
        let mut entries = Vec::new();
        for ([a, b], weight) in &self.pairs {
            let (a, b) = (&self.triangles[*a], &self.triangles[*b]);
            for column in 0..3 {
                let negative = b.shares[column].map(|s| -s);
                let row = a.terms(a.shares[column]).chain(b.terms(negative));
                add_square(row, [*weight, 0.0], &mut entries);
            }
        }
        for t in &self.triangles {
            for column in 0..3 {
                add_square(t.terms(t.shares[column]), [0.0, t.area], &mut entries);
            }
        }
        for tie in &self.ties {
            let t = &self.triangles[tie.triangle];
            let share = |j: usize| -(0..3).map(|a| tie.rest[a] * t.shares[a][j]).sum::<f64>();
            let ends = [(tie.to, 1.0), (tie.from, -1.0)];
            let row = ends.into_iter().chain(t.terms([0, 1, 2, 3].map(share)));
            add_square(row, [0.0, 1.0], &mut entries);
        }
        entries.sort_unstable_by_key(|(row, column, _)| (*row, *column));
        let mut merged: Vec<(usize, usize, [f64; 2])> = Vec::new();
        for (row, column, value) in entries {
            match merged.last_mut() {
                Some(last) if (last.0, last.1) == (row, column) => {
                    (0..2).for_each(|k| last.2[k] += value[k]);
                }
                _ => merged.push((row, column, value)),
            }
        }
        merged
    }
}

/// Adds the lower triangle of value · r rᵀ, with r the sparse row of `terms`.
fn add_square(
    terms: impl Iterator<Item = (usize, f64)>,
    value: [f64; 2],
    entries: &mut Vec<(usize, usize, [f64; 2])>,
) {
    // Neighbors share two corners: what is added up here need not be sorted later.
    let mut row: Vec<(usize, f64)> = Vec::with_capacity(8);
    for (node, share) in terms {
        match row.iter_mut().find(|(n, _)| *n == node) {
            Some((_, sum)) => *sum += share,
            None => row.push((node, share)),
        }
    }
    for (m, a) in &row {
        for (n, b) in row.iter().filter(|(n, _)| n <= m) {
            entries.push((*m, *n, value.map(|v| v * a * b)));
        }
    }
}

impl Factored<'_> {
    /// The unknowns at which the energy is least, from others: one step of Newton's method, which
    /// is exact, because the energy is quadratic. A step from afar leaves the error of a matrix
    /// of bad condition; one from near does not.
    pub(crate) fn step(
        &self,
        targets: &Targets,
        rotations: &[DMat3],
        unknowns: &[DVec3],
    ) -> Vec<DVec3> {
        let energy = self.energy;
        let derivative = energy.derivative(self.stiffness, targets, rotations, unknowns);
        let right = Array2::from_shape_fn((derivative.len(), 3), |(n, a)| derivative[n][a]);
        let step = self.factor.solve(right.view());
        (unknowns.iter().zip(step.rows()))
            .map(|(u, d)| *u - DVec3::new(d[0], d[1], d[2]))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::tests::column;

    fn problem(template: &Template) -> (Targets, Vec<DVec3>) {
        let waved = |v: &DVec3| *v + 0.3 * DVec3::new((2.0 * v.y).sin(), v.x * v.z, v.y.cos());
        let targets = Targets {
            targets: template.vertices.iter().map(waved).collect(),
            weights: (0..template.vertices.len())
                .map(|v| f64::from(v as u32 % 3))
                .collect(),
        };
        let energy = GradientEnergy::new(template, &template.vertices);
        let mut unknowns = energy.unknowns(&template.vertices);
        for (k, u) in unknowns.iter_mut().enumerate() {
            *u += 0.1 * DVec3::new((k as f64).sin(), (3.0 * k as f64).cos(), 0.5);
        }
        (targets, unknowns)
    }

    const STIFFNESS: Stiffness = Stiffness {
        bend: 1.5,
        stretch: 0.7,
    };

    #[test]
    fn the_derivative_vanishes_after_a_step() {
        // A loose piece hangs on the column.
        let body = column(6);
        let mut vertices = body.vertices.clone();
        vertices.extend([[0.0, 3.5, 0.0], [0.25, 3.5, 0.0], [0.0, 3.75, 0.0]].map(DVec3::from));
        let faces = [body.faces.clone(), vec![[24, 25, 26]]].concat();
        let template = Template::new(vertices, faces, vec![0; 27]).unwrap();
        let energy = GradientEnergy::new(&template, &template.vertices);
        let (mut targets, unknowns) = problem(&template);
        targets.weights[24..].fill(0.0);
        let rotations = vec![DMat3::from_rotation_z(0.3) * 1.1; energy.triangles.len()];
        let factored = energy.factor(STIFFNESS, &targets.weights).unwrap();
        let found = factored.step(&targets, &rotations, &unknowns);
        let largest = |at: &[DVec3]| {
            let d = energy.derivative(STIFFNESS, &targets, &rotations, at);
            d.iter().map(|v| v.length()).fold(0.0, f64::max)
        };
        let (before, after) = (largest(&unknowns), largest(&found));
        assert!(after <= 1e-9 * before, "{after} of {before}");
    }

    #[test]
    fn an_affine_deformation_costs_no_bending() {
        let template = column(6);
        let energy = GradientEnergy::new(&template, &template.vertices);
        let affine = DMat3::from_cols_array(&[1.2, 0.3, 0.0, -0.2, 0.9, 0.1, 0.5, 0.0, 1.1]);
        let mut unknowns = energy.unknowns(&template.vertices);
        unknowns.iter_mut().for_each(|u| *u = affine * *u);
        for (gradient, _) in energy.gradients(&unknowns) {
            assert!(gradient.abs_diff_eq(affine, 1e-12));
        }
        let free = Targets {
            targets: vec![DVec3::ZERO; 24],
            weights: vec![0.0; 24],
        };
        let rotations = vec![affine; energy.triangles.len()];
        let derivative = energy.derivative(STIFFNESS, &free, &rotations, &unknowns);
        assert!(derivative.iter().all(|d| d.length() <= 1e-10));
    }

    #[test]
    fn triangles_without_area_are_left_out() {
        let body = column(6);
        let faces = [body.faces.clone(), vec![[0, 4, 8]]].concat();
        let template = Template::new(body.vertices.clone(), faces, vec![0; 24]).unwrap();
        let energy = GradientEnergy::new(&template, &template.vertices);
        assert_eq!(energy.triangles.len(), body.faces.len());
        let (targets, unknowns) = problem(&template);
        let rotations = vec![DMat3::IDENTITY; energy.triangles.len()];
        let factored = energy.factor(STIFFNESS, &targets.weights).unwrap();
        let found = factored.step(&targets, &rotations, &unknowns);
        assert!(found.iter().all(|v| v.is_finite()));
    }
}

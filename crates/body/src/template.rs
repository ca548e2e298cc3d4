//! The mesh that all bodies of a model share: its triangles, parts, joints, and the matrix that
//! turns edges into vertices.

use crate::Result;
use crate::numeric::sparse_cholesky::SparseCholesky;
use crate::numeric::union_find::root;
use glam::DVec3;
use ndarray::{Array2, ArrayView2};
use std::collections::HashMap;

/// A template mesh, centimeters.
#[derive(Debug, Clone)]
pub struct Template {
    /// Vertices (V).
    pub vertices: Vec<DVec3>,
    /// Triangles (P): indices of vertices. Behind those of the surface come [`Template::bridges`]
    /// others.
    pub faces: Vec<[usize; 3]>,
    /// Triangles that are not drawn: one from each loose piece of the surface (an eye, a nail) to
    /// the vertex of the largest piece that is nearest to it, so that it goes where the body
    /// goes.
    pub bridges: usize,
    /// The rigid part of each vertex, from 0.
    pub vertex_parts: Vec<usize>,
    /// The rigid part of each triangle: that of most of its corners.
    pub face_parts: Vec<usize>,
    /// The edges of each triangle from its first corner to the second and the third.
    pub edges: Vec<[DVec3; 2]>,
    /// Pairs of triangles that share an edge.
    pub neighbors: Vec<[usize; 2]>,
    /// Joints: a spanning tree of the parts.
    pub joints: Vec<Joint>,
    /// The least squares of edges (see [`Template::vertices_of`]).
    solver: SparseCholesky,
}

/// Where two parts meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// The two parts; the first is nearer to the root of the tree.
    pub parts: [usize; 2],
    /// The middle of their border, centimeters.
    pub at: DVec3,
}

impl Template {
    /// A template from vertices in centimeters, triangles, and the part of each vertex. Vertices
    /// are rounded to single precision, in which files keep them, so that a template read again
    /// is the same.
    ///
    /// ```
    /// use glam::DVec3;
    /// use posing_body::Template;
    ///
    /// // Two triangles with a common edge: a thigh and a shin.
    /// let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)];
    /// let template = Template::new(vertices, vec![[0, 1, 2], [2, 1, 3]], vec![0, 0, 1, 1])?;
    /// assert_eq!((template.parts(), template.face_parts.clone()), (2, vec![0, 1]));
    /// assert_eq!(template.joints[0].parts, [0, 1]);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: sizes differ, a triangle names a vertex that is not there, or the
    /// parts do not hang together.
    pub fn new(
        vertices: Vec<DVec3>,
        mut faces: Vec<[usize; 3]>,
        vertex_parts: Vec<usize>,
    ) -> Result<Template> {
        if vertex_parts.len() != vertices.len() {
            return Err(format!(
                "has {} vertices, and parts for {}",
                vertices.len(),
                vertex_parts.len()
            )
            .into());
        }
        if faces.is_empty() || faces.iter().flatten().any(|v| *v >= vertices.len()) {
            return Err("has no triangles, or one that names a vertex that is not there".into());
        }
        let mut used = vec![false; vertices.len()];
        faces.iter().flatten().for_each(|v| used[*v] = true);
        if used.iter().any(|u| !u) {
            return Err("has vertices that no triangle holds".into());
        }
        let vertices: Vec<DVec3> = (vertices.iter()).map(|v| v.as_vec3().as_dvec3()).collect();
        if vertices.iter().any(|v| !v.is_finite()) {
            return Err("has vertices that are not finite".into());
        }
        let bridges = bridges(&vertices, &faces);
        faces.extend(&bridges);
        let face_parts = faces
            .iter()
            .map(|f| most(f.map(|v| vertex_parts[v])))
            .collect();
        let neighbors = neighbors(&faces);
        let solver = edge_solver(vertices.len(), &faces)
            .ok_or("has vertices that its triangles do not hold")?;
        let mut template = Template {
            edges: edges_of(&vertices, &faces),
            vertices,
            faces,
            bridges: bridges.len(),
            vertex_parts,
            face_parts,
            neighbors,
            joints: Vec::new(),
            solver,
        };
        template.joints = template.spanning_tree()?;
        Ok(template)
    }

    /// The triangles of the surface, without the bridges.
    pub fn surface(&self) -> &[[usize; 3]] {
        &self.faces[..self.faces.len() - self.bridges]
    }

    /// The number of rigid parts.
    pub fn parts(&self) -> usize {
        self.joints.len() + 1
    }

    /// The part at the root of the tree of joints.
    pub(crate) fn root(&self) -> usize {
        self.joints.first().map_or(0, |j| j.parts[0])
    }

    /// The position of a body: the mean of the vertices of the root.
    pub fn root_of(&self, vertices: &[DVec3]) -> DVec3 {
        let root = self.root();
        let own = (vertices.iter().zip(&self.vertex_parts)).filter(|(_, p)| **p == root);
        let (sum, n) = own.fold((DVec3::ZERO, 0.0), |(sum, n), (v, _)| (sum + *v, n + 1.0));
        sum / n
    }

    /// The two parts of each joint.
    pub(crate) fn joint_parts(&self) -> Vec<[usize; 2]> {
        self.joints.iter().map(|j| j.parts).collect()
    }

    /// The mean length of the edges, centimeters.
    pub(crate) fn resolution(&self) -> f64 {
        let sum: f64 = self.edges.iter().flatten().map(|e| e.length()).sum();
        sum / (2 * self.edges.len()) as f64
    }

    /// The edges of each triangle of vertices of this topology.
    pub(crate) fn edges_of(&self, vertices: &[DVec3]) -> Vec<[DVec3; 2]> {
        edges_of(vertices, &self.faces)
    }

    /// The vertices y whose edges are nearest to given ones, with their mean at the origin:
    ///
    /// ```text
    /// min Σ_k Σ_j |e_kj - (y_kj - y_k1)|²
    /// ```
    ///
    /// One factorization serves all; it is made with the template. O(V) a call.
    pub(crate) fn vertices_of(&self, edges: &[[DVec3; 2]]) -> Vec<DVec3> {
        let mut right = Array2::zeros((self.vertices.len(), 3));
        for (face, edges) in self.faces.iter().zip(edges) {
            for (corner, edge) in face[1..].iter().zip(edges) {
                for axis in 0..3 {
                    right[[*corner, axis]] += edge[axis];
                    right[[face[0], axis]] -= edge[axis];
                }
            }
        }
        let x = self.solver.solve(right.view());
        let vertices: Vec<DVec3> = (x.rows().into_iter())
            .map(|r| DVec3::new(r[0], r[1], r[2]))
            .collect();
        let mean = vertices.iter().sum::<DVec3>() / vertices.len() as f64;
        vertices.into_iter().map(|v| v - mean).collect()
    }

    /// A⁻¹ `b` for b (V, m), where A is the normal matrix of the edges with 1 added at the first
    /// vertex, which holds it. For columns of b that sum to zero it is the solution of the
    /// edges alone that leaves the first vertex where it is.
    pub(crate) fn solve(&self, b: ArrayView2<'_, f64>) -> Array2<f64> {
        self.solver.solve(b)
    }

    /// The entries (row, column, value) of the normal matrix of the edges, which leaves a shift
    /// free.
    pub(crate) fn edge_entries(&self) -> Vec<(usize, usize, f64)> {
        edge_entries(&self.faces)
    }

    /// The tree of the longest borders between parts, from the part with most of them outwards.
    fn spanning_tree(&self) -> Result<Vec<Joint>> {
        let parts = self.vertex_parts.iter().max().map_or(0, |p| p + 1);
        if let Some(part) = (0..parts).find(|p| !self.face_parts.contains(p)) {
            return Err(format!(
                "has a part {part} that most corners of no triangle are of: give it more vertices"
            )
            .into());
        }
        let mut borders: HashMap<[usize; 2], (f64, DVec3)> = HashMap::new();
        for [a, b] in &self.neighbors {
            let pair = [self.face_parts[*a], self.face_parts[*b]];
            if pair[0] == pair[1] {
                continue;
            }
            let shared = (self.faces[*a].iter()).filter(|v| self.faces[*b].contains(v));
            let ends: Vec<DVec3> = shared.map(|v| self.vertices[*v]).collect();
            if let [p, q] = ends[..] {
                let length = (q - p).length();
                let border = borders.entry([pair[0].min(pair[1]), pair[0].max(pair[1])]);
                let border = border.or_insert((0.0, DVec3::ZERO));
                border.0 += length;
                border.1 += length * (p + q) / 2.0;
            }
        }
        let mut borders: Vec<([usize; 2], (f64, DVec3))> = borders.into_iter().collect();
        borders.sort_by(|a, b| b.1.0.total_cmp(&a.1.0).then(a.0.cmp(&b.0)));
        let mut degree = vec![0; parts];
        borders
            .iter()
            .flat_map(|(pair, _)| pair)
            .for_each(|p| degree[*p] += 1);
        let root = (0..parts).rev().max_by_key(|p| degree[*p]).unwrap_or(0);
        let mut reached = vec![false; parts];
        reached[root] = true;
        let mut joints = Vec::new();
        // The longest border that leads out of what is reached, again and again.
        while let Some((pair, (length, sum))) = borders
            .iter()
            .find(|(pair, _)| reached[pair[0]] != reached[pair[1]])
        {
            let parts = if reached[pair[0]] {
                *pair
            } else {
                [pair[1], pair[0]]
            };
            reached[parts[1]] = true;
            joints.push(Joint {
                parts,
                at: *sum / *length,
            });
        }
        match reached.iter().position(|r| !r) {
            Some(part) => Err(format!("has a part {part} that touches no other part").into()),
            None => Ok(joints),
        }
    }
}

/// What occurs most often, the smallest of equals.
pub(super) fn most(values: [usize; 3]) -> usize {
    let count = |v: usize| values.iter().filter(|w| **w == v).count();
    let mut sorted = values;
    sorted.sort_unstable();
    let best = sorted.iter().rev().max_by_key(|v| count(**v));
    best.copied().unwrap_or(values[0])
}

fn edges_of(vertices: &[DVec3], faces: &[[usize; 3]]) -> Vec<[DVec3; 2]> {
    let edges = |f: &[usize; 3]| [1, 2].map(|j| vertices[f[j]] - vertices[f[0]]);
    faces.iter().map(edges).collect()
}

/// Pairs of triangles with a common edge, in order.
fn neighbors(faces: &[[usize; 3]]) -> Vec<[usize; 2]> {
    let mut open: HashMap<[usize; 2], usize> = HashMap::new();
    let mut pairs = Vec::new();
    for (k, face) in faces.iter().enumerate() {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let edge = [face[a].min(face[b]), face[a].max(face[b])];
            if let Some(other) = open.insert(edge, k) {
                pairs.push([other, k]);
            }
        }
    }
    pairs
}

/// A triangle from each piece of the surface that hangs on no other to the largest one.
fn bridges(vertices: &[DVec3], faces: &[[usize; 3]]) -> Vec<[usize; 3]> {
    let piece = pieces(vertices.len(), faces);
    let count = piece.iter().max().map_or(0, |p| p + 1);
    let mut members = vec![Vec::new(); count];
    for (v, p) in piece.iter().enumerate() {
        members[*p].push(v);
    }
    let Some(largest) = (0..count).rev().max_by_key(|p| members[*p].len()) else {
        return Vec::new();
    };
    (0..count)
        .filter(|p| *p != largest)
        .filter_map(|p| bridge(vertices, faces, &members[p], &members[largest]))
        .collect()
}

/// A triangle with an edge of one piece of the surface and the vertex of another that is nearest.
fn bridge(
    vertices: &[DVec3],
    faces: &[[usize; 3]],
    piece: &[usize],
    other: &[usize],
) -> Option<[usize; 3]> {
    let near = |v: &usize| {
        let distance = |u: &&usize| (vertices[**u] - vertices[*v]).length_squared();
        let nearest = other
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map(|u| (distance(&u), *u, *v))
    };
    let (_, u, v) = (piece.iter().filter_map(near)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let face = faces.iter().find(|f| f.contains(&v))?;
    let next = face.iter().find(|w| **w != v)?;
    Some([u, v, *next])
}

/// The connected piece of the surface that each vertex is of, from 0.
fn pieces(vertices: usize, faces: &[[usize; 3]]) -> Vec<usize> {
    let mut parent: Vec<usize> = (0..vertices).collect();
    for face in faces {
        let a = root(&mut parent, face[0]);
        for v in &face[1..] {
            let b = root(&mut parent, *v);
            parent[b] = a;
        }
    }
    let mut names = HashMap::new();
    let of = (0..vertices).map(|v| {
        let r = root(&mut parent, v);
        let next = names.len();
        *names.entry(r).or_insert(next)
    });
    of.collect()
}

/// The entries of GᵀG, the normal matrix of the edges.
fn edge_entries(faces: &[[usize; 3]]) -> Vec<(usize, usize, f64)> {
    let mut entries = Vec::with_capacity(6 * faces.len() + 1);
    for face in faces {
        for corner in &face[1..] {
            entries.push((face[0], face[0], 1.0));
            entries.push((*corner, *corner, 1.0));
            entries.push((face[0], *corner, -1.0));
        }
    }
    entries
}

/// The normal matrix of the edges; the first vertex is held, or all would be free to shift.
fn edge_solver(vertices: usize, faces: &[[usize; 3]]) -> Option<SparseCholesky> {
    let mut entries = edge_entries(faces);
    entries.push((0, 0, 1.0));
    SparseCholesky::new(vertices, &entries)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A box of `n` rings of four vertices along y, closed at both ends, in two parts.
    pub(crate) fn column(n: usize) -> Template {
        let mut vertices = Vec::new();
        for k in 0..n {
            for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                vertices.push(DVec3::new(x, k as f64, z));
            }
        }
        let mut faces = Vec::new();
        for k in 0..n - 1 {
            for c in 0..4 {
                let (a, b) = (4 * k + c, 4 * k + (c + 1) % 4);
                faces.push([a, b, a + 4]);
                faces.push([b, b + 4, a + 4]);
            }
        }
        let top = 4 * (n - 1);
        faces.extend([
            [0, 2, 1],
            [0, 3, 2],
            [top, top + 1, top + 2],
            [top, top + 2, top + 3],
        ]);
        let parts = (0..4 * n).map(|v| usize::from(v / 4 >= n / 2)).collect();
        Template::new(vertices, faces, parts).unwrap()
    }

    #[test]
    fn edges_give_back_the_vertices_that_they_are_of() {
        let template = column(6);
        let moved: Vec<DVec3> = (template.vertices.iter())
            .map(|v| DVec3::new(2.0 * v.x + v.y, v.y * v.y, v.z - v.x * v.y))
            .collect();
        let mean = moved.iter().sum::<DVec3>() / moved.len() as f64;
        let found = template.vertices_of(&template.edges_of(&moved));
        assert!(
            moved
                .iter()
                .zip(found)
                .all(|(a, b)| (*a - mean - b).length() < 1e-9)
        );
    }

    #[test]
    fn two_parts_meet_at_one_joint() {
        let template = column(6);
        assert_eq!(template.parts(), 2);
        let joint = template.joints[0];
        assert_eq!(joint.parts, [0, 1]);
        assert!(joint.at.x.abs() < 1e-9 && joint.at.y > 1.5 && joint.at.y < 3.5);
        assert_eq!(template.neighbors.len(), 3 * template.faces.len() / 2);
    }

    #[test]
    fn a_loose_piece_goes_where_the_body_goes() {
        let body = column(4);
        let mut vertices = body.vertices.clone();
        let eye = [[0.0, 3.5, 0.0], [0.25, 3.5, 0.0], [0.0, 3.75, 0.0]].map(DVec3::from_array);
        vertices.extend(eye);
        let mut faces = body.faces.clone();
        faces.push([16, 17, 18]);
        let parts = [body.vertex_parts.clone(), vec![1; 3]].concat();
        let template = Template::new(vertices.clone(), faces, parts).unwrap();
        assert_eq!(template.bridges, 1);
        assert_eq!(template.surface().len(), body.faces.len() + 1);
        let found = template.vertices_of(&template.edges);
        let shift = vertices[0] - found[0];
        assert!((vertices[17] - found[17] - shift).length() < 1e-9);
    }

    #[test]
    fn what_is_no_template_is_told() {
        let good = column(4);
        let new = |faces: Vec<[usize; 3]>, parts: Vec<usize>| {
            let new = Template::new(good.vertices.clone(), faces, parts);
            new.unwrap_err().to_string()
        };
        assert!(new(good.faces.clone(), vec![0; 3]).contains("parts for 3"));
        assert!(new(vec![], vec![0; 16]).contains("no triangles"));
        assert!(new(good.faces[..4].to_vec(), vec![0; 16]).contains("no triangle holds"));
    }
}

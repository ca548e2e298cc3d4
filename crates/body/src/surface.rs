//! The point of a surface that is nearest to another point.

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// Vertices near a point whose triangles are looked at.
const CANDIDATES: usize = 4;

/// A triangle mesh, or a cloud of points, in which nearest points are found.
pub struct Surface {
    vertices: Vec<DVec3>,
    faces: Vec<[usize; 3]>,
    /// The triangles at each vertex.
    faces_of: Vec<Vec<usize>>,
    /// The mean normal at each vertex, weighted by area; 0 without triangles.
    normals: Vec<DVec3>,
    /// Whether each vertex is at the border of a hole.
    is_border: Vec<bool>,
    /// The vertices of the tree: where there are triangles, those that they hold.
    in_tree: Vec<usize>,
    tree: Option<ImmutableKdTree<f64, 3>>,
}

/// A point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Three vertices, and the shares of the point in them; of a cloud three times the same.
    pub corners: [usize; 3],
    /// Sum to 1.
    pub shares: [f64; 3],
    /// Where it is.
    pub at: DVec3,
    /// The unit normal there, from those of the vertices; 0 for a cloud.
    pub normal: DVec3,
    /// Whether it is at the border of a hole: nothing is known of what is beyond.
    pub is_border: bool,
}

impl Surface {
    /// A surface of vertices and triangles, whose other vertices do not count; without triangles a
    /// cloud.
    pub fn new(vertices: Vec<DVec3>, faces: Vec<[usize; 3]>) -> Surface {
        let mut faces_of = vec![Vec::new(); vertices.len()];
        let mut normals = vec![DVec3::ZERO; vertices.len()];
        for (k, face) in faces.iter().enumerate() {
            let [a, b, c] = face.map(|v| vertices[v]);
            let normal = (b - a).cross(c - a);
            for v in face {
                faces_of[*v].push(k);
                normals[*v] += normal;
            }
        }
        normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
        let is_used = |v: &usize| faces.is_empty() || !faces_of[*v].is_empty();
        let in_tree: Vec<usize> = (0..vertices.len()).filter(is_used).collect();
        let points: Vec<[f64; 3]> = in_tree.iter().map(|v| vertices[*v].to_array()).collect();
        Surface {
            is_border: border(vertices.len(), &faces),
            vertices,
            faces,
            faces_of,
            normals,
            in_tree,
            tree: (!points.is_empty()).then(|| ImmutableKdTree::new_from_slice(&points)),
        }
    }

    /// The vertices.
    pub(crate) fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// The normal at each vertex.
    pub(crate) fn normals(&self) -> &[DVec3] {
        &self.normals
    }

    /// The point of the triangles at the nearest vertices that is nearest to `p`. `None` for an
    /// empty surface.
    pub fn nearest(&self, p: DVec3) -> Option<SurfacePoint> {
        let count = NonZero::new(CANDIDATES)?;
        let near = (self.tree.as_ref()?).nearest_n::<SquaredEuclidean>(&p.to_array(), count);
        let first = self.in_tree[near.first()?.item as usize];
        let mut best = SurfacePoint {
            corners: [first; 3],
            shares: [1.0, 0.0, 0.0],
            at: self.vertices[first],
            normal: self.normals[first],
            is_border: self.is_border[first],
        };
        let faces = near
            .iter()
            .flat_map(|n| &self.faces_of[self.in_tree[n.item as usize]]);
        for face in faces {
            let corners = self.faces[*face];
            let shares = nearest_shares(p, corners.map(|v| self.vertices[v]));
            let at = mix(corners.map(|v| self.vertices[v]), shares);
            if (at - p).length_squared() < (best.at - p).length_squared() {
                let normal = mix(corners.map(|v| self.normals[v]), shares).normalize_or_zero();
                let borders = (0..3).filter(|c| shares[*c] > 0.0);
                best = SurfacePoint {
                    is_border: borders.clone().all(|c| self.is_border[corners[c]]),
                    corners,
                    shares,
                    at,
                    normal,
                };
            }
        }
        Some(best)
    }
}

fn mix(values: [DVec3; 3], shares: [f64; 3]) -> DVec3 {
    values[0] * shares[0] + values[1] * shares[1] + values[2] * shares[2]
}

/// The shares of the corners in the point of a triangle that is nearest to `p` (Ericson, Real-Time
/// Collision Detection, 5.1.5).
fn nearest_shares(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let sum = va + vb + vc;
    [va / sum, vb / sum, vc / sum]
}

/// Whether each vertex is on an edge of one triangle only.
fn border(vertices: usize, faces: &[[usize; 3]]) -> Vec<bool> {
    let mut edges: Vec<[usize; 2]> = (faces.iter())
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    let mut is_border = vec![false; vertices];
    for group in edges.chunk_by(|a, b| a == b) {
        if let [[a, b]] = group {
            (is_border[*a], is_border[*b]) = (true, true);
        }
    }
    is_border
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::tests::column;

    #[test]
    fn the_nearest_point_is_nearer_than_all_others() {
        let template = column(5);
        let surface = Surface::new(template.vertices.clone(), template.faces.clone());
        for k in 0..200 {
            let angle = k as f64;
            let p = DVec3::new(2.0 * angle.sin(), angle % 5.0, 1.6 * (1.3 * angle).cos());
            let found = surface.nearest(p).unwrap();
            let distance = (found.at - p).length();
            for face in &template.faces {
                let corners = face.map(|v| template.vertices[v]);
                for shares in [[0.2, 0.3, 0.5], [0.0, 0.4, 0.6], [1.0, 0.0, 0.0]] {
                    assert!(distance <= (mix(corners, shares) - p).length() + 1e-12);
                }
            }
            let again = mix(found.corners.map(|v| template.vertices[v]), found.shares);
            assert!((again - found.at).length() < 1e-12);
            assert!(!found.is_border);
        }
    }

    #[test]
    fn many_points_in_one_plane_or_position_are_no_trouble() {
        let grid = (0..20_000).map(|k| DVec3::new((k % 100) as f64, (k / 100) as f64, 0.0));
        let same = (0..500).map(|_| DVec3::new(3.25, 7.0, 0.0));
        let cloud = Surface::new(grid.chain(same).collect(), Vec::new());
        let found = cloud.nearest(DVec3::new(3.3, 7.0, 2.0)).unwrap();
        assert_eq!(found.at, DVec3::new(3.25, 7.0, 0.0));
        let found = cloud.nearest(DVec3::new(50.4, 150.0, -1.0)).unwrap();
        assert_eq!(found.at, DVec3::new(50.0, 150.0, 0.0));
    }

    #[test]
    fn an_open_surface_has_a_border_and_a_cloud_no_normals() {
        let template = column(5);
        let faces = template.faces[..template.faces.len() - 2].to_vec();
        let open = Surface::new(template.vertices.clone(), faces);
        assert!(open.nearest(DVec3::new(0.0, 9.0, 0.0)).unwrap().is_border);
        assert!(!open.nearest(DVec3::new(0.0, -9.0, 0.0)).unwrap().is_border);
        let mut vertices = template.vertices.clone();
        vertices.push(DVec3::new(0.0, 30.0, 0.0));
        let with_loose = Surface::new(vertices, template.faces.clone());
        let found = with_loose.nearest(DVec3::new(0.0, 30.0, 0.0)).unwrap();
        assert_eq!(found.at, DVec3::new(0.0, 4.0, 0.0));
        let cloud = Surface::new(template.vertices.clone(), Vec::new());
        let found = cloud.nearest(DVec3::new(1.2, 2.0, 1.0)).unwrap();
        assert_eq!(found.normal, DVec3::ZERO);
        assert_eq!(found.at, DVec3::new(1.0, 2.0, 1.0));
        assert!(
            Surface::new(Vec::new(), Vec::new())
                .nearest(DVec3::ZERO)
                .is_none()
        );
    }
}

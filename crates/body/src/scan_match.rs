//! The points of a scan that belong to the vertices of a mesh near it.

use super::surface::{Surface, SurfacePoint};
use crate::numeric::parallel::map_chunks;
use glam::DVec3;

/// The cosine of the largest angle between the normals of a vertex and of its point of the scan: 60
/// degrees.
const ALIKE: f64 = 0.5;

/// Finds, for the vertices of a mesh, the points of a scan.
pub(crate) struct ScanMatcher<'a> {
    scan: &'a Surface,
    faces: &'a [[usize; 3]],
    /// 1, or -1 for a scan whose faces point inwards where those of the mesh point outwards.
    orientation: f64,
}

impl<'a> ScanMatcher<'a> {
    /// A matcher of a scan and a mesh near it: `vertices` (V), cm, and `faces`.
    pub(crate) fn new(
        scan: &'a Surface,
        faces: &'a [[usize; 3]],
        vertices: &[DVec3],
    ) -> ScanMatcher<'a> {
        let mut matcher = ScanMatcher {
            scan,
            faces,
            orientation: 1.0,
        };
        let normals = normals(vertices, faces);
        let nearest = matcher.nearest(vertices).into_iter();
        let alike = (nearest.zip(normals)).map(|(p, n)| p.map_or(0.0, |p| p.normal.dot(n)));
        if alike.sum::<f64>() < 0.0 {
            matcher.orientation = -1.0;
        }
        matcher
    }

    /// The nearest point of each vertex. `None`: it is farther than `limit` cm, at the border of a
    /// hole, or of another direction.
    pub(crate) fn matches(&self, vertices: &[DVec3], limit: f64) -> Vec<Option<DVec3>> {
        let normals = normals(vertices, self.faces);
        let nearest = self.nearest(vertices).into_iter().enumerate();
        let accept = |(v, point): (usize, Option<SurfacePoint>)| {
            let point = point?;
            // A cloud has no normals.
            let alike = point.normal == DVec3::ZERO
                || self.orientation * point.normal.dot(normals[v]) > ALIKE;
            (alike && is_seen(&point, vertices[v], limit)).then_some(point.at)
        };
        nearest.map(accept).collect()
    }

    /// The distance of each vertex to the scan, cm. `None`: it is more than `limit`, or the nearest
    /// point is at the border of a hole.
    pub(crate) fn distances(&self, vertices: &[DVec3], limit: f64) -> Vec<Option<f64>> {
        (self.nearest(vertices).into_iter().zip(vertices))
            .map(|(point, v)| {
                let point = point.filter(|p| is_seen(p, *v, limit))?;
                Some((point.at - *v).length())
            })
            .collect()
    }

    fn nearest(&self, vertices: &[DVec3]) -> Vec<Option<SurfacePoint>> {
        let chunk = |range: std::ops::Range<usize>| -> Vec<Option<SurfacePoint>> {
            range.map(|v| self.scan.nearest(vertices[v])).collect()
        };
        let chunks = map_chunks(vertices.len(), 256, chunk);
        chunks.into_iter().flatten().collect()
    }
}

/// Whether a scan shows a vertex at its nearest point.
fn is_seen(point: &SurfacePoint, vertex: DVec3, limit: f64) -> bool {
    (point.at - vertex).length() <= limit && !point.is_border
}

/// The unit normals of the vertices, weighted by area (V).
fn normals(vertices: &[DVec3], faces: &[[usize; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|v| vertices[v]);
        let normal = (b - a).cross(c - a);
        face.iter().for_each(|v| normals[*v] += normal);
    }
    normals.iter().map(|n| n.normalize_or_zero()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::tests::column;

    #[test]
    fn matches_are_near_alike_and_not_at_a_border() {
        let template = column(6);
        let vertices = &template.vertices;
        let faces = template.surface();
        let scan = Surface::new(vertices.clone(), faces.to_vec());
        let inside_out = faces.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        let inside_out = Surface::new(vertices.clone(), inside_out);
        for scan in [&scan, &inside_out] {
            let matcher = ScanMatcher::new(scan, faces, vertices);
            let found = matcher.matches(vertices, 1e-6);
            assert_eq!(found.iter().flatten().count(), vertices.len());
            let mirrored: Vec<DVec3> = (vertices.iter())
                .map(|v| DVec3::new(-v.x, v.y, v.z))
                .collect();
            assert_eq!(matcher.matches(&mirrored, 0.1).iter().flatten().count(), 0);
        }
        // The top is cut off.
        let open = Surface::new(vertices.clone(), faces[..faces.len() - 2].to_vec());
        let matcher = ScanMatcher::new(&open, faces, vertices);
        let found = matcher.matches(vertices, 0.1);
        assert!(found[20..].iter().all(Option::is_none));
        assert!(found[4..20].iter().all(Option::is_some));
        assert_eq!(matcher.distances(vertices, 0.1)[7], Some(0.0));
    }
}

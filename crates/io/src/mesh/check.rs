//! What is wrong with a mesh: faces, edges and the size of a body.

use super::Mesh;
use crate::Result;
use crate::numeric::union_find::root;
use glam::DVec3;
use std::fmt;

/// A triangle whose height is less than this part of its longest edge has no area.
const FLAT: f64 = 1e-9;

/// The plausible largest extents of a body, meters: an infant to a tall adult, or the arms spread.
const BODY_METERS: std::ops::RangeInclusive<f64> = 0.5..=2.6;

/// Units that [`Mesh::plausible_height`] suggests: names and meters.
const UNITS: [(&str, f64); 4] = [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)];

/// Something that is wrong with a mesh, displayed as one phrase. Faces and vertices are counted
/// from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finding {
    /// The mesh has no vertices.
    NoVertices,
    /// The mesh has no faces.
    NoFaces,
    /// Vertices have coordinates that are not finite.
    NotFinite {
        /// The number of such vertices.
        count: usize,
        /// The first of them.
        first: usize,
    },
    /// A face names a vertex that is not there.
    MissingVertex {
        /// The first such face.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// The number of vertices of the mesh.
        vertices: usize,
    },
    /// Faces have two equal corners.
    EqualCorners {
        /// The number of such faces.
        count: usize,
        /// The first of them.
        first: usize,
    },
    /// Faces have no area though their corners are three vertices: their height is less than 1e-9
    /// of their longest edge.
    ZeroArea {
        /// The number of such faces.
        count: usize,
        /// The first of them.
        first: usize,
    },
    /// Edges belong to more than two faces: the mesh is no surface there (non-manifold).
    NonManifold {
        /// The number of such edges.
        count: usize,
        /// The vertices of the first of them.
        first: [u32; 2],
    },
    /// Two faces run along their common edge in the same direction: one of them is flipped.
    Flipped {
        /// The number of such edges.
        count: usize,
        /// The vertices of the first of them.
        first: [u32; 2],
    },
    /// The surface has holes. Scans have them.
    Holes {
        /// The number of holes; holes that touch in a vertex count as one.
        count: usize,
        /// The number of open edges: those of one face.
        open_edges: usize,
    },
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let face = "the first is face";
        match *self {
            Finding::NoVertices => write!(f, "has no vertices"),
            Finding::NoFaces => write!(f, "has no faces"),
            Finding::NotFinite { count, first } => write!(
                f,
                "vertices that are not finite: {count}, the first is vertex {first} (counted from \
                 0)"
            ),
            Finding::MissingVertex {
                face,
                vertex,
                vertices,
            } => write!(
                f,
                "face {face} names vertex {vertex}, there are {vertices} (counted from 0)"
            ),
            Finding::EqualCorners { count, first } => write!(
                f,
                "faces with two equal corners: {count}, {face} {first} (counted from 0)"
            ),
            Finding::ZeroArea { count, first } => write!(
                f,
                "faces without area: {count}, {face} {first} (counted from 0)"
            ),
            Finding::NonManifold {
                count,
                first: [a, b],
            } => write!(
                f,
                "edges of more than two faces: {count}, the first joins vertices {a} and {b} \
                 (counted from 0)"
            ),
            Finding::Flipped {
                count,
                first: [a, b],
            } => write!(
                f,
                "neighboring faces with opposite orientation: {count}, the first pair shares \
                 vertices {a} and {b} (counted from 0)"
            ),
            Finding::Holes { count, open_edges } => {
                write!(f, "holes: {count}, with {open_edges} open edges")
            }
        }
    }
}

impl Mesh {
    /// What is wrong with the mesh; nothing for a closed surface whose faces are all oriented
    /// alike. Each kind of finding is named once, with its count. `Finding::Holes` is always
    /// last.
    ///
    /// The time grows as f log f with the number f of faces.
    ///
    /// ```
    /// use posing_io::mesh::{Finding, Mesh};
    ///
    /// let vertices = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    /// let mut body = Mesh { vertices, faces };
    /// assert_eq!(body.check(), []); // a tetrahedron is closed
    /// body.faces.pop();
    /// assert_eq!(body.check(), [Finding::Holes { count: 1, open_edges: 3 }]);
    /// ```
    pub fn check(&self) -> Vec<Finding> {
        let mut found = Vec::new();
        if self.vertices.is_empty() {
            found.push(Finding::NoVertices);
        }
        if self.faces.is_empty() {
            found.push(Finding::NoFaces);
        }
        let infinite = |v: &[f64; 3]| v.iter().any(|c| !c.is_finite());
        found.extend(
            count(self.vertices.iter().map(infinite))
                .map(|(count, first)| Finding::NotFinite { count, first }),
        );
        found.extend(missing_vertex(self));
        let equal = self.faces.iter().map(has_equal_corners);
        found.extend(count(equal).map(|(count, first)| Finding::EqualCorners { count, first }));
        let flat = self.faces.iter().map(|face| self.is_flat(face));
        found.extend(count(flat).map(|(count, first)| Finding::ZeroArea { count, first }));
        found.extend(self.edge_findings());
        found
    }

    /// Whether a face of three vertices that are there and finite has no area.
    fn is_flat(&self, face: &[u32; 3]) -> bool {
        let corner = |v: u32| self.vertices.get(v as usize).map(|v| DVec3::from_array(*v));
        let (Some(a), Some(b), Some(c)) = (corner(face[0]), corner(face[1]), corner(face[2]))
        else {
            return false;
        };
        let longest = [b - a, c - b, a - c].map(DVec3::length_squared);
        let longest = longest.into_iter().fold(0.0, f64::max);
        !has_equal_corners(face) && (b - a).cross(c - a).length() <= FLAT * longest
    }

    fn edge_findings(&self) -> Vec<Finding> {
        // Edges as (smaller vertex, larger vertex, runs backwards).
        let mut edges = Vec::with_capacity(3 * self.faces.len());
        for face in self.faces.iter().filter(|face| !has_equal_corners(face)) {
            for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
                edges.push((a.min(b), a.max(b), a > b));
            }
        }
        edges.sort_unstable();
        let (mut many, mut flipped, mut open) = (Vec::new(), Vec::new(), Vec::new());
        for group in edges.chunk_by(|e, f| (e.0, e.1) == (f.0, f.1)) {
            let edge = [group[0].0, group[0].1];
            match group {
                [_] => open.push(edge),
                [one, two] if one.2 == two.2 => flipped.push(edge),
                [_, _] => {}
                _ => many.push(edge),
            }
        }
        let found = |edges: &[[u32; 2]]| edges.first().map(|first| (edges.len(), *first));
        let many = found(&many).map(|(count, first)| Finding::NonManifold { count, first });
        let flipped = found(&flipped).map(|(count, first)| Finding::Flipped { count, first });
        let holes = (!open.is_empty()).then(|| Finding::Holes {
            count: groups(&open),
            open_edges: open.len(),
        });
        [many, flipped, holes].into_iter().flatten().collect()
    }

    /// Whether the largest extent along an axis is that of a body, 0.5 to 2.6 m. `meters_per_unit`
    /// is the length of the mesh's unit: 0.01 for centimeters.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`] with the extent and the remedy, the option `units`.
    pub fn plausible_height(&self, meters_per_unit: f64) -> Result<()> {
        let extent = |axis: usize| {
            let values = || self.vertices.iter().map(move |v| v[axis]);
            values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min)
        };
        let extent = (0..3).map(extent).fold(0.0, f64::max);
        let meters = extent * meters_per_unit;
        if BODY_METERS.contains(&meters) {
            return Ok(());
        }
        let (least, most) = BODY_METERS.into_inner();
        let fits = |(_, unit): &&(&str, f64)| BODY_METERS.contains(&(extent * unit));
        let remedy = match UNITS.iter().find(fits) {
            Some((name, unit)) => format!(
                "with the option `units {name}` it is {:.2} m",
                extent * unit
            ),
            None => "give the unit of the file with the option `units`".into(),
        };
        let size = if (0.01..1e5).contains(&meters) {
            format!("{meters:.2}")
        } else {
            format!("{meters:.2e}")
        };
        Err(format!(
            "the largest extent is {size} m, expected {least} to {most} m for a body; {remedy}"
        )
        .into())
    }
}

/// The first face that names a vertex that is not there.
pub(super) fn missing_vertex(mesh: &Mesh) -> Option<Finding> {
    let vertices = mesh.vertices.len();
    let missing = |(face, corners): (usize, &[u32; 3])| {
        let vertex = *corners.iter().find(|v| **v as usize >= vertices)?;
        Some(Finding::MissingVertex {
            face,
            vertex,
            vertices,
        })
    };
    mesh.faces.iter().enumerate().find_map(missing)
}

fn has_equal_corners([a, b, c]: &[u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// How many are true, and which is the first.
fn count(all: impl Iterator<Item = bool> + Clone) -> Option<(usize, usize)> {
    let first = all.clone().position(|b| b)?;
    Some((all.filter(|b| *b).count(), first))
}

/// The number of connected groups of edges.
fn groups(edges: &[[u32; 2]]) -> usize {
    let mut vertices: Vec<u32> = edges.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let mut parent: Vec<usize> = (0..vertices.len()).collect();
    let mut count = vertices.len();
    for edge in edges {
        let [a, b] = edge.map(|v| {
            // Every vertex of an edge is in the list.
            root(&mut parent, vertices.binary_search(&v).unwrap_or_default())
        });
        if a != b {
            parent[a] = b;
            count -= 1;
        }
    }
    count
}

#[cfg(test)]
mod tests;

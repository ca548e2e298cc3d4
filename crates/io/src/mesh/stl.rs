//! STL, text or binary.
//!
//! The format has no topology: each triangle has corners of its own. Corners that are equal to the
//! bit (-0 counts as 0) become one vertex. The order of the vertices is that of their first
//! appearance, so that a file written and read again has other vertex numbers. Normals and
//! attributes are ignored.

use super::super::text::{Lines, excerpt, parse_number};
use super::Mesh;
use crate::{Error, Place, Result};
use std::collections::HashMap;

/// The bytes of the comment that a binary file begins with.
const COMMENT: usize = 80;
/// The bytes of a triangle: a normal, three corners, an attribute.
const TRIANGLE: usize = 50;

/// Whether bytes have the form of a file: the word `solid` and a facet or the end, or the exact
/// size of a binary file.
pub(super) fn is_stl(bytes: &[u8]) -> bool {
    if declared_size(bytes) == Some(bytes.len() as u64) {
        return true;
    }
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(1000)]);
    is_text(bytes) && (start.contains("facet") || start.contains("endsolid"))
}

fn is_text(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"solid")
}

/// The size that a binary file with this head has.
fn declared_size(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(COMMENT..)?.first_chunk()?;
    let count = u64::from(u32::from_le_bytes(*count));
    Some((COMMENT + 4) as u64 + TRIANGLE as u64 * count)
}

/// Reads the bytes of a file.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<Mesh> {
    let mut merged = Merged::default();
    let size = bytes.len() as u64;
    // Binary files may begin with "solid" too; their size tells them.
    if declared_size(bytes) == Some(size) {
        read_binary(&bytes[COMMENT + 4..], name, &mut merged)?;
    } else if is_text(bytes) {
        read_text(bytes, name, &mut merged)?;
    } else {
        let what = match declared_size(bytes) {
            Some(expected) => {
                format!("expected {expected} bytes by its count of triangles, found {size}")
            }
            None => format!("has {size} bytes, a binary STL file has at least 84"),
        };
        return Err(Error::data(Place::file(name), what));
    }
    Ok(merged.mesh)
}

/// A triangle in an error is counted from 0.
fn read_binary(triangles: &[u8], name: &str, merged: &mut Merged) -> Result<()> {
    for (i, triangle) in triangles.as_chunks::<TRIANGLE>().0.iter().enumerate() {
        let values = triangle.as_chunks::<4>().0;
        let value = |at: usize| f64::from(f32::from_le_bytes(values[at]));
        // The first three values are the normal.
        let corners = [3, 6, 9].map(|at| [value(at), value(at + 1), value(at + 2)]);
        let added = merged.add(corners);
        added.map_err(|e| e.at(Place::file(name).part(format!("face {i}"))))?;
    }
    Ok(())
}

fn read_text(bytes: &[u8], name: &str, merged: &mut Merged) -> Result<()> {
    let mut lines = Lines::new(name, bytes);
    let mut corners = Vec::new();
    let mut ended = false;
    while let Some(line) = lines.next_line()? {
        let done = text_line(line, &mut corners, merged, &mut ended);
        done.map_err(|e| e.at(lines.here()))?;
    }
    if !ended || !corners.is_empty() {
        return Err(Error::data(lines.here(), "ends before endsolid"));
    }
    Ok(())
}

fn text_line(
    line: &str,
    corners: &mut Vec<[f64; 3]>,
    merged: &mut Merged,
    ended: &mut bool,
) -> Result<()> {
    let words: Vec<&str> = line.split_ascii_whitespace().take(4).collect();
    let first = words
        .first()
        .map_or(String::new(), |w| w.to_ascii_lowercase());
    match (first.as_str(), &words[..]) {
        ("vertex", [_, x, y, z]) if corners.len() < 3 => {
            corners.push([parse_number(x)?, parse_number(y)?, parse_number(z)?]);
        }
        ("vertex", [_, _, _, _]) => return Err("the facet has more than three corners".into()),
        ("vertex", _) => return Err("expected three numbers after vertex".into()),
        ("endloop", _) => {
            let count = corners.len();
            let corners = std::mem::take(corners).try_into();
            let corners =
                corners.map_err(|_| format!("the facet has {count} corners, expected three"))?;
            merged.add(corners)?;
        }
        ("endsolid", _) => *ended = true,
        ("" | "solid" | "facet" | "outer" | "endfacet", _) => {}
        _ => {
            let found = excerpt(words[0]);
            return Err(format!("expected facet, vertex or endsolid, found \"{found}\"").into());
        }
    }
    Ok(())
}

/// A mesh in which equal corners become one vertex.
#[derive(Default)]
struct Merged {
    mesh: Mesh,
    vertices: HashMap<[u64; 3], u32>,
}

impl Merged {
    fn add(&mut self, corners: [[f64; 3]; 3]) -> Result<()> {
        let mut face = [0; 3];
        for (index, corner) in face.iter_mut().zip(corners) {
            // The sum turns -0 into 0.
            let corner = corner.map(|v| v + 0.0);
            let key = corner.map(f64::to_bits);
            *index = match self.vertices.get(&key) {
                Some(&known) => known,
                None => {
                    let new = self.mesh.vertices.len() as u32;
                    self.mesh.add_vertex(corner)?;
                    self.vertices.insert(key, new);
                    new
                }
            };
        }
        self.mesh.add_polygon(&face)
    }
}

/// The bytes of a binary file, with the normals of the triangles.
pub(super) fn write(mesh: &Mesh) -> Vec<u8> {
    let mut out = Vec::with_capacity(COMMENT + 4 + TRIANGLE * mesh.faces.len());
    out.resize(COMMENT, 0);
    out.extend_from_slice(&(mesh.faces.len() as u32).to_le_bytes());
    for face in &mesh.faces {
        let corners = face.map(|v| glam::DVec3::from_array(mesh.vertices[v as usize]));
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for v in [normal, a, b, c].iter().flat_map(|p| p.to_array()) {
            out.extend_from_slice(&(v as f32).to_le_bytes());
        }
        out.extend_from_slice(&[0; 2]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::MeshFormat;
    use super::super::tests::testdata::{cube, message, read};

    const TEXT: &str = "solid a body
  facet normal 0 0 1
    outer loop
      vertex 0 0 0
      vertex 1 0 0
      vertex 0 1 0
    endloop
  endfacet
  FACET normal 0 0 1
    OUTER LOOP
      VERTEX 1 0 0
      VERTEX 1.5e0 1 0
      VERTEX -0 1 0
    ENDLOOP
  ENDFACET
endsolid a body
";

    #[test]
    fn text_is_read_and_merged() {
        let mesh = read("a.stl", TEXT).unwrap();
        assert_eq!(mesh.faces, [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(mesh.vertices[3], [1.5, 1.0, 0.0]);
        assert_eq!(read("unnamed", TEXT).unwrap(), mesh);
    }

    #[test]
    fn bad_text_is_named() {
        for (from, to, expected) in [
            ("vertex 1 0 0", "vertex 1 0", "a.stl:5: expected three"),
            ("vertex 1 0 0\n", "", "a.stl:6: the facet has 2 corners"),
            ("endloop", "vertex 1 1 1", "a.stl:7: the facet has more"),
            (
                "vertex 1 0 0",
                "vertex 1 0 nan",
                "a.stl:5: expected a finite",
            ),
            ("outer loop", "inner loop", "a.stl:3: expected facet"),
            ("endsolid a body\n", "", "a.stl:15: ends before endsolid"),
        ] {
            let text = message("a.stl", TEXT.replacen(from, to, 1));
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn bad_binary_is_named() {
        let sound = cube().to_bytes(MeshFormat::Stl).unwrap();
        let mut solid = sound.clone();
        solid[..5].copy_from_slice(b"solid");
        assert_eq!(read("a.stl", solid).unwrap().faces.len(), 12);
        let cut = message("a.stl", &sound[..500]);
        assert_eq!(
            cut,
            "a.stl: expected 684 bytes by its count of triangles, found 500"
        );
        assert!(message("a.stl", [1; 20]).contains("at least 84"));
        let mut huge = sound.clone();
        huge[80..84].fill(0xff);
        assert!(message("a.stl", huge).contains("expected 214748364834 bytes"));
        let mut bad = sound;
        bad[84 + 50 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(message("a.stl", bad).starts_with("a.stl: face 1: expected coordinates"));
    }
}

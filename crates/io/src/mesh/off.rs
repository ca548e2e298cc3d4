//! OFF (Geomview): `OFF`, a line of the numbers of vertices, faces and edges, a line a vertex and a
//! line a face (`3 0 1 2`, vertices counted from 0). Comments, and what stands behind the numbers
//! that count, such as colors and normals, are ignored.

use super::super::text::{Lines, excerpt, parse_number};
use super::Mesh;
use crate::{Error, Place, Result};
use std::io::Write;

/// Reads the bytes of a file.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<Mesh> {
    let mut lines = Lines::new(name, bytes);
    let mut mesh = Mesh::default();
    let ends = |what: &str| Error::data(Place::file(name), format!("ends before its {what}"));
    let head = next(&mut lines)?.ok_or_else(|| ends("header"))?;
    let mut words = head.split_ascii_whitespace();
    let kind = words.next().unwrap_or("");
    if !matches!(kind, "OFF" | "COFF" | "NOFF" | "CNOFF") || head.contains("BINARY") {
        let what = format!("expected OFF, found \"{}\"", excerpt(&head));
        return Err(Error::data(lines.here(), what));
    }
    let rest: Vec<&str> = words.collect();
    let counts = if rest.is_empty() {
        next(&mut lines)?.ok_or_else(|| ends("numbers of vertices and faces"))?
    } else {
        rest.join(" ")
    };
    let counts = counts.split(' ').take(2).map(|w| w.parse().ok());
    let Some(&[vertices, faces]) = counts.collect::<Option<Vec<usize>>>().as_deref() else {
        return Err(Error::data(
            lines.here(),
            "expected the numbers of vertices and faces",
        ));
    };
    for _ in 0..vertices {
        let line = next(&mut lines)?.ok_or_else(|| ends("last vertex"))?;
        vertex(&line, &mut mesh).map_err(|e| e.at(lines.here()))?;
    }
    for _ in 0..faces {
        let line = next(&mut lines)?.ok_or_else(|| ends("last face"))?;
        face(&line, &mut mesh).map_err(|e| e.at(lines.here()))?;
    }
    Ok(mesh)
}

/// The next line that says something, its words apart by one space.
fn next(lines: &mut Lines<&[u8]>) -> Result<Option<String>> {
    while let Some(line) = lines.next_line()? {
        let own = line.split('#').next().unwrap_or("");
        let words: Vec<&str> = own.split_ascii_whitespace().collect();
        if !words.is_empty() {
            return Ok(Some(words.join(" ")));
        }
    }
    Ok(None)
}

fn vertex(line: &str, mesh: &mut Mesh) -> Result<()> {
    let numbers = line.split(' ').take(3).map(parse_number);
    let numbers = numbers.collect::<Result<Vec<f64>>>()?;
    let at: [f64; 3] = numbers.try_into().map_err(|found: Vec<f64>| {
        Error::unfit(format!("expected three numbers, found {}", found.len()))
    })?;
    mesh.add_vertex(at)
}

fn face(line: &str, mesh: &mut Mesh) -> Result<()> {
    let bad = || Error::unfit(format!("expected a face, found \"{}\"", excerpt(line)));
    let mut words = line.split(' ').map(|w| w.parse::<u32>().map_err(|_| bad()));
    let count = words.next().ok_or_else(bad)??;
    let corners = words.by_ref().take(count as usize);
    let corners = corners.collect::<Result<Vec<u32>>>()?;
    if corners.len() < count as usize {
        return Err(bad());
    }
    if let Some(v) = corners.iter().find(|v| **v as usize >= mesh.vertices.len()) {
        let count = mesh.vertices.len();
        return Err(format!("the face names vertex {v}; the file has {count}, from 0").into());
    }
    mesh.add_polygon(&corners)
}

/// The bytes of a file, six digits after the point.
pub(super) fn write(mesh: &Mesh) -> Vec<u8> {
    let mut out = Vec::with_capacity(32 * (mesh.vertices.len() + mesh.faces.len()));
    // Writing to memory does not fail.
    let _ = writeln!(out, "OFF\n{} {} 0", mesh.vertices.len(), mesh.faces.len());
    for [x, y, z] in &mesh.vertices {
        let _ = writeln!(out, "{x:.6} {y:.6} {z:.6}");
    }
    for [a, b, c] in &mesh.faces {
        let _ = writeln!(out, "3 {a} {b} {c}");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::testdata::{message, read};

    const TEXT: &str =
        "OFF # a square\n\n4 1 0\n0 0 0\n1 0 0 255 0 0\n1 1 0\n0 1 -2.5e-1\n4 0 1 2 3\n";

    #[test]
    fn polygons_comments_and_colors() {
        let mesh = read("a.off", TEXT).unwrap();
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.vertices[3], [0.0, 1.0, -0.25]);
        let one_line = TEXT.replacen("OFF # a square\n\n4", "OFF 4", 1);
        assert_eq!(read("a.off", &one_line).unwrap(), mesh);
        let written = super::write(&mesh);
        assert_eq!(
            read("b.off", std::str::from_utf8(&written).unwrap()).unwrap(),
            mesh
        );
    }

    #[test]
    fn bad_files_are_told_by_line() {
        for (from, to, expected) in [
            ("OFF", "off", "a.off:1: expected OFF"),
            ("4 1 0\n", "4\n", "a.off:3: expected the numbers"),
            ("4 1 0\n", "4 x 0\n", "a.off:3: expected the numbers"),
            ("1 1 0\n", "1 1\n", "a.off:6: expected three numbers"),
            ("4 0 1 2 3", "4 0 1 2", "a.off:8: expected a face"),
            ("4 0 1 2 3", "4 0 1 2 4", "a.off:8: the face names vertex 4"),
            ("4 0 1 2 3\n", "", "a.off: ends before its last face"),
        ] {
            let text = message("a.off", TEXT.replacen(from, to, 1));
            assert!(text.starts_with(expected), "{text}");
        }
    }
}

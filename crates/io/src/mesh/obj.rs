//! Wavefront OBJ: the lines `v x y z` and `f a b c …`; all others are ignored.
//!
//! A corner of a face is `vertex`, `vertex/texture`, `vertex//normal` or `vertex/texture/normal`.
//! Vertices count from 1, or back from -1, the vertex read last. Numbers behind `x y z` (a weight,
//! a color) are ignored.

use super::super::text::{Lines, excerpt, parse_number};
use super::Mesh;
use crate::{Error, Place, Result};
use std::io::Write;

/// Reads the bytes of a file.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<Mesh> {
    let mut lines = Lines::new(name, bytes);
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    // The largest vertex that a face names, and the line of the face: a face may stand before its
    // vertices.
    let mut largest = (0, 0);
    while let Some(line) = lines.next_line()? {
        let mut words = line.split_ascii_whitespace();
        let done = match words.next() {
            Some("v") => vertex(words, &mut mesh),
            Some("f") => face(words, &mut mesh, &mut corners),
            _ => continue,
        };
        done.map_err(|e| e.at(lines.here()))?;
        if let Some(&corner) = corners.iter().max().filter(|c| **c >= largest.0) {
            largest = (corner, lines.number);
        }
        corners.clear();
    }
    let count = mesh.vertices.len();
    if largest.0 as usize >= count && !mesh.faces.is_empty() {
        let named = u64::from(largest.0) + 1;
        let what = format!("the face names vertex {named}, the file has {count}");
        return Err(Error::data(Place::line(name, largest.1), what));
    }
    Ok(mesh)
}

fn vertex<'a>(words: impl Iterator<Item = &'a str>, mesh: &mut Mesh) -> Result<()> {
    let mut at = [0.0; 3];
    let mut count = 0;
    for (number, word) in at.iter_mut().zip(words) {
        *number = parse_number(word)?;
        count += 1;
    }
    if count < 3 {
        return Err(format!("expected three numbers after v, found {count}").into());
    }
    mesh.add_vertex(at)
}

fn face<'a>(
    words: impl Iterator<Item = &'a str>,
    mesh: &mut Mesh,
    corners: &mut Vec<u32>,
) -> Result<()> {
    for word in words.take_while(|w| !w.starts_with('#')) {
        corners.push(corner(word, mesh.vertices.len())?);
    }
    mesh.add_polygon(corners)
}

/// The vertex of a corner such as `7/1/3` or `-1`, counted from 0; `known` vertices stand above.
fn corner(word: &str, known: usize) -> Result<u32> {
    let end = word.bytes().position(|b| b == b'/');
    let text = &word[..end.unwrap_or(word.len())];
    let bad = || {
        Error::unfit(format!(
            "expected a corner such as 7, 7/1 or 7//3, found \"{}\"",
            excerpt(word)
        ))
    };
    let number: i64 = text.parse().map_err(|_| bad())?;
    let index = match number {
        0 => return Err("the face names vertex 0; vertices count from 1".into()),
        1.. => number - 1,
        _ => known as i64 + number,
    };
    if index < 0 {
        return Err(format!("the face names vertex {number}, {known} stand above").into());
    }
    u32::try_from(index).map_err(|_| bad())
}

/// The bytes of a file, six digits after the point.
pub(super) fn write(mesh: &Mesh) -> Vec<u8> {
    let mut out = Vec::with_capacity(32 * (mesh.vertices.len() + mesh.faces.len()));
    // Writing to memory does not fail.
    for [x, y, z] in &mesh.vertices {
        let _ = writeln!(out, "v {x:.6} {y:.6} {z:.6}");
    }
    for face in &mesh.faces {
        let [a, b, c] = face.map(|v| u64::from(v) + 1);
        let _ = writeln!(out, "f {a} {b} {c}");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::testdata::{message, read};

    const POINTS: &str = "v 0 0 0\nv 1 0 0 0.5 0.5 0.5\r\nv 1 1 0 1\nv 0 1 -2.5e-1\n";

    #[test]
    fn all_forms_of_faces() {
        for face in [
            "f 1 2 3 4",
            "f 1/1 2/2 3/3 4/4",
            "f 1//9 2//9 3//9 4//9",
            "f  1/1/1\t2/2/2 3/3/3 4/4/4 # a quad",
            "f -4 -3 -2 -1",
        ] {
            let text = format!("# caf\u{e9}\nmtllib x\no body\n{POINTS}vn 0 0 1\n{face}\n");
            let mesh = read("a.obj", text).unwrap();
            assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]], "{face}");
            assert_eq!(mesh.vertices[3], [0.0, 1.0, -0.25]);
        }
        let before = read("a.obj", format!("f 1 2 3\n{POINTS}")).unwrap();
        assert_eq!(before.faces, [[0, 1, 2]]);
        let latin = [b"# caf\xe9\n", POINTS.as_bytes()].concat();
        assert_eq!(read("a.obj", latin).unwrap().vertices.len(), 4);
    }

    #[test]
    fn bad_lines_are_named() {
        for (lines, expected) in [
            ("f 1 2 5\nf 1 2 3", "a.obj:5: the face names vertex 5"),
            ("f 1 2 0", "a.obj:5: the face names vertex 0;"),
            ("f 1 2 -5", "a.obj:5: the face names vertex -5, 4 stand"),
            ("f 1 2 99999999999999999999", "a.obj:5: expected a corner"),
            ("f 1 2 4294967297", "a.obj:5: expected a corner"),
            ("f 1 2 4294967296", "vertex 4294967296, the file has 4"),
            ("f 1 2 x/1", "found \"x/1\""),
            ("f 1 2", "the face has 2 corners"),
            ("f", "a.obj:5: the face has no corners"),
            (
                "\nv 1 2",
                "a.obj:6: expected three numbers after v, found 2",
            ),
            ("v 1 2 z", "expected a number, found \"z\""),
            ("v 1 2 nan", "expected a finite number"),
            ("v 1 2 1e300", "expected coordinates within 1e12"),
        ] {
            let text = message("a.obj", format!("{POINTS}{lines}\n"));
            assert!(text.contains(expected), "{lines}: {text}");
        }
    }

    #[test]
    fn a_body_is_read() {
        let mut text = String::new();
        for i in 0..13_380 {
            text += &format!("v {:.6} {:.6} {:.6}\n", i as f64 / 7.0, -0.123456, 1.75);
        }
        for i in 0..26_756 {
            let v = i % 13_000 + 1;
            text += &format!("f {v}/{v} {}/{v} {}/{v}\n", v + 1, v + 2);
        }
        let mesh = read("a.obj", &text).unwrap();
        assert_eq!((mesh.vertices.len(), mesh.faces.len()), (13_380, 26_756));
    }
}

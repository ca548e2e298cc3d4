//! Stanford PLY, text or binary of either byte order.
//!
//! The properties `x`, `y`, `z` of the element `vertex` are read, and of `face` the list
//! `vertex_indices` or `vertex_index`, of any types and in any order; all other elements and
//! properties are passed over. Rows are counted from 0.

mod header;
mod values;

use super::super::text::{Lines, excerpt};
use super::Mesh;
use crate::{Error, Place, Result};
use header::{Element, Encoding, Header, Property};
use values::{BinaryValues, TextValues, Values};

/// Whether bytes begin as a file does.
pub(super) fn is_ply(bytes: &[u8]) -> bool {
    bytes
        .strip_prefix(b"ply")
        .is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace))
}

/// Reads the bytes of a file.
pub(super) fn read(bytes: &[u8], name: &str) -> Result<Mesh> {
    let mut lines = Lines::new(name, bytes);
    let header = header::read(&mut lines)?;
    if header.encoding == Encoding::Text {
        return read_elements(&header, name, &mut TextValues::new(lines));
    }
    let rest = &bytes[bytes.len() - lines.waiting()?.len()..];
    let mut values = BinaryValues {
        name,
        rest,
        big_endian: header.encoding == Encoding::BigEndian,
    };
    read_elements(&header, name, &mut values)
}

/// What a property is to the mesh.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Axis(usize),
    Corners,
    Other,
}

fn read_elements(header: &Header, name: &str, values: &mut impl Values) -> Result<Mesh> {
    let vertices = header.vertices();
    let none = || Error::data(Place::file(name), "has no element vertex");
    let vertices = vertices.ok_or_else(none)?;
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    for element in &header.elements {
        let roles = roles(element).map_err(|e| e.at(Place::file(name)))?;
        values.check_size(element)?;
        for row in 0..element.count {
            values.start_row()?;
            corners.clear();
            let done = read_row(element, &roles, values, &mut corners, vertices);
            done.and_then(|at| match element.name.as_str() {
                "vertex" => mesh.add_vertex(at),
                "face" => mesh.add_polygon(&corners),
                _ => Ok(()),
            })
            .map_err(|e| e.at(values.place(element, row)))?;
        }
    }
    values.finish()?;
    Ok(mesh)
}

/// The roles of an element's properties.
fn roles(element: &Element) -> Result<Vec<Role>> {
    let role = |p: &Property| match (element.name.as_str(), p.name.as_str(), p.list) {
        ("vertex", "x", None) => Role::Axis(0),
        ("vertex", "y", None) => Role::Axis(1),
        ("vertex", "z", None) => Role::Axis(2),
        ("face", "vertex_indices" | "vertex_index", Some(_)) => Role::Corners,
        _ => Role::Other,
    };
    let roles: Vec<Role> = element.properties.iter().map(role).collect();
    let has = |role: Role| roles.iter().filter(|r| **r == role).count() == 1;
    match element.name.as_str() {
        "vertex" if !(0..3).all(|axis| has(Role::Axis(axis))) => {
            Err("the element vertex needs the properties x, y and z".into())
        }
        "face" if element.count > 0 && !has(Role::Corners) => {
            Err("the element face needs one list vertex_indices".into())
        }
        _ => Ok(roles),
    }
}

/// Reads a row: the position of a vertex, or the corners of a face.
fn read_row(
    element: &Element,
    roles: &[Role],
    values: &mut impl Values,
    corners: &mut Vec<u32>,
    vertices: u64,
) -> Result<[f64; 3]> {
    let mut at = [0.0; 3];
    for (property, role) in element.properties.iter().zip(roles) {
        let count = match property.list {
            None => 1,
            Some(kind) => list_length(values.value(kind)?, property)?,
        };
        for _ in 0..count {
            let value = values.value(property.kind)?;
            match role {
                Role::Axis(axis) => at[*axis] = value,
                Role::Corners => corners.push(corner(value, vertices)?),
                Role::Other => {}
            }
        }
    }
    values.end_row()?;
    Ok(at)
}

fn list_length(value: f64, property: &Property) -> Result<u64> {
    if value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u32::MAX) {
        return Ok(value as u64);
    }
    let name = excerpt(&property.name);
    Err(format!("the list {name} has the length {value}").into())
}

fn corner(value: f64, vertices: u64) -> Result<u32> {
    let whole = value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u32::MAX);
    if whole && (value as u64) < vertices {
        return Ok(value as u32);
    }
    let count = format!("the file has {vertices} (counted from 0)");
    Err(format!("the face names vertex {value}, {count}").into())
}

/// The bytes of a little-endian file, in single precision.
pub(super) fn write(mesh: &Mesh) -> Vec<u8> {
    let (vertices, faces) = (mesh.vertices.len(), mesh.faces.len());
    let header = format!(
        "ply\nformat binary_little_endian 1.0\n\
         element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar uint vertex_indices\nend_header\n"
    );
    let mut out = header.into_bytes();
    out.reserve(12 * vertices + 13 * faces);
    for v in mesh.vertices.iter().flatten() {
        out.extend_from_slice(&(*v as f32).to_le_bytes());
    }
    for face in &mesh.faces {
        out.push(3);
        for v in face {
            out.extend_from_slice(&v.to_le_bytes());
        }
    }
    out
}

#[cfg(test)]
mod tests;

//! What the unit tests of meshes share.

use super::Mesh;
use crate::Input;
use crate::{Error, Result};

/// A closed cube of edge 1, faces anticlockwise as seen from outside.
pub(in crate::mesh) fn cube() -> Mesh {
    let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(f64::from);
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let mut mesh = Mesh {
        vertices: (0..8).map(corner).collect(),
        faces: Vec::new(),
    };
    for quad in quads {
        mesh.add_polygon(&quad).unwrap();
    }
    mesh
}

/// Reads bytes as the file of a name.
pub(in crate::mesh) fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh> {
    let bytes = std::io::Cursor::new(bytes.as_ref().to_vec());
    Mesh::read(Input::new(name, bytes)?)
}

/// The message of reading bytes that are no sound mesh: one line.
pub(in crate::mesh) fn message(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let error = read(name, bytes).unwrap_err();
    assert!(matches!(error, Error::Data { .. }), "{error}");
    let text = error.to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

//! Triangle meshes: Wavefront OBJ, Stanford PLY, STL, OFF, and sets of meshes with one topology.
//!
//! Lengths are in the unit of the file: none of the formats names one. All readers refuse
//! coordinates that are not finite and faces that name vertices the file does not have. Polygons
//! are cut into triangles, as a fan around their first corner. Colors, normals and texture
//! coordinates are not kept.

mod arrays;
mod check;
mod obj;
mod off;
mod ply;
mod set;
mod stl;

use super::Input;
use super::input::ContentKind;
use super::output::write_file;
use super::text::MAX_COORDINATE;
use crate::{Error, Place, Result};
use std::path::Path;

pub use check::Finding;
pub use set::MeshSet;

/// The largest size of a mesh file, decompressed, in bytes.
const LARGEST: u64 = 1 << 30;

/// The largest number of vertices, and of triangles, of a mesh.
const MOST: usize = 20_000_000;

/// A triangle mesh.
///
/// ```
/// use posing_io::mesh::Mesh;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("triangle.ply");
/// let mesh = Mesh {
///     vertices: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
///     faces: vec![[0, 1, 2]],
/// };
/// mesh.save(&path)?;
/// assert_eq!(Mesh::open(&path)?, mesh);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// The positions of the vertices, in the unit of the file.
    pub vertices: Vec<[f64; 3]>,
    /// The corners of the triangles: vertices counted from 0, anticlockwise as seen from outside.
    pub faces: Vec<[u32; 3]>,
}

/// A file format of meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// Wavefront OBJ, text.
    Obj,
    /// Stanford PLY, text or binary.
    Ply,
    /// STL, text or binary.
    Stl,
    /// OFF, text.
    Off,
}

impl MeshFormat {
    /// The format that a path's extension names: `.obj`, `.ply`, `.stl` or `.off`, in any case.
    ///
    /// # Errors
    /// [`Error::Usage`]: another extension, or none.
    pub fn of(path: impl AsRef<Path>) -> Result<MeshFormat> {
        let path = path.as_ref();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        MeshFormat::of_extension(extension).ok_or_else(|| {
            Error::usage(format!(
                "{}: unknown mesh format; use the extension .obj, .ply, .stl or .off",
                path.display()
            ))
        })
    }

    /// The extension of its files.
    pub fn extension(self) -> &'static str {
        match self {
            MeshFormat::Obj => "obj",
            MeshFormat::Ply => "ply",
            MeshFormat::Stl => "stl",
            MeshFormat::Off => "off",
        }
    }

    fn of_extension(extension: &str) -> Option<MeshFormat> {
        match extension.to_ascii_lowercase().as_str() {
            "obj" => Some(MeshFormat::Obj),
            "ply" => Some(MeshFormat::Ply),
            "stl" => Some(MeshFormat::Stl),
            "off" => Some(MeshFormat::Off),
            _ => None,
        }
    }

    /// The format that a name ends in, before `.gz` or `.zst`.
    fn of_input(name: &str) -> Option<MeshFormat> {
        let mut parts = name.rsplit('.');
        let last = parts.next()?;
        match last.to_ascii_lowercase().as_str() {
            "gz" | "zst" => MeshFormat::of_extension(parts.next()?),
            _ => MeshFormat::of_extension(last),
        }
    }
}

impl Mesh {
    /// Opens a mesh file; gzip and zstd are decompressed.
    ///
    /// A file that begins with `ply` is PLY. Other files are what their extension says. A file of
    /// another extension, or of none, is STL where it has the form of one, otherwise OBJ.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: no sound mesh, or one larger than 1
    /// GiB or 20 million
    /// triangles; the place has the line of a text file.
    pub fn open(path: impl AsRef<Path>) -> Result<Mesh> {
        Mesh::read(Input::open(path)?)
    }

    /// Reads a mesh from an open input, whose name may have an extension.
    ///
    /// # Errors
    /// Those of [`Mesh::open`].
    pub fn read(input: Input) -> Result<Mesh> {
        let name = input.name.clone();
        let fail = |what: &str| Err(Error::data(Place::file(&name), what));
        match input.kind() {
            ContentKind::Empty => return fail("is empty, expected a mesh"),
            ContentKind::Npy | ContentKind::Npz => {
                return fail("is a NumPy file, expected a mesh (OBJ, PLY, STL or OFF)");
            }
            ContentKind::Text => {}
        }
        let bytes = input.read_all(LARGEST)?;
        let mesh = match MeshFormat::of_input(&name) {
            _ if ply::is_ply(&bytes) => ply::read(&bytes, &name)?,
            Some(MeshFormat::Ply) => return fail("does not begin with ply, as PLY files do"),
            Some(MeshFormat::Stl) => stl::read(&bytes, &name)?,
            Some(MeshFormat::Off) => off::read(&bytes, &name)?,
            None if stl::is_stl(&bytes) => stl::read(&bytes, &name)?,
            Some(MeshFormat::Obj) | None => obj::read(&bytes, &name)?,
        };
        if mesh.vertices.is_empty() {
            return fail("has no vertices");
        }
        Ok(mesh)
    }

    /// Writes the mesh to a file, complete or not at all. The extension names the format.
    ///
    /// # Errors
    /// [`Error::Usage`]: an extension other than these of a mesh. [`Error::Io`]: the file cannot be
    /// written.
    /// [`Error::Data`]: a face names a vertex that is not there.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let format = MeshFormat::of(&path)?;
        write_file(path, &self.to_bytes(format)?)
    }

    /// The bytes of a file: OBJ with six digits after the point, or binary PLY or STL in single
    /// precision. Equal meshes give equal bytes.
    ///
    /// # Errors
    /// [`Error::Data`]: a face names a vertex that is not there.
    pub fn to_bytes(&self, format: MeshFormat) -> Result<Vec<u8>> {
        if let Some(finding) = check::missing_vertex(self) {
            let place = Place::file("the mesh");
            return Err(Error::data(place, finding.to_string()));
        }
        Ok(match format {
            MeshFormat::Obj => obj::write(self),
            MeshFormat::Ply => ply::write(self),
            MeshFormat::Stl => stl::write(self),
            MeshFormat::Off => off::write(self),
        })
    }

    /// Adds a vertex that a file holds.
    fn add_vertex(&mut self, at: [f64; 3]) -> Result<()> {
        if let Some(v) = at.iter().find(|v| !(v.abs() <= MAX_COORDINATE)) {
            return Err(
                format!("expected coordinates within {MAX_COORDINATE:e}, found {v}").into(),
            );
        }
        if self.vertices.len() == MOST {
            return Err(format!("the mesh has more than {MOST} vertices").into());
        }
        self.vertices.push(at);
        Ok(())
    }

    /// Adds a polygon, as triangles around its first corner.
    fn add_polygon(&mut self, corners: &[u32]) -> Result<()> {
        let [first, rest @ ..] = corners else {
            return Err("the face has no corners".into());
        };
        if rest.len() < 2 {
            let n = corners.len();
            return Err(format!("the face has {n} corners, expected three or more").into());
        }
        if self.faces.len() + rest.len() - 1 > MOST {
            return Err(format!("the mesh has more than {MOST} triangles").into());
        }
        self.faces
            .extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        Ok(())
    }
}

#[cfg(test)]
mod tests;

//! Sets of meshes with one topology.

use super::super::Input;
use super::super::input::ContentKind;
use super::arrays;
use super::{Mesh, MeshFormat};
use crate::{Error, Place, Result};
use ndarray::{Array3, s};
use std::path::{Path, PathBuf};

/// Meshes of one topology: the same number of vertices and the same faces.
///
/// ```
/// use posing_io::MeshSet;
///
/// let set = MeshSet::open(&["../../testdata/bodies/poses.npz"])?; // one person in 16 poses
/// assert_eq!(set.vertices.dim(), (16, 1400, 3));
/// assert_eq!(set.mesh(0).faces, set.faces);
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSet {
    /// Where each mesh was read: a path, or `bodies.npz[3]` for a mesh of an archive, counted from
    /// 0.
    pub names: Vec<String>,
    /// The vertices, meshes x vertices x 3, in the unit of the files, in single precision.
    pub vertices: Array3<f32>,
    /// The corners of the triangles, as in [`Mesh::faces`].
    pub faces: Vec<[u32; 3]>,
}

impl MeshSet {
    /// Opens meshes in the order of the paths. A path is a mesh file; a folder, of which all mesh
    /// files (`.obj`, `.ply`, `.stl`, `.off`, also with `.gz` or `.zst`) are read in the order of
    /// their names; or an `.npz` archive.
    ///
    /// An archive has the arrays `vertices`, (meshes, vertices, 3) or (vertices, 3) of float32 or
    /// float64, and `faces`, (faces, 3) of a whole type, vertices counted from 0. A mesh that
    /// is NaN throughout, a frame in which nothing is known, is left out.
    ///
    /// # Errors
    /// [`Error::Usage`]: no paths. [`Error::Io`]: a file or folder cannot be read. [`Error::Data`]:
    /// no sound mesh or
    /// archive, a folder without mesh files, or two files of different topology, both of which the
    /// message names.
    pub fn open<P: AsRef<Path>>(paths: &[P]) -> Result<MeshSet> {
        let mut builder = Builder::default();
        for path in paths {
            let path = path.as_ref();
            if path.is_dir() {
                for file in mesh_files(path)? {
                    builder.open(&file)?;
                }
            } else {
                builder.open(path)?;
            }
        }
        builder.finish()
    }

    /// Opens the meshes of an `.npz` archive whose vertices may be in an array of another name: the
    /// first of `names` that the archive has. Returns the set and the position of that name in
    /// `names`.
    ///
    /// # Errors
    /// Those of [`MeshSet::open`]; the archive has none of the arrays; the file is no archive.
    pub fn open_array(path: impl AsRef<Path>, names: &[&str]) -> Result<(MeshSet, usize)> {
        let mut builder = Builder::default();
        let input = Input::open(path)?;
        if input.kind() != ContentKind::Npz {
            return Err(Error::data(Place::file(input.name), "is no NPZ archive"));
        }
        let chosen = builder.read_archive(input, names)?;
        Ok((builder.finish()?, chosen))
    }

    /// A mesh of the set, counted from 0.
    ///
    /// # Panics
    /// The set has no such mesh.
    pub fn mesh(&self, index: usize) -> Mesh {
        let rows = self.vertices.slice(s![index, .., ..]);
        let vertex = |row: ndarray::ArrayView1<'_, f32>| [row[0], row[1], row[2]].map(f64::from);
        Mesh {
            vertices: rows.outer_iter().map(vertex).collect(),
            faces: self.faces.clone(),
        }
    }
}

/// The mesh files of a folder, in the order of their names.
fn mesh_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let fail = |e| Error::io(folder, e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned());
        let name = name.filter(|n| !n.starts_with('.'));
        if name.is_some_and(|n| MeshFormat::of_input(&n).is_some()) && path.is_file() {
            files.push(path);
        }
    }
    if files.is_empty() {
        let place = Place::file(folder.display().to_string());
        return Err(Error::data(
            place,
            "has no mesh files (.obj, .ply, .stl, .off); give files of motion by their names",
        ));
    }
    files.sort();
    Ok(files)
}

#[derive(Default)]
struct Builder {
    names: Vec<String>,
    xyz: Vec<f32>,
    first: Option<Topology>,
}

/// What all meshes share, and the file it comes from.
struct Topology {
    file: String,
    vertices: usize,
    faces: Vec<[u32; 3]>,
}

impl Builder {
    fn open(&mut self, path: &Path) -> Result<()> {
        let input = Input::open(path)?;
        let file = input.name.clone();
        if input.kind() == ContentKind::Npz {
            self.read_archive(input, &["vertices"])?;
        } else {
            let mesh = Mesh::read(input)?;
            self.check(&file, mesh.vertices.len(), mesh.faces)?;
            self.names.push(file);
            let values = mesh.vertices.iter().flatten();
            self.xyz.extend(values.map(|v| *v as f32));
        }
        Ok(())
    }

    /// Adds the meshes of an archive; returns which of the arrays `names` they are.
    fn read_archive(&mut self, input: Input, names: &[&str]) -> Result<usize> {
        let file = input.name.clone();
        let read = arrays::read(input, names)?;
        self.check(&file, read.count, read.faces)?;
        let meshes = read.xyz.chunks_exact(3 * read.count).enumerate();
        for (i, mesh) in meshes.filter(|(_, mesh)| !arrays::is_absent(mesh)) {
            self.names.push(format!("{file}[{i}]"));
            self.xyz.extend_from_slice(mesh);
        }
        if self.names.is_empty() {
            return Err(Error::data(Place::file(file), "has no meshes"));
        }
        Ok(read.chosen)
    }

    /// Compares the topology of a file with that of the first file.
    fn check(&mut self, file: &str, vertices: usize, faces: Vec<[u32; 3]>) -> Result<()> {
        let Some(first) = &self.first else {
            let file = file.to_string();
            self.first = Some(Topology {
                file,
                vertices,
                faces,
            });
            return Ok(());
        };
        let other = &first.file;
        let what = if vertices != first.vertices {
            format!("has {vertices} vertices, {other} has {}", first.vertices)
        } else if faces.len() != first.faces.len() {
            let expected = first.faces.len();
            format!("has {} faces, {other} has {expected}", faces.len())
        } else if let Some(i) = (0..faces.len()).find(|&i| faces[i] != first.faces[i]) {
            let (found, expected) = (faces[i], first.faces[i]);
            format!("face {i} is {found:?}, in {other} {expected:?} (counted from 0)")
        } else {
            return Ok(());
        };
        let what = format!("{what}; all meshes need the same vertices and faces");
        Err(Error::data(Place::file(file), what))
    }

    fn finish(self) -> Result<MeshSet> {
        let Some(first) = self.first else {
            return Err(Error::usage("expected mesh files, a folder or an NPZ file"));
        };
        let shape = (self.names.len(), first.vertices, 3);
        let vertices = Array3::from_shape_vec(shape, self.xyz);
        Ok(MeshSet {
            names: self.names,
            vertices: vertices.map_err(|e| Error::data(Place::file(first.file), e.to_string()))?,
            faces: first.faces,
        })
    }
}

#[cfg(test)]
mod tests;

//! Writing meshes as commands do: one file, an archive, or a folder of files.

use super::mesh::{Mesh, MeshFormat};
use super::npz::{NpzArray, NpzValues, npz_bytes};
use super::output::write_file;
use crate::pose::units::Units;
use crate::{Error, Result};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Where meshes go, by the name of the output.
#[derive(Debug, Clone, PartialEq)]
pub enum MeshOutput {
    /// One mesh in a file.
    File(PathBuf),
    /// All meshes in an `.npz` archive.
    Archive(PathBuf),
    /// A file per mesh in a folder.
    Folder(PathBuf, MeshFormat),
}

impl MeshOutput {
    /// The output of a name: a folder if it ends in `/` or is one, else by the extension.
    ///
    /// # Errors
    /// [`Error::Usage`]: the extension is of no format of meshes.
    pub fn of(path: &Path, format: &str) -> Result<MeshOutput> {
        let format = MeshFormat::of(Path::new("x").with_extension(format))?;
        let ends_in_slash = path.as_os_str().as_encoded_bytes().last() == Some(&b'/');
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        if ends_in_slash || path.is_dir() {
            return Ok(MeshOutput::Folder(path.to_path_buf(), format));
        }
        if extension.eq_ignore_ascii_case("npz") {
            return Ok(MeshOutput::Archive(path.to_path_buf()));
        }
        match MeshFormat::of(path) {
            Ok(_) => Ok(MeshOutput::File(path.to_path_buf())),
            Err(_) => Err(Error::usage(format!(
                "{}: expected a name that ends in .obj, .ply, .stl, .npz, or in / for a folder",
                path.display()
            ))),
        }
    }

    /// Writes meshes of `faces`, vertices in centimeters, in the unit and axis `units`.
    ///
    /// # Errors
    /// [`Error::Usage`]: several meshes for one file. [`Error::Io`]: a file cannot be written.
    pub fn write(&self, meshes: &[Vec<DVec3>], faces: &[[usize; 3]], units: Units) -> Result<()> {
        match self {
            MeshOutput::Archive(path) => {
                let turned: Vec<_> = faces.iter().map(|f| units.up.triangle(*f)).collect();
                let bytes =
                    npz_bytes(&[vertex_array("vertices", meshes, units), face_array(&turned)])?;
                write_file(path, &bytes)
            }
            MeshOutput::File(path) => match meshes {
                [one] => mesh(one, faces, units).save(path),
                many => Err(Error::usage(format!(
                    "{}: {} meshes do not go into one file; name a folder (ending in /) or an .npz",
                    path.display(),
                    many.len()
                ))),
            },
            MeshOutput::Folder(..) => {
                self.prepare()?;
                self.write_files(0, meshes.len().max(10_000), meshes, faces, units)
            }
        }
    }

    /// Makes the folder, if it is one.
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be made. [`Error::Usage`]: it holds meshes already, which would be
    /// mixed with the new ones.
    #[doc(hidden)]
    pub fn prepare(&self) -> Result<()> {
        let MeshOutput::Folder(path, _) = self else {
            return Ok(());
        };
        std::fs::create_dir_all(path).map_err(|e| Error::io(path, e))?;
        let files = std::fs::read_dir(path).map_err(|e| Error::io(path, e))?;
        let is_mesh = |e: &std::fs::DirEntry| MeshFormat::of(e.path()).is_ok();
        if files.flatten().any(|e| is_mesh(&e)) {
            Err(Error::usage(format!(
                "{}: holds meshes already, and old and new ones would be mixed; name another \
             folder, or empty it",
                path.display()
            )))
        } else {
            Ok(())
        }
    }

    /// Writes meshes of a folder, the first of them number `first` of fewer than `most`; a frame
    /// without a mesh has no file.
    ///
    /// # Errors
    /// [`Error::Io`]: a file cannot be written.
    #[doc(hidden)]
    pub fn write_files(
        &self,
        first: usize,
        most: usize,
        meshes: &[Vec<DVec3>],
        faces: &[[usize; 3]],
        units: Units,
    ) -> Result<()> {
        let MeshOutput::Folder(path, format) = self else {
            return Ok(());
        };
        let digits = most.saturating_sub(1).to_string().len();
        let there = meshes.iter().enumerate().filter(|(_, m)| !m.is_empty());
        for (k, vertices) in there {
            let name = format!("{:0digits$}.{}", first + k, format.extension());
            mesh(vertices, faces, units).save(path.join(name))?;
        }
        Ok(())
    }
}

/// A mesh in the unit and axis `units`, of vertices in centimeters.
pub fn mesh(vertices: &[DVec3], faces: &[[usize; 3]], units: Units) -> Mesh {
    let vertex = |v: &DVec3| {
        let mut xyz = v.to_array();
        units.write(&mut xyz);
        xyz
    };
    Mesh {
        vertices: vertices.iter().map(vertex).collect(),
        faces: (faces.iter())
            .map(|f| units.up.triangle(f.map(|v| v as u32)))
            .collect(),
    }
}

/// Vertices (n, V, 3) as an array of an archive; a mesh that is not there (empty) is NaN.
pub fn vertex_array(name: &str, meshes: &[Vec<DVec3>], units: Units) -> NpzArray {
    let count = meshes.iter().map(Vec::len).max().unwrap_or(0);
    let mut values = Vec::with_capacity(3 * count * meshes.len());
    for mesh in meshes {
        for k in 0..count {
            let mut xyz = mesh.get(k).map_or([f64::NAN; 3], |v| v.to_array());
            units.write(&mut xyz);
            values.extend(xyz.map(|v| v as f32));
        }
    }
    NpzArray {
        name: name.into(),
        shape: vec![meshes.len(), count, 3],
        values: NpzValues::Floats(values),
    }
}

/// Faces (F, 3) as an array of an archive.
pub fn face_array(faces: &[[usize; 3]]) -> NpzArray {
    NpzArray {
        name: "faces".into(),
        shape: vec![faces.len(), 3],
        values: NpzValues::Whole(faces.iter().flatten().map(|v| *v as i32).collect()),
    }
}

//! Files of meshes as sequences: which files are meshes, and reading them.

use super::mesh_scene::MeshFigure;
use crate::io::input::ContentKind;
use crate::io::keypoint_files::is_frame_folder;
use crate::io::{Input, MeshFormat, MeshSet};
use crate::pose::units::Units;
use crate::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// The arrays of an archive that are drawn without `--array`: that of meshes, and the meshes that
/// `body-fit` writes.
const ARRAYS: [&str; 2] = ["vertices", "completed"];
/// The arrays of `body-fit`, which are in centimeters.
const IN_CM: [&str; 2] = ["completed", "predicted"];

/// Whether the files are meshes: a folder, a name that ends in `.obj`, `.ply`, `.stl` or `.off`, an
/// NPZ archive or the beginning of a PLY file. Standard input is a table.
///
/// ```
/// use posing_draw::mesh_sequences::are_meshes;
///
/// let files = |names: &[&str]| names.iter().map(Into::into).collect::<Vec<_>>();
/// assert!(are_meshes(&files(&["body.obj", "scan.ply"]))?);
/// assert!(!are_meshes(&files(&["-"]))?);
/// assert!(are_meshes(&files(&["body.obj", "-"])).is_err());
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// Usage: some are and some are not. Io: a file of another name cannot be read.
pub fn are_meshes(files: &[PathBuf]) -> Result<bool> {
    let mut kinds = Vec::new();
    for file in files {
        kinds.push(is_mesh(file)?);
    }
    let (mesh, table) = (
        kinds.iter().position(|k| *k),
        kinds.iter().position(|k| !*k),
    );
    if let (Some(mesh), Some(table)) = (mesh, table) {
        let (mesh, table) = (files[mesh].display(), files[table].display());
        let what = format!("{mesh} is a mesh and {table} a table; they cannot be drawn together");
        return Err(Error::usage(what));
    }
    Ok(mesh.is_some())
}

fn is_mesh(path: &Path) -> Result<bool> {
    if path == Path::new("-") {
        return Ok(false);
    }
    if path.is_dir() {
        return Ok(!is_frame_folder(path));
    }
    if is_mesh_file(path) {
        return Ok(true);
    }
    let input = Input::open(path)?;
    let first = input.first_bytes();
    let is_ply = first.starts_with(b"ply\n") || first.starts_with(b"ply\r");
    Ok(is_ply || input.kind() == ContentKind::Npz)
}

/// Whether the name is that of a mesh file, perhaps compressed.
fn is_mesh_file(path: &Path) -> bool {
    let is_packed = path.extension().is_some_and(|e| e == "gz" || e == "zst");
    let name = if is_packed {
        path.with_extension("")
    } else {
        path.to_path_buf()
    };
    MeshFormat::of(name).is_ok()
}

/// A sequence: a folder, an archive, or all single files.
pub struct Sequence {
    /// The caption.
    pub name: String,
    /// One set, or one of each file.
    pub sets: Vec<MeshSet>,
    /// Names of the meshes; empty for an archive.
    pub labels: Vec<String>,
    /// Whether the file itself has a unit: it is of `body-fit`.
    pub in_cm: bool,
}

/// What is read.
pub struct MeshFiles<'a> {
    /// Folders, archives and mesh files: each folder and archive is a sequence, all other files
    /// together are one.
    pub files: &'a [PathBuf],
    /// The arrays of archives to read, each as a sequence; empty: the usual one.
    pub arrays: &'a [String],
    /// Unit and axis of the files; meshes are turned y up. The unit is centimeters where it is not
    /// known.
    pub units: Units,
    /// Whether single files must have one topology; otherwise each is a set of its own.
    pub one_topology: bool,
}

impl MeshFiles<'_> {
    /// Reads the files.
    ///
    /// # Errors
    /// Those of [`MeshSet::open`]; data: a mesh has no faces.
    pub fn read(&self) -> Result<Vec<Sequence>> {
        let (mut sequences, mut single): (Vec<Sequence>, Vec<PathBuf>) = Default::default();
        for file in self.files {
            if file.is_dir() {
                let set = MeshSet::open(std::slice::from_ref(file))?;
                sequences.push(Sequence {
                    name: name_of(file),
                    labels: labels(&set.names),
                    sets: vec![set],
                    in_cm: false,
                });
            } else if !is_mesh_file(file) && Input::open(file)?.kind() == ContentKind::Npz {
                sequences.extend(self.read_archive(file)?);
            } else {
                single.push(file.clone());
            }
        }
        if let (Some(first), Some(last)) = (single.first(), single.last()) {
            let sets = if self.one_topology {
                vec![MeshSet::open(&single)?]
            } else {
                single.chunks(1).map(MeshSet::open).collect::<Result<_>>()?
            };
            let (first, last) = (name_of(first), name_of(last));
            sequences.push(Sequence {
                name: if single.len() == 1 {
                    first
                } else {
                    format!("{first} … {last}")
                },
                sets,
                labels: single.iter().map(|f| name_of(f)).collect(),
                in_cm: false,
            });
        }
        for set in sequences.iter_mut().flat_map(|s| &mut s.sets) {
            // Here the file can still be named.
            if let (Some(file), true) = (set.names.first(), set.faces.is_empty()) {
                return Err(Error::data(Place::file(file), "has no faces to draw"));
            }
            self.to_centimeters(set);
        }
        Ok(sequences)
    }

    /// The meshes of an archive: a sequence of each array.
    fn read_archive(&self, file: &Path) -> Result<Vec<Sequence>> {
        let read = |names: &[&str], name: String| {
            let (set, chosen) = MeshSet::open_array(file, names)?;
            Ok(Sequence {
                name,
                sets: vec![set],
                labels: Vec::new(),
                in_cm: IN_CM.contains(&names[chosen]),
            })
        };
        let name = name_of(file);
        match self.arrays {
            [] => Ok(vec![read(&ARRAYS, name)?]),
            [one] => Ok(vec![read(&[one], name)?]),
            several => several
                .iter()
                .map(|array| read(&[array], format!("{name} {array}")))
                .collect(),
        }
    }

    /// Turns meshes y up, and those of a known unit into centimeters (the flag's default is
    /// centimeters).
    fn to_centimeters(&self, set: &mut MeshSet) {
        let Some(values) = set.vertices.as_slice_mut() else {
            return;
        };
        for vertex in values.as_chunks_mut::<3>().0 {
            let mut at = vertex.map(f64::from);
            self.units.read(&mut at);
            *vertex = at.map(|v| v as f32);
        }
    }
}

impl Sequence {
    /// The sets as figures of a scene.
    pub fn figures(&self) -> impl Iterator<Item = MeshFigure<'_>> {
        let whole = self.sets.len() == 1;
        self.sets.iter().map(move |set| MeshFigure {
            // Messages about one of several files name that file.
            name: if whole { &self.name } else { &set.names[0] },
            vertices: set.vertices.view(),
            faces: &set.faces,
            labels: if whole { &self.labels } else { &[] },
        })
    }
}

fn labels(names: &[String]) -> Vec<String> {
    names.iter().map(|n| name_of(Path::new(n))).collect()
}

/// What a figure is called: the file's name without folder and endings.
pub fn name_of(path: &Path) -> String {
    if path == Path::new("-") {
        return "standard input".into();
    }
    let mut name = path.file_name().unwrap_or_default().to_string_lossy();
    for ending in [
        ".gz", ".zst", ".csv", ".npy", ".bvh", ".npz", ".obj", ".ply", ".stl", ".off",
    ] {
        if let Some(stem) = name.strip_suffix(ending).filter(|stem| !stem.is_empty()) {
            name = stem.to_string().into();
        }
    }
    name.into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_are_known_by_name_or_content() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            path
        };
        let meshes = [
            file("a.OBJ", b""),
            file("b.stl.gz", b""),
            file("c", b"ply\nformat ascii 1.0\n"),
            file("d", b"PK\x03\x04"),
            folder.path().to_path_buf(),
        ];
        assert!(are_meshes(&meshes).unwrap());
        let tables = [file("e.csv", b"a.x,a.y,a.z\n"), PathBuf::from("-")];
        assert!(!are_meshes(&tables).unwrap());
        let both = are_meshes(&[meshes[0].clone(), tables[0].clone()]).unwrap_err();
        assert!(both.to_string().contains("e.csv a table"), "{both}");
        assert!(are_meshes(&[folder.path().join("none.csv")]).is_err());
    }

    #[test]
    fn figures_are_named_after_files() {
        for (path, name) in [
            ("a/walk.csv", "walk"),
            ("walk.csv.gz", "walk"),
            ("x.npy", "x"),
            (".csv", ".csv"),
            ("-", "standard input"),
        ] {
            assert_eq!(name_of(Path::new(path)), name);
        }
    }
}

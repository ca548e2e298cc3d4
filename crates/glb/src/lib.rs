#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Binary glTF 2.0 (`.glb`): a mesh with its skeleton, morph targets and animations, for animation
//! software and viewers.
//!
//! Written after the Khronos glTF 2.0 specification (ISO/IEC 12113). Lengths are meters, y points
//! up, and a body faces +z. Equal meshes give equal bytes. Only what is written here is supported:
//! nothing is read.
//!
//! A vertex x of bone b moves to R_b (x - q_b) + p_b, with q_b the bone's position in the rest
//! pose, p_b its position in the animation and R_b its rotation in the world since the rest pose.
//! With A_b the bone's axes in the rest pose, its node stands at p_b and is turned by R_b A_b;
//! `Animation::from_world` turns these into the rotations and translations relative to the parent
//! that the file holds.

mod animation;
mod buffer;
mod check;
mod document;
mod mannequin;
mod normals;
mod rest_axes;
mod skeleton;
mod tube;
mod unit_weights;

use posing_core::{Error, Place, Result, pose};
use posing_io::bvh;
use posing_io::output::write_file;
use std::path::Path;

pub use animation::Animation;

/// A triangle mesh that bones and morph targets move.
///
/// ```
/// use posing_glb::{Animation, Bone, SkinnedMesh};
///
/// let mesh = SkinnedMesh {
///     name: "flag".into(),
///     vertices: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
///     faces: vec![[0, 1, 2]],
///     bones: vec![Bone { name: "pole".into(), ..Bone::default() }],
///     weights: vec![[(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]; 3],
///     animations: vec![Animation {
///         name: "wave".into(),
///         times: vec![0.0, 1.0],
///         rotations: vec![vec![[0.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0]]],
///         ..Animation::default()
///     }],
///     ..SkinnedMesh::default()
/// };
/// assert!(mesh.to_glb()?.starts_with(b"glTF"));
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SkinnedMesh {
    /// The name that animation software shows.
    pub name: String,
    /// The positions of the vertices (V) in the rest pose, meters.
    pub vertices: Vec<[f32; 3]>,
    /// The corners of the triangles: vertices counted from 0, anticlockwise as seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// The skeleton (B), in any order; empty for a mesh without one.
    pub bones: Vec<Bone>,
    /// The bones that each vertex follows (V), with weights of at least 0. Weights are scaled to
    /// sum 1. Empty without bones.
    pub weights: Vec<[(u16, f32); 4]>,
    /// Morph targets (K).
    pub shapes: Vec<Shape>,
    /// Animations of the bones and the morph targets.
    pub animations: Vec<Animation>,
}

/// A bone of the skeleton.
#[derive(Debug, Clone, PartialEq)]
pub struct Bone {
    /// The name that animation software shows.
    pub name: String,
    /// The bone that this bone hangs on, counted from 0.
    pub parent: Option<usize>,
    /// The position of its joint in the rest pose, meters.
    pub at: [f32; 3],
    /// The rotation of its axes in the rest pose, from the world's, as a quaternion x, y, z, w.
    pub rotation: [f32; 4],
}

/// A bone at the origin with the axes of the world.
impl Default for Bone {
    fn default() -> Bone {
        Bone {
            name: String::new(),
            parent: None,
            at: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
        }
    }
}

/// A morph target: weight times offset is added to each vertex, before the bones move it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Shape {
    /// The name that animation software shows.
    pub name: String,
    /// The offset of each vertex (V), meters.
    pub offsets: Vec<[f32; 3]>,
}

impl SkinnedMesh {
    /// The bytes of a GLB file. Normals are the mean of the triangles' at each vertex, by area; the
    /// material is a plain skin tone.
    ///
    /// # Errors
    /// [`Error::Data`]: sizes that do not fit, indices of what is not there,
    /// numbers that are not finite, bones in a circle, times that do not rise, or more than 4
    /// GiB.
    pub fn to_glb(&self) -> Result<Vec<u8>> {
        check::check(self)?;
        document::write(self)
    }

    /// Writes a GLB file, complete or not at all.
    ///
    /// # Errors
    /// Those of [`SkinnedMesh::to_glb`], and [`Error::Io`]: the file cannot be
    /// written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_file(path, &self.to_glb()?)
    }
}

#[cfg(test)]
mod tests;

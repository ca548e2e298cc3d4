//! Linear blend skinning with corrective shapes, fitted to sample meshes: the form of a body that
//! animation software plays.
//!
//! Vertex v of a mesh, from its position x_v in the template, is
//!
//! ```text
//! y_v = Σ_b w_vb (R_b (x_v + Σ_k c_k s_vk) + t_b)
//! ```
//!
//! | symbol | meaning | shape | unit |
//! |---|---|---|---|
//! | w | weights of the bones, at least 0, sum 1, at most four above 0 per vertex | (V, B) | none |
//! | R, t | rotation and translation of each bone, a rigid part | (B, 3, 3), (B, 3) | none, cm |
//! | s | corrective shapes: offsets in the rest pose | (K, V, 3) | cm |
//! | c | their weights, of mean square 1 over the samples | (K) | none |
//!
//! The rotations of the samples are known. Translations and weights are fitted in turn, each by
//! least squares (B. H. Le, Z. Deng: Smooth Skinning Decomposition with Rigid Bones. SIGGRAPH Asia
//! 2012, without its step for rotations). Corrective shapes are the principal components of what
//! remains, carried back into the rest pose (P. G. Kry, D. L. James, D. K. Pai: EigenSkin. SCA
//! 2002).
//!
//! In a [`Frame`] the translations are free: a bone may leave its joint by some millimeters, as
//! real joints and soft tissue do. Where only rotations are known, [`JointSkinning`] takes the
//! translations from joints by forward kinematics.
//!
//! Cost of a fit: O(N V (B + K)) a round for N samples; half a second for 30 meshes of 13,000
//! vertices on two cores. A fit needs at least as many samples as corrective shapes. Opposite
//! rotations of neighboring bones collapse the skin, as in any blend of matrices.

mod frames;
mod joints;
mod shapes;
mod translations;
mod tree;
mod weights;

use super::template::Template;
use crate::Result;
use glam::{DMat3, DVec3};
use translations::Solver;
use tree::Tree;

pub use joints::JointSkinning;
pub(crate) use weights::BoneWeights;

/// Rounds of translations and weights; three reach the figures that thirty do.
const ROUNDS: usize = 5;

/// A mesh of the template's topology to fit to.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// The absolute rotation of each part (B).
    pub rotations: &'a [DMat3],
    /// The vertices (V), centimeters.
    pub vertices: &'a [DVec3],
}

/// A skin fitted to samples.
#[derive(Debug, Clone)]
pub struct Skinning {
    /// The template's vertices (V), centimeters.
    pub vertices: Vec<DVec3>,
    /// The bone that each bone hangs on; one bone has none.
    pub parents: Vec<Option<usize>>,
    /// The position about which each bone turns in the rest pose, centimeters: the joint with its
    /// parent; of the root, the middle of its part.
    pub places: Vec<DVec3>,
    /// The bones that each vertex follows (V).
    pub weights: Vec<BoneWeights>,
    /// Corrective shapes (K, V), centimeters, the largest first.
    pub shapes: Vec<Vec<DVec3>>,
    solver: Solver,
}

/// A skin's fit to one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The absolute rotation of each bone (B).
    pub rotations: Vec<DMat3>,
    /// The translation of each bone (B), centimeters: a point x of the rest pose moves to R x + t.
    pub translations: Vec<DVec3>,
    /// The weight of each corrective shape (K).
    pub weights: Vec<f64>,
    /// The mean distance of the vertices from the mesh, millimeters.
    pub error_mm: f64,
}

impl Skinning {
    /// Fits a skin with `shapes` corrective shapes to samples.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: too few samples, sizes that differ from the template's, or numbers
    /// that are not finite.
    pub fn fit(template: &Template, samples: &[Sample<'_>], shapes: usize) -> Result<Skinning> {
        check(template, samples)?;
        if shapes > samples.len() {
            let n = samples.len();
            return Err(
                format!("{shapes} corrective shapes need as many samples, {n} are given").into(),
            );
        }
        let tree = Tree::of(template);
        let mut skinning = Skinning {
            vertices: template.vertices.clone(),
            parents: tree.parents(),
            places: Vec::new(),
            weights: weights::rigid(template),
            shapes: Vec::new(),
            solver: Solver::new(&weights::rigid(template), tree.len())?,
        };
        for _ in 0..ROUNDS {
            let motions: Result<Vec<_>> = (samples.iter())
                .map(|s| Ok(skinning.frame(s)?.motions()))
                .collect();
            skinning.weights = weights::fit(template, &tree, samples, &motions?);
            skinning.solver = Solver::new(&skinning.weights, tree.len())?;
        }
        let joints = joints::fit_joints(template, &tree, samples, &skinning.weights)?;
        skinning.places = tree.positions(template, &joints);
        skinning.shapes = shapes::fit(&skinning, samples, shapes)?;
        Ok(skinning)
    }
}

fn check(template: &Template, samples: &[Sample<'_>]) -> Result<()> {
    if samples.is_empty() {
        return Err("a skin is fitted to one sample or more; none is given".into());
    }
    let (vertices, parts) = (template.vertices.len(), template.parts());
    samples
        .iter()
        .try_for_each(|s| check_sizes(vertices, parts, s))
}

fn check_sizes(vertices: usize, bones: usize, sample: &Sample<'_>) -> Result<()> {
    let found = (sample.vertices.len(), sample.rotations.len());
    if found == (vertices, bones) {
        return Ok(());
    }
    Err(format!(
        "expected {vertices} vertices and {bones} rotations, found {} and {}",
        found.0, found.1
    )
    .into())
}

#[cfg(test)]
mod tests;

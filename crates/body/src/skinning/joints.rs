//! Blend skinning with joints: rotations alone give the vertices, by forward kinematics.
//!
//! Bone c on parent p turns about the rest position q of their joint: t_c = t_p + (R_p - R_c) q. So
//! the vertices are linear in the joints,
//!
//! ```text
//! y_v = Σ_b w_vb R_b x_v + t_root + Σ_j ω_vj (R_p - R_c)_j q_j,
//!     ω_vj the weights of the bones that hang on joint j
//! ```
//!
//! and all q are fitted to the vertices of the samples at once; t_root is free in each sample.
//! Weights and joints are fitted in turn.

use super::tree::{Tree, borders};
use super::weights::{self, BoneWeights, blend, used};
use super::{ROUNDS, Sample, check};
use crate::Result;
use crate::numeric::linalg::cholesky_solve;
use crate::template::Template;
use glam::{DAffine3, DMat3, DVec3};
use ndarray::{Array1, Array2};

/// The pull of each joint to the middle of its parts' border, in shares of the mean diagonal:
/// rotations about one axis leave the joint free along it.
const PULL: f64 = 1e-3;

/// A skin posed by rotations alone.
#[derive(Debug, Clone, PartialEq)]
pub struct JointSkinning {
    /// The template's vertices (V), centimeters.
    pub vertices: Vec<DVec3>,
    /// The bones that each vertex follows (V).
    pub weights: Vec<BoneWeights>,
    /// The rest position of each of the template's joints, centimeters.
    pub joints: Vec<DVec3>,
    tree: Tree,
}

impl JointSkinning {
    /// Fits weights and joints to samples.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: too few samples, sizes that differ from the template's, or numbers
    /// that are not finite.
    pub fn fit(template: &Template, samples: &[Sample<'_>]) -> Result<JointSkinning> {
        check(template, samples)?;
        let tree = Tree::of(template);
        let mut skin = JointSkinning {
            vertices: template.vertices.clone(),
            weights: weights::rigid(template),
            joints: borders(template),
            tree,
        };
        for _ in 0..ROUNDS {
            skin.joints = fit_joints(template, &skin.tree, samples, &skin.weights)?;
            let motions: Vec<_> = samples.iter().map(|s| skin.motions_of(s)).collect();
            skin.weights = weights::fit(template, &skin.tree, samples, &motions);
        }
        Ok(skin)
    }

    /// The vertices (V) for the absolute rotation of each part, centimeters, with their mean at the
    /// origin.
    pub fn pose(&self, rotations: &[DMat3]) -> Vec<DVec3> {
        let motions = self.tree.forward(rotations, &self.joints);
        let mut found: Vec<DVec3> = (self.weights.iter().zip(&self.vertices))
            .map(|(w, x)| blend(w, &motions).transform_point3(*x))
            .collect();
        let mean = found.iter().sum::<DVec3>() / found.len() as f64;
        found.iter_mut().for_each(|y| *y -= mean);
        found
    }

    /// The motions of the bones in a sample, shifted to its mean.
    fn motions_of(&self, sample: &Sample<'_>) -> Vec<DAffine3> {
        let mut motions = self.tree.forward(sample.rotations, &self.joints);
        let misses = (self.weights.iter().zip(&self.vertices).zip(sample.vertices))
            .map(|((w, x), y)| *y - blend(w, &motions).transform_point3(*x));
        let shift = misses.sum::<DVec3>() / self.vertices.len() as f64;
        motions.iter_mut().for_each(|m| m.translation += shift);
        motions
    }
}

/// The rest positions of the joints that fit samples best under given weights.
pub(crate) fn fit_joints(
    template: &Template,
    tree: &Tree,
    samples: &[Sample<'_>],
    weights: &[BoneWeights],
) -> Result<Vec<DVec3>> {
    let start = borders(template);
    let count = start.len();
    let hanging = shares(tree, weights, count);
    let products = hanging.t().dot(&hanging);
    let mut normal = Array2::zeros((3 * count, 3 * count));
    let mut right = Array1::zeros(3 * count);
    for sample in samples {
        let turns = tree.differences(sample.rotations);
        // (J, 3): Σ_v ω_vj r_v. As ω has mean 0, the mean of r does not matter.
        let misses = hanging
            .t()
            .dot(&misses(template, tree, weights, sample, &start));
        for j in 0..count {
            let back = turns[j].transpose();
            let b = back * DVec3::new(misses[[j, 0]], misses[[j, 1]], misses[[j, 2]]);
            for k in 0..count {
                let block = back * turns[k] * products[[j, k]];
                for (c, column) in [block.x_axis, block.y_axis, block.z_axis]
                    .iter()
                    .enumerate()
                {
                    for a in 0..3 {
                        normal[[3 * j + a, 3 * k + c]] += column[a];
                    }
                }
            }
            for a in 0..3 {
                right[3 * j + a] += b[a];
            }
        }
    }
    let pull = PULL * normal.diag().mean().unwrap_or(0.0) + f64::MIN_POSITIVE;
    normal.diag_mut().mapv_inplace(|v| v + pull);
    let moved = cholesky_solve(normal, right).ok_or("the samples are not finite")?;
    let moved = moved.as_slice().unwrap_or(&[]).chunks_exact(3);
    Ok(start
        .iter()
        .zip(moved)
        .map(|(q, m)| *q + DVec3::from_slice(m))
        .collect())
}

/// ω (V, J) less its mean over the vertices.
fn shares(tree: &Tree, weights: &[BoneWeights], joints: usize) -> Array2<f64> {
    let hanging = tree.hanging();
    let mut shares = Array2::zeros((weights.len(), joints));
    for (mut row, weights) in shares.rows_mut().into_iter().zip(weights) {
        for (bone, weight) in used(weights) {
            for (share, hangs) in row.iter_mut().zip(&hanging) {
                *share += if hangs[bone] { weight } else { 0.0 };
            }
        }
    }
    if let Some(mean) = shares.mean_axis(ndarray::Axis(0)) {
        shares -= &mean;
    }
    shares
}

/// What joints at `at` leave of a sample (V, 3), of any shift.
fn misses(
    template: &Template,
    tree: &Tree,
    weights: &[BoneWeights],
    sample: &Sample<'_>,
    at: &[DVec3],
) -> Array2<f64> {
    let motions = tree.forward(sample.rotations, at);
    let mut misses = Array2::zeros((weights.len(), 3));
    let vertices = template.vertices.iter().zip(sample.vertices);
    for ((mut row, weights), (x, y)) in misses.rows_mut().into_iter().zip(weights).zip(vertices) {
        let miss = *y - blend(weights, &motions).transform_point3(*x);
        row.assign(&Array1::from_vec(miss.to_array().to_vec()));
    }
    misses
}

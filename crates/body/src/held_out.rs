//! How well a body makes meshes that it was not learned from: each is left out of the pose model,
//! or of the components of shape, once, with its neighbors. Parts and template are those of all.

use super::body_model::BodyModel;
use super::decomposition::synthesize;
use super::pose_model::{Follows, JointInputs, PoseModel};
use super::shape_model::{Metric, ShapeModel};
use super::template::Template;
use crate::Result;
use glam::{DMat3, DVec3};
use ndarray::{Array2, Axis};

/// Groups of meshes that are left out together.
const FOLDS: usize = 5;
/// People who are tried, at most: each takes a second.
const PEOPLE: usize = 5;

/// The mean distance of the vertices of two meshes whose middles are laid on each other, cm.
pub(super) fn mean_error(made: &[DVec3], mesh: &[DVec3]) -> f64 {
    let count = mesh.len() as f64;
    let middle = |mesh: &[DVec3]| mesh.iter().sum::<DVec3>() / count;
    let shift = middle(mesh) - middle(made);
    let far = made
        .iter()
        .zip(mesh)
        .map(|(a, b)| (*a + shift).distance(*b));
    far.sum::<f64>() / count
}

/// The mean error of poses that are left out; `None` for fewer than two groups of them.
pub(super) fn of_poses(
    template: &Template,
    poses: &[Vec<DVec3>],
    decomposed: &[(Vec<DMat3>, Vec<DMat3>)],
    follows: Follows,
    inputs: JointInputs,
) -> Result<Option<f64>> {
    if poses.len() < 2 * FOLDS {
        return Ok(None);
    }
    let mut sum = 0.0;
    for fold in 0..FOLDS {
        // Neighbors of a sequence go together.
        let is_out = |k: &usize| k * FOLDS / poses.len() == fold;
        let (out, kept): (Vec<usize>, Vec<usize>) = (0..poses.len()).partition(is_out);
        let kept: Vec<_> = kept.into_iter().map(|k| decomposed[k].clone()).collect();
        let model = PoseModel::learn(template, &kept, follows, inputs)?;
        for k in out {
            let rotations = &decomposed[k].0;
            let q = model.deformations(template, rotations);
            sum += mean_error(&synthesize(template, rotations, &q), &poses[k]);
        }
    }
    Ok(Some(sum / poses.len() as f64))
}

/// The mean error of people who are left out, by bodies with the pose model of `body`; `turns` are
/// the rotations of each, and the first rows of `matrices` are theirs.
pub(super) fn of_people(
    body: &BodyModel,
    people: &[Vec<DVec3>],
    turns: &[Vec<DMat3>],
    matrices: &Array2<f32>,
    (components, metric): (usize, Metric),
) -> Result<Option<f64>> {
    if people.len() < 2 * FOLDS {
        return Ok(None);
    }
    let (mut sum, mut count) = (0.0, 0);
    for fold in 0..FOLDS {
        let is_out = |k: &usize| *k < people.len() && k * FOLDS / people.len() == fold;
        let (out, kept): (Vec<usize>, Vec<usize>) = (0..matrices.nrows()).partition(is_out);
        let kept = matrices.select(Axis(0), &kept);
        let without = BodyModel {
            shape: ShapeModel::learn(&body.template, &kept, components, metric)?,
            ..body.clone()
        };
        for k in out.into_iter().take(PEOPLE / FOLDS) {
            let shape = without.shape_of(&people[k], &turns[k], components);
            sum += mean_error(&without.synthesize(&turns[k], &shape), &people[k]);
            count += 1;
        }
    }
    Ok(Some(sum / f64::from(count)))
}

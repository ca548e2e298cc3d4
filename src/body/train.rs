//! Learning a body from meshes of one topology.

use super::body_model::BodyModel;
use super::decomposition::{Decomposer, SMOOTHNESS, fit_rotations};
use super::pose_model::{Follows, PoseModel};
use super::shape_model::{Metric, ShapeModel, matrices_of_person};
use super::template::Template;
use crate::Result;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// How a body is learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The weight of smoothness of Q, in squared mean edge lengths.
    pub smoothness: f64,
    /// The joints that a triangle follows.
    pub follows: Follows,
    /// The most components of shape.
    pub components: usize,
    /// In what the components of shape are orthogonal.
    pub metric: Metric,
    /// Whether the template's own shape, that of the poses, counts as one more person.
    pub with_template: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            smoothness: SMOOTHNESS,
            follows: Follows::default(),
            components: 20,
            metric: Metric::default(),
            with_template: true,
        }
    }
}

impl Settings {
    /// The paper's: two joints of each part, components of the matrices, of the people alone.
    pub fn paper() -> Settings {
        Settings {
            follows: Follows::OfPart(2),
            metric: Metric::Matrices,
            with_template: false,
            ..Settings::default()
        }
    }
}

/// Learns a body: the template, its poses (the template's own may be among them), and people in any
/// pose. `done` is told each mesh that has been decomposed.
///
/// # Errors
/// [`crate::Error::Unfit`]: no pose, or meshes that are not finite.
pub fn train(
    template: Template,
    poses: &[Vec<DVec3>],
    people: &[Vec<DVec3>],
    settings: &Settings,
    done: &mut dyn FnMut(),
) -> Result<BodyModel> {
    let decomposer =
        Decomposer::new(&template, settings.smoothness).ok_or("has triangles without area")?;
    let mut decompose = |pose: &Vec<DVec3>| {
        let rotations = fit_rotations(&template, pose);
        let q = decomposer.deformations(pose, &rotations);
        done();
        (rotations, q)
    };
    let decomposed: Vec<(Vec<DMat3>, Vec<DMat3>)> = poses.iter().map(&mut decompose).collect();
    let pose = PoseModel::learn(&template, &decomposed, settings.follows)?;
    let training_rotations = decomposed.into_iter().map(|(r, _)| r).collect();
    let mut matrices: Vec<f32> = Vec::new();
    for person in people {
        let rotations = fit_rotations(&template, person);
        matrices.extend(matrices_of_person(
            &decomposer,
            &pose,
            &template,
            person,
            &rotations,
        ));
        done();
    }
    let mut shape = ShapeModel::of_template(&template);
    if !people.is_empty() {
        let mut rows = people.len();
        if settings.with_template {
            matrices.extend(&shape.mean);
            rows += 1;
        }
        let matrices = Array2::from_shape_vec((rows, 9 * template.faces.len()), matrices)
            .map_err(|e| e.to_string())?;
        shape = ShapeModel::learn(&template, &matrices, settings.components, settings.metric)?;
    }
    drop(decomposer);
    Ok(BodyModel {
        template,
        pose,
        shape,
        training_rotations,
        joint_names: Vec::new(),
    })
}

//! Learning a body from meshes of one topology.

use super::body_model::{BodyModel, HeldOutErrors};
use super::decomposition::{Decomposer, SMOOTHNESS, fit_rotations, synthesize};
use super::held_out::{mean_error, of_people, of_poses};
use super::pose_model::{Follows, JointInputs, PoseModel};
use super::shape_model::{Metric, ShapeModel, matrices_of_person};
use super::template::Template;
use crate::Result;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// Inputs of more numbers count where they leave this share of the error at most.
const WORTH: f64 = 0.95;

/// How a body is learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The weight of smoothness of Q, in squared mean edge lengths.
    pub smoothness: f64,
    /// The joints that a triangle follows.
    pub follows: Follows,
    /// What of them; `None`: what makes poses best that are left out.
    pub inputs: Option<JointInputs>,
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
            // Rotations make fits several times as slow.
            inputs: Some(JointInputs::Twist),
            components: 20,
            metric: Metric::default(),
            with_template: true,
        }
    }
}

impl Settings {
    /// Those of Anguelov et al.: two joints of each part, components of the matrices, of the people
    /// alone.
    pub fn paper() -> Settings {
        Settings {
            follows: Follows::OfPart(2),
            inputs: Some(JointInputs::Twist),
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
    let (pose, poses_left_out) = pose_model(&template, poses, &decomposed, settings)?;
    let errors = decomposed.iter().zip(poses);
    let errors = errors.map(|((r, q), mesh)| mean_error(&synthesize(&template, r, q), mesh));
    let decomposed_error = errors.sum::<f64>() / poses.len() as f64;
    let training_rotations = decomposed.into_iter().map(|(r, _)| r).collect();
    let mut matrices: Vec<f32> = Vec::new();
    let mut turns: Vec<Vec<DMat3>> = Vec::new();
    for person in people {
        let rotations = fit_rotations(&template, person);
        matrices.extend(matrices_of_person(
            &decomposer,
            &pose,
            &template,
            person,
            &rotations,
        ));
        turns.push(rotations);
        done();
    }
    let mut shape = ShapeModel::of_template(&template);
    if !people.is_empty() && settings.with_template {
        matrices.extend(&shape.mean);
    }
    let rows = matrices.len() / (9 * template.faces.len());
    let matrices = Array2::from_shape_vec((rows, 9 * template.faces.len()), matrices)
        .map_err(|e| e.to_string())?;
    if !people.is_empty() {
        shape = ShapeModel::learn(&template, &matrices, settings.components, settings.metric)?;
    }
    drop(decomposer);
    let mut body = BodyModel {
        template,
        pose,
        shape,
        training_rotations,
        joint_names: Vec::new(),
        errors: None,
    };
    let learned = (settings.components, settings.metric);
    let people_left_out = of_people(&body, people, &turns, &matrices, learned)?;
    body.errors = Some(HeldOutErrors {
        decomposed: decomposed_error,
        poses: poses_left_out,
        people: people_left_out,
    });
    Ok(body)
}

/// The pose model, and its error on poses that are left out.
fn pose_model(
    template: &Template,
    poses: &[Vec<DVec3>],
    decomposed: &[(Vec<DMat3>, Vec<DMat3>)],
    settings: &Settings,
) -> Result<(PoseModel, Option<f64>)> {
    let tried = match settings.inputs {
        Some(inputs) => vec![inputs],
        None => vec![JointInputs::Twist, JointInputs::Rotation],
    };
    let mut best = (
        tried[0],
        of_poses(template, poses, decomposed, settings.follows, tried[0])?,
    );
    for inputs in &tried[1..] {
        let own = of_poses(template, poses, decomposed, settings.follows, *inputs)?;
        // More numbers must be worth it.
        if own
            .zip(best.1)
            .is_some_and(|(own, before)| own < WORTH * before)
        {
            best = (*inputs, own);
        }
    }
    let model = PoseModel::learn(template, decomposed, settings.follows, best.0)?;
    Ok((model, best.1))
}

//! The surfaces that belong to a fit: the model's own, and the one that goes through the markers.

use super::body_model::BodyModel;
use super::fit::Fit;
use super::warp::Warp;
use glam::{DMat3, DVec3};

/// The two surfaces of a fit, centimeters.
#[derive(Debug, Clone, PartialEq)]
pub struct Completion {
    /// The vertices of the model with the fitted rotations and shape, put where the markers are.
    pub predicted: Vec<DVec3>,
    /// These, warped by a thin plate so that markers are where they were seen, but for the noise.
    pub completed: Vec<DVec3>,
}

/// Makes the surfaces; `shape` are the matrices of the fitted shape (see
/// [`super::ShapeModel::matrices`]), `noise` the standard deviation of a marker's coordinate, cm,
/// if known: else the surface is as smooth as it predicts each marker best from the others.
pub fn complete(body: &BodyModel, fit: &Fit, shape: &[DMat3], noise: Option<f64>) -> Completion {
    let vertices = body.synthesize_shaped(&fit.state.rotations, shape);
    // The marker model's positions are relative to the first vertex.
    let shift = fit.shift - vertices[0];
    let predicted: Vec<DVec3> = vertices.iter().map(|v| *v + shift).collect();
    let completed = match Warp::new(&fit.missed, noise) {
        Some(warp) => predicted.iter().map(|v| *v + warp.at(*v)).collect(),
        None => predicted.clone(),
    };
    Completion {
        predicted,
        completed,
    }
}

//! The surfaces that belong to a fit: the model's own, and the one that goes through the markers.

use super::body_model::BodyModel;
use super::fit::Fit;
use super::marker_model::MarkerModel;
use glam::{DMat3, DVec3};

/// The two surfaces of a fit, centimeters.
#[derive(Debug, Clone, PartialEq)]
pub struct Completion {
    /// The vertices of the model with the fitted rotations and shape, put where the markers are.
    pub predicted: Vec<DVec3>,
    /// These, warped towards the markers as the energy E_H + w_Z Σ |y_m - z_m|² says.
    pub completed: Vec<DVec3>,
}

/// Makes the surfaces; `shape` are the matrices of the fitted shape (see
/// [`super::ShapeModel::matrices`]).
pub fn complete(body: &BodyModel, markers: &MarkerModel, fit: &Fit, shape: &[DMat3]) -> Completion {
    let vertices = body.synthesize_shaped(&fit.state.rotations, shape);
    // The marker model's positions are relative to the first vertex.
    let shift = fit.shift - vertices[0];
    let predicted: Vec<DVec3> = vertices.iter().map(|v| *v + shift).collect();
    let warp = markers.warp(&fit.pulls);
    let completed = predicted.iter().zip(warp).map(|(v, w)| *v + w).collect();
    Completion {
        predicted,
        completed,
    }
}

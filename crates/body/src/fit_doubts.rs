//! What is doubtful about bodies that were fitted to markers.

use super::animation::MarkerFrame;
use super::body_model::BodyModel;
use super::fit::BodyState;
use glam::{DMat3, DVec3};

/// The least share of the markers that tells a body.
const LEAST_SHARE: f64 = 2.0 / 3.0;
/// A body lies if the cosine of its root's tilt is below this,
const LIES: f64 = 0.5;
/// and all lie the same way if the cosine between that and the axis is over this.
const SAME_WAY: f64 = 0.8;
/// Poses of the training that lie, of which there is at most this share where lying is unusual.
const UNUSUAL: f64 = 0.05;

/// Whether a frame lacks so many markers that the body is hardly told.
pub fn has_few_markers(frame: &MarkerFrame) -> bool {
    let seen = frame.iter().flatten().count();
    (seen as f64) < LEAST_SHARE * frame.len() as f64
}

/// The axis along which all bodies lie, from feet to head, where hardly a pose of the training
/// does: it may point up. `None`: somebody stands, they lie in different ways, or there is nobody.
pub fn lying_axis<'a>(
    body: &BodyModel,
    states: impl Iterator<Item = &'a BodyState>,
) -> Option<&'static str> {
    let root = body.template.root();
    let up = |rotations: &[DMat3]| rotations[root] * DVec3::Y;
    let trained = &body.training_rotations;
    let lying = trained.iter().filter(|r| up(r).y < LIES).count();
    let ups: Vec<DVec3> = states.map(|state| up(&state.rotations)).collect();
    if ups.is_empty() || lying as f64 > UNUSUAL * trained.len() as f64 {
        return None;
    }
    let axes = [
        ("x", DVec3::X),
        ("-x", DVec3::NEG_X),
        ("z", DVec3::Z),
        ("-z", DVec3::NEG_Z),
    ];
    let is_along = |axis: DVec3| ups.iter().all(|up| up.dot(axis) > SAME_WAY);
    let found = axes.into_iter().find(|(_, axis)| is_along(*axis));
    found.map(|(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::bending_body;

    #[test]
    fn bodies_that_all_lie_one_way_are_told() {
        let body = bending_body();
        let trained = &body.training_rotations[1];
        let state = |turn: DMat3| BodyState {
            rotations: trained.iter().map(|r| turn * *r).collect(),
            shape: Vec::new(),
        };
        let flat = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let over = DMat3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        let axis = |turns: &[DMat3]| {
            let states: Vec<BodyState> = turns.iter().map(|turn| state(*turn)).collect();
            lying_axis(&body, states.iter())
        };
        assert_eq!(axis(&[DMat3::IDENTITY]), None);
        assert_eq!(axis(&[flat, flat]), Some("z"));
        assert_eq!(axis(&[flat, over]), None);
        assert_eq!(axis(&[flat, DMat3::IDENTITY]), None);
        assert_eq!(axis(&[]), None);
    }

    #[test]
    fn a_third_of_the_markers_may_be_missing() {
        let some = Some(DVec3::ZERO);
        assert!(!has_few_markers(&vec![some, some, None]));
        assert!(has_few_markers(&vec![some, some, None, None]));
    }
}

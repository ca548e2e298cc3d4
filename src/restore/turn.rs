//! The turns of P1 by their three angles τ: R = Rz Ry Rx (see [`super::synthesis`]).

use crate::pose::rotation::{Axis, cross_matrix, decompose, parse_order};
use glam::{DMat3, DVec3};

/// R = Rz Ry Rx.
pub(super) fn turn(tau: DVec3) -> DMat3 {
    DMat3::from_rotation_z(tau.z) * DMat3::from_rotation_y(tau.y) * DMat3::from_rotation_x(tau.x)
}

/// dR/dτx = Rz Ry Rx [ex]×, dR/dτy = Rz Ry [ey]× Rx, dR/dτz = [ez]× R.
pub(super) fn turn_derivatives(tau: DVec3) -> [DMat3; 3] {
    let (x, y, z) = (
        DMat3::from_rotation_x(tau.x),
        DMat3::from_rotation_y(tau.y),
        DMat3::from_rotation_z(tau.z),
    );
    [
        z * y * x * cross_matrix(DVec3::X),
        z * y * cross_matrix(DVec3::Y) * x,
        cross_matrix(DVec3::Z) * z * y * x,
    ]
}

/// The angles τ with R(τ) R_start = R.
pub(super) fn angles_from(start: &DMat3, now: &DMat3) -> DVec3 {
    let relative = *now * start.transpose();
    let order = parse_order("zyx").unwrap_or([Axis::Z; 3]);
    let [z, y, x] = decompose(&relative, order, [0.0; 3]);
    DVec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivatives_of_the_turn_are_right() {
        let tau = DVec3::new(0.3, -0.8, 1.9);
        let h = 1e-6;
        for (k, d) in turn_derivatives(tau).into_iter().enumerate() {
            let e = DVec3::AXES[k] * h;
            let want = (turn(tau + e) - turn(tau - e)) * (0.5 / h);
            assert!(
                (0..3).all(|c| (d.col(c) - want.col(c)).length() <= 1e-8),
                "{k}"
            );
        }
        let r = turn(tau);
        assert!((angles_from(&DMat3::IDENTITY, &r) - tau).length() <= 1e-9);
    }
}

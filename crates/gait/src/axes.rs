//! Axes of segments from two directions, the joint center at a marker's side, and the angles
//! between axes.
//!
//! The axes of a segment are the columns of a rotation matrix: x forwards, y to the left, z up.

use glam::{DMat3, DVec3};

/// The direction of a vector; NaN of one without length.
pub(crate) fn unit(v: DVec3) -> DVec3 {
    v / v.length()
}

/// Axes with z along `z`, and y as near to `y` as it gets.
pub(crate) fn zy(z: DVec3, y: DVec3) -> DMat3 {
    let z = unit(z);
    let x = unit(y.cross(z));
    DMat3::from_cols(x, z.cross(x), z)
}

/// Axes with z along `z`, and x as near to `x` as it gets.
pub(crate) fn zx(z: DVec3, x: DVec3) -> DMat3 {
    let z = unit(z);
    let y = unit(z.cross(x));
    DMat3::from_cols(y.cross(z), y, z)
}

/// Axes with y along `y`, and x as near to `x` as it gets.
pub(crate) fn yx(y: DVec3, x: DVec3) -> DMat3 {
    let y = unit(y);
    let x = unit(x - x.dot(y) * y);
    DMat3::from_cols(x, y, x.cross(y))
}

/// The center of a joint: `distance` from the marker at its side, with a right angle between the
/// marker and the proximal center, in the plane of both and the wand, away from the wand. `turn`
/// (radians) turns that plane about the line from the marker to the proximal center.
pub(crate) fn chord(
    wand: DVec3,
    proximal: DVec3,
    marker: DVec3,
    distance: f64,
    turn: f64,
) -> DVec3 {
    let (along, to_wand) = (unit(proximal - marker), wand - marker);
    let mut across = unit(to_wand - to_wand.dot(along) * along);
    if turn != 0.0 {
        across = DMat3::from_axis_angle(along, turn) * across;
    }
    let cosine = distance / (proximal - marker).length();
    let sine = (1.0 - cosine * cosine).sqrt();
    marker + distance * (cosine * along - sine * across)
}

/// The rotation of `child` in `parent` as turns about y, then the new x, then the new z: the
/// angles about y, x and z, degrees.
pub(crate) fn yxz(parent: DMat3, child: DMat3) -> [f64; 3] {
    let m = parent.transpose() * child;
    let y = m.z_axis.x.atan2(m.z_axis.z);
    let x = (-m.z_axis.y).clamp(-1.0, 1.0).asin();
    let z = m.x_axis.y.atan2(m.y_axis.y);
    [y, x, z].map(f64::to_degrees)
}

/// The rotation of `child` in `parent` as turns about x, then the new y, then the new z: the
/// angles about x, y and z, degrees.
pub(crate) fn xyz(parent: DMat3, child: DMat3) -> [f64; 3] {
    let m = parent.transpose() * child;
    let x = (-m.z_axis.y).atan2(m.z_axis.z);
    let y = m.z_axis.x.clamp(-1.0, 1.0).asin();
    let z = (-m.y_axis.x).atan2(m.x_axis.x);
    [x, y, z].map(f64::to_degrees)
}

/// An angle in degrees, less whole turns: in [-180, 180).
pub(crate) fn wrapped(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_goes_out_as_it_came_in() {
        let parent = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(1.1);
        let turns: [[f64; 3]; 3] = [[0.3, -0.9, 2.8], [-2.9, 1.2, -0.4], [1.0, 0.0, 0.0]];
        for turn in turns {
            let [first, second, third] = turn;
            let back = |angles: [f64; 3]| {
                let error = (0..3).map(|i| (angles[i] - turn[i].to_degrees()).abs());
                assert!(error.fold(0.0, f64::max) < 1e-9, "{angles:?}");
            };
            let [y, z] = [DMat3::from_rotation_y, DMat3::from_rotation_z];
            let x = DMat3::from_rotation_x;
            back(yxz(parent, parent * y(first) * x(second) * z(third)));
            back(xyz(parent, parent * x(first) * y(second) * z(third)));
        }
    }

    #[test]
    fn axes_keep_their_first_direction_and_are_right_handed() {
        let (a, b) = (DVec3::new(1.0, 2.0, -0.5), DVec3::new(-0.3, 1.0, 2.0));
        let frames = [(zy(a, b), 2, 1), (zx(a, b), 2, 0), (yx(a, b), 1, 0)];
        for (axes, kept, near) in frames {
            assert!(crate::pose::rotation::is_rotation(axes, 1e-12));
            assert!((axes.col(kept) - unit(a)).length() < 1e-12 && axes.col(near).dot(b) > 0.0);
            assert!(axes.col(3 - kept - near).dot(b).abs() < 1e-12);
        }
    }

    #[test]
    fn a_center_is_at_its_distance_and_square() {
        let (wand, proximal) = (DVec3::new(40.0, 90.0, 250.0), DVec3::new(5.0, -20.0, 400.0));
        let marker = DVec3::new(10.0, 50.0, 3.0);
        for turn in [0.0, 0.3] {
            let center = chord(wand, proximal, marker, 57.0, turn);
            assert!(((center - marker).length() - 57.0).abs() < 1e-9);
            assert!((center - marker).dot(center - proximal).abs() < 1e-9);
            let plane = (wand - marker).cross(proximal - marker);
            assert!((plane.dot(center - marker).abs() < 1e-6) == (turn == 0.0));
        }
        let center = chord(wand, proximal, marker, 57.0, 0.0);
        assert!((wand - center).length() > (wand - marker).length());
        assert_eq!(
            [wrapped(190.0), wrapped(-180.0), wrapped(540.0)],
            [-170.0, -180.0, -180.0]
        );
    }
}

//! Rotations: axes, Euler angles of any order, both poles included, and the nearest rotation.
//!
//! Angles are radians. `R` is a rotation matrix that acts on columns: `y = R x`.

use glam::{DMat3, DVec3};

/// One coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// The first axis.
    X,
    /// The second axis.
    Y,
    /// The third axis.
    Z,
}

impl Axis {
    /// 0, 1 or 2.
    #[doc(hidden)]
    pub fn index(self) -> usize {
        self as usize
    }
    /// The unit vector along the axis.
    #[doc(hidden)]
    pub fn unit(self) -> DVec3 {
        DVec3::AXES[self.index()]
    }
    /// `x`, `y` or `z` in either case.
    #[doc(hidden)]
    pub fn parse(letter: char) -> Option<Axis> {
        match letter.to_ascii_lowercase() {
            'x' => Some(Axis::X),
            'y' => Some(Axis::Y),
            'z' => Some(Axis::Z),
            _ => None,
        }
    }
    /// The rotation about this axis.
    #[doc(hidden)]
    pub fn rotation(self, angle: f64) -> DMat3 {
        match self {
            Axis::X => DMat3::from_rotation_x(angle),
            Axis::Y => DMat3::from_rotation_y(angle),
            Axis::Z => DMat3::from_rotation_z(angle),
        }
    }
}

/// Three different axes read from text such as `XYZ`; `None` when it is anything else.
///
/// ```
/// use posing_core::pose::rotation::{Axis, parse_order};
///
/// assert_eq!(parse_order("ZXY"), Some([Axis::Z, Axis::X, Axis::Y]));
/// assert_eq!(parse_order("ZXZ"), None);
/// ```
pub fn parse_order(text: &str) -> Option<[Axis; 3]> {
    let axes: Option<Vec<Axis>> = text.trim().chars().map(Axis::parse).collect();
    three_axes(axes?)
}

/// The axes in their order if they are three different ones, as a ball joint has; else `None`.
#[doc(hidden)]
pub fn three_axes(axes: impl IntoIterator<Item = Axis>) -> Option<[Axis; 3]> {
    let axes: Vec<Axis> = axes.into_iter().collect();
    let axes: [Axis; 3] = axes.try_into().ok()?;
    (axes[0] != axes[1] && axes[1] != axes[2] && axes[0] != axes[2]).then_some(axes)
}

/// The rotation that turns about the first axis first: `R = R_last … R_first` (the ASF convention).
#[doc(hidden)]
pub fn compose(order: &[Axis], angles: &[f64]) -> DMat3 {
    order
        .iter()
        .zip(angles)
        .fold(DMat3::IDENTITY, |m, (axis, &a)| axis.rotation(a) * m)
}

/// The angles `(a, b, c)` with `R = R_i(a) R_j(b) R_k(c)` for `order = [i, j, k]` (the BVH
/// convention: the last named turns first), chosen near `near`.
///
/// Each rotation has two such triples, and each angle is free by whole turns: the triple with the
/// smallest largest step from `near` is taken, so that following a motion never jumps by more than
/// half a turn. At the poles (`b` a quarter turn) only `a + c` or `a - c` is determined: `c` keeps
/// its value from `near`.
#[doc(hidden)]
pub fn decompose(r: &DMat3, order: [Axis; 3], near: [f64; 3]) -> [f64; 3] {
    let [i, j, k] = order.map(Axis::index);
    // +1 for an even order (xyz, yzx, zxy), -1 for an odd one.
    let e = if (i + 1) % 3 == j { 1.0 } else { -1.0 };
    let m = |row: usize, column: usize| r.col(column)[row];
    let cos_b = m(i, i).hypot(m(i, j));
    let b = (e * m(i, k)).atan2(cos_b);
    if cos_b < 1e-9 {
        // R_j(±90°): with c fixed, a follows from the remaining entries.
        let c = near[2];
        let rest = *r * order[2].rotation(-c) * order[1].rotation(-b);
        let a = (e * rest.col(j)[k]).atan2(rest.col(j)[j]);
        return [
            nearest_equivalent_angle(a, near[0]),
            nearest_equivalent_angle(b, near[1]),
            c,
        ];
    }
    let a = (-e * m(j, k)).atan2(m(k, k));
    let c = (-e * m(i, j)).atan2(m(i, i));
    let half = std::f64::consts::PI;
    let first = [a, b, c];
    let second = [a + half, half - b, c + half];
    let to_near = |t: [f64; 3]| [0, 1, 2].map(|n| nearest_equivalent_angle(t[n], near[n]));
    let step = |t: &[f64; 3]| (0..3).map(|n| (t[n] - near[n]).abs()).fold(0.0, f64::max);
    let (first, second) = (to_near(first), to_near(second));
    if step(&second) < step(&first) - 1e-9 {
        second
    } else {
        first
    }
}

/// Whether the columns of a matrix are orthonormal and right-handed, to within `tolerance`.
pub fn is_rotation(matrix: DMat3, tolerance: f64) -> bool {
    let product = matrix.transpose() * matrix;
    product.abs_diff_eq(DMat3::IDENTITY, tolerance)
        && (matrix.determinant() - 1.0).abs() <= tolerance
}

/// `angle` plus whole turns, as close to `near` as it gets.
#[doc(hidden)]
pub fn nearest_equivalent_angle(angle: f64, near: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle + ((near - angle) / turn).round() * turn
}

/// The matrix `[v]x` with `[v]x u = v × u`.
#[doc(hidden)]
pub fn cross_matrix(v: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, v.z, -v.y),
        DVec3::new(-v.z, 0.0, v.x),
        DVec3::new(v.y, -v.x, 0.0),
    )
}

/// The rotation by the vector `v`: about its direction, by its length.
#[doc(hidden)]
pub fn from_rotation_vector(v: DVec3) -> DMat3 {
    let angle = v.length();
    if angle < 1e-12 {
        return DMat3::IDENTITY + cross_matrix(v);
    }
    DMat3::from_axis_angle(v / angle, angle)
}

/// The rotation vector of a rotation, 0 to π long, radians: the inverse of
/// [`from_rotation_vector`].
///
/// The angle is found by its sine and cosine both, the axis near π from the symmetric part: an arc
/// cosine loses half of the digits at both ends.
#[doc(hidden)]
pub fn rotation_vector(r: &DMat3) -> DVec3 {
    let skew = DVec3::new(
        r.y_axis.z - r.z_axis.y,
        r.z_axis.x - r.x_axis.z,
        r.x_axis.y - r.y_axis.x,
    ) / 2.0;
    let cosine = (r.x_axis.x + r.y_axis.y + r.z_axis.z - 1.0) / 2.0;
    let angle = skew.length().atan2(cosine);
    if cosine > -0.9 {
        let sine = skew.length();
        return skew * if sine > 1e-9 { angle / sine } else { 1.0 };
    }
    // (1 - cos) n nᵀ is the symmetric part less cos I; its longest column is the best seen.
    let outer = (*r + r.transpose()) * 0.5 - DMat3::from_diagonal(DVec3::splat(cosine));
    let columns = [outer.x_axis, outer.y_axis, outer.z_axis];
    let longest = columns
        .into_iter()
        .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    let axis = longest.unwrap_or(DVec3::X).normalize_or(DVec3::X);
    angle * if axis.dot(skew) < 0.0 { -axis } else { axis }
}

/// How the rotation vector v of a rotation changes when the rotation is turned further by a small
/// vector d in its own frame: log(exp(v) exp(d)) ≈ v + J d (the inverse of the right Jacobian).
/// Finite up to and at a length of π.
#[doc(hidden)]
pub fn rotation_vector_jacobian(v: DVec3) -> DMat3 {
    let angle = v.length();
    let square = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        1.0 / (angle * angle) - 1.0 / (2.0 * angle * (angle / 2.0).tan())
    };
    let cross = cross_matrix(v);
    DMat3::IDENTITY + cross * 0.5 + cross * cross * square
}

/// The angle between two rotations, 0 to pi.
///
/// ```
/// use glam::DMat3;
/// use posing_core::pose::rotation::angle_between;
///
/// let (a, b) = (DMat3::from_rotation_x(0.2), DMat3::from_rotation_x(0.5));
/// assert!((angle_between(&a, &b) - 0.3).abs() < 1e-9);
/// ```
pub fn angle_between(a: &DMat3, b: &DMat3) -> f64 {
    let d = a.transpose() * *b;
    let cos = (d.x_axis.x + d.y_axis.y + d.z_axis.z - 1.0) / 2.0;
    let sin = DVec3::new(
        d.y_axis.z - d.z_axis.y,
        d.z_axis.x - d.x_axis.z,
        d.x_axis.y - d.y_axis.x,
    )
    .length()
        / 2.0;
    sin.atan2(cos)
}

/// The frame of two directions: a rotation whose columns are x along `x`, y in the plane of both on
/// the side of `y`, and z = x × y.
///
/// `None` when a vector has no direction (zero, infinite, NaN), or when `y` is a multiple of `x`;
/// where it nearly is, rounding turns y about x.
#[doc(hidden)]
pub fn frame_along(x: DVec3, y: DVec3) -> Option<DMat3> {
    let x = x.try_normalize()?;
    let y = (y - x * y.dot(x)).try_normalize()?;
    Some(DMat3::from_cols(x, y, x.cross(y)))
}

/// The shortest rotation that carries the direction of `from` to that of `to`.
///
/// `None` when a vector has no direction. Opposite directions turn about an axis chosen from `from`
/// alone.
#[doc(hidden)]
pub fn shortest_arc(from: DVec3, to: DVec3) -> Option<DMat3> {
    let (f, t) = (from.try_normalize()?, to.try_normalize()?);
    let axis = f.cross(t);
    let (sin, cos) = (axis.length(), f.dot(t));
    if sin < 1e-12 {
        if cos > 0.0 {
            return Some(DMat3::IDENTITY);
        }
        return Some(DMat3::from_axis_angle(
            f.any_orthonormal_vector(),
            std::f64::consts::PI,
        ));
    }
    Some(DMat3::from_axis_angle(axis / sin, sin.atan2(cos)))
}

/// R = Rz Ry Rx.
#[doc(hidden)]
pub fn rotation_zyx(tau: DVec3) -> DMat3 {
    DMat3::from_rotation_z(tau.z) * DMat3::from_rotation_y(tau.y) * DMat3::from_rotation_x(tau.x)
}

/// dR/dτx = Rz Ry Rx \[ex\]×, dR/dτy = Rz Ry \[ey\]× Rx, dR/dτz = \[ez\]× R.
#[doc(hidden)]
pub fn rotation_zyx_derivatives(tau: DVec3) -> [DMat3; 3] {
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
#[doc(hidden)]
pub fn angles_zyx_between(start: &DMat3, now: &DMat3) -> DVec3 {
    let relative = *now * start.transpose();
    let order = parse_order("zyx").unwrap_or([Axis::Z; 3]);
    let [z, y, x] = decompose(&relative, order, [0.0; 3]);
    DVec3::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jacobian_of_a_rotation_vector_agrees_with_differences() {
        let axis = DVec3::new(0.3, -0.8, 0.5).normalize();
        for angle in [0.0, 1e-6, 0.4, 2.0, 3.1] {
            let v = axis * angle;
            let jacobian = rotation_vector_jacobian(v);
            for d in [DVec3::X, DVec3::Y, DVec3::Z] {
                let at = |h: f64| {
                    rotation_vector(&(from_rotation_vector(v) * from_rotation_vector(d * h)))
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!((slope - jacobian * d).length() < 1e-6, "{angle}");
            }
        }
    }

    #[test]
    fn stretches_and_reflections_are_no_rotations() {
        let turn = from_rotation_vector(DVec3::new(0.3, -2.0, 0.5));
        assert!(is_rotation(turn, 1e-12));
        let flip = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        let shear = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(1e-5, 0.0, 1.0));
        let not_a_number = DMat3::from_diagonal(DVec3::new(1.0, f64::NAN, 1.0));
        for wrong in [
            turn * (1.0 + 1e-5),
            turn * flip,
            turn * shear,
            DMat3::ZERO,
            not_a_number,
        ] {
            assert!(!is_rotation(wrong, 1e-6), "{wrong}");
        }
    }

    #[test]
    fn a_rotation_vector_is_given_back_at_0_and_at_pi_too() {
        use std::f64::consts::PI;
        for angle in [
            0.0,
            1e-12,
            1e-7,
            1e-3,
            1.0,
            2.5,
            2.8,
            PI - 1e-3,
            PI - 1e-7,
            PI,
        ] {
            for axis in [
                DVec3::X,
                DVec3::new(1.0, -2.0, 0.5),
                DVec3::new(-1e-3, 1.0, 1.0),
            ] {
                let v = angle * axis.normalize();
                let r = from_rotation_vector(v);
                let found = rotation_vector(&r);
                let back = from_rotation_vector(found);
                assert!(back.abs_diff_eq(r, 1e-12), "{angle}: {found}");
                let same = (found - v).length().min((found + v).length());
                assert!(
                    same <= 1e-9 && (angle == PI || (found - v).length() <= 1e-9),
                    "{v} {found}"
                );
            }
        }
    }

    fn orders() -> Vec<[Axis; 3]> {
        ["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"]
            .iter()
            .map(|o| parse_order(o).unwrap())
            .collect()
    }

    fn outer(order: [Axis; 3], t: [f64; 3]) -> DMat3 {
        order[0].rotation(t[0]) * order[1].rotation(t[1]) * order[2].rotation(t[2])
    }

    #[test]
    fn every_order_turns_back_into_its_matrix_poles_included() {
        let quarter = std::f64::consts::FRAC_PI_2;
        for order in orders() {
            for b in [
                0.3,
                -1.2,
                quarter,
                -quarter,
                quarter - 1e-7,
                -quarter + 1e-10,
                3.0,
            ] {
                for (a, c) in [(0.4, -2.0), (3.1, 0.0), (-1.0, 1.0)] {
                    let r = outer(order, [a, b, c]);
                    let t = decompose(&r, order, [0.2, -0.1, 0.7]);
                    let err = angle_between(&r, &outer(order, t));
                    assert!(err <= 1e-7, "{order:?} {a} {b} {c}: {err}");
                }
            }
        }
    }

    #[test]
    fn following_a_motion_through_a_pole_keeps_steps_small() {
        let order = parse_order("zyx").unwrap();
        let mut near = [0.1, 1.2, 0.3];
        for step in 0..100 {
            let t = [0.1, 1.2 + 0.01 * step as f64, 0.3];
            let got = decompose(&outer(order, t), order, near);
            assert!(
                (0..3).all(|n| (got[n] - near[n]).abs() <= 0.02),
                "{step}: {got:?} {near:?}"
            );
            near = got;
        }
    }

    #[test]
    fn composing_turns_the_first_named_first() {
        let order = parse_order("XYZ").unwrap();
        let m = compose(&order, &[0.1, 0.2, 0.3]);
        let want = Axis::Z.rotation(0.3) * Axis::Y.rotation(0.2) * Axis::X.rotation(0.1);
        assert!(angle_between(&m, &want) <= 1e-15);
        assert!(parse_order("XYX").is_none() && parse_order("XY").is_none());
    }

    #[test]
    fn a_swing_carries_one_direction_to_the_other() {
        for to in [DVec3::new(0.0, 2.0, 0.1), -DVec3::X, DVec3::X] {
            let r = shortest_arc(DVec3::X * 3.0, to).unwrap();
            assert!((r * DVec3::X - to.normalize()).length() <= 1e-12);
        }
        assert!(shortest_arc(DVec3::ZERO, DVec3::X).is_none());
    }

    #[test]
    fn a_frame_has_the_first_direction_for_x_and_the_second_on_the_side_of_y() {
        let (x, y) = (DVec3::new(0.2, -3.0, 1.0), DVec3::new(40.0, 1.0, -7.0));
        for (x, y) in [(x, y), (y, x), (1e-9 * x, -y), (x, y + 1e3 * x)] {
            let frame = frame_along(x, y).unwrap();
            assert!(is_rotation(frame, 1e-12), "{frame}");
            assert!((frame.x_axis - x.normalize()).length() <= 1e-12);
            let across = frame.transpose() * y.normalize();
            assert!(across.y > 0.0 && across.z.abs() <= 1e-12, "{across}");
        }
        let none = [
            (DVec3::ZERO, y),
            (x, DVec3::ZERO),
            (DVec3::Y, -2.0 * DVec3::Y),
            (x, DVec3::new(1.0, f64::NAN, 0.0)),
            (DVec3::new(f64::INFINITY, 0.0, 0.0), y),
        ];
        assert!(none.iter().all(|(x, y)| frame_along(*x, *y).is_none()));
    }

    #[test]
    fn a_ball_joint_turns_about_three_different_axes() {
        use Axis::{X, Y, Z};
        assert_eq!(three_axes([Z, X, Y]), Some([Z, X, Y]));
        for other in [&[Z, X][..], &[], &[Z, X, Z], &[Z, Z, X], &[X, Y, Z, X]] {
            assert_eq!(three_axes(other.iter().copied()), None);
        }
    }

    #[test]
    fn the_exponential_is_a_rotation_about_its_vector() {
        let v = DVec3::new(0.3, -0.2, 0.9);
        assert!((from_rotation_vector(v) * v - v).length() <= 1e-14);
        assert!(
            (angle_between(&DMat3::IDENTITY, &from_rotation_vector(v)) - v.length()).abs() <= 1e-14
        );
        let tiny = DVec3::new(1e-14, 0.0, 0.0);
        assert!(
            (from_rotation_vector(tiny) * DVec3::Y - DVec3::new(0.0, 1.0, 1e-14)).length() <= 1e-20
        );
    }

    #[test]
    fn the_derivatives_of_the_turn_are_right() {
        let tau = DVec3::new(0.3, -0.8, 1.9);
        let h = 1e-6;
        for (k, d) in rotation_zyx_derivatives(tau).into_iter().enumerate() {
            let e = DVec3::AXES[k] * h;
            let want = (rotation_zyx(tau + e) - rotation_zyx(tau - e)) * (0.5 / h);
            assert!(
                (0..3).all(|c| (d.col(c) - want.col(c)).length() <= 1e-8),
                "{k}"
            );
        }
        let r = rotation_zyx(tau);
        assert!((angles_zyx_between(&DMat3::IDENTITY, &r) - tau).length() <= 1e-9);
    }
}

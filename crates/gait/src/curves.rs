//! The curves of a trial by name: angles and centers of joints.

use crate::angles::{ANGLES, Body, CENTERS, Direction, with_quirk};
use crate::side::Side;
use glam::DVec3;
use std::collections::BTreeMap;

/// Curves by Plug-in Gait's names, a value of three numbers a frame; NaN where it is not known.
///
/// `LKneeAngles` and so on are degrees in [-180, 180). `LHJC`, `LKJC` and `LAJC` are the centers of
/// hip, knee and ankle, millimeters in the laboratory's axes with z up, `LSJC`, `LEJC` and `LWJC`
/// those of shoulder, elbow and wrist; `LGroundReactionForce` is N/kg in these axes. `LKneeForce`
/// is N/kg, `LKneeMoment` N mm/kg, `LKneePower` W/kg in the third number.
pub type Curves = BTreeMap<String, Vec<DVec3>>;

/// Whether a curve is of angles, which go around.
pub fn is_angle(curve: &str) -> bool {
    curve.ends_with("Angles")
}

/// Angles and centers; the upper body's where it has any.
pub(crate) fn kinematics(bodies: &[Body], direction: Direction, quirks: bool) -> Curves {
    let (mut curves, lab) = (Curves::new(), direction.axes());
    for side in Side::BOTH {
        let all: Vec<_> = bodies.iter().map(|body| body.angles(side, lab)).collect();
        for (i, name) in ANGLES.into_iter().enumerate() {
            let mut curve: Vec<DVec3> = all.iter().map(|angles| angles[i]).collect();
            if quirks
                && name == "FootProgressAngles"
                && side == Side::Left
                && direction.name() == "+x"
            {
                curve.iter_mut().for_each(|v| *v = with_quirk(*v));
            }
            if i < 5 || curve.iter().any(|v| v.is_finite()) {
                curves.insert(format!("{}{name}", side.letter()), curve);
            }
        }
        for (i, name) in CENTERS.into_iter().enumerate() {
            let curve = bodies.iter().map(|body| body.centers(side)[i]);
            let curve: Vec<DVec3> = curve.collect();
            if i < 3 || curve.iter().any(|v| v.is_finite()) {
                curves.insert(format!("{}{name}", side.letter()), curve);
            }
        }
    }
    curves
}

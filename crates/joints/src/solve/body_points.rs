//! Which markers are where on the body, by the set that knows their names.

use super::landmarks::JointSet;
use super::marker_sets::{MarkerSet, NamedMarker};
use super::tuning::FEWEST_MARKERS;
use crate::pose::orientation::{BodyPoints, SidePoints};

/// How far markers are before or behind the middle of their bone to be of its front or back, cm.
const FRONT: f64 = 3.0;
/// Bones with markers at the front and at the back.
const BONES: [&str; 3] = ["root", "thorax", "head"];

/// The positions of markers on the body; `None` where no built-in set knows enough of them.
#[doc(hidden)]
pub fn body_points(points: &[String]) -> Option<BodyPoints> {
    let set = MarkerSet::of(points)?;
    let markers = set.markers(points);
    if markers.len() < FEWEST_MARKERS {
        return None;
    }
    let of = |is: &dyn Fn(&NamedMarker) -> bool| -> Vec<usize> {
        markers.iter().filter(|m| is(m)).map(|m| m.point).collect()
    };
    let offset = |m: &NamedMarker| m.landmark.offset_and_sd(JointSet::Cmu, m.is_right)[0];
    let side = |is_right: bool| {
        let on = |bones: &[&str], least: f64| {
            of(&|m: &NamedMarker| {
                let is_on = bones.contains(&m.landmark.bone.as_ref());
                is_on && m.is_right == is_right && m.landmark.along >= least
            })
        };
        SidePoints {
            shoulder: on(&["clavicle"], 0.0),
            hip: of(&|m| {
                let x = offset(m).x;
                m.landmark.bone == "root" && x != 0.0 && (x < 0.0) == is_right
            }),
            knee: on(&["femur"], 1.0),
            ankle: on(&["tibia"], 1.0),
            toe: on(&["foot", "toes"], 0.5),
            wrist: on(&["wrist"], 0.0),
        }
    };
    let front = |bone: &&str| {
        let on = |sign: f64| of(&|m| m.landmark.bone == *bone && sign * offset(m).z > FRONT);
        [on(1.0), on(-1.0)]
    };
    Some(BodyPoints {
        head: of(&|m| m.landmark.bone == "head"),
        sides: [side(false), side(true)],
        fronts: BONES.iter().map(front).collect(),
    })
}

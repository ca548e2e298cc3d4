//! Pelvis and legs in a frame: centers of the joints, and axes of the segments.

use crate::axes::{chord, yx, zy};
use crate::markers::Frame;
use crate::parameters::Subject;
use crate::side::Side;
use glam::{DMat3, DVec3};

/// The angles of the pelvis' regression for the hip's center (Davis and others 1991), radians.
const THETA: f64 = 0.5;
const BETA: f64 = 0.314;

/// The pelvis: its axes, and the middle of the front markers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pelvis {
    pub axes: DMat3,
    pub origin: DVec3,
}

impl Pelvis {
    pub(crate) fn new(frame: &Frame) -> Pelvis {
        let [left, right, sacrum] = frame.pelvis();
        let origin = (left + right) / 2.0;
        Pelvis {
            axes: yx(left - right, origin - sacrum),
            origin,
        }
    }

    /// The hip's center.
    fn hip(&self, side: Side, subject: &Subject) -> DVec3 {
        let c = 0.115 * subject.mean_leg() - 15.3;
        let depth = subject.sides[side as usize].asis_trochanter + subject.radius;
        let across = c * THETA.sin() - subject.inter_asis / 2.0;
        let local = DVec3::new(
            c * THETA.cos() * BETA.sin() - depth * BETA.cos(),
            -side.sign() * across,
            -c * THETA.cos() * BETA.cos() - depth * BETA.sin(),
        );
        self.origin + self.axes * local
    }
}

/// A leg: centers of its joints in millimeters, axes of its segments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Leg {
    pub hip: DVec3,
    pub knee: DVec3,
    pub ankle: DVec3,
    pub thigh: DMat3,
    pub shank: DMat3,
    /// The foot along its markers, before the offsets of the static trial.
    pub raw_foot: DMat3,
    pub foot: DMat3,
}

impl Leg {
    pub(crate) fn new(frame: &Frame, pelvis: &Pelvis, side: Side, subject: &Subject) -> Leg {
        let [thi, kne, tib, ank, _, toe] = frame.leg(side);
        let (own, q) = (&subject.sides[side as usize], side.sign());
        let hip = pelvis.hip(side, subject);
        let knee = chord(
            thi,
            hip,
            kne,
            own.knee_width / 2.0 + subject.radius,
            own.thigh_turn,
        );
        let distance = own.ankle_width / 2.0 + subject.radius;
        let ankle = chord(tib, knee, ank, distance, own.shank_turn);
        let shank = zy(knee - ankle, q * (ank - ankle));
        let raw_foot = zy(ankle - toe, shank.y_axis);
        let offset = DMat3::from_rotation_y(-own.plant_flexion)
            * DMat3::from_rotation_x(-q * own.rotation_offset);
        Leg {
            hip,
            knee,
            ankle,
            thigh: zy(hip - knee, q * (kne - knee)),
            shank,
            raw_foot,
            foot: raw_foot * offset,
        }
    }
}

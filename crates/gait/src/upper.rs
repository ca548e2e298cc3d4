//! Head, thorax and arms in a frame: axes of the segments.

use crate::axes::{chord, unit, zx, zy};
use crate::markers::Frame;
use crate::parameters::Subject;
use crate::side::Side;
use glam::{DMat3, DVec3};

/// The head's axes along its markers, before the offset of the static trial.
pub(crate) fn raw_head(frame: &Frame) -> DMat3 {
    let [lfhd, rfhd, lbhd, rbhd] = frame.head();
    let x = unit(lfhd + rfhd - lbhd - rbhd);
    let z = unit(x.cross(lfhd + lbhd - rfhd - rbhd));
    DMat3::from_cols(x, z.cross(x), z)
}

/// The thorax: its axes, of which z points down, and the point between the shoulders.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Thorax {
    pub axes: DMat3,
    pub origin: DVec3,
}

impl Thorax {
    pub(crate) fn new(frame: &Frame, subject: &Subject) -> Thorax {
        let [c7, t10, clav, strn] = frame.trunk();
        let axes = zx(
            (strn + t10 - clav - c7) / 2.0,
            (clav + strn - t10 - c7) / 2.0,
        );
        Thorax {
            axes,
            origin: clav - subject.radius * axes.x_axis,
        }
    }
}

/// An arm: centers of its joints in millimeters, axes of its segments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arm {
    pub shoulder: DVec3,
    pub elbow: DVec3,
    pub wrist: DVec3,
    pub upper_arm: DMat3,
    pub forearm: DMat3,
    pub hand: DMat3,
}

impl Arm {
    pub(crate) fn new(frame: &Frame, thorax: &Thorax, side: Side, subject: &Subject) -> Arm {
        let [sho, elb, wra, wrb, fin] = frame.arm(side);
        let (own, q, r) = (&subject.sides[side as usize], side.sign(), subject.radius);
        let top = thorax.origin;
        let wand = q * unit(thorax.axes.x_axis.cross(sho - top));
        let shoulder = chord(top + wand, top, sho, own.shoulder_offset + r, 0.0);
        let between = (wra + wrb) / 2.0;
        let normal = q * unit(unit(shoulder - elb).cross(unit(between - elb)));
        let elbow = chord(elb + normal, shoulder, elb, own.elbow_width / 2.0 + r, 0.0);
        let across = unit(unit(elbow - between).cross(unit(wra - wrb)));
        let wrist = between - q * (own.wrist_width / 2.0 + r) * across;
        let z = unit(shoulder - elbow);
        let y = unit((wrist - elbow).cross(z));
        let x = unit(y.cross(elbow - wrist));
        let hand = chord(between, wrist, fin, own.hand_thickness / 2.0 + r, 0.0);
        Arm {
            shoulder,
            elbow,
            wrist,
            upper_arm: DMat3::from_cols(y.cross(z), y, z),
            forearm: DMat3::from_cols(x, y, x.cross(y)),
            hand: zy(wrist - hand, q * (between - wra)),
        }
    }
}

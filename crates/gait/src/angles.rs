//! The angles between the segments, by Plug-in Gait's conventions.

use crate::axes::{wrapped, xyz, yxz};
use crate::lower::{Leg, Pelvis};
use crate::markers::{Frame, Markers};
use crate::parameters::Subject;
use crate::side::Side;
use crate::upper::{Arm, Thorax, raw_head};
use glam::{DMat3, DVec3};

/// The angles, by their names without the side; the first five are the lower body's.
pub const ANGLES: [&str; 12] = [
    "PelvisAngles",
    "HipAngles",
    "KneeAngles",
    "AnkleAngles",
    "FootProgressAngles",
    "ThoraxAngles",
    "HeadAngles",
    "SpineAngles",
    "NeckAngles",
    "ShoulderAngles",
    "ElbowAngles",
    "WristAngles",
];

/// The centers, by their names without the side; the first three are a leg's.
pub(crate) const CENTERS: [&str; 6] = ["HJC", "KJC", "AJC", "SJC", "EJC", "WJC"];

/// A trial whose pelvis moves less than this stands, millimeters.
const STANDING: f64 = 800.0;

/// Where a person walks: the axis of the laboratory from which progression is counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// The axis: x or y, either way.
    pub forward: DVec3,
    /// Whether the person stands; the axis is then that which the pelvis faces.
    pub standing: bool,
}

impl Direction {
    /// The direction of a trial: from the pelvis' first place to its last.
    #[doc(hidden)]
    pub fn of(markers: &Markers) -> Direction {
        let seen = (0..markers.frames()).map(|t| Pelvis::new(&markers.frame(t)));
        let mut seen = seen.filter(|pelvis| pelvis.origin.is_finite()).peekable();
        let first = seen.peek().map_or(DVec3::ZERO, |pelvis| pelvis.origin);
        let (mut last, mut facing) = (first, DVec3::ZERO);
        for pelvis in seen {
            last = pelvis.origin;
            facing += Some(pelvis.axes.x_axis)
                .filter(|x| x.is_finite())
                .unwrap_or_default();
        }
        let moved = (last - first).with_z(0.0);
        let standing = moved.length() < STANDING;
        let along = if standing { facing } else { moved };
        let forward = if along.x.abs() >= along.y.abs() {
            DVec3::X * 1f64.copysign(along.x)
        } else {
            DVec3::Y * 1f64.copysign(along.y)
        };
        Direction { forward, standing }
    }

    /// The axis as `+x`, `-x`, `+y` or `-y`.
    pub fn name(&self) -> &'static str {
        match (self.forward.x, self.forward.y) {
            (x, _) if x > 0.0 => "+x",
            (x, _) if x < 0.0 => "-x",
            (_, y) if y > 0.0 => "+y",
            _ => "-y",
        }
    }

    /// The laboratory's axes along it: forwards, left, up.
    #[doc(hidden)]
    pub fn axes(&self) -> DMat3 {
        DMat3::from_cols(self.forward, DVec3::Z.cross(self.forward), DVec3::Z)
    }
}

/// A pelvis that turns so much walks a turn, degrees: in a straight walk it turns 15 to either
/// side.
pub(crate) const TURN: f64 = 45.0;

/// How far the pelvis turns from where it faces first, at most, degrees.
pub(crate) fn turn(markers: &Markers) -> f64 {
    let across = |t: usize| {
        let [left, right, _] = markers.frame(t).pelvis();
        (left - right).truncate()
    };
    let mut seen = (0..markers.frames()).map(across).filter(|v| v.is_finite());
    let first = seen.next().unwrap_or_default();
    let angles = seen.map(|v| v.angle_to(first).abs().to_degrees());
    angles.filter(|a| a.is_finite()).fold(0.0, f64::max)
}

/// The segments in a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Body {
    pub pelvis: Pelvis,
    pub legs: [Leg; 2],
    pub thorax: Thorax,
    pub head: DMat3,
    pub arms: [Arm; 2],
}

impl Body {
    pub(crate) fn new(frame: &Frame, subject: &Subject) -> Body {
        let (pelvis, thorax) = (Pelvis::new(frame), Thorax::new(frame, subject));
        Body {
            pelvis,
            legs: Side::BOTH.map(|side| Leg::new(frame, &pelvis, side, subject)),
            thorax,
            head: raw_head(frame) * DMat3::from_rotation_y(subject.head_offset),
            arms: Side::BOTH.map(|side| Arm::new(frame, &thorax, side, subject)),
        }
    }

    /// The centers of a side's joints, hip, knee, ankle, shoulder, elbow and wrist, millimeters;
    /// NaN where a marker is missing, or a parameter.
    pub(crate) fn centers(&self, side: Side) -> [DVec3; CENTERS.len()] {
        let (leg, arm) = (&self.legs[side as usize], &self.arms[side as usize]);
        let [legs, arms] = [
            [leg.hip, leg.knee, leg.ankle],
            [arm.shoulder, arm.elbow, arm.wrist],
        ];
        std::array::from_fn(|i| if i < 3 { legs[i] } else { arms[i - 3] })
    }

    /// The [`ANGLES`] of a side, degrees in [-180, 180), about the axes that Plug-in Gait names x,
    /// y and z; NaN where a marker is missing.
    pub(crate) fn angles(&self, side: Side, lab: DMat3) -> [DVec3; ANGLES.len()] {
        let (leg, arm) = (&self.legs[side as usize], &self.arms[side as usize]);
        let (pelvis, thorax, q) = (self.pelvis.axes, self.thorax.axes, side.sign());
        let lower = lower_angles(lab, [pelvis, leg.thigh, leg.shank, leg.foot], side);
        let [a, b, g] = xyz(thorax, arm.upper_arm);
        let shoulder = [-b, q * a + 180.0, 180.0 - q * g].map(wrapped);
        let upper = [
            yxz_angles(lab, thorax, &|[b, a, g]| [b + 180.0, -q * a, q * g + 180.0]),
            yxz_angles(lab, self.head, &|[b, a, g]| [-b, q * a, -q * g]),
            yxz_angles(thorax, pelvis, &|[b, a, g]| {
                [b + 180.0, -q * a, 180.0 - q * g]
            }),
            yxz_angles(self.head, thorax, &|[b, a, g]| {
                [180.0 - b, -q * a, q * g + 180.0]
            }),
            DVec3::from_array(shoulder),
            yxz_angles(arm.upper_arm, arm.forearm, &|[b, _, _]| [b, 0.0, 0.0]),
            yxz_angles(arm.forearm, arm.hand, &|[b, a, g]| [b, -q * a, -q * g]),
        ];
        std::array::from_fn(|i| if i < 5 { lower[i] } else { upper[i - 5] })
    }
}

/// The first five of [`ANGLES`] of a side, by the axes of pelvis, thigh, shank and foot, of which
/// that of the foot's z points backwards and of x up, and those of others forwards, left and up.
#[doc(hidden)]
pub fn lower_angles(lab: DMat3, axes: [DMat3; 4], side: Side) -> [DVec3; 5] {
    let ([pelvis, thigh, shank, foot], q) = (axes, side.sign());
    [
        yxz_angles(lab, pelvis, &|[b, a, g]| [b, q * a, -q * g]),
        yxz_angles(pelvis, thigh, &|[b, a, g]| [-b, -q * a, -q * g]),
        yxz_angles(thigh, shank, &|[b, a, g]| [b, -q * a, -q * g]),
        yxz_angles(shank, foot, &|[b, a, g]| [-b - 90.0, -q * g, -q * a]),
        yxz_angles(lab, foot, &|[b, a, g]| [b, q * g, -q * a]),
    ]
}

/// Angles of those about y, x and z: b, a and g of the literature.
fn yxz_angles(parent: DMat3, child: DMat3, angles: &dyn Fn([f64; 3]) -> [f64; 3]) -> DVec3 {
    DVec3::from_array(angles(yxz(parent, child)).map(wrapped))
}

/// What Vicon writes for a foot's progression on the left of a person who walks along +x: other
/// angles, which are not those of the same rotation.
pub(crate) fn with_quirk(angles: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = angles;
    DVec3::from_array([x + 180.0, -180.0 - y, z + 180.0].map(wrapped))
}

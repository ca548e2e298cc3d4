//! Forces, moments and powers of a leg's joints by inverse dynamics, per kilogram of the body.
//!
//! From the foot upwards: a segment's mass times (gravity less its center's acceleration) is added
//! to the force from below, its moment about the proximal joint to the moment, less what turns the
//! segment.

use crate::angles::Body;
use crate::lower::Leg;
use crate::side::Side;
use glam::{DMat3, DVec3};
use std::ops::{Add, Mul};

/// The joints, from below.
pub(crate) const JOINTS: [&str; 3] = ["Ankle", "Knee", "Hip"];
/// Foot, shank and thigh: share of the body's mass, place of the center of mass from the
/// proximal end in lengths, radius of gyration in lengths. (The radii are Dempster's about the
/// proximal end; Vicon takes them about the center of mass.)
const SEGMENTS: [[f64; 3]; 3] = [
    [0.0145, 0.5, 0.69],
    [0.0465, 0.433, 0.528],
    [0.1, 0.433, 0.54],
];
/// m/s².
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);
/// The second difference over nine frames, and the slope of a line through five.
const SECOND: [f64; 9] = [
    -1.0 / 560.0,
    8.0 / 315.0,
    -0.2,
    1.6,
    -205.0 / 72.0,
    1.6,
    -0.2,
    8.0 / 315.0,
    -1.0 / 560.0,
];
const SLOPE: [f64; 5] = [-0.2, -0.1, 0.0, 0.1, 0.2];

/// Values weighted around each frame; `none` where the weights reach beyond the ends.
fn filtered<T>(values: &[T], weights: &[f64], none: T) -> Vec<T>
where
    T: Copy + Mul<f64, Output = T> + Add<Output = T>,
{
    let half = weights.len() / 2;
    let mut out = vec![none; values.len()];
    for (i, around) in values.windows(weights.len()).enumerate() {
        let terms = around.iter().zip(weights).map(|(v, w)| *v * *w);
        out[i + half] = terms.reduce(|a, b| a + b).unwrap_or(none);
    }
    out
}

/// The angular velocity of axes over time, rad/s, in the laboratory's axes, as Vicon has it: an
/// axis by the slope of the next one against the one after it two frames later, where the last
/// value of the slope stands. (Exactly: by the axes of the frame itself. Found by regression of
/// Vicon's moments, whose error this lowers to a tenth.)
fn angular_velocity(axes: &[DMat3], rate: f64) -> Vec<DVec3> {
    let change = filtered(axes, &SLOPE, DMat3::NAN);
    let later = |t: usize| axes.get(t + SLOPE.len() / 2).copied().unwrap_or(DMat3::NAN);
    let one = |(t, change): (usize, DMat3)| {
        let w = later(t).transpose() * change * rate;
        // Each stands twice in a rotation in its own axes; Vicon takes these of the two.
        axes[t] * -DVec3::new(w.z_axis.y, w.x_axis.z, w.y_axis.x)
    };
    change.into_iter().enumerate().map(one).collect()
}

/// A joint over time.
#[derive(Debug, Clone, Default)]
pub(crate) struct JointKinetics {
    /// N/kg.
    pub force: Vec<DVec3>,
    /// N mm/kg.
    pub moment: Vec<DVec3>,
    /// W/kg, in z; x and y are 0.
    pub power: Vec<DVec3>,
}

/// Ankle, knee and hip of a side. `loads` are force and moment about the laboratory's origin on
/// the foot, N/kg and N mm/kg; `foot` is the foot's length.
pub(crate) fn leg(
    bodies: &[Body],
    side: Side,
    loads: &[[DVec3; 2]],
    foot: f64,
    rate: f64,
) -> [JointKinetics; 3] {
    let legs = || bodies.iter().map(|body| &body.legs[side as usize]);
    let axes = |i: usize| legs().map(move |leg| [leg.foot, leg.shank, leg.thigh][i]);
    let ends = |leg: &Leg| {
        let tip = leg.ankle - foot * leg.foot.z_axis;
        [[leg.ankle, tip], [leg.knee, leg.ankle], [leg.hip, leg.knee]]
    };
    let mut all: Vec<Vec<DMat3>> = (0..3).map(|i| axes(i).collect()).collect();
    all.push(bodies.iter().map(|body| body.pelvis.axes).collect());
    let axes = all;
    let turning: Vec<Vec<DVec3>> = axes.iter().map(|a| angular_velocity(a, rate)).collect();
    let mut loads = loads.to_vec();
    let mut joints: [JointKinetics; 3] = Default::default();
    for (i, [mass, place, gyration]) in SEGMENTS.into_iter().enumerate() {
        let ends: Vec<[DVec3; 2]> = legs().map(|leg| ends(leg)[i]).collect();
        let centers: Vec<DVec3> = ends.iter().map(|[p, d]| *p + place * (*d - *p)).collect();
        let acceleration = filtered(&centers, &SECOND, DVec3::NAN);
        let angular = filtered(&turning[i], &SLOPE, DVec3::NAN);
        let joint = &mut joints[i];
        for t in 0..bodies.len() {
            let ([p, d], axes) = (ends[t], axes[i][t]);
            let weight = mass * (GRAVITY - acceleration[t] * rate * rate / 1e3);
            let inertia = mass * (gyration * (d - p).length()).powi(2) / 1e3;
            // None about z.
            let turned = |v: DVec3| axes * (inertia * (axes.transpose() * v).with_z(0.0));
            let w = turning[i][t];
            let torque = turned(angular[t] * rate) + w.cross(turned(w));
            let [force, moment] = &mut loads[t];
            *force += weight;
            // About the laboratory's origin; the joint's moment is that about its center.
            *moment += centers[t].cross(weight) - torque;
            let about = *moment - p.cross(*force);
            let power = -about.dot(w - turning[i + 1][t]) / 1e3;
            let (f, m) = (axes.transpose() * *force, axes.transpose() * about);
            joint.force.push(shown_force(i, f));
            joint.moment.push(shown_moment(i, m, side.sign()));
            joint.power.push(DVec3::new(0.0, 0.0, power));
        }
    }
    joints
}

/// A force in the distal segment's axes with the signs of Plug-in Gait.
fn shown_force(joint: usize, f: DVec3) -> DVec3 {
    if joint == 0 {
        DVec3::new(f.x, -f.y, f.z)
    } else {
        -f
    }
}

/// A moment in the distal segment's axes about Plug-in Gait's x, y and z.
fn shown_moment(joint: usize, m: DVec3, q: f64) -> DVec3 {
    match joint {
        0 => DVec3::new(-m.y, q * m.z, -q * m.x),
        1 => DVec3::new(m.y, -q * m.x, -q * m.z),
        _ => DVec3::new(-m.y, -q * m.x, -q * m.z),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_those_of_motions_known() {
        let rate = 100.0;
        let falls: Vec<DVec3> = (0..20)
            .map(|t| 0.5 * GRAVITY * (f64::from(t) / rate).powi(2))
            .collect();
        let found = filtered(&falls, &SECOND, DVec3::NAN);
        assert!(found[3].is_nan() && found[16].is_nan());
        assert!((found[10] * rate * rate - GRAVITY).length() < 1e-9);
        let axes: Vec<DMat3> = (0..9)
            .map(|t| DMat3::from_rotation_z(0.02 * f64::from(t)))
            .collect();
        let turning = angular_velocity(&axes, rate);
        assert!((turning[4] - DVec3::Z * 2.0).length() < 4e-3 && turning[1].is_nan());
    }
}

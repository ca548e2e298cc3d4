//! The rotations of a file as angles: where they jump though the joint hardly turns.

use super::{Finding, FindingKind};
use crate::pose::JointAngles;
use crate::pose::rotation::{angle_between, compose};
use posing_core::often;

/// The smallest jump of an angle from one frame to the next that may be a flip, radians.
const JUMP: f64 = std::f64::consts::FRAC_PI_2;
/// A jump is a flip if the joint turns by less than this share of it.
const TURN: f64 = 0.25;

/// Joints whose angles jump, by a whole turn or through gimbal lock, while the joint itself hardly
/// turns: what is interpolated between two such frames goes astray.
pub(crate) fn flips(joints: &[JointAngles]) -> Vec<Finding> {
    joints.iter().filter_map(flips_of).collect()
}

fn flips_of(joint: &JointAngles) -> Option<Finding> {
    let jumps = (1..joint.angles.nrows()).filter_map(|t| Some((t, flip_at(joint, t)?)));
    let jumps: Vec<(usize, f64)> = jumps.collect();
    let (first, by) = *jumps.first()?;
    let times = often(jumps.len());
    Some(Finding {
        kind: FindingKind::EulerFlip,
        points: vec![joint.joint.clone()],
        frames: Some([first, first + 1]),
        what: format!(
            "an angle of {} jumps {times}, by {:.0} degrees in frame {first}, though the \
             joint hardly turns: do not interpolate there",
            joint.joint,
            by.to_degrees()
        ),
    })
}

/// By how much an angle flips from the frame before to frame `t`.
fn flip_at(joint: &JointAngles, t: usize) -> Option<f64> {
    let (before, now) = (joint.angles.row(t - 1), joint.angles.row(t));
    let steps = before.iter().zip(now).map(|(a, b)| (b - a).abs());
    let largest = steps.fold(0.0, f64::max);
    if largest <= JUMP || before.iter().chain(now).any(|v| v.is_nan()) {
        return None;
    }
    let turn = |row: ndarray::ArrayView1<'_, f64>| compose(&joint.axes, &row.to_vec());
    let turned = angle_between(&turn(before), &turn(now));
    (turned < TURN * largest).then_some(largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::Axis;
    use ndarray::{Array2, array};
    use std::f64::consts::PI;

    #[test]
    fn angles_that_jump_while_the_joint_rests_are_flips() {
        let joint = |angles: Array2<f64>| JointAngles {
            joint: "hand".into(),
            axes: vec![Axis::Z, Axis::X, Axis::Y],
            angles,
        };
        let turned = joint(array![[3.1, 0.0, 0.2], [3.1 - 2.0 * PI, 0.0, 0.2]]);
        let found = flips(&[turned]);
        assert!(
            found[0].what.contains("once, by 360 degrees in frame 1"),
            "{found:?}"
        );
        // The same rotation through the other side of the middle axis.
        let other = joint(array![[0.1, 0.2, 0.3], [0.1 + PI, PI - 0.2, 0.3 + PI]]);
        assert_eq!(flips(&[other]).len(), 1);
        let real = joint(array![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        let missing = joint(array![[0.0, 0.0, 0.0], [f64::NAN, 2.0, 0.0]]);
        assert_eq!(flips(&[real, missing]), []);
    }
}

//! A skeleton with the joints of its body and its rest pose.

use super::hierarchy::Hierarchy;
use super::rest::RestPose;
use super::segments::BodyJoints;
use super::shape::Limb;
use super::tuning::feet::{LEG, LEGS};
use super::tuning::rest::NO_LENGTH;
use glam::DVec3;

/// A skeleton, its body and its rest pose.
#[derive(Clone, Copy)]
pub(super) struct Figure<'a> {
    pub tree: &'a Hierarchy,
    pub body: &'a BodyJoints,
    pub rest: &'a RestPose,
}

impl Figure<'_> {
    /// The direction in the rest pose from a joint to another, or to the mean of what hangs on it.
    pub(super) fn direction(&self, joint: usize, end: Option<usize>) -> Option<DVec3> {
        let pose = &self.rest.pose;
        let bone = match end {
            Some(end) => pose.positions[end] - pose.positions[joint],
            None => {
                let children = self.tree.children(joint).map(|j| self.tree.offsets[j]);
                let tips = self.tree.tips[joint].iter().copied();
                pose.rotations[joint] * children.chain(tips).sum::<DVec3>()
            }
        };
        (bone.length() > NO_LENGTH * self.leg()).then(|| bone.normalize())
    }

    /// The length of a leg at rest, the mean of both.
    pub(super) fn leg(&self) -> f64 {
        let positions = &self.rest.pose.positions;
        let long = |leg: &Limb| {
            let [hip, knee, ankle] = leg.joints.map(|j| positions[j]);
            hip.distance(knee) + knee.distance(ankle)
        };
        self.body.legs.iter().map(long).sum::<f64>() / 2.0
    }

    /// The joints of a hand that bend: the wrist, and with CMU's names the joint after it.
    pub(super) fn hand(&self, arm: &Limb) -> Vec<usize> {
        let more = arm.end.filter(|_| self.body.has_hand_joint());
        [Some(arm.joints[2]), more].into_iter().flatten().collect()
    }

    /// What counts as a centimeter: a share of the leg, unless that is a person's in centimeters.
    pub(super) fn centimeter(&self) -> f64 {
        let leg = self.leg();
        if LEGS.contains(&leg) { 1.0 } else { leg / LEG }
    }
}

//! The channels of a take that is carried onto a level floor, and whose legs turn.

use super::floor::Level;
use super::hold::Held;
use crate::ik::retarget::hierarchy::{Hierarchy, Pose};
use crate::ik::retarget::segments::BodyJoints;
use crate::io::Bvh;
use crate::pose::rotation::{Axis, decompose, shortest_arc};
use crate::pose::{Channel, UpAxis};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayViewMut1};

/// A body, and what moves it.
pub(super) struct Body<'a> {
    bvh: &'a Bvh,
    tree: &'a Hierarchy,
    joints: &'a BodyJoints,
    up: UpAxis,
    /// The joint whose channels move the body as a whole.
    pub carrier: usize,
}

impl<'a> Body<'a> {
    /// That of a take.
    ///
    /// # Errors
    /// [`Error::Unfit`]: no joint has the channels that move it.
    pub(super) fn new(
        bvh: &'a Bvh,
        tree: &'a Hierarchy,
        joints: &'a BodyJoints,
        up: UpAxis,
    ) -> Result<Body<'a>> {
        let count = |joint: usize, angle: bool| {
            let (channels, _) = tree.channels(joint);
            channels.iter().filter(|c| c.is_angle() == angle).count()
        };
        let carrier = tree.upwards(joints.base).find(|j| count(*j, false) == 3);
        let carrier = carrier.filter(|j| count(*j, true) == 3).ok_or_else(|| {
            Error::unfit("no joint above its legs has channels for position and rotation both")
        })?;
        Ok(Body {
            bvh,
            tree,
            joints,
            up,
            carrier,
        })
    }

    /// The values of the channels of all frames; what is neither turned nor moved keeps its own.
    pub(super) fn motion(&self, level: &Level, held: Option<&Held>) -> Array2<f64> {
        let mut motion = self.bvh.motion.clone();
        let mut pose = Pose::default();
        for (t, mut row) in motion.rows_mut().into_iter().enumerate() {
            let turns = [0, 1].map(|side: usize| held.map(|held| held.turns[side][t]));
            let lowered = held.map_or(0.0, |held| held.lowered[t]);
            let is_moved = !level.is_still() || lowered > 0.0;
            if !is_moved && turns.iter().flatten().flatten().all(Option::is_none) {
                continue;
            }
            self.tree.pose(row.view(), &mut pose);
            for (side, turns) in turns.into_iter().enumerate() {
                if let Some([Some(upper), Some(lower)]) = turns {
                    // In the take's own directions: the floor's slope cancels out.
                    let own = level.turn;
                    let turns = [upper, lower].map(|r| own.transpose() * r * own);
                    self.bend(side, turns, &pose, &mut row);
                }
            }
            if is_moved {
                let place = level.place(t, pose.positions[self.carrier]) - lowered * DVec3::Y;
                self.carry(level.turn, place, &pose, &mut row);
            }
        }
        motion
    }

    /// The global rotation of what a joint hangs on.
    fn above(&self, joint: usize, pose: &Pose) -> DMat3 {
        let parent = self.tree.parents[joint];
        parent.map_or(DMat3::IDENTITY, |parent| pose.rotations[parent])
    }

    /// Turns the body, and puts it to a place.
    fn carry(&self, by: DMat3, place: DVec3, pose: &Pose, row: &mut ArrayViewMut1<'_, f64>) {
        let above = self.above(self.carrier, pose);
        if by != DMat3::IDENTITY {
            let local = above.transpose() * by * pose.rotations[self.carrier];
            self.put(self.carrier, local, row);
        }
        let parent = self.tree.parents[self.carrier];
        let origin = parent.map_or(DVec3::ZERO, |parent| pose.positions[parent]);
        let own = self.up.rotation().transpose() * (above.transpose() * (place - origin));
        let (channels, first) = self.tree.channels(self.carrier);
        for (n, channel) in channels.iter().enumerate() {
            let value = &mut row[first + n];
            if let Channel::Translate(axis) = channel
                && value.is_finite()
            {
                *value = own[axis.index()];
            }
        }
    }

    /// Turns thigh and shin of a leg; the foot keeps its direction.
    fn bend(
        &self,
        side: usize,
        [upper, lower]: [DMat3; 2],
        pose: &Pose,
        row: &mut ArrayViewMut1<'_, f64>,
    ) {
        let [hip, knee, ankle] = self.joints.legs[side].joints;
        let bone = |from: usize, to: usize| pose.positions[to] - pose.positions[from];
        let above = upper * self.above(knee, pose);
        let shin = above.transpose() * lower * pose.rotations[knee];
        let shin = above * self.put(knee, shin, row) * pose.rotations[knee].transpose();
        // A knee that turns about fewer axes leaves the ankle aside, and the thigh makes up for it.
        let thigh = upper * bone(hip, knee);
        let (now, goal) = (
            thigh + shin * bone(knee, ankle),
            thigh + lower * bone(knee, ankle),
        );
        let aim = shortest_arc(now, goal).unwrap_or(DMat3::IDENTITY);
        let own = self.above(hip, pose).transpose() * aim * upper * pose.rotations[hip];
        self.put(hip, own, row);
        let above = aim * shin * self.above(ankle, pose);
        self.put(ankle, above.transpose() * pose.rotations[ankle], row);
    }

    /// Puts a joint's rotation in its parent's frame into its channels, near the values that they
    /// have; the rotation that they can turn.
    fn put(&self, joint: usize, local: DMat3, row: &mut ArrayViewMut1<'_, f64>) -> DMat3 {
        let (channels, first) = self.tree.channels(joint);
        let mut axes = Vec::new();
        for (n, channel) in channels.iter().enumerate() {
            if let Channel::Rotate(axis) = channel {
                axes.push((*axis, Some(first + n)));
            }
        }
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            if axes.iter().all(|(own, _)| *own != axis) {
                axes.push((axis, None));
            }
        }
        let order = [0, 1, 2].map(|n| axes[n].0);
        let at = [0, 1, 2].map(|n| axes[n].1);
        let near = at.map(|at| at.map_or(0.0, |at| row[at]));
        if near.iter().any(|angle| !angle.is_finite()) {
            return local;
        }
        let turn = self.up.rotation();
        let angles = decompose(&(turn.transpose() * local * turn), order, near);
        let mut possible = DMat3::IDENTITY;
        for ((at, axis), angle) in at.into_iter().zip(order).zip(angles) {
            if let Some(at) = at {
                row[at] = angle;
                possible *= axis.rotation(angle);
            }
        }
        turn * possible * turn.transpose()
    }
}

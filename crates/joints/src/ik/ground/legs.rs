//! The legs of a take with rotations, and the points of feet that stand.

use super::contacts::Contacts;
use super::feet::Feet;
use super::floor::{Floor, Level};
use super::stance::stances;
use super::tuning::*;
use crate::ik::retarget::feet::LegFrame;
use crate::ik::retarget::hierarchy::{Hierarchy, Missing, Pose};
use crate::ik::retarget::segments::BodyJoints;
use crate::ik::retarget::tuning::feet::{LEG, LEGS};
use crate::io::Bvh;
use crate::numeric::statistics::quantile;
use crate::pose::two_bone::TwoBones;
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// A point of a foot.
struct Point {
    joint: usize,
    /// From the joint, in its frame: to an End Site, or nothing.
    tip: DVec3,
    side: usize,
    /// Whether a foot is held by it: the joint of the toes, or the ankle of a foot without toes.
    is_held: bool,
}

/// The legs of a take in all its frames.
pub(super) struct Legs {
    /// The points of both feet.
    pub feet: Feet,
    /// By side and frame.
    pub frames: [Vec<LegFrame>; 2],
    /// The length of a leg.
    pub leg: f64,
    points: Vec<Point>,
}

/// The points of a side's foot that stand: joints and End Sites below the ankle, which rises in
/// each stance; the ankle alone where it has none.
fn points_of(tree: &Hierarchy, body: &BodyJoints, side: usize) -> Vec<Point> {
    let leg = &body.legs[side];
    let ankle = leg.joints[2];
    let held = leg.end.unwrap_or(ankle);
    let own = (0..tree.len()).filter(|j| tree.is_below(*j, ankle));
    let all = own.flat_map(|joint| {
        let tips = tree.tips[joint].iter().copied();
        let point = move |tip: DVec3| Point {
            joint,
            tip,
            side,
            is_held: joint == held && tip == DVec3::ZERO,
        };
        std::iter::once(DVec3::ZERO).chain(tips).map(point)
    });
    let all: Vec<Point> = all.collect();
    let has_toes = leg.end.is_some();
    let stands = |point: &Point| !has_toes || point.joint != ankle || point.tip != DVec3::ZERO;
    all.into_iter().filter(stands).collect()
}

impl Legs {
    /// Those of a take that the joint `carrier` moves.
    ///
    /// # Errors
    /// [`Error::Unfit`]: the legs have no length.
    pub(super) fn read(
        bvh: &Bvh,
        tree: &Hierarchy,
        body: &BodyJoints,
        carrier: usize,
        rate: f64,
    ) -> Result<Legs> {
        let rest = tree.zero().positions;
        let long = |side: usize| {
            let [hip, knee, ankle] = body.legs[side].joints.map(|j| rest[j]);
            hip.distance(knee) + knee.distance(ankle)
        };
        let leg = (long(0) + long(1)) / 2.0;
        if !(leg > 0.0 && leg.is_finite()) {
            return Err(Error::unfit("its legs have no length"));
        }
        let unit = if LEGS.contains(&leg) { 1.0 } else { leg / LEG };
        let points: Vec<Point> = (0..2)
            .flat_map(|side| points_of(tree, body, side))
            .collect();
        let mut tracks = vec![Vec::with_capacity(bvh.motion.nrows()); points.len()];
        let (mut frames, mut middle) = ([Vec::new(), Vec::new()], DVec3::ZERO);
        let mut pose = Pose::default();
        for row in bvh.motion.rows() {
            tree.pose(row, &mut pose);
            let missing = tree.missing(row);
            middle += pose.positions[carrier];
            for (point, track) in points.iter().zip(&mut tracks) {
                track.push(place_of(point, tree, &pose, &missing));
            }
            for (side, frames) in frames.iter_mut().enumerate() {
                frames.push(leg_of(body.legs[side].joints, tree, &pose, &missing));
            }
        }
        middle /= bvh.motion.nrows() as f64;
        let feet = Feet {
            points: tracks,
            scale: [rate, unit],
            pivot: [middle.x, middle.z],
        };
        Ok(Legs {
            feet,
            frames,
            leg,
            points,
        })
    }

    /// Whether the hip of a point's leg is over its foot.
    pub(super) fn is_upright(&self, track: usize, frame: usize) -> bool {
        let bones = &self.frames[self.points[track].side][frame].bones;
        bones.hip.y - bones.ankle.y > ABOVE * self.leg
    }

    /// How high the lowest points of feet are over soles, by how high ankles are over them, 0 where
    /// these are on soles; and between which heights they may stand on a floor at 0.
    pub(super) fn sole(&self, floor: &Floor, lowest: f64) -> (f64, [f64; 2]) {
        let unit = self.leg / LEG;
        let normal = floor.normal();
        let mut heights = Vec::new();
        for (track, point) in self.points.iter().enumerate() {
            let over = floor.heights[track] - lowest;
            if !point.is_held || over.is_nan() || over > ALIKE * unit {
                continue;
            }
            let points = &self.feet.points[track];
            let found = stances(points, self.feet.scale, SPEED, |t| {
                self.is_upright(track, t)
            });
            let frames = &self.frames[point.side];
            let ankle = |t: usize| (frames[t].source - points[t]).dot(normal) + over;
            heights.extend(found.into_iter().flatten().map(ankle));
        }
        // Later in a stance the heel rises.
        let Some(ankle) = quantile(heights, FLAT) else {
            return (0.0, [-AT_ZERO[0] * unit, MARKERS * unit]);
        };
        let sole = ANKLE * unit - ankle;
        if sole < THIN * unit {
            (0.0, [-AT_ZERO[0] * unit, AT_ZERO[0] * unit])
        } else {
            let near = AT_ZERO[1] * unit;
            (sole, [sole - near, sole + near])
        }
    }

    /// Carries everything onto a level floor.
    pub(super) fn place(&mut self, level: &Level) {
        for frames in &mut self.frames {
            for (t, frame) in frames.iter_mut().enumerate() {
                let TwoBones { hip, knee, ankle } = &mut frame.bones;
                for point in [hip, knee, ankle, &mut frame.source] {
                    *point = level.place(t, *point);
                }
                frame.thigh = level.turn * frame.thigh;
            }
        }
        for points in &mut self.feet.points {
            *points = level.places(points);
        }
    }

    /// The contacts of both feet with the floor that everything was carried onto.
    pub(super) fn standing(&self, level: &Level) -> [Contacts; 2] {
        let unit = self.feet.scale[1];
        let is_held = |side: usize| move |p: &Point| p.side == side && p.is_held;
        let tracks = [0, 1].map(|side| self.points.iter().position(is_held(side)));
        let heights = tracks.map(|track| track.map_or(f64::NAN, |track| level.height(track)));
        // What stands higher than the other foot is held up.
        let most = heights[0].min(heights[1]) + ALIKE * unit;
        [0, 1].map(|side: usize| {
            let points = tracks[side].map_or(Vec::new(), |track| self.feet.points[track].clone());
            Contacts::of(points, heights[side].min(most), self.feet.scale)
        })
    }
}

/// Where a point of a foot is in a frame; nan: missing.
fn place_of(point: &Point, tree: &Hierarchy, pose: &Pose, missing: &[Missing]) -> DVec3 {
    let lacks = tree.lacks_position(point.joint, missing)
        || point.tip != DVec3::ZERO && missing[point.joint].rotation;
    if lacks {
        DVec3::NAN
    } else {
        pose.positions[point.joint] + pose.rotations[point.joint] * point.tip
    }
}

/// A leg in a frame.
fn leg_of(joints: [usize; 3], tree: &Hierarchy, pose: &Pose, missing: &[Missing]) -> LegFrame {
    let [hip, knee, ankle] = joints.map(|j| pose.positions[j]);
    let lacks = tree.lacks_position(joints[2], missing) || missing[joints[2]].rotation;
    LegFrame {
        bones: TwoBones { hip, knee, ankle },
        thigh: pose.rotations[joints[0]],
        source: if lacks { DVec3::NAN } else { ankle },
        foot: [DMat3::IDENTITY; 2],
        toes_rest: false,
    }
}

//! Feet that stand stay where they stand, through a blend.

use super::bone_tree::BoneTree;
use super::timing::{point_at, smooth};
use crate::clip::Clip;
use crate::joint_map::joint;
use crate::pose::foot_contacts::{ContactLimits, contacts, fade};
use crate::pose::ranges;
use crate::pose::two_bone::TwoBones;
use glam::DVec3;
use std::ops::Range;

/// When a foot stands: slower and lower than this, for as long as this.
const STANDING: ContactLimits = ContactLimits {
    speed: 40.0,
    height: 6.0,
    seconds: 0.05,
};
/// Over this time, seconds, what holds a foot fades before and after it stands.
const FADE: f64 = 0.15;
/// A leg is stretched to this share of its length at most, if it is not already.
const REACH: f64 = 0.9995;
/// The weight of the mean side of the knee against its bend in a frame, cm: the knee of a straight
/// leg keeps its plane.
const HINGE: f64 = 2.0;
/// From the ankle to the ball of the foot it is this far at least, cm.
const LEAST_FOOT: f64 = 4.0;

/// The three joints whose points a leg is.
const LEGS: [[usize; 3]; 2] = [
    [joint::LHIP, joint::LKNEE, joint::LFOOT],
    [joint::RHIP, joint::RKNEE, joint::RFOOT],
];

/// A leg of two clips.
#[derive(Debug, Clone)]
pub(super) struct Leg {
    /// Hip, knee and ankle.
    bones: [usize; 3],
    /// The point that stands: the ball of the foot, else the ankle.
    sole: usize,
    /// Points that go with the thigh, the shin and the foot, the last with the ankle.
    segments: [Vec<usize>; 3],
    /// When the foot stands in each clip.
    contacts: [Vec<Range<usize>>; 2],
}

/// The legs of which the points are known.
pub(super) fn legs(clips: [&Clip; 2], tree: &BoneTree) -> Vec<Leg> {
    LEGS.iter()
        .filter_map(|joints| Leg::new(clips, tree, *joints))
        .collect()
}

impl Leg {
    fn new(clips: [&Clip; 2], tree: &BoneTree, joints: [usize; 3]) -> Option<Leg> {
        let single = |j: usize| match clips[0].joints.of(j) {
            [point] => Some(*point),
            _ => None,
        };
        let [hip, knee, ankle] = [single(joints[0])?, single(joints[1])?, single(joints[2])?];
        if !(tree.hangs_on(ankle, knee) && tree.hangs_on(knee, hip)) {
            return None;
        }
        let track = |clip: &Clip, point: usize| -> Vec<DVec3> {
            let frames = 0..clip.poses.frames() as isize;
            frames.map(|t| clip.point(t, point)).collect()
        };
        let length = |p: usize| {
            let gap = |t: isize| (clips[0].point(t, p) - clips[0].point(t, ankle)).length();
            (0..clips[0].poses.frames() as isize)
                .map(gap)
                .find(|l| l.is_finite())
                .unwrap_or(0.0)
        };
        let ball = tree.children(ankle).find(|p| length(*p) >= LEAST_FOOT);
        let sole = ball.unwrap_or(ankle);
        let points = 0..clips[0].poses.points.len();
        let below = |p: usize| points.clone().filter(move |q| tree.hangs_on(*q, p));
        Some(Leg {
            bones: [hip, knee, ankle],
            sole,
            segments: [
                below(hip)
                    .filter(|p| !tree.hangs_on(*p, knee) && *p != hip)
                    .collect(),
                below(knee)
                    .filter(|p| !tree.hangs_on(*p, ankle) && *p != knee)
                    .collect(),
                below(ankle).collect(),
            ],
            contacts: clips.map(|clip| contacts(&track(clip, sole), clip.rate, &STANDING)),
        })
    }

    /// The steps, of those in `reach`, in which the foot stands in the clip that leads:
    /// `leader` tells it and its frame.
    pub(super) fn standing(
        &self,
        reach: Range<isize>,
        leader: impl Fn(isize) -> (usize, isize),
    ) -> Vec<Range<isize>> {
        let stands = |k: &isize| {
            let (clip, frame) = leader(*k);
            let frame = usize::try_from(frame).unwrap_or(usize::MAX);
            self.contacts[clip].iter().any(|c| c.contains(&frame))
        };
        ranges(reach.filter(stands))
    }

    /// How far the sole goes over the ground from one frame of a clip to another.
    pub(super) fn way(&self, clip: &Clip, frames: [f64; 2]) -> DVec3 {
        let [from, to] = frames.map(|t| point_at(clip, t, self.sole).with_y(0.0));
        to - from
    }

    /// Where the sole is, on the ground.
    pub(super) fn position(&self, pose: &[DVec3]) -> DVec3 {
        pose[self.sole].with_y(0.0)
    }

    /// Holds the foot through the poses of the steps, of which the first and the last stay as they
    /// are. `standing` are steps; `ways` is how far the foot goes by itself from the step before
    /// each while it stands: it may roll.
    pub(super) fn plant(
        &self,
        poses: &mut [Vec<DVec3>],
        standing: &[Range<isize>],
        ways: &[DVec3],
        rate: f64,
    ) {
        let last = poses.len() - 1;
        let mut held: Vec<Range<usize>> = std::iter::once(0..1).collect();
        let mut offsets = vec![DVec3::ZERO; poses.len()];
        let mut weights = vec![0.0; poses.len()];
        let mut path = vec![DVec3::ZERO; poses.len()];
        (1..poses.len()).for_each(|k| path[k] = path[k - 1] + ways[k]);
        for range in standing {
            let inside = range.start.max(1) as usize..(range.end.max(1) as usize).min(last);
            if inside.is_empty() {
                continue;
            }
            let from_path = |k: usize| self.position(&poses[k]) - path[k];
            let (first, end) = (from_path(0), from_path(last));
            // What stands at an end of the blend stands there; through all of it, where both ends
            // differ, it goes from one to the other.
            let start = |k: usize| match (range.start <= 1, range.end >= last as isize) {
                (true, false) => first,
                (false, true) => end,
                (true, true) => first.lerp(end, smooth(k as f64 / last as f64)),
                (false, false) => {
                    inside.clone().map(from_path).sum::<DVec3>() / inside.len() as f64
                }
            };
            for k in inside.clone() {
                (offsets[k], weights[k]) = (start(k) - from_path(k), 1.0);
            }
            held.push(inside);
        }
        held.push(last..last + 1);
        if offsets.iter().any(|o| !o.is_finite()) {
            return;
        }
        let longest = (FADE * rate).round() as usize;
        fade(&held, longest, &mut offsets, &mut weights);
        let bones = |pose: &[DVec3]| TwoBones {
            hip: pose[self.bones[0]],
            knee: pose[self.bones[1]],
            ankle: pose[self.bones[2]],
        };
        let bends = poses.iter().map(|pose| bones(pose).bend());
        let hinge = bends.sum::<DVec3>().normalize_or_zero() * HINGE;
        for (pose, offset) in poses.iter_mut().zip(offsets) {
            if offset != DVec3::ZERO {
                let own = bones(pose);
                self.carry(pose, own, offset, hinge);
            }
        }
    }

    /// Carries the foot by `offset`; the leg follows.
    fn carry(&self, pose: &mut [DVec3], own: TwoBones, offset: DVec3, hinge: DVec3) {
        let goal = own.ankle + offset;
        let moved = (offset.length() / HINGE).min(1.0);
        let Some(reached) = own.reach(goal, own.bend() + moved * hinge, REACH) else {
            return;
        };
        let knee = own.hip + reached.upper * (own.knee - own.hip);
        let [thigh, shin, foot] = &self.segments;
        thigh
            .iter()
            .for_each(|p| pose[*p] = own.hip + reached.upper * (pose[*p] - own.hip));
        shin.iter()
            .for_each(|p| pose[*p] = knee + reached.lower * (pose[*p] - own.knee));
        foot.iter()
            .for_each(|p| pose[*p] += reached.ankle - own.ankle);
        pose[self.bones[1]] = knee;
    }
}

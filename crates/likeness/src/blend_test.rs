//! Whether a transition is good: blending the clips there keeps bone lengths, foot contacts and
//! accelerations within the clips' own ranges.
//!
//! Each measure is a share of its limit; a transition is good where none is above 1. Speeds and
//! accelerations are taken over frames 1/30 s apart (`STEP_SECONDS`), so that they mean the same
//! at any rate and the noise of single frames counts less:
//!
//! - Bones: how far a bone's length leaves the range of both clips, over `BONE_SLACK` of the
//!   length. Bones of ASF files never vary; without a slack no blend would be good.
//! - Feet: the speed of a foot while it is planted in the clip of more weight, over `SLIDING`. A
//!   foot is planted where it moves by less than `PLANTED_SPEED` within `PLANTED_HEIGHT` of the
//!   lowest that it is in its clip.
//! - Acceleration: the largest of each joint, over the largest of that joint in either clip.
//!
//! What is not seen, such as accelerations at the ends of a clip, counts as within its limit.
//! People may judge otherwise: this is a rule instead of them.

use super::clip::Clip;
use super::joint_map::{PARENTS, joint};
use glam::DVec3;
use std::ops::RangeInclusive;

/// By how much of its length a bone may leave its range.
pub(crate) const BONE_SLACK: f64 = 0.05;
/// The speed below which a low foot is planted, cm/s. In walks of CMU ankles stay below it a third
/// of the time, and swing with some 400.
pub(crate) const PLANTED_SPEED: f64 = 20.0;
/// The height above the clip's lowest up to which a slow foot is planted, cm: an ankle rises by
/// some 8 while the toes stay.
pub(crate) const PLANTED_HEIGHT: f64 = 10.0;
/// The speed that a planted foot may have in the blend, cm/s: half as much again, since the feet of
/// clips that begin or end to stand have it too.
pub(crate) const SLIDING: f64 = 30.0;
/// The time between the frames of which speeds and accelerations are taken, seconds.
pub(crate) const STEP_SECONDS: f64 = 1.0 / 30.0;

/// What rounding may add to a share: a clip that goes over into its own moved copy is as good as
/// the clip.
const ROUNDING: f64 = 1e-6;

/// The joints that are feet.
const FEET: [usize; 2] = [joint::LFOOT, joint::RFOOT];

/// Two clips joined, from inside. Offsets count frames from the transition.
pub trait BlendedClips {
    /// The clips: first a, then b.
    fn clips(&self) -> [&Clip; 2];
    /// The offsets at which the clips are blended.
    fn span(&self) -> RangeInclusive<isize>;
    /// Where a joint is, cm: in clip a before the span, in the moved clip b after it; NaN where
    /// there is no such frame.
    fn joint(&self, offset: isize, joint: usize) -> DVec3;
    /// The clip of more weight (0: a, 1: b), and its frame.
    fn source(&self, offset: isize) -> (usize, isize);
}

/// What a clip does by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipRange {
    /// The least and the greatest distance of each joint to its parent, cm.
    bones: [[f64; 2]; 16],
    /// The largest acceleration of each joint, cm/s².
    accelerations: [f64; 16],
    /// The least height of each foot, cm.
    lowest: [f64; 2],
}

impl ClipRange {
    /// Measures a clip. Frames that lack a joint are left out.
    pub fn measure(clip: &Clip) -> ClipRange {
        let frames = 0..clip.poses.frames() as isize;
        let step = clip.frames_in(STEP_SECONDS) as isize;
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let bone = |j: usize| {
            let lengths = (frames.clone())
                .map(|t| (clip.joint(t, j) - clip.joint(t, PARENTS[j])).length())
                .filter(|l| l.is_finite());
            lengths.fold([f64::INFINITY, 0.0], |[low, high], l| {
                [low.min(l), high.max(l)]
            })
        };
        let acceleration = |j: usize| {
            let frames = clip.runs.iter().flat_map(|run| {
                run.start as isize + step..(run.end as isize - step).max(run.start as isize + step)
            });
            largest(&mut frames.map(|t| acceleration(|t| clip.joint(t, j), t, step, clip.rate)))
        };
        ClipRange {
            bones: std::array::from_fn(bone),
            accelerations: std::array::from_fn(acceleration),
            lowest: FEET.map(|j| {
                let heights = frames.clone().map(|t| clip.joint(t, j).y);
                heights.fold(f64::INFINITY, f64::min)
            }),
        }
    }
}

/// How a blend compares with its clips: shares of limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlendQuality {
    /// The share for bone lengths.
    pub bones: f64,
    /// The share for planted feet.
    pub feet: f64,
    /// The share for accelerations.
    pub acceleration: f64,
}

impl BlendQuality {
    /// Measures `blend`, whose clips have the ranges `ranges`.
    pub fn measure(blend: &impl BlendedClips, ranges: [&ClipRange; 2]) -> BlendQuality {
        let mut quality = BlendQuality {
            bones: 0.0,
            feet: 0.0,
            acceleration: 0.0,
        };
        for offset in blend.span() {
            quality.bones = quality.bones.max(bones(blend, ranges, offset));
            quality.feet = quality.feet.max(feet(blend, ranges, offset));
            let acceleration = accelerations(blend, ranges, offset);
            quality.acceleration = quality.acceleration.max(acceleration);
        }
        quality
    }

    /// Whether no limit is passed.
    pub fn is_good(&self) -> bool {
        [self.bones, self.feet, self.acceleration]
            .iter()
            .all(|share| *share <= 1.0 + ROUNDING)
    }
}

/// The worst bone, `offset` frames from the transition.
fn bones(blend: &impl BlendedClips, ranges: [&ClipRange; 2], offset: isize) -> f64 {
    let excess = |j: usize| {
        let length = (blend.joint(offset, j) - blend.joint(offset, PARENTS[j])).length();
        let [a, b] = ranges.map(|range| range.bones[j]);
        let (low, high) = (a[0].min(b[0]), a[1].max(b[1]));
        let slack = BONE_SLACK * 0.5 * (low + high);
        share((low - length).max(length - high).max(0.0), slack)
    };
    (1..16).map(excess).fold(0.0, f64::max)
}

/// The faster planted foot.
fn feet(blend: &impl BlendedClips, ranges: [&ClipRange; 2], offset: isize) -> f64 {
    let (leader, at) = blend.source(offset);
    let clip = blend.clips()[leader];
    let step = clip.frames_in(STEP_SECONDS) as isize;
    let speed = |joint: &dyn Fn(isize) -> DVec3, t: isize| {
        (joint(t + step) - joint(t - step)).length() * clip.rate / (2 * step) as f64
    };
    let share = |(k, j): (usize, usize)| {
        let is_low = clip.joint(at, j).y <= ranges[leader].lowest[k] + PLANTED_HEIGHT;
        let is_planted = is_low && speed(&|t| clip.joint(t, j), at) <= PLANTED_SPEED;
        if is_planted {
            speed(&|k| blend.joint(k, j), offset) / SLIDING
        } else {
            0.0
        }
    };
    FEET.into_iter().enumerate().map(share).fold(0.0, f64::max)
}

/// The joint of the largest acceleration against its limit.
fn accelerations(blend: &impl BlendedClips, ranges: [&ClipRange; 2], offset: isize) -> f64 {
    let [a, _] = blend.clips();
    let step = a.frames_in(STEP_SECONDS) as isize;
    let of = |j: usize| {
        let limit = ranges[0].accelerations[j].max(ranges[1].accelerations[j]);
        share(
            acceleration(|k| blend.joint(k, j), offset, step, a.rate),
            limit,
        )
    };
    (0..16).map(of).fold(0.0, f64::max)
}

/// The acceleration of a joint at `t`, from frames `step` apart; NaN where one is missing.
fn acceleration(joint: impl Fn(isize) -> DVec3, t: isize, step: isize, rate: f64) -> f64 {
    let second = joint(t + step) - 2.0 * joint(t) + joint(t - step);
    second.length() * (rate / step as f64).powi(2)
}

/// `value` over `limit`; a limit of 0 allows what rounding does.
fn share(value: f64, limit: f64) -> f64 {
    value / limit.max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::tests::stroll;
    use crate::cross_fade::CrossFade;
    use crate::testdata::{own_names, standing, take_of};

    fn quality(a: &Clip, b: &Clip, frames: [usize; 2], half: usize) -> BlendQuality {
        let ranges = [a, b].map(ClipRange::measure);
        BlendQuality::measure(
            &CrossFade::new([a, b], frames, half),
            [&ranges[0], &ranges[1]],
        )
    }

    /// A clip at 30 frames a second.
    fn clip(poses: &[[DVec3; 16]]) -> Clip {
        Clip::new(take_of(poses), 30.0, &own_names()).unwrap()
    }

    #[test]
    fn a_clip_that_goes_on_as_it_was_is_good() {
        let a = stroll(90, 30.0, 0.0);
        let found = quality(&a, &a, [40, 40], 5);
        assert!(found.is_good() && found.acceleration > 0.0, "{found:?}");
        assert!(found.bones < 1e-6);
    }

    #[test]
    fn an_arm_that_folds_is_a_bone_that_shortens() {
        let still = clip(&[standing(); 40]);
        let mut down = standing();
        down[joint::LELBOW] = down[joint::LSHOULDER] - DVec3::new(0.0, 30.0, 0.0);
        down[joint::LHAND] = down[joint::LELBOW] - DVec3::new(0.0, 25.0, 0.0);
        let found = quality(&still, &clip(&[down; 40]), [20, 20], 5);
        // Half way the bones have 1/√2 of their length: 0.29 of it are lost.
        let lost = 1.0 - 0.5_f64.sqrt();
        assert!((found.bones - lost / BONE_SLACK).abs() < 1e-6, "{found:?}");
        assert!(!found.is_good());
        assert!(found.feet < 1e-6);
    }

    #[test]
    fn a_planted_foot_that_is_drawn_aside_slides() {
        let mut wide = standing();
        for j in [joint::LKNEE, joint::LFOOT] {
            wide[j].x += 10.0;
        }
        let found = quality(&clip(&[standing(); 40]), &clip(&[wide; 40]), [20, 20], 5);
        // 10 cm in 1/3 s by a smoothstep: at most 1.5 times the mean of 30 cm/s, here over two
        // frames.
        assert!((1.3..1.5).contains(&found.feet), "{found:?}");
        // Feet in the air may do so.
        let raised = |mut pose: [DVec3; 16]| {
            pose.iter_mut().for_each(|p| p.y += 50.0);
            pose
        };
        let jump = |pose| {
            let mut poses = [raised(pose); 40];
            poses[0] = pose;
            clip(&poses)
        };
        let found = quality(&jump(standing()), &jump(wide), [20, 20], 5);
        assert_eq!(found.feet, 0.0);
    }

    #[test]
    fn two_still_poses_that_differ_need_an_acceleration_that_neither_has() {
        let mut bowed = standing();
        bowed[joint::HEAD].z += 1.0;
        let found = quality(&clip(&[standing(); 40]), &clip(&[bowed; 40]), [20, 20], 5);
        assert!(found.acceleration > 1.0 && !found.is_good(), "{found:?}");
        assert!(found.bones < 1.0);
    }

    #[test]
    fn measures_that_are_not_numbers_are_not_good() {
        let nan = BlendQuality {
            bones: 0.0,
            feet: f64::NAN,
            acceleration: 0.0,
        };
        assert!(!nan.is_good());
    }
}

//! The plain joint of two clips: the second is moved and turned to where the first is, and over
//! some frames the points go from those of the first to those of the second.
//!
//! ```text
//! p(k) = (1 - w(k)) a(i + k) + w(k) (Ry(turn) (b(j + k) - hip_b(j)) + hip_a(i))
//! w(k) = 3 u² - 2 u³,  u = (k + h) / 2 h,  limited to 0 and 1
//! ```
//!
//! i and j are the frames of the transition, k counts frames from them, h is half the cross-fade.
//! The turn about the vertical carries the yaw of b at j to that of a at i; the hips are their
//! positions on the ground, so heights stay. Averages of positions shorten bones where the poses
//! differ: [`super::blend_test`] measures it. That makes it a test of how alike the poses are;
//! `Blender` joins clips that are to be looked at.

use super::blend_test::BlendedClips;
use super::body_frame;
use super::clip::Clip;
use super::joint_map::joint;
use glam::{DQuat, DVec3};
use std::ops::RangeInclusive;

/// A turn about the vertical and a move on the ground.
#[derive(Debug, Clone, Copy)]
struct Alignment {
    turn: DQuat,
    from: DVec3,
    to: DVec3,
}

impl Alignment {
    /// The one that carries frame `j` of `b` to frame `i` of `a`.
    fn new(a: &Clip, i: usize, b: &Clip, j: usize) -> Alignment {
        let ground = |clip: &Clip, t: usize| {
            let hip = clip.joint(t as isize, joint::HIP);
            DVec3::new(hip.x, 0.0, hip.z)
        };
        let yaw = |clip: &Clip, t: usize| {
            let across = clip.joint(t as isize, joint::LHIP) - clip.joint(t as isize, joint::RHIP);
            body_frame::yaw(across)
        };
        Alignment {
            turn: DQuat::from_rotation_y(yaw(a, i) - yaw(b, j)),
            from: ground(b, j),
            to: ground(a, i),
        }
    }

    fn apply(&self, p: DVec3) -> DVec3 {
        self.turn * (p - self.from) + self.to
    }
}

/// A clip that goes over into another: points are blended linearly, with a weight that rises
/// smoothly over `2 half` frames. The second clip is turned about the vertical and moved on the
/// ground, so that the hips meet at the transition.
#[derive(Debug, Clone, Copy)]
pub struct CrossFade<'a> {
    /// The clips: first a, then b.
    pub clips: [&'a Clip; 2],
    /// The frame of each clip at which the transition is, from 0.
    pub frames: [usize; 2],
    /// Frames of the cross-fade before and after the transition, one at least.
    pub half: usize,
    alignment: Alignment,
}

impl<'a> CrossFade<'a> {
    /// The transition from one clip to another at a frame of each, with `half` frames of cross-fade
    /// before and after it.
    ///
    /// Both clips should be able to fade there ([`Clip::can_fade`]); points are missing where they
    /// do not.
    pub fn new(clips: [&'a Clip; 2], frames: [usize; 2], half: usize) -> CrossFade<'a> {
        CrossFade {
            clips,
            frames,
            half: half.max(1),
            alignment: Alignment::new(clips[0], frames[0], clips[1], frames[1]),
        }
    }

    /// The weight of clip b, `offset` frames from the transition: 0 before the cross-fade, 1 after
    /// it.
    pub(crate) fn weight(&self, offset: isize) -> f64 {
        let half = self.half as f64;
        let u = ((offset as f64 + half) / (2.0 * half)).clamp(0.0, 1.0);
        u * u * (3.0 - 2.0 * u)
    }

    /// A point of the blend, `offset` frames from the transition, cm. At weight 0 it is that of
    /// clip a, at weight 1 that of the moved clip b, exactly; between them it is missing where
    /// either clip lacks it.
    pub(crate) fn point(&self, offset: isize, point: usize) -> DVec3 {
        let of = |clip: usize| {
            let frame = self.frames[clip] as isize + offset;
            self.clips[clip].point(frame, point)
        };
        let moved = || self.alignment.apply(of(1));
        match self.weight(offset) {
            0.0 => of(0),
            1.0 => moved(),
            weight => of(0).lerp(moved(), weight),
        }
    }
}

impl BlendedClips for CrossFade<'_> {
    fn clips(&self) -> [&Clip; 2] {
        self.clips
    }

    fn span(&self) -> RangeInclusive<isize> {
        -(self.half as isize)..=self.half as isize
    }

    fn joint(&self, offset: isize, joint: usize) -> DVec3 {
        let points = self.clips[0].joints.of(joint).iter();
        let sum: DVec3 = points.clone().map(|p| self.point(offset, *p)).sum();
        sum / points.len() as f64
    }

    fn source(&self, offset: isize) -> (usize, isize) {
        let clip = usize::from(self.weight(offset) >= 0.5);
        (clip, self.frames[clip] as isize + offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::tests::stroll;

    #[test]
    fn before_the_cross_fade_is_a_and_after_it_moved_b() {
        let (a, b) = (stroll(60, 30.0, 0.0), stroll(50, 30.0, 0.4));
        let fade = CrossFade::new([&a, &b], [20, 30], 5);
        for t in 0..=15 {
            assert_eq!(fade.point(t - 20, 3), a.point(t, 3));
        }
        for t in 25..40 {
            // Distances and heights are those of b.
            let (p, q) = (fade.joint(t - 20, 3), fade.joint(t - 20, 15));
            let (own_p, own_q) = (b.joint(t + 10, 3), b.joint(t + 10, 15));
            assert!(((p - q).length() - (own_p - own_q).length()).abs() < 1e-9);
            assert_eq!(p.y, own_p.y);
        }
        let hip = |clip: &Clip, t| clip.joint(t, joint::HIP);
        let placed = fade.alignment.apply(hip(&b, 30)) - hip(&a, 20);
        assert!(placed.x.abs() + placed.z.abs() < 1e-9);
    }

    #[test]
    fn weights_rise_from_0_to_1_and_are_even_about_the_transition() {
        let a = stroll(30, 30.0, 0.0);
        let fade = CrossFade::new([&a, &a], [15, 15], 4);
        assert_eq!(
            [-9, -4, 0, 4, 9].map(|k| fade.weight(k)),
            [0., 0., 0.5, 1., 1.]
        );
        for k in -4..4 {
            assert!(fade.weight(k) < fade.weight(k + 1));
            assert!((fade.weight(k) + fade.weight(-k) - 1.0).abs() < 1e-12);
        }
    }
}

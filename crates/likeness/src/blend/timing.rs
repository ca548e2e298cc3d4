//! Which frames of two clips are blended at each step: both go at one cadence.
//!
//! Clip b runs `pace` frames for a frame of clip a. Over the blend the steps go from those of a to
//! those of b: `da = 1 / (1 - w + w pace)`, `db = pace da`, so that each clip has its own pace
//! where it alone counts.

use crate::body_frame::yaw;
use crate::clip::Clip;
use crate::joint_map::joint;
use glam::{DQuat, DVec3};

/// Paces that are tried: these powers of 2, in steps of a twelfth.
const PACES: std::ops::RangeInclusive<i32> = -12..=12;
/// What a pace costs more for each power of 2 squared, as a share.
const UNEVEN: f64 = 0.3;
/// Seconds to either side of the transition over which a pace is judged.
const JUDGED: f64 = 0.4;
/// Poses to either side that are compared.
const COMPARED: i32 = 6;

/// The frames of the steps of a blend, from 0 to its last.
#[derive(Debug, Clone)]
pub(super) struct Timing {
    /// The frame of clip a, whole at the first step.
    pub a: Vec<f64>,
    /// The frame of clip b, whole at the last step.
    pub b: Vec<f64>,
    /// The weight of clip b, 0 to 1.
    pub weights: Vec<f64>,
    /// Frames of clip b for a frame of clip a.
    pub pace: f64,
}

/// From 0 to 1 with no speed at the ends.
pub(super) fn smooth(u: f64) -> f64 {
    u * u * (3.0 - 2.0 * u)
}

impl Timing {
    /// The steps of a blend with the transition in its middle, `half` steps from either end.
    /// `None`: the clips do not go on for so long.
    pub(super) fn new(
        clips: [&Clip; 2],
        frames: [usize; 2],
        half: usize,
        pace: f64,
    ) -> Option<Timing> {
        let steps = 2 * half;
        let [i, j] = frames.map(|t| t as f64);
        let weight = |k: f64| smooth(k / steps as f64);
        let mut ways = vec![0.0];
        for k in 0..steps {
            let w = weight(k as f64 + 0.5);
            ways.push(ways[k] + 1.0 / (1.0 - w + w * pace));
        }
        let first = (i - ways[half]).round();
        let a: Vec<f64> = ways.iter().map(|way| first + way).collect();
        let weights: Vec<f64> = (0..=steps).map(|k| weight(k as f64)).collect();
        let mut b: Vec<f64> = a.iter().map(|a| j + pace * (a - i)).collect();
        let left = b[steps].round() - b[steps];
        b.iter_mut().zip(&weights).for_each(|(b, w)| *b += w * left);
        let goes_on = |clip: &Clip, frame: usize, steps: &[f64]| {
            let run = clip.runs.iter().find(|run| run.contains(&frame));
            run.is_some_and(|run| {
                steps[0] >= run.start as f64 && steps[steps.len() - 1] <= (run.end - 1) as f64
            })
        };
        (goes_on(clips[0], frames[0], &a) && goes_on(clips[1], frames[1], &b)).then_some(Timing {
            a,
            b,
            weights,
            pace,
        })
    }

    /// The number of steps.
    pub(super) fn steps(&self) -> usize {
        self.a.len() - 1
    }
}

/// A point at a time between two frames, cm.
pub(super) fn point_at(clip: &Clip, frame: f64, point: usize) -> DVec3 {
    let (before, share) = (frame.floor(), frame.fract());
    let own = clip.point(before as isize, point);
    match share {
        0.0 => own,
        share => own.lerp(clip.point(before as isize + 1, point), share),
    }
}

/// The yaw of the body in a frame, radians.
pub(super) fn yaw_at(clip: &Clip, frame: f64) -> f64 {
    let frame = frame.round() as isize;
    yaw(clip.joint(frame, joint::LHIP) - clip.joint(frame, joint::RHIP))
}

/// The pace of clip b about a transition: that at which its poses before and after are most like
/// those of clip a.
pub(super) fn pace(clips: [&Clip; 2], frames: [usize; 2]) -> f64 {
    let reach = JUDGED * clips[0].rate / f64::from(COMPARED);
    let pose = |clip: &Clip, frame: f64| -> [DVec3; 16] {
        let frame = frame.round();
        let turn = DQuat::from_rotation_y(-yaw_at(clip, frame));
        let hip = clip.joint(frame as isize, joint::HIP);
        std::array::from_fn(|j| turn * (clip.joint(frame as isize, j) - hip))
    };
    let cost = |pace: f64| {
        let (mut sum, mut count) = (0.0, 0);
        for k in -COMPARED..=COMPARED {
            let way = f64::from(k) * reach;
            let own = pose(clips[0], frames[0] as f64 + way);
            let other = pose(clips[1], frames[1] as f64 + pace * way);
            let squares = own
                .iter()
                .zip(other)
                .map(|(p, q)| (*p - q).length_squared());
            let square: f64 = squares.sum();
            if square.is_finite() {
                sum += square;
                count += 1;
            }
        }
        let mean = sum / f64::from(count) * (1.0 + UNEVEN * pace.log2().powi(2));
        // One to each side at least, and few lost at the ends.
        if count > COMPARED {
            mean
        } else {
            f64::INFINITY
        }
    };
    let paces = PACES.map(|k| f64::from(k) / 12.0).map(f64::exp2);
    let costs = paces.map(|pace| (pace, cost(pace)));
    // Where two cost the same, the pace that changes nothing.
    let one = (1.0, cost(1.0));
    let best = costs.fold(one, |best, own| if own.1 < best.1 { own } else { best });
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::tests::stroll;

    #[test]
    fn steps_go_from_those_of_one_clip_to_those_of_the_other() {
        let (a, b) = (stroll(200, 30.0, 0.0), stroll(200, 30.0, 0.0));
        let timing = Timing::new([&a, &b], [100, 80], 20, 0.6).unwrap();
        let n = timing.steps();
        assert_eq!(
            (n, timing.a[0].fract(), timing.b[n].fract()),
            (40, 0.0, 0.0)
        );
        let step = |t: &[f64], k: usize| t[k + 1] - t[k];
        assert!((step(&timing.a, 0) - 1.0).abs() < 0.01);
        assert!((step(&timing.b, n - 1) - 1.0).abs() < 0.02);
        for k in 0..n {
            let pace = step(&timing.b, k) / step(&timing.a, k);
            assert!((pace - 0.6).abs() < 0.04, "{pace}");
        }
        assert!(Timing::new([&a, &b], [100, 10], 20, 0.6).is_none());
        let even = Timing::new([&a, &b], [100, 80], 20, 1.0).unwrap();
        assert_eq!((even.a[0], even.b[0], even.b[n]), (80.0, 60.0, 100.0));
    }

    #[test]
    fn a_clip_at_another_rate_has_its_pace() {
        // The same wave of the hand, in fewer frames.
        let (a, b) = (stroll(200, 30.0, 0.0), stroll(130, 20.0, 0.0));
        let b = Clip { rate: 30.0, ..b };
        assert!((pace([&a, &b], [90, 60]) - 2.0 / 3.0).abs() < 0.05);
        assert_eq!(pace([&a, &a], [90, 90]), 1.0);
    }
}

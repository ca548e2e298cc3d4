//! Rotations that were solved for, beside those that time alone gives.
//!
//! Where a rotation is missing for some frames, a cubic from the frames before to those after is a
//! second estimate of it: in the rotation vectors from the last frame, with the speeds at both
//! ends. A fifth of it makes solutions no worse on the whole and small motions twice as good. A
//! solution that leaves the straight way (slerp) farther than the joint ever does in the take was
//! led astray, and the straight way takes its place.

use super::tuning::rotation_paths::*;
use crate::io::Bvh;
use crate::pose::Channel;
use crate::pose::rotation::{Axis, compose, decompose, from_rotation_vector, rotation_vector};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};
use std::f64::consts::TAU;
use std::ops::Range;

/// Mixes the rotations of `motion` (frames, channels; radians) that `bvh` lacks with the cubics
/// through the frames around them, where `is_meant` says so of their first frame and channel; what
/// was not solved for follows the cubic alone. Those of joints with other than three angles, and
/// those at an end of the take, stay as they are.
pub fn mix_with_paths(
    bvh: &Bvh,
    is_meant: impl Fn(usize, usize) -> bool,
    motion: &mut Array2<f64>,
) {
    let mut first = 0;
    for joint in &bvh.joints {
        let rotations = RotationChannels::of(&joint.channels, first);
        first += joint.channels.len();
        let Some(rotations) = rotations else { continue };
        for frames in rotations.gaps(bvh.motion.view()) {
            if is_meant(frames.start, rotations.columns[0]) {
                rotations.mix(bvh.motion.view(), frames, motion);
            }
        }
    }
}

/// The three rotation channels of a joint.
struct RotationChannels {
    columns: [usize; 3],
    axes: [Axis; 3],
}

impl RotationChannels {
    fn of(channels: &[Channel], first: usize) -> Option<RotationChannels> {
        let rotation = |(c, channel): (usize, &Channel)| match channel {
            Channel::Rotate(axis) => Some((first + c, *axis)),
            _ => None,
        };
        let all: Vec<(usize, Axis)> = channels.iter().enumerate().filter_map(rotation).collect();
        let [a, b, c] = all[..] else { return None };
        Some(RotationChannels {
            columns: [a.0, b.0, c.0],
            axes: [a.1, b.1, c.1],
        })
    }

    fn angles(&self, motion: ArrayView2<'_, f64>, t: usize) -> [f64; 3] {
        self.columns.map(|c| motion[[t, c]])
    }

    /// The rotation in a frame: the last named turns first.
    fn rotation(&self, motion: ArrayView2<'_, f64>, t: usize) -> DMat3 {
        let [a, b, c] = self.angles(motion, t);
        let [i, j, k] = self.axes;
        compose(&[k, j, i], &[c, b, a])
    }

    fn is_known(&self, motion: ArrayView2<'_, f64>, t: usize) -> bool {
        self.angles(motion, t).iter().all(|v| v.is_finite())
    }

    /// Runs of frames without the rotation, between frames that have it.
    fn gaps(&self, motion: ArrayView2<'_, f64>) -> Vec<Range<usize>> {
        let mut out: Vec<Range<usize>> = Vec::new();
        for t in (0..motion.nrows()).filter(|t| !self.is_known(motion, *t)) {
            match out.last_mut().filter(|last| last.end == t) {
                Some(last) => last.end = t + 1,
                None => out.push(t..t + 1),
            }
        }
        out.retain(|gap| gap.start > 0 && gap.end < motion.nrows());
        out
    }

    /// The cubic over the frames `gap` from those around them; `None` where these lack the rotation
    /// too.
    fn cubic(&self, motion: ArrayView2<'_, f64>, gap: &Range<usize>) -> Option<Vec<DMat3>> {
        let (start, end) = (gap.start.checked_sub(1)?, gap.end);
        if end >= motion.nrows() || ![start, end].iter().all(|t| self.is_known(motion, *t)) {
            return None;
        }
        let base = self.rotation(motion, start);
        let from_base = |t: usize| rotation_vector(&(base.transpose() * self.rotation(motion, t)));
        let steps = (end - start) as f64;
        let to = from_base(end);
        let all_known = |frames: Range<usize>| frames.into_iter().all(|t| self.is_known(motion, t));
        let before = (1..=SIDE.min(start)).rev();
        let before = before.into_iter().find(|k| all_known(start - k..start));
        let after = (1..=SIDE.min(motion.nrows() - 1 - end)).rev();
        let after = after.into_iter().find(|k| all_known(end + 1..end + k + 1));
        let speed_before = before.map(|k| -from_base(start - k) / k as f64);
        let speed_after = after.map(|k| (nearest_turn(from_base(end + k), to) - to) / k as f64);
        let straight = to / steps;
        let speed = |own: Option<DVec3>| own.map_or(straight, |own| LASTING * own);
        let (v, w) = (speed(speed_before) * steps, speed(speed_after) * steps);
        let at = |t: usize| {
            let u = (t - start) as f64 / steps;
            let (b, c, d) = (
                u * (1.0 - u).powi(2),
                u * u * (3.0 - 2.0 * u),
                u * u * (u - 1.0),
            );
            base * from_rotation_vector(v * b + to * c + w * d)
        };
        Some(gap.clone().map(at).collect())
    }

    /// The straight way over the frames `gap`, whose ends are known.
    fn straight(&self, motion: ArrayView2<'_, f64>, gap: &Range<usize>) -> Vec<DMat3> {
        let base = self.rotation(motion, gap.start - 1);
        let to = rotation_vector(&(base.transpose() * self.rotation(motion, gap.end)));
        let steps = (gap.len() + 1) as f64;
        let share = |t: usize| (t + 1 - gap.start) as f64 / steps;
        let at = |t: usize| base * from_rotation_vector(to * share(t));
        gap.clone().map(at).collect()
    }

    /// How far the joint leaves the straight way at most, over segments as long as `gap`
    /// elsewhere; `None` where there is no room.
    fn farthest(&self, motion: ArrayView2<'_, f64>, length: usize) -> Option<f64> {
        let last = motion.nrows().checked_sub(length + 1)?;
        let leaves = |start: usize| {
            let gap = start..start + length;
            let is_whole = (start - 1..=gap.end).all(|t| self.is_known(motion, t));
            is_whole.then(|| {
                let truth: Vec<DMat3> = gap.clone().map(|t| self.rotation(motion, t)).collect();
                apart(&self.straight(motion, &gap), &truth)
            })
        };
        let step = (last / COMPARED).max(1);
        let all = (1..last).step_by(step).filter_map(leaves);
        all.max_by(f64::total_cmp)
    }

    /// Mixes what was solved for over a gap with the cubic.
    fn mix(&self, known: ArrayView2<'_, f64>, gap: Range<usize>, motion: &mut Array2<f64>) {
        let Some(cubic) = self.cubic(known, &gap) else {
            return;
        };
        let is_solved = |t: usize| self.is_known(motion.view(), t);
        let solution = |(n, t): (usize, usize)| match is_solved(t) {
            true => self.rotation(motion.view(), t),
            false => cubic[n],
        };
        let solved: Vec<DMat3> = gap.clone().enumerate().map(solution).collect();
        let straight = self.straight(known, &gap);
        let farthest = self.farthest(known, gap.len());
        let is_astray = farthest.is_some_and(|most| apart(&straight, &solved) > ASTRAY * most);
        for (n, t) in gap.enumerate() {
            let step = rotation_vector(&(cubic[n].transpose() * solved[n])) * SOLVED;
            let mixed = match is_astray {
                true => straight[n],
                false => cubic[n] * from_rotation_vector(step),
            };
            let near = self.angles(motion.view(), t - 1);
            let angles = decompose(&mixed, self.axes, near);
            for (c, angle) in self.columns.iter().zip(angles) {
                motion[[t, *c]] = angle;
            }
        }
    }
}

/// The root-mean-square angle between rotations, radians.
fn apart(a: &[DMat3], b: &[DMat3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| distance(a, b).powi(2));
    (squares.sum::<f64>() / a.len().max(1) as f64).sqrt()
}

/// The angle between two rotations.
fn distance(a: &DMat3, b: &DMat3) -> f64 {
    rotation_vector(&(a.transpose() * *b)).length()
}

/// The vector of the same rotation as `v` that is nearest to `to`.
fn nearest_turn(v: DVec3, to: DVec3) -> DVec3 {
    let long = v.length();
    let other = v * ((long - TAU) / long);
    match long > 1e-9 && other.distance(to) < v.distance(to) {
        true => other,
        false => v,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Input;

    /// A joint that swings about all axes, 120 frames; the frames of `gap` are missing.
    fn swing(gap: Range<usize>) -> (Bvh, Array2<f64>) {
        let row = |t: usize| {
            let s = |speed: f64| 40.0 * (speed * t as f64).sin();
            format!("{} {} {}\n", s(0.11), s(0.07), s(0.13))
        };
        let text = "HIERARCHY\nROOT a\n\
            {\nOFFSET 0 0 0\n\
            CHANNELS 3 Zrotation Xrotation Yrotation\n\
            }\nMOTION\nFrames: 120\n\
            Frame Time: 0.01\n"
            .to_string()
            + &(0..120).map(row).collect::<String>();
        let input = Input::new("t", std::io::Cursor::new(text.into_bytes())).unwrap();
        let mut bvh = Bvh::read(input, 1.0, false).unwrap();
        let truth = bvh.motion.clone();
        for t in gap {
            bvh.motion.row_mut(t).fill(f64::NAN);
        }
        (bvh, truth)
    }

    fn off(motion: &Array2<f64>, truth: &Array2<f64>) -> f64 {
        (motion - truth)
            .iter()
            .map(|d| d.powi(2))
            .sum::<f64>()
            .sqrt()
    }

    #[test]
    fn a_good_solution_stays_good_and_one_astray_becomes_the_straight_way() {
        let (bvh, truth) = swing(40..60);
        let mut good = truth.clone();
        mix_with_paths(&bvh, |_, _| true, &mut good);
        let mut held = truth.clone();
        (40..60).for_each(|t| held.row_mut(t).assign(&truth.row(39)));
        assert!(off(&good, &truth) < 0.1 * off(&held, &truth));
        let mut astray = truth.clone();
        for t in 40..60 {
            astray.row_mut(t).mapv_inplace(|v| v + 2.0);
        }
        mix_with_paths(&bvh, |_, _| true, &mut astray);
        let rotations = RotationChannels::of(&bvh.joints[0].channels, 0).unwrap();
        let straight = rotations.straight(truth.view(), &(40..60));
        for (n, straight) in straight.iter().enumerate() {
            let own = rotations.rotation(astray.view(), 40 + n);
            assert!(distance(&own, straight) < 1e-9);
        }
        // All that was there stays.
        assert!(
            (0..40)
                .chain(60..120)
                .all(|t| astray.row(t) == truth.row(t))
        );
    }

    #[test]
    fn what_lies_at_an_end_stays_and_what_is_not_solved_follows_time() {
        for gap in [0..9, 110..120, 0..120] {
            let (bvh, truth) = swing(gap);
            let mut motion = truth.clone();
            mix_with_paths(&bvh, |_, _| true, &mut motion);
            assert_eq!(motion, truth);
        }
        // What was not solved for: by time alone, where that is meant.
        let (bvh, truth) = swing(40..60);
        let mut open = bvh.motion.clone();
        mix_with_paths(&bvh, |_, _| false, &mut open);
        assert!(open[[50, 0]].is_nan());
        mix_with_paths(&bvh, |t, c| (t, c) == (40, 0), &mut open);
        let mut held = truth.clone();
        (40..60).for_each(|t| held.row_mut(t).assign(&truth.row(39)));
        assert!(off(&open, &truth) < 0.6 * off(&held, &truth));
    }
}

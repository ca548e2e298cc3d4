//! One clip goes over into another by rotations: bones keep their lengths, both clips go at one
//! cadence, and feet that stand stay where they stand.
//!
//! Clip b is turned about the vertical to face as clip a does, in the mean over the blend. Which
//! points hang on which is measured (`bone_tree`); what hangs on a point is turned from a to b on
//! the shortest way. `timing` says which frames of the clips belong together. On the ground the
//! root goes on by the steps of both, weighed, so that its speed goes from one to the other; b is
//! put where that ends. Then feet are planted (`planting`).

mod bone_tree;
mod planting;
mod timing;

use self::bone_tree::BoneTree;
use self::planting::Leg;
use self::timing::{Timing, pace, point_at, yaw_at};
use crate::blend_test::{BlendQuality, BlendedClips, ClipRange};
use crate::clip::Clip;
use crate::joint_map::joint;
use crate::pose::Poses;
use glam::{DQuat, DVec3};
use ndarray::Array2;
use std::ops::RangeInclusive;

/// Seconds of a blend that are tried where none are given.
const OVERS: [f64; 4] = [0.3, 0.5, 0.8, 1.2];
/// Seconds before and after a blend in which feet that stand are looked for.
const AROUND: f64 = 1.0;

/// Two clips that may be blended at any of their frames.
#[derive(Debug, Clone)]
pub struct Blender<'a> {
    clips: [&'a Clip; 2],
    tree: BoneTree,
    legs: Vec<Leg>,
}

/// Two clips, joined.
#[derive(Debug, Clone)]
pub struct Blend<'a> {
    clips: [&'a Clip; 2],
    timing: Timing,
    /// The steps of the blend from its first, a frame of clip a, to its last, one of clip b.
    poses: Vec<Vec<DVec3>>,
    turn: DQuat,
    shift: DVec3,
}

impl<'a> Blender<'a> {
    /// Measures two clips of one rate with the same points.
    pub fn new(clips: [&'a Clip; 2]) -> Blender<'a> {
        // Each joint is the middle of one point at least.
        let root = clips[0].joints.of(joint::HIP).first().copied().unwrap_or(0);
        let tree = BoneTree::new(clips, root);
        Blender {
            legs: planting::legs(clips, &tree),
            tree,
            clips,
        }
    }

    /// The blend at a frame of each clip, over `over` seconds; without them over the longest of
    /// some times that gives a good one, else over that which comes nearest to it. `None`: the
    /// clips do not go on for so long, or lack joints there.
    pub fn blend(
        &self,
        frames: [usize; 2],
        over: Option<f64>,
        ranges: [&ClipRange; 2],
    ) -> Option<(Blend<'a>, BlendQuality)> {
        let pace = pace(self.clips, frames);
        let overs = over.map_or(OVERS.to_vec(), |over| vec![over]);
        let worst = |q: &BlendQuality| q.bones.max(q.feet).max(q.acceleration);
        let mut best: Option<(Blend<'a>, BlendQuality)> = None;
        for over in overs {
            let half = self.clips[0].frames_in(over / 2.0);
            let timing = (Timing::new(self.clips, frames, half, pace))
                .or_else(|| Timing::new(self.clips, frames, half, 1.0));
            let Some(blend) = timing.and_then(|timing| self.joined(timing)) else {
                continue;
            };
            let quality = BlendQuality::measure(&blend, ranges);
            let is_better = best.as_ref().is_none_or(|(_, before)| {
                quality.is_good() || !before.is_good() && worst(&quality) < worst(before)
            });
            if is_better {
                best = Some((blend, quality));
            }
        }
        best
    }

    fn joined(&self, timing: Timing) -> Option<Blend<'a>> {
        let turn = self.turn(&timing);
        let steps = timing.steps();
        let pose = |clip: usize, k: usize| -> Vec<DVec3> {
            let (frame, turn) = match clip {
                0 => (timing.a[k], DQuat::IDENTITY),
                _ => (timing.b[k], turn),
            };
            let points = 0..self.clips[clip].poses.points.len();
            points
                .map(|p| turn * point_at(self.clips[clip], frame, p))
                .collect()
        };
        let root = self.tree.root;
        let (mut a, mut b) = (pose(0, 0), pose(1, 0));
        let mut position = a[root].with_y(0.0);
        let mut poses = vec![a.clone()];
        for k in 1..=steps {
            let (next_a, next_b) = (pose(0, k), pose(1, k));
            let middle = 0.5 * (timing.weights[k - 1] + timing.weights[k]);
            let way = (next_a[root] - a[root]).lerp(next_b[root] - b[root], middle);
            (a, b) = (next_a, next_b);
            position += way.with_y(0.0);
            let weight = timing.weights[k];
            let height = (1.0 - weight) * a[root].y + weight * b[root].y;
            let at = position.with_y(height);
            poses.push(if k == steps {
                b.iter().map(|p| *p - b[root] + at).collect()
            } else {
                let between = self.tree.between(&a, &b, weight);
                between.into_iter().map(|p| p + at).collect()
            });
        }
        let mut blend = Blend {
            clips: self.clips,
            shift: poses[steps][root] - b[root],
            turn,
            poses,
            timing,
        };
        let is_whole = |k: isize| (0..16).all(|j| blend.joint(k, j).is_finite());
        if !blend.span().all(is_whole) {
            return None;
        }
        self.plant(&mut blend);
        Some(blend)
    }

    /// The turn about the vertical that lets clip b face as clip a does.
    fn turn(&self, timing: &Timing) -> DQuat {
        let [a, b] = self.clips;
        let (mut sin, mut cos) = (0.0, 0.0);
        for (i, j) in timing.a.iter().zip(&timing.b) {
            let (s, c) = (yaw_at(a, *i) - yaw_at(b, *j)).sin_cos();
            if s.is_finite() {
                (sin, cos) = (sin + s, cos + c);
            }
        }
        DQuat::from_rotation_y(f64::atan2(sin, cos))
    }

    fn plant(&self, blend: &mut Blend<'a>) {
        let last = blend.timing.steps() as isize;
        let around = self.clips[0].frames_in(AROUND) as isize;
        let of_leg = |leg: &Leg| leg.standing(-around..last + around + 1, |k| blend.leader(k));
        let standing: Vec<_> = self.legs.iter().map(of_leg).collect();
        let ways: Vec<_> = self.legs.iter().map(|leg| blend.ways(leg)).collect();
        // A foot that stands from before to after the blend says where clip b is.
        let stands_through = |k: &usize| {
            let mut ranges = standing[*k].iter();
            ranges.any(|range| range.start <= 0 && range.end > last)
        };
        if let Some(k) = (0..self.legs.len()).find(stands_through) {
            let [from, to] = [0, last as usize].map(|k| &blend.poses[k]);
            let leg = &self.legs[k];
            let end = leg.position(from) + ways[k].iter().sum::<DVec3>();
            blend.move_end(end - leg.position(to));
        }
        for ((leg, standing), ways) in self.legs.iter().zip(&standing).zip(&ways) {
            leg.plant(&mut blend.poses, standing, ways, self.clips[0].rate);
        }
    }
}

impl Blend<'_> {
    /// Moves clip b by `by`, and the blend with it more and more.
    fn move_end(&mut self, by: DVec3) {
        for (pose, weight) in self.poses.iter_mut().zip(&self.timing.weights) {
            pose.iter_mut().for_each(|p| *p += *weight * by);
        }
        self.shift += by;
    }

    /// The frames of clip a that stay as they are are those up to this one, those of clip b that
    /// are only moved those from the other on.
    pub fn ends(&self) -> [usize; 2] {
        let last = self.timing.steps();
        [self.timing.a[0] as usize, self.timing.b[last] as usize]
    }

    /// Frames of clip b for a frame of clip a while both count.
    pub fn pace(&self) -> f64 {
        self.timing.pace
    }

    /// Seconds of the blend.
    pub fn seconds(&self) -> f64 {
        self.timing.steps() as f64 / self.clips[0].rate
    }

    /// The clip of more weight at a step, and its frame.
    fn leader(&self, step: isize) -> (usize, isize) {
        let last = self.timing.steps();
        let [first, end] = self.ends().map(|t| t as isize);
        match usize::try_from(step) {
            Err(_) => (0, first + step),
            Ok(k) if k > last => (1, end + (k - last) as isize),
            Ok(k) if self.timing.weights[k] < 0.5 => (0, self.timing.a[k].round() as isize),
            Ok(k) => (1, self.timing.b[k].round() as isize),
        }
    }

    /// How far the sole of a leg goes, in the clip of more weight, from the step before each.
    fn ways(&self, leg: &Leg) -> Vec<DVec3> {
        let way = |k: usize| match (k.checked_sub(1), self.leader(k as isize)) {
            (None, _) => DVec3::ZERO,
            (Some(before), (0, _)) => {
                leg.way(self.clips[0], [self.timing.a[before], self.timing.a[k]])
            }
            (Some(before), _) => {
                self.turn * leg.way(self.clips[1], [self.timing.b[before], self.timing.b[k]])
            }
        };
        (0..=self.timing.steps()).map(way).collect()
    }

    /// A point at a step, cm.
    fn point(&self, step: isize, point: usize) -> DVec3 {
        let last = self.timing.steps();
        let [first, end] = self.ends().map(|t| t as isize);
        match usize::try_from(step) {
            Err(_) => self.clips[0].point(first + step, point),
            Ok(k) if k > last => {
                let frame = end + (k - last) as isize;
                self.turn * self.clips[1].point(frame, point) + self.shift
            }
            Ok(k) => self.poses[k][point],
        }
    }

    /// The whole take: clip a up to the blend, the blend, the rest of clip b, with all points.
    /// Times are those of a, and go on with the steps of b; the take has the name `name`.
    pub fn to_poses(&self, name: &str) -> Poses {
        let [a, b] = self.clips;
        let [first, end] = self.ends();
        let last = self.timing.steps();
        let frames = first + last + b.poses.frames() - end;
        let mut xyz = Array2::zeros((frames, a.poses.xyz.ncols()));
        for (mut row, step) in xyz.rows_mut().into_iter().zip(-(first as isize)..) {
            for point in 0..a.poses.points.len() {
                let p = self.point(step, point);
                (0..3).for_each(|axis| row[3 * point + axis] = p[axis]);
            }
        }
        Poses {
            points: a.poses.points.clone(),
            xyz,
            time: Some((0..frames).map(|t| self.time(t)).collect()),
            take: Some(vec![name.into(); frames]),
        }
    }

    /// The time of a frame of the whole take, seconds.
    fn time(&self, frame: usize) -> f64 {
        let [a, b] = self.clips;
        let [first, end] = self.ends();
        let start = a.poses.time.as_ref().map_or(0.0, |time| time[0]);
        let Some(step) = frame.checked_sub(first).filter(|step| *step > 0) else {
            return start + a.seconds(0, frame);
        };
        let last = self.timing.steps();
        let before = start + a.seconds(0, first) + step.min(last) as f64 / a.rate;
        let after = step.saturating_sub(last);
        // Sums of decimal times have more digits than were measured.
        ((before + b.seconds(end, end + after)) * 1e9).round() / 1e9
    }
}

impl BlendedClips for Blend<'_> {
    fn clips(&self) -> [&Clip; 2] {
        self.clips
    }

    fn span(&self) -> RangeInclusive<isize> {
        0..=self.timing.steps() as isize
    }

    fn joint(&self, offset: isize, joint: usize) -> DVec3 {
        let points = self.clips[0].joints.of(joint).iter();
        let sum: DVec3 = points.clone().map(|p| self.point(offset, *p)).sum();
        sum / points.len() as f64
    }

    fn source(&self, offset: isize) -> (usize, isize) {
        self.leader(offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::tests::stroll;

    fn blended<'a>(clips: [&'a Clip; 2], frames: [usize; 2], over: Option<f64>) -> Blend<'a> {
        let ranges = clips.map(ClipRange::measure);
        let blender = Blender::new(clips);
        let blend = blender.blend(frames, over, [&ranges[0], &ranges[1]]);
        blend.unwrap().0
    }

    #[test]
    fn before_the_blend_is_a_and_after_it_moved_b() {
        let (a, b) = (stroll(60, 30.0, 0.0), stroll(50, 30.0, 0.4));
        let blend = blended([&a, &b], [20, 30], Some(1.0 / 3.0));
        let whole = blend.to_poses("a>b");
        let [first, end] = blend.ends();
        for t in 0..=first {
            assert_eq!(whole.frame(t), a.poses.frame(t));
        }
        let start = first + blend.timing.steps();
        assert_eq!(whole.frames(), start + 50 - end);
        for t in end..50 {
            // Distances and heights are those of b.
            let length = |poses: &Poses, t: usize| {
                let p = |j: usize| DVec3::from_array([0, 1, 2].map(|c| poses.xyz[[t, 3 * j + c]]));
                (p(3).distance(p(15)), p(3).y)
            };
            let (own, moved) = (length(&b.poses, t), length(&whole, start + t - end));
            assert!((own.0 - moved.0).abs() < 1e-9 && (own.1 - moved.1).abs() < 1e-9);
        }
        assert_eq!(&*whole.take.unwrap()[0], "a>b");
        let time = whole.time.unwrap();
        assert!(
            time.windows(2)
                .all(|t| (t[1] - t[0] - 1.0 / 30.0).abs() < 1e-8)
        );
    }

    #[test]
    fn a_clip_over_into_its_own_moved_copy_is_the_clip() {
        let a = stroll(90, 30.0, 0.0);
        let mut b = a.clone();
        let turn = DQuat::from_rotation_y(2.0);
        for mut row in b.poses.xyz.rows_mut() {
            for p in row.as_slice_mut().unwrap().chunks_exact_mut(3) {
                let moved = turn * DVec3::new(p[0], p[1], p[2]) + DVec3::new(-300.0, 0.0, 80.0);
                p.copy_from_slice(&moved.to_array());
            }
        }
        let whole = blended([&a, &b], [45, 45], None).to_poses("");
        assert_eq!(whole.frames(), 90);
        let far = (&whole.xyz - &a.poses.xyz).mapv(f64::abs);
        let far = far.into_iter().fold(0.0, f64::max);
        assert!(far < 1e-6, "{far}");
    }

    #[test]
    fn bones_keep_their_lengths_and_speed_goes_from_one_to_the_other() {
        let a = stroll(120, 30.0, 0.0);
        let mut b = stroll(120, 30.0, 0.3);
        // Three times as fast over the ground, and crouching.
        for (t, mut row) in b.poses.xyz.rows_mut().into_iter().enumerate() {
            for p in row.as_slice_mut().unwrap().chunks_exact_mut(3) {
                p[0] += 4.0 * t as f64;
                p[2] += 0.2 * p[1];
            }
        }
        let blend = blended([&a, &b], [60, 60], Some(0.8));
        let ranges = [&a, &b].map(ClipRange::measure);
        let quality = BlendQuality::measure(&blend, [&ranges[0], &ranges[1]]);
        assert!(quality.bones < 1e-6, "{quality:?}");
        let hip = |k: isize| blend.joint(k, joint::HIP).with_y(0.0);
        let speeds: Vec<f64> = (0..24)
            .map(|k| hip(k + 1).distance(hip(k)) * 30.0)
            .collect();
        assert!(speeds.windows(2).all(|s| s[1] > s[0] - 3.0), "{speeds:?}");
        assert!(speeds[23] > 2.0 * speeds[0]);
    }
}

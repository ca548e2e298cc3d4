//! A take that can be blended with others: its poses in the world, and where its joints are seen
//! without a break.

use super::joint_map::{JOINTS, JointColumns, JointMap};
use crate::Result;
use crate::pose::Poses;
use glam::DVec3;
use std::ops::Range;

/// A take that can be blended.
#[derive(Debug, Clone)]
pub struct Clip {
    /// Its poses in the world, cm.
    pub poses: Poses,
    /// Which points the sixteen joints are.
    pub joints: JointColumns,
    /// Frames a second.
    pub rate: f64,
    /// Runs of consecutive frames.
    pub runs: Vec<Range<usize>>,
}

impl Clip {
    /// A take, whose rate is given.
    ///
    /// ```
    /// use posing_io::{Amc, Asf};
    /// use posing_likeness::{Clip, JointMap};
    ///
    /// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
    /// let take = Amc::open("../../testdata/cmu/09/09_06.amc", &asf)?.to_poses(120.0)?;
    /// let clip = Clip::new(take, 120.0, &JointMap::cmu())?;
    /// assert_eq!(clip.frames_in(0.5), 60);
    /// let can_fade = clip.can_fade(60); // half a second before and after
    /// assert!(!can_fade[59] && can_fade[60]);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: joints are missing.
    pub fn new(poses: Poses, rate: f64, map: &JointMap) -> Result<Clip> {
        Ok(Clip {
            joints: map.find(&poses.points)?,
            runs: poses.runs(),
            poses,
            rate,
        })
    }

    /// A point in a frame, cm; NaN where it is missing, or the clip has no such frame.
    pub(crate) fn point(&self, frame: isize, point: usize) -> DVec3 {
        match usize::try_from(frame) {
            Ok(t) if t < self.poses.frames() => {
                let at = |axis| self.poses.xyz[[t, 3 * point + axis]];
                DVec3::new(at(0), at(1), at(2))
            }
            _ => DVec3::NAN,
        }
    }

    /// A joint in a frame, like [`Clip::point`].
    pub(crate) fn joint(&self, frame: isize, joint: usize) -> DVec3 {
        match usize::try_from(frame) {
            Ok(t) if t < self.poses.frames() => self.joints.at(&self.poses.xyz, t, joint),
            _ => DVec3::NAN,
        }
    }

    /// Frames of a length of time, at least one.
    pub fn frames_in(&self, seconds: f64) -> usize {
        ((seconds * self.rate).round() as usize).max(1)
    }

    /// For each frame, whether the clip goes on for `half` frames before and after it and shows all
    /// joints in them.
    pub fn can_fade(&self, half: usize) -> Vec<bool> {
        let is_whole = |t: usize| (0..JOINTS.len()).all(|j| self.joint(t as isize, j).is_finite());
        let mut can = vec![false; self.poses.frames()];
        for run in &self.runs {
            let mut whole = 0;
            for t in run.clone() {
                whole = if is_whole(t) { whole + 1 } else { 0 };
                if whole > 2 * half {
                    can[t - half] = true;
                }
            }
        }
        can
    }

    /// Seconds from frame `from` to frame `to`: by the times, else by the rate.
    pub(crate) fn seconds(&self, from: usize, to: usize) -> f64 {
        match &self.poses.time {
            Some(time) => time[to] - time[from],
            None => (to as f64 - from as f64) / self.rate,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::joint_map::joint;
    use crate::testdata::{own_names, standing, take_of};
    use glam::DQuat;

    /// A person who walks along a circle and waves, `rate` frames a second; `late` seconds later
    /// than another.
    pub(crate) fn stroll(frames: usize, rate: f64, late: f64) -> Clip {
        let pose = |t: usize| {
            let s = t as f64 / rate - late;
            let turn = DQuat::from_rotation_y(0.5 * s);
            let position = DVec3::new(60.0 * s, 0.0, 20.0 * s.sin());
            let mut pose = standing();
            pose[joint::LHAND] += DVec3::new(0.0, 10.0 * (2.0 * s).sin(), 0.0);
            pose.map(|p| turn * p + position)
        };
        let poses = take_of(&(0..frames).map(pose).collect::<Vec<_>>());
        let time = (0..frames).map(|t| t as f64 / rate).collect();
        let poses = Poses {
            time: Some(time),
            ..poses
        };
        Clip::new(poses, rate, &own_names()).unwrap()
    }

    #[test]
    fn frames_can_fade_where_all_joints_are_seen_about_them() {
        let mut clip = stroll(30, 30.0, 0.0);
        assert_eq!(clip.can_fade(4).iter().filter(|c| **c).count(), 30 - 8);
        assert!(clip.can_fade(15).iter().all(|c| !c));
        for t in [5, 14, 25] {
            clip.poses.xyz[[t, 3 * clip.joints.of(joint::LHAND)[0]]] = f64::NAN;
        }
        let can = clip.can_fade(4);
        let able: Vec<usize> = (0..30).filter(|t| can[*t]).collect();
        assert_eq!(able, [19, 20]);
    }

    #[test]
    fn a_jump_in_time_ends_what_can_fade() {
        let mut a = stroll(30, 30.0, 0.0);
        let time = a.poses.time.as_mut().unwrap();
        time[12..].iter_mut().for_each(|t| *t += 1.0);
        let a = Clip::new(a.poses, 30.0, &own_names()).unwrap();
        let can = a.can_fade(2);
        assert!(can[9] && !can[10] && !can[13] && can[14]);
    }
}

//! Poses of the sixteen joints in the body's own frame: the hip at the origin, no yaw, lengths in
//! body heights.
//!
//! The body faces along z: yaw is taken from the direction of the right hip joint to the left one,
//! which becomes x. Pitch and roll stay. The height of a body is measured from its take: the median
//! lengths of the bones from the head to the hip and from a hip joint to its foot, added up.

use super::joint_map::{JointMap, PARENTS, joint};
use crate::Result;
use crate::numeric::statistics::median;
use crate::pose::Poses;
use glam::DVec3;
use ndarray::{Array3, s};
use std::ops::Range;

/// The poses of a take in the body's own frame.
#[derive(Debug, Clone)]
pub struct BodyFramePoses {
    /// (frames, 16, 3), body heights; NaN missing.
    pub joints: Array3<f64>,
    /// The hip's height above the ground y = 0, body heights, a frame.
    pub hip_height: Vec<f64>,
    /// The hip's position on the ground (x, z), body heights, a frame.
    pub place: Vec<[f64; 2]>,
    /// The yaw that was removed, radians, a frame: the turn about y that carries the body's x to
    /// that of the world.
    pub yaw: Vec<f64>,
    /// Runs of consecutive frames.
    pub runs: Vec<Range<usize>>,
    /// Frames a second; `None` where the times give none.
    pub rate: Option<f64>,
    /// The body's height, cm.
    pub height: f64,
}

impl BodyFramePoses {
    /// Poses of a take, whose rate is given.
    ///
    /// ```
    /// use posing_io::{Amc, Asf};
    /// use posing_likeness::{BodyFramePoses, JointMap};
    ///
    /// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
    /// let take = Amc::open("../../testdata/cmu/09/09_06.amc", &asf)?.to_poses(120.0)?;
    /// let poses = BodyFramePoses::new(&take, Some(120.0), &JointMap::cmu())?;
    /// assert_eq!(poses.joints.dim(), (take.frames(), 16, 3));
    /// assert!(poses.hip_height[0] > 0.4 && poses.hip_height[0] < 0.7); // body heights
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: joints are missing, or the body's height cannot be measured.
    pub fn new(take: &Poses, rate: Option<f64>, map: &JointMap) -> Result<BodyFramePoses> {
        let points = map.find(&take.points)?;
        let frames = take.frames();
        let at = |t: usize, j: usize| points.at(&take.xyz, t, j);
        let height = height(frames, at).ok_or(
            "shows no body height: no frame has both ends of each bone from the head to a foot",
        )?;
        let mut joints = Array3::zeros((frames, 16, 3));
        let hip = |t: usize| at(t, joint::HIP) / height;
        let across = |t: usize| at(t, joint::LHIP) - at(t, joint::RHIP);
        for t in 0..frames {
            let hip = at(t, joint::HIP);
            let turn = without_yaw(across(t));
            for j in 0..16 {
                let local = turn(at(t, j) - hip) / height;
                (0..3).for_each(|axis| joints[[t, j, axis]] = local[axis]);
            }
        }
        Ok(BodyFramePoses {
            joints,
            hip_height: (0..frames).map(|t| hip(t).y).collect(),
            place: (0..frames).map(|t| [hip(t).x, hip(t).z]).collect(),
            yaw: (0..frames).map(|t| yaw(across(t))).collect(),
            runs: take.runs(),
            rate,
            height,
        })
    }

    /// The number of frames.
    pub fn frames(&self) -> usize {
        self.hip_height.len()
    }

    /// The run of consecutive frames that frame `t` is in.
    #[doc(hidden)]
    pub fn run_of(&self, t: usize) -> Range<usize> {
        let run = self.runs.iter().find(|run| run.contains(&t));
        run.cloned().unwrap_or(t..t + 1)
    }

    /// Joints of a frame, body heights.
    pub fn frame(&self, t: usize) -> [DVec3; 16] {
        let rows = self.joints.slice(s![t, .., ..]);
        std::array::from_fn(|j| DVec3::new(rows[[j, 0]], rows[[j, 1]], rows[[j, 2]]))
    }
}

/// The turn about y that carries `across`, from the right hip joint to the left one, into the plane
/// z = 0, x > 0. Where it stands upright, no turn.
fn without_yaw(across: DVec3) -> impl Fn(DVec3) -> DVec3 {
    let length = across.x.hypot(across.z);
    let (c, s) = if length > 0.0 {
        (across.x / length, across.z / length)
    } else {
        (1.0, 0.0)
    };
    move |v| DVec3::new(c * v.x + s * v.z, v.y, c * v.z - s * v.x)
}

/// The yaw of a body whose left hip joint lies in the direction `across` of the right one, radians.
pub(crate) fn yaw(across: DVec3) -> f64 {
    (-across.z).atan2(across.x)
}

/// The bones from the head to the hip, and from the hip joints to the feet.
const TALL: [usize; 3] = [joint::CHEST, joint::NECK, joint::HEAD];
const LEGS: [[usize; 2]; 2] = [[joint::LKNEE, joint::LFOOT], [joint::RKNEE, joint::RFOOT]];

/// The height of a body, cm: the mean of both legs, and the trunk. `None` if a bone is never seen,
/// or all are points.
fn height(frames: usize, at: impl Fn(usize, usize) -> DVec3) -> Option<f64> {
    let length = |j: &usize| {
        let lengths = (0..frames).map(|t| (at(t, *j) - at(t, PARENTS[*j])).length());
        median(lengths.filter(|l| l.is_finite()).collect())
    };
    let sum = |bones: &[usize]| bones.iter().map(length).sum::<Option<f64>>();
    let legs = (sum(&LEGS[0])? + sum(&LEGS[1])?) / 2.0;
    Some(sum(&TALL)? + legs).filter(|h| *h > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::{own_names, standing, take_of};

    #[test]
    fn position_and_yaw_are_removed_and_lengths_are_heights() {
        let turn = glam::DQuat::from_rotation_y(0.7);
        let moved = standing().map(|p| turn * p + DVec3::new(30.0, 0.0, -50.0));
        let poses =
            BodyFramePoses::new(&take_of(&[standing(), moved]), Some(10.0), &own_names()).unwrap();
        assert_eq!(poses.height, 160.0);
        for (a, b) in poses.frame(0).iter().zip(poses.frame(1)) {
            assert!((*a - b).length() < 1e-12);
        }
        assert!((poses.hip_height[0] - 90.0 / 160.0).abs() < 1e-12);
        assert!((poses.frame(0)[joint::LHAND].x - 75.0 / 160.0).abs() < 1e-12);
    }
}

//! The missing values of a BVH file: solved for from a table of the positions of its joints, with
//! all that are there held.
//!
//! The missing values of a frame are those that put the joints there, and where that leaves
//! something open (the twist of a bone, a hand without children), that are nearest to the
//! [rotations filled](super::rotation_cleaning) without the table.

use super::least_turns::turn_to;
use super::rotation_cleaning::{RotationCleaning, clean_rotations};
use super::solver::{IkSettings, IkSolver, MAX_DOFS, Regularization};
use super::tuning::missing_channels::*;
use crate::io::Bvh;
use crate::io::bvh::{BvhPoints, BvhSkeleton, Joint};
use crate::numeric::parallel;
use crate::pose::kinematics::Posture;
use crate::pose::{JointChannels, Poses, point_at};
use crate::{Error, Result};
use glam::DMat3;
use ndarray::{Array2, ArrayView1};

/// The motion of `bvh` (frames, channels; radians and centimeters) with its missing values, from
/// `poses`, the positions of its joints (as many frames, cm, y up; NaN is missing; a value stays
/// missing where its joint's children are, or where its channel has none in the whole take). `turn`
/// carries the file's axes to y up.
///
/// # Errors
/// [`Error::Usage`]: another number of frames, no joint of the file among the points, or more than
/// `MAX_DOFS` channels.
pub fn solve_missing_channels(bvh: &Bvh, poses: &Poses, turn: DMat3) -> Result<Array2<f64>> {
    if poses.frames() != bvh.motion.nrows() {
        let what = format!(
            "the table has {} frames, the BVH file {}",
            poses.frames(),
            bvh.motion.nrows()
        );
        return Err(Error::usage(what));
    }
    let rig = BvhSkeleton::new(&bvh.joints, turn, true)?;
    if rig.skeleton.dof_count() > MAX_DOFS {
        let what = format!("the BVH file has more than {MAX_DOFS} channels that can be solved for");
        return Err(Error::usage(what));
    }
    let points = rig.points(BvhPoints::Origins);
    let column = |name: &String| poses.points.iter().position(|p| p == name);
    let known: Vec<(usize, usize)> = points
        .iter()
        .filter_map(|(name, bone)| Some((column(name)?, *bone)))
        .collect();
    if known.is_empty() {
        return Err(Error::usage(
            "no point of the table is a joint of the BVH file",
        ));
    }
    let bones: Vec<usize> = known.iter().map(|k| k.1).collect();
    let joints = bvh.joints.iter();
    let channels = JointChannels::all(joints.map(|j| (j.name.clone(), j.channels.clone())));
    let fill = RotationCleaning {
        noise_limit: f64::INFINITY,
        pops: false,
        max_gap: None,
        ..RotationCleaning::default()
    };
    let rate = bvh.rate().unwrap_or(1.0);
    let mut paths = clean_rotations(&channels, bvh.motion.view(), rate, &fill).motion;
    let is_bare = |t: usize| {
        let missing = bvh.motion.row(t).iter().filter(|v| v.is_nan()).count();
        2 * missing > bvh.motion.ncols()
    };
    let is_bare: Vec<bool> = (0..paths.nrows()).map(is_bare).collect();
    for t in 0..paths.nrows() {
        if is_bare[t] {
            // The path of a whole body that is missing may be far from its pose.
            let place = |j: &Joint| Some(point_at(poses.xyz.view(), t, column(&j.name)?));
            let at = bvh.joints.iter().map(|j| {
                let place = place(j).filter(|at| at.is_finite());
                place.map(|at| turn.transpose() * at)
            });
            let mut frame = paths.row(t).to_vec();
            turn_to(bvh, &channels, &at.collect::<Vec<_>>(), &mut frame);
            paths.row_mut(t).assign(&ArrayView1::from(&frame));
        }
    }
    let is_seen = |c: usize| bvh.motion.column(c).iter().any(|v| v.is_finite());
    let solving = Solving {
        bvh,
        rig: &rig,
        poses,
        known: &known,
        is_seen: (0..bvh.motion.ncols()).map(is_seen).collect(),
        children: children(bvh, poses, &known),
        paths,
        is_bare,
    };
    let frames = parallel::map_chunks(bvh.motion.nrows(), CHUNK, |range| {
        let mut solver = IkSolver::new(&rig.skeleton, &bones, IkSettings::default());
        range
            .map(|t| solving.frame(t, &mut solver))
            .collect::<Vec<_>>()
    });
    let values = frames.into_iter().flatten().flatten().collect();
    Array2::from_shape_vec(bvh.motion.dim(), values).map_err(|e| Error::usage(e.to_string()))
}

/// What all frames have in common.
struct Solving<'a> {
    bvh: &'a Bvh,
    rig: &'a BvhSkeleton,
    poses: &'a Poses,
    /// The column of each joint among the points, and its bone.
    known: &'a [(usize, usize)],
    /// The motion filled without the positions.
    paths: Array2<f64>,
    /// Whether most of each frame is missing.
    is_bare: Vec<bool>,
    /// Whether each channel has a value in the take.
    is_seen: Vec<bool>,
    /// By channel, the known joints that it moves first: the children of its joint.
    children: Vec<Vec<usize>>,
}

/// By channel, which of the `known` joints are children of its joint.
fn children(bvh: &Bvh, poses: &Poses, known: &[(usize, usize)]) -> Vec<Vec<usize>> {
    let column = |name: &str| known.iter().position(|(p, _)| poses.points[*p] == name);
    let of_joint = |j: usize| -> Vec<usize> {
        let below = bvh.joints.iter().filter(|joint| joint.parent == Some(j));
        let end = format!("{}_end", bvh.joints[j].name);
        let names = below.map(|joint| joint.name.as_str());
        names.chain([end.as_str()]).filter_map(column).collect()
    };
    let joints = bvh.joints.iter().enumerate();
    joints
        .flat_map(|(j, joint)| vec![of_joint(j); joint.channels.len()])
        .collect()
}

impl Solving<'_> {
    /// The channels of a frame.
    fn frame(&self, t: usize, solver: &mut IkSolver<'_>) -> Vec<f64> {
        let is_missing: Vec<bool> = self.bvh.motion.row(t).iter().map(|v| v.is_nan()).collect();
        let mut frame = self.paths.row(t).to_vec();
        if !is_missing.contains(&true) {
            return frame;
        }
        // What the take never has.
        frame
            .iter_mut()
            .filter(|v| v.is_nan())
            .for_each(|v| *v = 0.0);
        let mut start = vec![0.0; self.rig.skeleton.dof_count()];
        self.rig.values(&frame, &mut start);
        let mut fixed = vec![true; start.len()];
        for (channel, value) in self.rig.channels.iter().enumerate() {
            if let Some(value) = value {
                fixed[*value] = !is_missing[channel];
            }
        }
        let (targets, weights) = self.targets(t, &start);
        solver.set_weights(&weights);
        let mut q = start.clone();
        let regularization = Regularization {
            previous: &start,
            previous_weight: PATH_WEIGHT,
            rest: &start,
            rest_weight: 0.0,
        };
        solver.solve(&targets, &fixed, &regularization, &mut q);
        for (value, solved) in frame.iter_mut().zip(self.rig.frame(&q)) {
            *value = solved;
        }
        for (c, value) in frame.iter_mut().enumerate() {
            // What was there stays to the last digit.
            if !is_missing[c] || self.is_open(t, c) {
                *value = self.bvh.motion[[t, c]];
            }
        }
        frame
    }

    /// Whether nothing says what a channel was: it has no value in the take, or the points that it
    /// moves are missing; where most of a frame is missing, all points.
    fn is_open(&self, t: usize, channel: usize) -> bool {
        let is_unknown =
            |&j: &usize| !point_at(self.poses.xyz.view(), t, self.known[j].0).is_finite();
        if !self.is_seen[channel] {
            return true;
        }
        // Of a body that is placed, the path tells what points leave open.
        if self.is_bare[t] {
            return (0..self.known.len()).all(|j| is_unknown(&j));
        }
        self.children[channel].iter().any(is_unknown)
    }

    /// Where the joints are in a frame, and the weight of each coordinate; those that the table
    /// does not have are where `start` puts them, and hardly count.
    fn targets(&self, t: usize, start: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut posture = Posture::default();
        self.rig.skeleton.posture_into(start, &mut posture);
        let mut targets = Vec::with_capacity(3 * self.known.len());
        let mut weights = Vec::with_capacity(3 * self.known.len());
        for &(p, bone) in self.known {
            let at = point_at(self.poses.xyz.view(), t, p);
            let (target, weight) = if at.is_finite() {
                (at, 1.0)
            } else {
                (posture.ends[bone], UNKNOWN_WEIGHT)
            };
            targets.extend(target.to_array());
            weights.extend([weight; 3]);
        }
        (targets, weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Input;

    /// An arm of three joints that swings; rotations of the middle one are missing in some frames.
    fn arm(is_missing: impl Fn(usize) -> bool) -> (Bvh, Bvh) {
        let head = "HIERARCHY\nROOT a\n{\
            \n OFFSET 0 0 0\
            \n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\
            \n JOINT b\n {\n OFFSET 0 30 0\
            \n CHANNELS 3 Zrotation Xrotation Yrotation\
            \n JOINT c\n {\n OFFSET 0 25 0\
            \n CHANNELS 3 Zrotation Xrotation Yrotation\
            \n End Site\n {\n OFFSET 5 10 0\
            \n }\n }\n }\n}\nMOTION\
            \nFrames: 40\nFrame Time: 0.01\
            \n";
        let text = |hide: bool| {
            let row = |t: usize| {
                let s = (0.2 * t as f64).sin();
                let middle = if hide && is_missing(t) {
                    "nan nan nan".to_string()
                } else {
                    format!("{} {} {}", 40.0 * s, 20.0 * s * s, 10.0 * s)
                };
                format!(
                    "{} 90 0 5 {} 3 {middle} {} 0 {}\n",
                    t,
                    8.0 * s,
                    15.0 * s,
                    5.0 * s
                )
            };
            head.to_string() + &(0..40).map(row).collect::<String>()
        };
        let read = |text: String| {
            let input = Input::new("t", std::io::Cursor::new(text.into_bytes())).unwrap();
            Bvh::read(input, 1.0, false).unwrap()
        };
        (read(text(false)), read(text(true)))
    }

    #[test]
    fn missing_rotations_follow_from_the_positions_and_the_others_stay() {
        let (truth, gaps) = arm(|t| (10..25).contains(&t));
        let poses = truth.to_poses().unwrap();
        let solved = solve_missing_channels(&gaps, &poses, DMat3::IDENTITY).unwrap();
        for ((t, c), value) in solved.indexed_iter() {
            let (want, was) = (truth.motion[[t, c]], gaps.motion[[t, c]]);
            if was.is_finite() {
                assert_eq!(*value, was);
            } else {
                assert!(
                    (value - want).abs() < 0.02,
                    "frame {t}, channel {c}: {value} {want}"
                );
            }
        }
        assert!(solve_missing_channels(&gaps, &poses.slice(0..3), DMat3::IDENTITY).is_err());
    }

    #[test]
    fn where_positions_are_missing_values_stay_missing() {
        let (_, gaps) = arm(|t| t == 11 || t < 2);
        let mut poses = gaps.to_poses().unwrap();
        assert!(poses.xyz[[11, 6]].is_nan() && poses.xyz[[11, 3]].is_finite());
        poses.xyz.fill(f64::NAN);
        let solved = solve_missing_channels(&gaps, &poses, DMat3::IDENTITY).unwrap();
        assert!(solved[[11, 6]].is_nan() && solved[[0, 6]].is_nan() && solved[[12, 6]].is_finite());
        let never = arm(|_| true).1;
        let solved = solve_missing_channels(&never, &never.to_poses().unwrap(), DMat3::IDENTITY);
        assert!(solved.unwrap().column(6).iter().all(|v| v.is_nan()));
    }
}

//! The missing values of a BVH file: solved for from the positions of its joints, with all that are there held.
//!
//! A missing value first goes straight from the one before to the one after. Then the missing values of a frame are those that put the
//! joints where they are wanted, and where that leaves something open (the twist of a bone, a hand without children), that are nearest
//! to the straight way.

use super::solver::{IkSettings, IkSolver, MAX_DOFS, Regularization};
use crate::io::Bvh;
use crate::io::bvh::{BvhPoints, BvhSkeleton};
use crate::numeric::parallel;
use crate::pose::Poses;
use crate::pose::rotation::nearest_equivalent_angle;
use crate::{Error, Result};
use glam::DMat3;
use ndarray::Array2;

/// Holds what the joints leave open to the straight way, cm² a squared radian.
const STRAIGHT_WEIGHT: f64 = 1e-2;
/// Frames of one parallel task.
const CHUNK: usize = 8;

/// The motion of `bvh` (frames, channels; radians and centimetres) with its missing values, from `poses`, the positions of its joints
/// (as many frames, cm, y up; NaN is missing). `turn` carries the file's axes to y up.
///
/// # Errors
/// [`Error::Usage`]: another number of frames, no joint of the file among the points, or more than [`MAX_DOFS`] channels.
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
    let straight = straight_ways(bvh);
    let bones: Vec<usize> = known.iter().map(|k| k.1).collect();
    let frames = parallel::map_chunks(bvh.motion.nrows(), CHUNK, |range| {
        let mut solver = IkSolver::new(&rig.skeleton, &bones, IkSettings::default());
        let one = |t: usize| {
            let is_missing: Vec<bool> = bvh.motion.row(t).iter().map(|v| v.is_nan()).collect();
            let mut frame = straight.row(t).to_vec();
            if !is_missing.contains(&true) {
                return frame;
            }
            let mut start = vec![0.0; rig.skeleton.dof_count()];
            rig.values(&frame, &mut start);
            let mut fixed = vec![true; start.len()];
            for (channel, value) in rig.channels.iter().enumerate() {
                if let Some(value) = value {
                    fixed[*value] = !is_missing[channel];
                }
            }
            let wanted = known.iter().flat_map(|&(p, _)| 3 * p..3 * p + 3);
            let wanted: Vec<f64> = wanted.map(|i| poses.xyz[[t, i]]).collect();
            let mut q = start.clone();
            let regularization = Regularization {
                previous: &start,
                previous_weight: STRAIGHT_WEIGHT,
                rest: &start,
                rest_weight: 0.0,
            };
            solver.solve(&wanted, &fixed, &regularization, &mut q);
            for (value, solved) in frame.iter_mut().zip(rig.frame(&q)) {
                *value = solved;
            }
            // What was there stays to the last digit.
            for ((value, was), missing) in frame.iter_mut().zip(bvh.motion.row(t)).zip(is_missing) {
                if !missing {
                    *value = *was;
                }
            }
            frame
        };
        range.map(one).collect::<Vec<_>>()
    });
    let values = frames.into_iter().flatten().flatten().collect();
    Array2::from_shape_vec(bvh.motion.dim(), values).map_err(|e| Error::usage(e.to_string()))
}

/// The motion with each missing value on the straight way from the one before to the one after (angles the shorter way), at the ends of
/// the take as the nearest one, and 0 where a channel has none.
fn straight_ways(bvh: &Bvh) -> Array2<f64> {
    let kinds = bvh.joints.iter().flat_map(|j| &j.channels);
    let mut out = bvh.motion.clone();
    for (c, channel) in kinds.enumerate() {
        let seen: Vec<usize> = (0..out.nrows())
            .filter(|&t| bvh.motion[[t, c]].is_finite())
            .collect();
        let mut next = 0;
        for t in 0..out.nrows() {
            while next < seen.len() && seen[next] < t {
                next += 1;
            }
            if seen.get(next) == Some(&t) {
                continue;
            }
            let before = next.checked_sub(1).map(|i| seen[i]);
            let after = seen.get(next).copied();
            let value = |t: usize| bvh.motion[[t, c]];
            out[[t, c]] = match (before, after) {
                (Some(a), Some(b)) => {
                    let end = match channel.is_angle() {
                        true => nearest_equivalent_angle(value(b), value(a)),
                        false => value(b),
                    };
                    value(a) + (end - value(a)) * (t - a) as f64 / (b - a) as f64
                }
                (Some(near), None) | (None, Some(near)) => value(near),
                (None, None) => 0.0,
            };
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Input;

    /// An arm of three joints that swings; rotations of the middle one are missing in some frames.
    fn arm(is_missing: impl Fn(usize) -> bool) -> (Bvh, Bvh) {
        let head = "HIERARCHY\nROOT a\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n JOINT b\n {\n OFFSET 0 30 0\n CHANNELS 3 Zrotation Xrotation Yrotation\n JOINT c\n {\n OFFSET 0 25 0\n CHANNELS 3 Zrotation Xrotation Yrotation\n End Site\n {\n OFFSET 5 10 0\n }\n }\n }\n}\nMOTION\nFrames: 40\nFrame Time: 0.01\n";
        let text = |hide: bool| {
            let row = |t: usize| {
                let s = (0.2 * t as f64).sin();
                let middle = match hide && is_missing(t) {
                    true => "nan nan nan".to_string(),
                    false => format!("{} {} {}", 40.0 * s, 20.0 * s * s, 10.0 * s),
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
    fn without_positions_missing_values_go_straight() {
        let (_, gaps) = arm(|t| t == 11 || t < 2);
        let mut poses = gaps.to_poses().unwrap();
        assert!(poses.xyz[[11, 6]].is_nan() && poses.xyz[[11, 3]].is_finite());
        poses.xyz.fill(f64::NAN);
        let solved = solve_missing_channels(&gaps, &poses, DMat3::IDENTITY).unwrap();
        let mean = 0.5 * (gaps.motion[[10, 6]] + gaps.motion[[12, 6]]);
        assert!((solved[[11, 6]] - mean).abs() < 1e-9);
        assert!((solved[[0, 6]] - gaps.motion[[2, 6]]).abs() < 1e-9);
    }
}

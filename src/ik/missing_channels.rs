//! The missing values of a BVH file: solved for from the positions of its joints, with all that are
//! there held.
//!
//! There are two estimates of where a joint is: its restored position, and where it comes to lie
//! when each missing value follows a smooth path in time ([`channel_paths`](super::channel_paths)).
//! They are weighed by their variances. The missing values of a frame are those that put the joints
//! there, and where that leaves something open (the twist of a bone, a hand without children), that
//! are nearest to the path.

use super::channel_paths::{Joints, interpolated, variances};
use super::solver::{IkSettings, IkSolver, MAX_DOFS, Regularization};
use super::tuning::missing_channels::*;
use crate::io::Bvh;
use crate::io::bvh::{BvhPoints, BvhSkeleton};
use crate::numeric::parallel;
use crate::pose::Poses;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::{Array2, ArrayView2};

/// How sure positions are.
#[derive(Debug, Clone, Copy)]
pub struct PositionSd<'a> {
    /// Standard deviations of a coordinate (frames, points), cm; NaN: measured.
    pub sd: ArrayView2<'a, f64>,
    /// Values stay missing whose joint's children would be less sure, cm.
    pub most: f64,
}

/// The motion of `bvh` (frames, channels; radians and centimeters) with its missing values, from
/// `poses`, the positions of its joints (as many frames, cm, y up; NaN is missing; a value stays
/// missing where its joint's children are, or where its channel has none in the whole take), and
/// their standard deviations `sd` (frames, points; cm; NaN: measured), where they are known. `turn`
/// carries the file's axes to y up.
///
/// # Errors
/// [`Error::Usage`]: another number of frames, no joint of the file among the points, or more than
/// `MAX_DOFS` channels.
pub fn solve_missing_channels(
    bvh: &Bvh,
    poses: &Poses,
    sd: Option<PositionSd<'_>>,
    turn: DMat3,
) -> Result<Array2<f64>> {
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
    let paths = interpolated(bvh);
    let is_seen = |c: usize| bvh.motion.column(c).iter().any(|v| v.is_finite());
    let solving = Solving {
        bvh,
        rig: &rig,
        poses,
        sd,
        known: &known,
        variances: variances(bvh, &rig, &bones, &paths),
        is_seen: (0..bvh.motion.ncols()).map(is_seen).collect(),
        children: children(bvh, poses, &known),
        paths,
    };
    let frames = parallel::map_chunks(bvh.motion.nrows(), CHUNK, |range| {
        let mut solver = IkSolver::new(&rig.skeleton, &bones, IkSettings::default());
        let mut joints = Joints::new(&rig, &bones);
        range
            .map(|t| solving.frame(t, &mut solver, &mut joints))
            .collect::<Vec<_>>()
    });
    let values = frames.into_iter().flatten().flatten().collect();
    Array2::from_shape_vec(bvh.motion.dim(), values).map_err(|e| Error::usage(e.to_string()))
}

/// What all frames have in common.
struct Solving<'a, 's> {
    bvh: &'a Bvh,
    rig: &'a BvhSkeleton,
    poses: &'a Poses,
    sd: Option<PositionSd<'s>>,
    /// The column of each joint among the points, and its bone.
    known: &'a [(usize, usize)],
    paths: Array2<f64>,
    /// (frames, joints), cm².
    variances: Array2<f64>,
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

impl Solving<'_, '_> {
    /// The channels of a frame.
    fn frame(&self, t: usize, solver: &mut IkSolver<'_>, joints: &mut Joints<'_>) -> Vec<f64> {
        let is_missing: Vec<bool> = self.bvh.motion.row(t).iter().map(|v| v.is_nan()).collect();
        let mut frame = self.paths.row(t).to_vec();
        if !is_missing.contains(&true) {
            return frame;
        }
        let mut start = vec![0.0; self.rig.skeleton.dof_count()];
        self.rig.values(&frame, &mut start);
        let mut fixed = vec![true; start.len()];
        for (channel, value) in self.rig.channels.iter().enumerate() {
            if let Some(value) = value {
                fixed[*value] = !is_missing[channel];
            }
        }
        let (targets, weights) = self.targets(t, &joints.places(&frame));
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

    /// The standard deviation of a restored position, cm; NaN where it was measured, or nothing is
    /// known of that.
    fn sd(&self, frame: usize, point: usize) -> f64 {
        self.sd.map_or(f64::NAN, |sd| sd.sd[[frame, point]])
    }

    /// Whether nothing says what a channel was: it has no value in the take, or the points that it
    /// moves are missing or too unsure.
    fn is_open(&self, t: usize, channel: usize) -> bool {
        let most = self.sd.map_or(f64::INFINITY, |sd| sd.most);
        let is_unknown = |&j: &usize| {
            let p = self.known[j].0;
            let is_missing = (0..3).any(|c| self.poses.xyz[[t, 3 * p + c]].is_nan());
            // The variance of both estimates together.
            let precision = self.sd(t, p).powi(-2) + 1.0 / self.variances[[t, j]];
            is_missing || precision.powf(-0.5) > most
        };
        !self.is_seen[channel] || self.children[channel].iter().any(is_unknown)
    }

    /// Where the joints are in a frame by both estimates, and the weight of each coordinate;
    /// `along` is where the paths put them.
    fn targets(&self, t: usize, along: &[DVec3]) -> (Vec<f64>, Vec<f64>) {
        let mut targets = Vec::with_capacity(3 * along.len());
        let mut weights = Vec::with_capacity(3 * along.len());
        for (j, (&(p, _), path)) in self.known.iter().zip(along).enumerate() {
            let at = DVec3::from_array([0, 1, 2].map(|c| self.poses.xyz[[t, 3 * p + c]]));
            let sd = self.sd(t, p);
            let precision = |variance: f64| 1.0 / (variance + LEAST_VARIANCE);
            let of_path = precision(self.variances[[t, j]]);
            let (target, weight) = match (at.is_finite(), sd.is_finite()) {
                (true, true) => {
                    let of_position = precision(sd * sd);
                    let both = of_position + of_path;
                    ((at * of_position + *path * of_path) / both, both)
                }
                (true, false) => (at, precision(0.0)),
                (false, _) => (*path, of_path),
            };
            targets.extend(target.to_array());
            weights.extend([weight; 3]);
        }
        let most = weights.iter().copied().fold(0.0, f64::max);
        if most > 0.0 {
            weights.iter_mut().for_each(|w| *w /= most);
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
        let solved = solve_missing_channels(&gaps, &poses, None, DMat3::IDENTITY).unwrap();
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
        assert!(solve_missing_channels(&gaps, &poses.slice(0..3), None, DMat3::IDENTITY).is_err());
    }

    #[test]
    fn where_positions_are_missing_values_stay_missing() {
        let (_, gaps) = arm(|t| t == 11 || t < 2);
        let mut poses = gaps.to_poses().unwrap();
        assert!(poses.xyz[[11, 6]].is_nan() && poses.xyz[[11, 3]].is_finite());
        poses.xyz.fill(f64::NAN);
        let solved = solve_missing_channels(&gaps, &poses, None, DMat3::IDENTITY).unwrap();
        assert!(solved[[11, 6]].is_nan() && solved[[0, 6]].is_nan() && solved[[12, 6]].is_finite());
        let never = arm(|_| true).1;
        let solved =
            solve_missing_channels(&never, &never.to_poses().unwrap(), None, DMat3::IDENTITY);
        assert!(solved.unwrap().column(6).iter().all(|v| v.is_nan()));
    }

    #[test]
    fn unsure_positions_count_less_than_a_sure_path() {
        let (truth, gaps) = arm(|t| (18..22).contains(&t));
        let mut poses = truth.to_poses().unwrap();
        // The end of the arm, 5 cm off.
        let tip = poses.points.iter().position(|p| p == "c").unwrap();
        (18..22).for_each(|t| poses.xyz[[t, 3 * tip]] += 5.0);
        let mut sd = Array2::from_elem((40, poses.points.len()), f64::NAN);
        let off = |sd: ArrayView2<'_, f64>| {
            let sd = PositionSd {
                sd,
                most: f64::INFINITY,
            };
            let solved = solve_missing_channels(&gaps, &poses, Some(sd), DMat3::IDENTITY).unwrap();
            (solved[[20, 6]] - truth.motion[[20, 6]]).abs()
        };
        (18..22).for_each(|t| sd.row_mut(t).fill(0.01));
        let sure = off(sd.view());
        (18..22).for_each(|t| sd.row_mut(t).fill(10.0));
        let unsure = off(sd.view());
        assert!(unsure < 0.3 * sure, "{unsure} {sure}");
        // Too unsure altogether.
        let sd = PositionSd {
            sd: sd.view(),
            most: 1e-6,
        };
        let solved = solve_missing_channels(&gaps, &poses, Some(sd), DMat3::IDENTITY).unwrap();
        assert!(solved[[20, 6]].is_nan() && solved[[10, 6]].is_finite());
    }
}

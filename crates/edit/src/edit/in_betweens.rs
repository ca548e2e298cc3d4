//! The motion between key poses.
//!
//! Each bone's rotation relative to its parent, and the root's position, run through the keys as
//! monotone cubics (PCHIP) in time. P2 then finds the skeleton's values for the joints so placed,
//! near those between the keys' own; a joint that is pinned at one position in both keys stays
//! there, and none goes below the floor. The frames at the keys are the keys.
//!
//! At the share s of the way between two keys a joint has the standard deviation
//!
//! ```text
//! σₖ(s) = u |key₂ − key₁|ₖ √(4 s (1 − s))     cm
//! ```
//!
//! with u = .45, as measured on people's takes (`cargo bench --bench editing -- betweens`). The
//! prior's posterior of the joints with this deviation was tried instead: takes of people
//! that the model did not know were met no better with keys half a second apart and worse with a
//! quarter, for what lies between keys is not an unlikely pose but a likely one at another time.

use super::keys::Key;
use super::pose_solver::{Constraints, Pose, PoseSolver, floor_under};
use crate::numeric::pchip::pchip;
use crate::pose::Skeleton;
use crate::pose::kinematics::Posture;
use crate::{Error, Result};
use glam::{DMat3, DQuat, DVec3};
use ndarray::{Array2, Axis, aview1};

/// u: a joint may stray by this share of its way.
const STRAY: f64 = 0.45;
/// Pins closer than this are one position, cm.
const SAME_POSITION: f64 = 0.5;
/// No motion has more frames.
const MOST_FRAMES: usize = 100_000;

/// A motion through key poses.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Frames a second.
    pub rate: f64,
    /// The time of the first frame, seconds.
    pub first: f64,
    /// The values of the skeleton's degrees of freedom (frames, values).
    pub values: Array2<f64>,
    /// The joints (frames, 3 K), cm.
    pub xyz: Array2<f64>,
    /// The standard deviation of a coordinate of each joint (frames, K), cm; 0 at keys.
    pub sd: Array2<f64>,
    /// Whether each joint is held by a pin (frames, K).
    pub fixed: Array2<bool>,
}

impl Motion {
    /// A motion of one pose at time 0, with the coordinates at which each joint is pinned (K).
    pub fn of_one(pose: &Pose, pins: &[[Option<f64>; 3]], rate: f64) -> Motion {
        let fixed = fixed(pose, pins);
        let sd = fixed.iter().zip(&pose.sd);
        let sd: Vec<f64> = sd
            .map(|(is_fixed, sd)| if *is_fixed { 0.0 } else { *sd })
            .collect();
        Motion {
            rate,
            first: 0.0,
            values: one_row(&pose.q),
            xyz: one_row(&pose.xyz),
            sd: one_row(&sd),
            fixed: one_row(&fixed),
        }
    }

    fn set(&mut self, frame: usize, pose: &Pose, sd: &[f64], pins: &[[Option<f64>; 3]]) {
        self.values.row_mut(frame).assign(&aview1(&pose.q));
        self.xyz.row_mut(frame).assign(&aview1(&pose.xyz));
        self.sd.row_mut(frame).assign(&aview1(sd));
        let fixed = fixed(pose, pins);
        self.fixed.row_mut(frame).assign(&aview1(&fixed));
    }
}

fn one_row<T: Clone>(values: &[T]) -> Array2<T> {
    aview1(values).insert_axis(Axis(0)).to_owned()
}

/// Whether each joint is where a pin holds all its coordinates.
fn fixed(pose: &Pose, pins: &[[Option<f64>; 3]]) -> Vec<bool> {
    let joints = pins.iter().zip(&pose.missed);
    joints
        .map(|(pin, missed)| pin.iter().all(Option::is_some) && *missed == 0.0)
        .collect()
}

/// The frames from the first key to the last, at `rate` frames a second; the keys' times are whole
/// numbers of frames.
///
/// # Errors
/// [`Error::Usage`]: fewer than two keys, or more than 100,000 frames.
pub fn in_betweens(solver: &PoseSolver, keys: &[Key], rate: f64, floor: bool) -> Result<Motion> {
    let (Some(first), Some(last)) = (keys.first(), keys.last().filter(|_| keys.len() > 1)) else {
        return Err(Error::usage("a motion needs two keys at least"));
    };
    let frame_of = |time: f64| ((time - first.time) * rate).round() as usize;
    let frames = frame_of(last.time) + 1;
    if frames > MOST_FRAMES {
        let what = format!("the keys are {frames} frames apart; at most {MOST_FRAMES} can be made");
        return Err(Error::usage(what));
    }
    let at: Vec<usize> = keys.iter().map(|k| frame_of(k.time)).collect();
    let curves = BoneCurves::through(&solver.rig.skeleton, keys, &at, frames);
    let joints = solver.rig.joints();
    let mut motion = Motion {
        rate,
        first: first.time,
        values: Array2::zeros((frames, solver.rig.skeleton.dof_count())),
        xyz: Array2::zeros((frames, 3 * joints)),
        sd: Array2::zeros((frames, joints)),
        fixed: Array2::from_elem((frames, joints), false),
    };
    let certain = vec![0.0; joints];
    for (pair, ends) in keys.windows(2).zip(at.windows(2)) {
        let segment = Segment::new(solver, pair, floor);
        motion.set(ends[0], &pair[0].pose, &certain, &pair[0].pins);
        for t in ends[0] + 1..ends[1] {
            let share = (t - ends[0]) as f64 / (ends[1] - ends[0]) as f64;
            let between = curves.joints(t, &solver.rig.bones);
            let pose = segment.pose(solver, share, &between);
            motion.set(t, &pose, &pose.sd, &segment.pins);
        }
        motion.set(ends[1], &pair[1].pose, &certain, &pair[1].pins);
    }
    Ok(motion)
}

/// Two neighboring keys.
struct Segment<'a> {
    keys: &'a [Key],
    /// How far each joint goes (K), cm.
    ways: Vec<f64>,
    /// The values of the second key, angles as near to those of the first as they can be.
    last: Vec<f64>,
    /// The pins of both keys that are at one position.
    pins: Vec<[Option<f64>; 3]>,
    floor: Option<Vec<f64>>,
}

impl<'a> Segment<'a> {
    fn new(solver: &PoseSolver, keys: &'a [Key], floor: bool) -> Segment<'a> {
        let [a, b] = [&keys[0], &keys[1]];
        let position = |key: &Key, k: usize| DVec3::from_slice(&key.pose.xyz[3 * k..]);
        let joints = 0..solver.rig.joints();
        let shared = |k: usize| -> [Option<f64>; 3] {
            std::array::from_fn(|c| {
                let (p, q) = (a.pins[k][c]?, b.pins[k][c]?);
                ((p - q).abs() < SAME_POSITION).then_some(p)
            })
        };
        Segment {
            keys,
            ways: (joints.clone())
                .map(|k| (position(b, k) - position(a, k)).length())
                .collect(),
            last: (solver.rig.skeleton).nearest_equivalent(&b.pose.q, &a.pose.q),
            floor: floor.then(|| {
                let floors = floor_under(&a.pose.xyz).into_iter();
                let floors = floors.zip(floor_under(&b.pose.xyz));
                floors.map(|(a, b)| a.min(b)).collect()
            }),
            pins: joints.map(shared).collect(),
        }
    }

    /// The pose at `share` of the way, where the bones' curves put the joints `between` (3 K).
    fn pose(&self, solver: &PoseSolver, share: f64, between: &[f64]) -> Pose {
        let mut goals = Constraints {
            floor: self.floor.clone(),
            ..Constraints::none(solver.rig.joints())
        };
        goals.pins.copy_from_slice(&self.pins);
        let ways = self.keys[0].pose.q.iter().zip(&self.last);
        let near: Vec<f64> = ways.map(|(a, b)| a + share * (b - a)).collect();
        let apart = STRAY * (4.0 * share * (1.0 - share)).sqrt();
        Pose {
            sd: self.ways.iter().map(|way| way * apart).collect(),
            ..solver.at_positions(&goals, between, self.keys[0].pose.placement, &near)
        }
    }
}

/// The motion of every bone in its parent's frame.
struct BoneCurves<'a> {
    skeleton: &'a Skeleton,
    /// By bone: its rotation in its parent's frame, where it starts there, and where it ends in
    /// its own.
    rotations: Vec<Vec<DQuat>>,
    starts: Vec<Vec<DVec3>>,
    ends: Vec<Vec<DVec3>>,
}

impl<'a> BoneCurves<'a> {
    /// Curves through the keys, which are at the frames `at`.
    fn through(
        skeleton: &'a Skeleton,
        keys: &[Key],
        at: &[usize],
        frames: usize,
    ) -> BoneCurves<'a> {
        let postures: Vec<Posture> = (keys.iter()).map(|k| skeleton.posture(&k.pose.q)).collect();
        let x: Vec<f64> = at.iter().map(|t| *t as f64).collect();
        let all: Vec<f64> = (0..frames).map(|t| t as f64).collect();
        let curve = |values: Vec<f64>| pchip(&x, &values, &all);
        let curves = |values: &[DVec3]| -> Vec<DVec3> {
            let by_axis = [0, 1, 2].map(|c| curve(values.iter().map(|v| v[c]).collect()));
            (0..frames)
                .map(|t| DVec3::new(by_axis[0][t], by_axis[1][t], by_axis[2][t]))
                .collect()
        };
        let above = |posture: &Posture, i: usize| match skeleton.bones()[i].parent {
            Some(p) => (posture.rotations[p], posture.ends[p]),
            None => (DMat3::IDENTITY, DVec3::ZERO),
        };
        let mut out = BoneCurves {
            skeleton,
            rotations: Vec::new(),
            starts: Vec::new(),
            ends: Vec::new(),
        };
        for i in 0..skeleton.bones().len() {
            let mut turns: Vec<DQuat> = Vec::new();
            let (mut starts, mut ends) = (Vec::new(), Vec::new());
            for posture in &postures {
                let (turn, end) = above(posture, i);
                let local = DQuat::from_mat3(&(turn.transpose() * posture.rotations[i]));
                let flip = turns.last().is_some_and(|last| last.dot(local) < 0.0);
                turns.push(if flip { -local } else { local });
                starts.push(turn.transpose() * (posture.starts[i] - end));
                ends.push(posture.rotations[i].transpose() * (posture.ends[i] - posture.starts[i]));
            }
            let by_part =
                [0, 1, 2, 3].map(|c| curve(turns.iter().map(|q| q.to_array()[c]).collect()));
            let turn = |t: usize| DQuat::from_array(by_part.each_ref().map(|c| c[t])).normalize();
            out.rotations.push((0..frames).map(turn).collect());
            out.starts.push(curves(&starts));
            out.ends.push(curves(&ends));
        }
        out
    }

    /// The ends of these bones in a frame, cm.
    fn joints(&self, t: usize, bones: &[usize]) -> Vec<f64> {
        let mut turns: Vec<DQuat> = Vec::new();
        let mut ends: Vec<DVec3> = Vec::new();
        for (i, bone) in self.skeleton.bones().iter().enumerate() {
            let (turn, end) = match bone.parent {
                Some(p) => (turns[p], ends[p]),
                None => (DQuat::IDENTITY, DVec3::ZERO),
            };
            let own = turn * self.rotations[i][t];
            ends.push(end + turn * self.starts[i][t] + own * self.ends[i][t]);
            turns.push(own);
        }
        bones.iter().flat_map(|&b| ends[b].to_array()).collect()
    }
}

//! The motion of FBX files ([`posing_fbx`]) as BVH hierarchies and as positions.

use super::bvh::{Bvh, EndSite, Joint};
use super::input::Input;
use super::marker_take::unique_names;
use super::motion_format::{MotionFormat, recognized};
use super::text::excerpt;
use crate::pose::poses::point_at;
use crate::pose::rotation::{Axis, decompose};
use crate::pose::{Channel, Poses};
use crate::{Error, Place, Result};
use glam::{DMat3, DQuat, DVec3};
use ndarray::Array2;
use posing_core::error::is_hidden;
use posing_fbx::{FbxFile, FbxMotion};

/// The order of the rotation channels; the last turns first.
const ORDER: [Axis; 3] = [Axis::Z, Axis::X, Axis::Y];
/// A joint that leaves its place in its parent bone by more than this, cm, gets position channels.
const FIXED: f64 = 0.003;
/// The most bytes of a file.
const LARGEST_FILE: u64 = 2 << 30;

/// Reads an FBX file.
///
/// # Errors
/// [`Error::Io`]: it cannot be read. [`Error::Data`]: it is no FBX file, damaged or too large, or
/// has no skeleton.
pub fn read(input: Input) -> Result<FbxFile> {
    let name = input.name.clone();
    let bytes = input.read_all(LARGEST_FILE)?;
    if bytes.is_empty() {
        return Err(Error::data(Place::file(name), "is empty"));
    }
    if MotionFormat::of(&bytes) != MotionFormat::Fbx {
        let what = recognized(&bytes).unwrap_or("is no FBX file");
        return Err(Error::data(Place::file(name), what));
    }
    FbxFile::read(&name, &bytes)
}

/// The positions of the joints, and of the ends of bones that Blender writes, under their names;
/// what repeats gets `_2` and so on.
pub fn to_poses(motion: &FbxMotion) -> Poses {
    let times = (0..motion.positions.nrows()).map(|frame| frame as f64 / motion.rate);
    Poses {
        points: unique_names(seen(motion).iter().map(String::as_str)),
        xyz: motion.positions.clone(),
        time: Some(times.collect()),
        take: None,
    }
}

/// The motion as a BVH hierarchy whose zero pose is the rest pose. The root has position channels,
/// and each joint that moves against its parent's bone; the ends of bones are End Sites. Where a
/// key is no number, values are NaN.
///
/// ```
/// use posing_fbx::{FbxJoint, FbxMotion};
/// use glam::{DQuat, DVec3};
/// use ndarray::{Array2, array};
///
/// let joint = |name: &str, parent, y| FbxJoint {
///     name: name.into(),
///     parent,
///     rest: DVec3::new(0.0, y, 0.0),
///     is_end: false,
/// };
/// let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
/// let motion = FbxMotion {
///     joints: vec![joint("hips", None, 90.0), joint("head", Some(0), 160.0)],
///     rate: 30.0,
///     positions: array![[0.0, 90.0, 0.0, -70.0, 90.0, 0.0]],
///     turns: Array2::from_elem((1, 2), turn),
///     notes: Vec::new(),
/// };
/// let bvh = posing_io::fbx::to_bvh(&motion);
/// assert_eq!(bvh.joints[1].offset, DVec3::new(0.0, 70.0, 0.0));
/// let head = bvh.to_poses()?.xyz.row(0).to_vec()[3..6].to_vec();
/// assert!(head.iter().zip([-70.0, 90.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9));
/// # Ok::<(), posing_core::Error>(())
/// ```
pub fn to_bvh(motion: &FbxMotion) -> Bvh {
    let names = bvh_names(motion);
    let placed = Placed::of(motion);
    let is_end = |i: usize| motion.joints[i].is_end && !placed.is_free[i];
    let mut places = vec![0; motion.joints.len()];
    let mut joints: Vec<Joint> = Vec::new();
    let mut sources = Vec::new();
    let tree = motion.tree_len();
    for (i, own) in motion.joints[..tree].iter().enumerate() {
        let parent = own.parent.map(|p| places[p]);
        let offset = own.parent.map(|p| own.rest - motion.joints[p].rest);
        let offset = offset.unwrap_or(DVec3::ZERO);
        if let (true, Some(above)) = (is_end(i), parent) {
            let after = joints.iter().filter(|j| j.parent == parent).count();
            joints[above].ends.push(EndSite { offset, after });
            continue;
        }
        places[i] = joints.len();
        let mut channels = Vec::new();
        if parent.is_none() || placed.is_free[i] {
            channels.extend([Axis::X, Axis::Y, Axis::Z].map(Channel::Translate));
        }
        channels.extend(ORDER.map(Channel::Rotate));
        joints.push(Joint {
            name: names[i].clone(),
            parent,
            offset,
            channels,
            ends: Vec::new(),
        });
        sources.push(i);
    }
    for i in 0..joints.len() {
        if joints[i].ends.is_empty() && !joints.iter().any(|j| j.parent == Some(i)) {
            joints[i].ends.push(EndSite::default());
        }
    }
    Bvh {
        motion: channel_values(motion, &placed, &joints, &sources),
        joints,
        frame_time: 1.0 / motion.rate,
        notes: left_out(&names[tree..]),
    }
}

/// What a hierarchy of one root has no place for.
fn left_out(names: &[String]) -> Vec<String> {
    let note = || {
        format!(
            "left out of BVH, which has one root: {}",
            excerpt(&names.join(", "))
        )
    };
    (!names.is_empty()).then(note).into_iter().collect()
}

/// The values of the channels; `sources` are the joints of `motion` that `joints` are.
fn channel_values(
    motion: &FbxMotion,
    placed: &Placed,
    joints: &[Joint],
    sources: &[usize],
) -> Array2<f64> {
    let frames = motion.positions.nrows();
    let mut values = Array2::zeros((frames, Bvh::channels(joints)));
    let mut column = 0;
    for (joint, &source) in joints.iter().zip(sources) {
        let above = motion.joints[source].parent;
        let mut near = [0.0; 3];
        for frame in 0..frames {
            let (before, from) = placed.above(motion, frame, above);
            let mut at = column;
            if joint.channels.len() > 3 {
                let step = point_at(motion.positions.view(), frame, source) - from;
                for value in (before.inverse() * step).to_array() {
                    values[[frame, at]] = value;
                    at += 1;
                }
            }
            let own = DMat3::from_quat(before.inverse() * motion.turns[[frame, source]]);
            let angles = decompose(&own, ORDER, near);
            for (i, angle) in angles.into_iter().enumerate() {
                values[[frame, at + i]] = if own.is_finite() { angle } else { f64::NAN };
            }
            if own.is_finite() {
                near = angles;
            }
        }
        column += joint.channels.len();
    }
    values
}

/// Where a hierarchy of fixed offsets puts the joints, as long as they keep to them.
struct Placed {
    /// (frames, joints)
    at: Array2<DVec3>,
    /// Whether a joint leaves its place in its parent's bone, and so has positions of its own.
    is_free: Vec<bool>,
}

impl Placed {
    fn of(motion: &FbxMotion) -> Placed {
        let shape = motion.turns.dim();
        let mut placed = Placed {
            at: Array2::from_elem(shape, DVec3::ZERO),
            is_free: vec![false; shape.1],
        };
        let truth = |frame, joint| point_at(motion.positions.view(), frame, joint);
        for (i, joint) in motion.joints.iter().enumerate() {
            let offset = joint.parent.map(|p| joint.rest - motion.joints[p].rest);
            for frame in 0..shape.0 {
                let (turn, from) = placed.above(motion, frame, joint.parent);
                let fixed = offset.map(|offset| from + turn * offset);
                placed.at[[frame, i]] = fixed.unwrap_or_else(|| truth(frame, i));
            }
            let leaves = |frame| (placed.at[[frame, i]] - truth(frame, i)).length() > FIXED;
            if (0..shape.0).any(leaves) {
                placed.is_free[i] = true;
                (0..shape.0).for_each(|frame| placed.at[[frame, i]] = truth(frame, i));
            }
        }
        placed
    }

    /// The turn of a joint above in a frame, and where it is put.
    fn above(&self, motion: &FbxMotion, frame: usize, above: Option<usize>) -> (DQuat, DVec3) {
        match above {
            Some(p) => (motion.turns[[frame, p]], self.at[[frame, p]]),
            None => (DQuat::IDENTITY, DVec3::ZERO),
        }
    }
}

/// The names of the joints without characters that are not seen.
fn seen(motion: &FbxMotion) -> Vec<String> {
    let shown = |name: &String| name.replace(is_hidden, " ").trim().to_string();
    motion
        .joints
        .iter()
        .map(|joint| shown(&joint.name))
        .collect()
}

/// Names as BVH holds them: without blanks and braces.
fn bvh_names(motion: &FbxMotion) -> Vec<String> {
    let is_syntax = |c: char| c.is_whitespace() || matches!(c, '{' | '}');
    let names: Vec<String> = seen(motion)
        .iter()
        .map(|name| name.replace(is_syntax, "_"))
        .collect();
    unique_names(names.iter().map(String::as_str))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{BvhPoints, BvhSkeleton};
    use posing_fbx::FbxJoint;
    use rand::Rng;

    /// A body whose second joint slides and whose fifth bone grows, at random.
    fn random(frames: usize) -> FbxMotion {
        let mut rng = crate::numeric::parallel::rng(5, 0);
        let mut number = |size: f64| rng.random_range(-size..size);
        let parents = [
            None,
            Some(0),
            Some(1),
            Some(2),
            Some(0),
            Some(4),
            Some(5),
            Some(5),
        ];
        let names = [
            "hips",
            "slider",
            "arm b",
            "arm b_end",
            "{leg}",
            "foot",
            "foot_end",
            "foot",
        ];
        let rests: Vec<DVec3> = (0..8)
            .map(|_| DVec3::from_array([0; 3].map(|_| number(50.0))))
            .collect();
        let joints = parents.iter().zip(names).zip(&rests);
        let joints: Vec<FbxJoint> = joints
            .map(|((parent, name), rest)| FbxJoint {
                name: name.into(),
                parent: *parent,
                rest: *rest,
                is_end: name.ends_with("_end"),
            })
            .collect();
        let mut positions = Array2::zeros((frames, 24));
        let turns = Array2::from_shape_fn((frames, 8), |_| {
            DQuat::from_array([0; 4].map(|_| number(1.0))).normalize()
        });
        for frame in 0..frames {
            let mut at = [DVec3::ZERO; 8];
            for (j, joint) in joints.iter().enumerate() {
                let step = joint.parent.map(|p| (p, joint.rest - rests[p]));
                at[j] = match step {
                    Some((p, step)) => {
                        let grown = if j == 5 { 1.2 } else { 1.0 };
                        let slid = if j == 1 { number(3.0) } else { 0.0 };
                        at[p] + turns[[frame, p]] * (step * grown + DVec3::X * slid)
                    }
                    None => DVec3::from_array([0; 3].map(|_| number(100.0))),
                };
                for (axis, value) in at[j].to_array().into_iter().enumerate() {
                    positions[[frame, 3 * j + axis]] = value;
                }
            }
        }
        FbxMotion {
            joints,
            rate: 120.0,
            positions,
            turns,
            notes: Vec::new(),
        }
    }

    #[test]
    fn joints_stand_where_they_did_and_turn_as_they_did() {
        let motion = random(40);
        let bvh = to_bvh(&motion);
        let names: Vec<&str> = bvh.joints.iter().map(|j| j.name.as_str()).collect();
        assert_eq!(
            names,
            ["hips", "slider", "arm_b", "_leg_", "foot", "foot_2"]
        );
        let widths: Vec<usize> = bvh.joints.iter().map(|j| j.channels.len()).collect();
        assert_eq!(widths, [6, 6, 3, 3, 6, 3]);
        let skeleton = BvhSkeleton::new(&bvh.joints, DMat3::IDENTITY, true).unwrap();
        let got = bvh.positions(&skeleton, BvhPoints::Origins, 120.0);
        let wanted = [
            "hips",
            "slider",
            "arm_b",
            "arm_b_end",
            "_leg_",
            "foot",
            "foot_end",
            "foot_2",
        ];
        for (j, name) in wanted.into_iter().enumerate() {
            let at = got.points.iter().position(|point| point == name).unwrap();
            for frame in 0..40 {
                let truth = point_at(motion.positions.view(), frame, j);
                let far = (point_at(got.xyz.view(), frame, at) - truth).length();
                assert!(far < 1e-9, "{name} {frame}: {far}");
            }
        }
        // What is written and read again is the same to its digits.
        let text = bvh.to_bytes(1.0);
        let again = Bvh::from_bytes("t.bvh", text).unwrap();
        assert_eq!((again.joints.len(), again.rate()), (6, Some(120.0)));
        let far = (&again.motion - &bvh.motion).mapv(f64::abs);
        assert!(far.iter().all(|d| *d < 1e-6));
    }

    #[test]
    fn a_body_that_keeps_its_bones_has_positions_at_its_root_alone() {
        let mut motion = random(3);
        for frame in 0..3 {
            for j in 1..8 {
                let p = motion.joints[j].parent.unwrap();
                let step = motion.joints[j].rest - motion.joints[p].rest;
                let at =
                    point_at(motion.positions.view(), frame, p) + motion.turns[[frame, p]] * step;
                for (axis, value) in at.to_array().into_iter().enumerate() {
                    motion.positions[[frame, 3 * j + axis]] = value;
                }
            }
        }
        let bvh = to_bvh(&motion);
        assert!(bvh.joints.iter().skip(1).all(|j| j.channels.len() == 3));
        assert_eq!(bvh.joints[2].ends.len(), 1);
    }

    #[test]
    fn missing_turns_are_missing_values_and_names_are_apart() {
        let mut motion = random(3);
        motion.turns[[1, 2]] = DQuat::from_array([f64::NAN; 4]);
        motion.joints[0].name = "\u{202e}Hips \u{7}".into();
        motion.joints[4].name = "Hips".into();
        let bvh = to_bvh(&motion);
        assert_eq!(
            (bvh.joints[0].name.as_str(), bvh.joints[3].name.as_str()),
            ("Hips", "Hips_2")
        );
        let missing: Vec<usize> = bvh.missing().iter().map(|(frame, _)| *frame).collect();
        assert_eq!(missing, [1, 1, 1]);
        let points = to_poses(&motion).points;
        assert_eq!(
            (points[4].as_str(), points[2].as_str()),
            ("Hips_2", "arm b")
        );
    }
}

//! The sixteen joints of the pose descriptor (Chen et al., Fig. 1), and which points of a table
//! they are.

use crate::Result;
use crate::draw::figure::strip::StripJoints;
use crate::pose::{NameFinder, NameMap};
use glam::DVec3;
use ndarray::Array2;
use std::collections::BTreeMap;

/// The joints, in the order in which arrays hold them.
#[doc(hidden)]
pub const JOINTS: [&str; 16] = [
    "Hip",
    "Chest",
    "Neck",
    "Head",
    "LShoulder",
    "LElbow",
    "LHand",
    "RShoulder",
    "RElbow",
    "RHand",
    "LHip",
    "LKnee",
    "LFoot",
    "RHip",
    "RKnee",
    "RFoot",
];
/// The parent of each joint; the hip's is itself.
#[doc(hidden)]
pub const PARENTS: [usize; 16] = [0, 0, 1, 2, 2, 4, 5, 2, 7, 8, 0, 10, 11, 0, 13, 14];
/// The points of the CMU skeleton. Each is the end of the bone of its name; a foot is the ankle.
const CMU: [&str; 16] = [
    "root",
    "thorax",
    "lowerneck",
    "head",
    "lclavicle",
    "lhumerus",
    "lwrist",
    "rclavicle",
    "rhumerus",
    "rwrist",
    "lhipjoint",
    "lfemur",
    "ltibia",
    "rhipjoint",
    "rfemur",
    "rtibia",
];

/// The joints, to be drawn.
#[doc(hidden)]
pub const SIXTEEN_JOINTS: StripJoints<'static> = StripJoints {
    names: &JOINTS,
    parents: &PARENTS,
};

/// Indices of joints in [`JOINTS`].
#[doc(hidden)]
pub mod joint {
    #![allow(missing_docs)]
    pub const HIP: usize = 0;
    pub const CHEST: usize = 1;
    pub const NECK: usize = 2;
    pub const HEAD: usize = 3;
    pub const LSHOULDER: usize = 4;
    pub const LELBOW: usize = 5;
    pub const LHAND: usize = 6;
    pub const RSHOULDER: usize = 7;
    pub const RELBOW: usize = 8;
    pub const RHAND: usize = 9;
    pub const LHIP: usize = 10;
    pub const LKNEE: usize = 11;
    pub const LFOOT: usize = 12;
    pub const RHIP: usize = 13;
    pub const RKNEE: usize = 14;
    pub const RFOOT: usize = 15;
}

/// The name of the point that is each joint.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointMap([String; 16]);

impl JointMap {
    /// The map of the CMU skeleton, by the names that `amc2xyz` writes.
    pub fn cmu() -> JointMap {
        JointMap(CMU.map(String::from))
    }

    /// The map by which the joints are found among `points`: that of the CMU skeleton where they
    /// have its names, else the shipped map that fits them; CMU's again where none does.
    ///
    /// ```
    /// use posing_likeness::JointMap;
    ///
    /// let names = posing_core::pose::joints::cmu_names();
    /// assert_eq!(JointMap::fitting(&names), JointMap::cmu());
    /// ```
    pub fn fitting(points: &[String]) -> JointMap {
        let cmu = JointMap::cmu();
        match (cmu.find(points), NameMap::fitting(points)) {
            (Err(_), Some(map)) => JointMap::of_names(map),
            _ => cmu,
        }
    }

    /// A map of each joint's name to that of its point, such as `LHand` to `lwrist`.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: joints are missing or unknown.
    pub fn new(mut points: BTreeMap<String, String>) -> Result<JointMap> {
        let mut missing = Vec::new();
        let map = JOINTS.map(|joint| {
            points.remove(joint).unwrap_or_else(|| {
                missing.push(joint);
                String::new()
            })
        });
        if !missing.is_empty() {
            return Err(format!("has no point for {}", missing.join(", ")).into());
        }
        match points.keys().next() {
            Some(unknown) => Err(format!(
                "names a joint \"{unknown}\", which is none of {}",
                JOINTS.join(", ")
            )
            .into()),
            None => Ok(JointMap(map)),
        }
    }

    /// The points, in the order of [`JOINTS`].
    pub(crate) fn points(&self) -> &[String] {
        &self.0
    }

    /// The map of a shipped map of names, whose hand is a point beyond the wrist if there is one.
    pub fn of_names(map: &NameMap) -> JointMap {
        let name = |point: &str| map.joints.get(point).cloned();
        let either = |points: &[&str]| {
            let names = points.iter().filter_map(|p| name(p));
            names.collect::<Vec<_>>().join("|")
        };
        let hips = ["lhipjoint", "rhipjoint"].map(|p| name(p).unwrap_or_default());
        JointMap(std::array::from_fn(|j| match JOINTS[j] {
            "Hip" => [name("root"), Some(hips.join("+"))]
                .into_iter()
                .flatten()
                .collect::<Vec<_>>()
                .join("|"),
            trunk @ ("Chest" | "Neck" | "Head") => {
                map.trunk.get(trunk).cloned().unwrap_or_default()
            }
            "LHand" => either(&["lwrist", "lradius"]),
            "RHand" => either(&["rwrist", "rradius"]),
            _ => either(&[CMU[j]]),
        }))
    }

    /// The points of each joint among `points`. A name may be several with `|` between them, of
    /// which the first that is there counts, and with `+` between them the middle of points.
    /// All may have one prefix, as in `mixamorig:Hips`.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: joints whose points are not there, or those of two people.
    pub(crate) fn find(&self, points: &[String]) -> Result<JointColumns> {
        let singles = self.0.iter().flat_map(|name| name.split(['|', '+']));
        let finder = NameFinder::new(points, singles);
        if finder.is_ambiguous() {
            return Err("has the joints of two people; part them".into());
        }
        let mut missing = Vec::new();
        let mut found = JointColumns::default();
        for ((joint, name), found) in JOINTS.iter().zip(&self.0).zip(&mut found.0) {
            let literal = points.iter().position(|p| p == name).map(|p| vec![p]);
            let middle = |names: &str| names.split('+').map(|n| finder.find(n)).collect();
            match literal.or_else(|| name.split('|').find_map(middle)) {
                Some(columns) => *found = columns,
                None => missing.push(format!("\"{name}\" ({joint})")),
            }
        }
        if missing.is_empty() {
            Ok(found)
        } else {
            Err(format!(
                "has no point {}; say with the option `map` which points the joints are",
                missing.join(", ")
            )
            .into())
        }
    }
}

/// The points whose middle each joint is, in the order of `JOINTS`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointColumns([Vec<usize>; 16]);

impl JointColumns {
    /// Where a joint is in a frame of points `xyz` (frames, 3 J); NaN where it is missing.
    pub(crate) fn at(&self, xyz: &Array2<f64>, frame: usize, joint: usize) -> DVec3 {
        let columns = &self.0[joint];
        let at = |&p: &usize| DVec3::from_array([0, 1, 2].map(|c| xyz[[frame, 3 * p + c]]));
        match columns[..] {
            [one] => at(&one),
            _ => columns.iter().map(at).sum::<DVec3>() / columns.len() as f64,
        }
    }

    /// The points of a joint.
    pub(crate) fn of(&self, joint: usize) -> &[usize] {
        &self.0[joint]
    }
}

impl Default for JointMap {
    fn default() -> Self {
        JointMap::cmu()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints;

    #[test]
    fn the_cmu_map_finds_all_joints() {
        let names = joints::cmu_names();
        let found = JointMap::cmu().find(&names).unwrap();
        assert_eq!(names[found.of(joint::HEAD)[0]], "head");
        assert_eq!(names[found.of(joint::LFOOT)[0]], "ltibia");
        let said = JointMap::cmu().find(&names[1..]).unwrap_err().to_string();
        assert!(
            said.contains("\"root\" (Hip)") && said.contains("the option `map`"),
            "{said}"
        );
    }

    #[test]
    fn a_map_names_all_joints_and_no_other() {
        let whole: BTreeMap<String, String> = JOINTS.map(|j| (j.into(), format!("my{j}"))).into();
        let names: Vec<String> = JOINTS.map(|j| format!("my{j}")).into();
        let new = |names| JointMap::new(names).map_err(|e| e.to_string());
        let map = new(whole.clone()).unwrap();
        let found = map.find(&names).unwrap();
        assert!((0..16).all(|j| found.of(j) == [j]));
        let mut without = whole.clone();
        without.remove("Head");
        assert!(new(without).unwrap_err().contains("Head"));
        let mut with = whole;
        with.insert("Tail".into(), "x".into());
        assert!(new(with).unwrap_err().contains("\"Tail\""));
    }

    #[test]
    fn every_shipped_map_of_names_finds_its_joints() {
        for map in NameMap::shipped() {
            let names = map.joints.values().chain(map.trunk.values());
            // The first of several names, the whole of a middle.
            let names = names.flat_map(|n| n.split('|').next().unwrap_or(n).split('+'));
            let mut points: Vec<String> = names.map(|n| format!("rig:{n}")).collect();
            points.sort();
            points.dedup();
            let found = JointMap::of_names(map).find(&points);
            let found = found.unwrap_or_else(|e| panic!("{}: {e}", map.name));
            assert!((0..16).all(|j| !found.of(j).is_empty()), "{}", map.name);
            let two: Vec<String> = points.iter().map(|p| p.replace("rig:", "two:")).collect();
            let two = [points, two].concat();
            assert!(JointMap::of_names(map).find(&two).is_err(), "{}", map.name);
        }
    }

    #[test]
    fn a_joint_may_be_in_the_middle_of_points() {
        let map: BTreeMap<String, String> = JOINTS.map(|j| (j.into(), format!("my{j}"))).into();
        let mut middle = map.clone();
        middle.insert("Hip".into(), "pelvis|myLHip+myRHip".into());
        let names: Vec<String> = map.values().filter(|n| *n != "myHip").cloned().collect();
        let found = JointMap::new(middle).unwrap().find(&names).unwrap();
        let xyz = Array2::from_shape_fn((1, 45), |(_, c)| c as f64);
        let (left, right) = (
            found.at(&xyz, 0, joint::LHIP),
            found.at(&xyz, 0, joint::RHIP),
        );
        assert_eq!(found.at(&xyz, 0, joint::HIP), (left + right) / 2.0);
    }
}

//! The sixteen joints of the pose descriptor (Chen et al., Fig. 1), and which points of a table they are.

use std::collections::BTreeMap;

/// The joints, in the order in which arrays hold them.
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

/// Indices of joints in [`JOINTS`].
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

    /// A map of each joint's name to that of its point, such as `LHand` to `lwrist`.
    ///
    /// # Errors
    /// The joints that are missing or unknown, as a phrase.
    pub fn new(mut points: BTreeMap<String, String>) -> std::result::Result<JointMap, String> {
        let mut missing = Vec::new();
        let map = JOINTS.map(|joint| {
            points.remove(joint).unwrap_or_else(|| {
                missing.push(joint);
                String::new()
            })
        });
        if !missing.is_empty() {
            return Err(format!("has no point for {}", missing.join(", ")));
        }
        match points.keys().next() {
            Some(unknown) => Err(format!(
                "names a joint \"{unknown}\", which is none of {}",
                JOINTS.join(", ")
            )),
            None => Ok(JointMap(map)),
        }
    }

    /// The points, in the order of [`JOINTS`].
    pub fn points(&self) -> &[String] {
        &self.0
    }

    /// The index of each joint among `points`.
    ///
    /// # Errors
    /// The joints whose points are not there, as a phrase.
    pub fn find(&self, points: &[String]) -> std::result::Result<[usize; 16], String> {
        let mut missing = Vec::new();
        let mut found = [0; 16];
        for ((joint, name), found) in JOINTS.iter().zip(&self.0).zip(&mut found) {
            match points.iter().position(|p| p == name) {
                Some(index) => *found = index,
                None => missing.push(format!("\"{name}\" ({joint})")),
            }
        }
        match missing.is_empty() {
            true => Ok(found),
            false => Err(format!(
                "has no point {}; say with --map which points the joints are",
                missing.join(", ")
            )),
        }
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
        assert_eq!(names[found[joint::HEAD]], "head");
        assert_eq!(names[found[joint::LFOOT]], "ltibia");
        let said = JointMap::cmu().find(&names[1..]).unwrap_err();
        assert!(
            said.contains("\"root\" (Hip)") && said.contains("--map"),
            "{said}"
        );
    }

    #[test]
    fn a_map_names_all_joints_and_no_other() {
        let whole: BTreeMap<String, String> = JOINTS.map(|j| (j.into(), format!("my{j}"))).into();
        let names: Vec<String> = JOINTS.map(|j| format!("my{j}")).into();
        let map = JointMap::new(whole.clone()).unwrap();
        assert_eq!(map.find(&names).unwrap(), std::array::from_fn(|k| k));
        let mut without = whole.clone();
        without.remove("Head");
        assert!(JointMap::new(without).unwrap_err().contains("Head"));
        let mut with = whole;
        with.insert("Tail".into(), "x".into());
        assert!(JointMap::new(with).unwrap_err().contains("\"Tail\""));
    }
}

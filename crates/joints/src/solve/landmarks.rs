//! Where on which bone markers are, and which joints are asked for.

use super::tuning::{LEAST_SD, TRUE_PLACE};
use crate::pose::joints::CMU;
use crate::prior::rotations::bones::mirror;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::LazyLock;

/// The joints that markers are solved for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointSet {
    /// The 23 of the built-in model: CMU's.
    #[default]
    Cmu,
    /// Centers of the hips, knees, ankles, shoulders, elbows and wrists: LHJC, LKJC, LAJC, LSJC,
    /// LEJC, LWJC and those of the right side.
    Anatomical,
}

/// The anatomical joints and the bones that end at them.
const CENTERS: [(&str, &str); 6] = [
    ("HJC", "hipjoint"),
    ("KJC", "femur"),
    ("AJC", "tibia"),
    ("SJC", "clavicle"),
    ("EJC", "humerus"),
    ("WJC", "wrist"),
];

impl JointSet {
    /// The set that some joints are of.
    pub(super) fn of(points: &[String]) -> JointSet {
        if points.iter().any(|p| CMU.contains(&p.as_str())) {
            JointSet::Cmu
        } else {
            JointSet::Anatomical
        }
    }

    /// The names of the joints, and of the bones whose ends they are.
    pub(super) fn joints(self) -> Vec<(String, String)> {
        match self {
            JointSet::Cmu => CMU.iter().map(|n| (n.to_string(), n.to_string())).collect(),
            JointSet::Anatomical => ["L", "R"]
                .iter()
                .flat_map(|side| {
                    let of = move |(name, bone): &(&str, &str)| {
                        (
                            format!("{side}{name}"),
                            format!("{}{bone}", side.to_lowercase()),
                        )
                    };
                    CENTERS.iter().map(of)
                })
                .collect(),
        }
    }
}

/// A landmark: where a marker on it is about.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Landmark {
    /// The bone, without l or r where it is of a side.
    pub bone: Cow<'static, str>,
    /// The share of the bone at which the offset begins.
    pub along: f64,
    /// The offset in the axes of the rest pose, of the left side, and its deviations, cm: for CMU's
    /// joints and for anatomical ones.
    offsets: [[DVec3; 2]; 2],
}

static ALL: LazyLock<Vec<(&'static str, Landmark)>> = LazyLock::new(|| {
    let rows = include_str!("landmarks.csv").lines().skip(1);
    let parsed = rows.filter_map(|row| {
        let cells: Vec<&'static str> = row.split(',').collect();
        let numbers: Vec<f64> = cells
            .get(2..)?
            .iter()
            .filter_map(|c| c.parse().ok())
            .collect();
        let vector = |at: usize| DVec3::from_slice(&numbers[at..at + 3]);
        (numbers.len() == 13).then(|| {
            let of = |at: usize| [vector(at), vector(at + 3).max(DVec3::splat(LEAST_SD))];
            let landmark = Landmark {
                bone: Cow::Borrowed(cells[1]),
                along: numbers[0],
                offsets: [of(1), of(7)],
            };
            (cells[0], landmark)
        })
    });
    parsed.collect()
});

/// The landmark of a name.
pub(crate) fn landmark(name: &str) -> Option<&'static Landmark> {
    ALL.iter().find(|(own, _)| *own == name).map(|(_, l)| l)
}

impl Landmark {
    /// The end of a bone.
    pub(crate) fn joint(bone: &str) -> Landmark {
        Landmark::new(bone, 1.0, [DVec3::ZERO, DVec3::splat(TRUE_PLACE)])
    }

    /// A landmark that is at one position for all joints.
    pub(crate) fn new(bone: &str, along: f64, offset_and_sd: [DVec3; 2]) -> Landmark {
        Landmark {
            bone: Cow::Owned(bone.to_string()),
            along,
            offsets: [offset_and_sd; 2],
        }
    }

    /// The same landmark at another position.
    pub(crate) fn at(&self, offset: DVec3, sd: DVec3) -> Landmark {
        Landmark::new(&self.bone, self.along, [offset, sd])
    }

    /// Where it is, from a share of the bone, and the deviations of that, cm.
    pub(crate) fn offset_and_sd(&self, joints: JointSet, is_right: bool) -> [DVec3; 2] {
        let [at, sd] = self.offsets[usize::from(joints == JointSet::Anatomical)];
        if is_right { [mirror(at), sd] } else { [at, sd] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_dictionary_is_read() {
        let rows = include_str!("landmarks.csv").lines().count() - 1;
        assert_eq!(ALL.len(), rows);
        let [left, sd] = landmark("ASI").unwrap().offset_and_sd(JointSet::Cmu, false);
        let [right, _] = landmark("ASI").unwrap().offset_and_sd(JointSet::Cmu, true);
        assert_eq!((left.x, left.y, left.z), (-right.x, right.y, right.z));
        assert!(sd.min_element() >= LEAST_SD);
        assert_eq!(landmark("nothing"), None);
    }
}

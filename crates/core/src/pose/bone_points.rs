//! Where named points stand on their bones: at the ends, as CMU's joints do, or at the starts, as
//! the joints of a BVH file.

use super::joints::{CMU, CMU_PARENT};
use crate::numeric::statistics::median;
use glam::DVec3;
use ndarray::ArrayView2;
use std::borrow::Cow;

/// The bones that CMU's skeleton has beyond [`CMU`], each with its parent.
const EXTREMITIES: [(&str, &str); 8] = [
    ("ltoes", "lfoot"),
    ("rtoes", "rfoot"),
    ("lhand", "lwrist"),
    ("rhand", "rwrist"),
    ("lthumb", "lwrist"),
    ("rthumb", "rwrist"),
    ("lfingers", "lhand"),
    ("rfingers", "rhand"),
];

/// Bones that start together are less than this share of the figure's size apart; their ends are
/// about 15% apart.
const TOGETHER: f64 = 0.08;

/// Frames that are looked at.
const FRAMES: usize = 200;

/// The end of its bone at which a point with the bone's name stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BonePoints {
    /// Where the bone starts.
    Starts,
    /// Where it ends.
    Ends,
}

impl BonePoints {
    /// Tells from names and lengths, for CMU's names: starts, if there are points NAME_end, or if
    /// points whose bones start together are at one position. Nothing is known of other names, and
    /// they count as ends. `xyz`: (frames, 3 J), NaN missing.
    #[doc(hidden)]
    pub fn of(names: &[String], xyz: ArrayView2<'_, f64>) -> BonePoints {
        let is_end = |n: &String| n.strip_suffix("_end").is_some_and(is_bone);
        if names.iter().any(is_end) || siblings_are_together(names, xyz) {
            BonePoints::Starts
        } else {
            BonePoints::Ends
        }
    }

    /// The bones at whose ends the points of a table stand.
    #[doc(hidden)]
    pub fn bone_ends(self, points: &[String]) -> Cow<'_, [String]> {
        match self {
            BonePoints::Starts => Cow::Owned(bone_ends_of_starts(points)),
            BonePoints::Ends => Cow::Borrowed(points),
        }
    }
}

/// For each point of a table of starts, the bone at whose end it stands: that above its own, or for
/// NAME_end the bone NAME. The root stands for itself. The first of several points at one
/// position has the name; the others, and what CMU does not know, are named as nothing is, so that
/// they match no joint.
pub fn bone_ends_of_starts(names: &[String]) -> Vec<String> {
    let mut out: Vec<String> = Vec::with_capacity(names.len());
    for name in names {
        let bone = match name.strip_suffix("_end").filter(|n| is_bone(n)) {
            Some(bone) => Some(bone),
            None if name == CMU[0] => Some(CMU[0]),
            None => parent(name),
        };
        out.push(match bone {
            Some(bone) if !out.iter().any(|n| n == bone) => bone.to_string(),
            _ => format!("{name} (start)"),
        });
    }
    out
}

/// The bone above a bone of CMU's skeleton.
fn parent(name: &str) -> Option<&'static str> {
    let own = (CMU.iter().position(|c| *c == name))
        .filter(|&i| i > 0)
        .map(|i| CMU[CMU_PARENT[i]]);
    let further = || EXTREMITIES.iter().find(|(n, _)| *n == name).map(|e| e.1);
    own.or_else(further)
}

/// Whether CMU's skeleton has a bone of this name.
pub(super) fn is_bone(name: &str) -> bool {
    CMU.contains(&name) || parent(name).is_some()
}

/// Whether bones with one parent start at one position, in the median of the frames and of the
/// pairs. `false` without such pairs.
fn siblings_are_together(names: &[String], xyz: ArrayView2<'_, f64>) -> bool {
    let parents: Vec<_> = names.iter().map(|n| parent(n)).collect();
    let mut pairs = Vec::new();
    for a in 0..names.len() {
        pairs.extend((0..a).filter_map(|b| (parents[a]? == parents[b]?).then_some((a, b))));
    }
    let step = xyz.nrows().div_ceil(FRAMES).max(1);
    let mut apart = Vec::new();
    for row in xyz.rows().into_iter().step_by(step) {
        let at = |p: usize| DVec3::new(row[3 * p], row[3 * p + 1], row[3 * p + 2]);
        let seen = (0..names.len()).map(at).filter(|p| p.is_finite());
        let (low, high) = seen.fold((DVec3::MAX, DVec3::MIN), |(l, h), p| (l.min(p), h.max(p)));
        let size = (high - low).max_element();
        let ratios = (pairs.iter()).map(|&(a, b)| (at(a) - at(b)).length() / size);
        apart.extend(ratios.filter(|r| r.is_finite()));
    }
    median(apart).is_some_and(|ratio| ratio < TOGETHER)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|n| n.to_string()).collect()
    }

    #[test]
    fn ends_of_bones_are_named_by_what_starts_there() {
        let starts = names(&[
            "root",
            "lhipjoint",
            "lfemur",
            "ltibia",
            "lfoot",
            "ltoes",
            "lowerback",
            "head",
            "head_end",
            "lwrist_end",
            "tail",
        ]);
        let ends = [
            "root",
            "lhipjoint (start)",
            "lhipjoint",
            "lfemur",
            "ltibia",
            "lfoot",
            "lowerback (start)",
            "upperneck",
            "head",
            "lwrist",
            "tail (start)",
        ];
        assert_eq!(bone_ends_of_starts(&starts), ends);
    }

    #[test]
    fn starts_are_told_by_names_and_by_positions() {
        let four = names(&["root", "lhipjoint", "rhipjoint", "lfemur"]);
        let apart = Array2::from_shape_vec(
            (1, 12),
            vec![0., 90., 0., 9., 80., 0., -9., 80., 0., 20., 45., 0.],
        )
        .unwrap();
        let mut together = apart.clone();
        (0..3).for_each(|i| together[[0, 6 + i]] = together[[0, 3 + i]]);
        let of = |xyz: &Array2<f64>| BonePoints::of(&four, xyz.view());
        assert_eq!(
            (of(&apart), of(&together)),
            (BonePoints::Ends, BonePoints::Starts)
        );
        assert_eq!(of(&Array2::from_elem((1, 12), f64::NAN)), BonePoints::Ends);
        let ends = names(&["lfoot", "lfoot_end"]);
        assert_eq!(
            BonePoints::of(&ends, Array2::zeros((1, 6)).view()),
            BonePoints::Starts
        );
    }
}

//! CMU's joints: names, order, chains (figure 2 of Lai et al.).
//!
//! A joint is the end point of the bone of the same name; joint 1 is the root.

use super::NameMap;
use super::rotation::frame_along;
use glam::{DMat3, DVec3};

/// The 23 joints in Lai et al.'s order: 69 numbers per pose.
pub const CMU: [&str; 23] = [
    "root",
    "lhipjoint",
    "lfemur",
    "ltibia",
    "lfoot",
    "rhipjoint",
    "rfemur",
    "rtibia",
    "rfoot",
    "lowerback",
    "upperback",
    "thorax",
    "lowerneck",
    "upperneck",
    "head",
    "lclavicle",
    "lhumerus",
    "lradius",
    "lwrist",
    "rclavicle",
    "rhumerus",
    "rradius",
    "rwrist",
];

/// The parent of each joint of [`CMU`]; the root is its own.
#[doc(hidden)]
pub const CMU_PARENT: [usize; 23] = [
    0, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 12, 13, 11, 15, 16, 17, 11, 19, 20, 21,
];

/// CMU's rest pose: the mean over 17 subjects, left and right made equal; centimeters from the
/// root.
#[rustfmt::skip]
#[doc(hidden)]
pub const CMU_REST: [[f64; 3]; 23] = [
    [0.0, 0.0, 0.0],
    [9.2, -9.9, 4.1], [22.9, -47.5, 4.1], [37.7, -88.1, 4.1], [38.7, -90.9, 15.7],
    [-9.2, -9.9, 4.1], [-22.9, -47.5, 4.1], [-37.7, -88.1, 4.1], [-38.7, -90.9, 15.7],
    [0.0, 11.6, -1.1], [0.0, 23.2, -1.1], [0.0, 34.9, -0.7],
    [0.0, 44.4, 0.1], [0.0, 53.9, -1.2], [0.0, 63.7, -1.8],
    [18.2, 41.1, -1.4], [48.1, 41.1, -1.4], [66.6, 41.1, -1.4], [75.8, 41.1, -1.4],
    [-18.2, 41.1, -1.4], [-48.1, 41.1, -1.4], [-66.6, 41.1, -1.4], [-75.8, 41.1, -1.4],
];

/// The points of the pelvis: the root and the hip joints, which do not turn against it.
#[doc(hidden)]
pub const PELVIS: [&str; 3] = ["root", "lhipjoint", "rhipjoint"];

/// The frame of a pelvis by its points, in the order of [`PELVIS`]: x from the right hip to the
/// left, y near the way from between them to the root, z forward. `None` where it has none.
#[doc(hidden)]
pub fn pelvis_frame([root, left, right]: [DVec3; 3]) -> Option<DMat3> {
    frame_along(left - right, root - (left + right) / 2.0)
}

/// The frame of CMU's pelvis in the rest pose.
#[doc(hidden)]
pub fn rest_pelvis() -> DMat3 {
    let rest = PELVIS.map(|name| CMU.iter().position(|c| *c == name).unwrap_or(0));
    let frame = pelvis_frame(rest.map(|i| DVec3::from_array(CMU_REST[i])));
    frame.unwrap_or(DMat3::IDENTITY)
}

/// The six joints observed in Lai et al.'s completion test (16, 20, 19, 23, 5 and 9).
pub const PAPER_SIX: [&str; 6] = [
    "lclavicle",
    "rclavicle",
    "lwrist",
    "rwrist",
    "lfoot",
    "rfoot",
];

/// The indices of the six joints of Lai et al.'s completion test; `None` unless all six are among
/// the points.
#[doc(hidden)]
pub fn paper_six_of(points: &[String]) -> Option<[usize; 6]> {
    let found = PAPER_SIX.map(|name| points.iter().position(|p| p == name));
    found
        .iter()
        .all(Option::is_some)
        .then(|| found.map(Option::unwrap_or_default))
}

/// How a body divides into parts.
#[derive(Debug, Clone, PartialEq)]
#[doc(hidden)]
pub struct BodyParts {
    /// The coordinates of each part; the first is the whole body.
    pub parts: Vec<Vec<usize>>,
    /// Sets of parts that cover every coordinate once.
    pub factorizations: Vec<Vec<usize>>,
}

/// The first joints of the limbs: the trunk is what remains of the body.
const LIMBS: [&str; 4] = ["lhipjoint", "rhipjoint", "lclavicle", "rclavicle"];

/// The parts of a body with these points: {whole}, {legs and root, upper body}, {left leg and root,
/// right leg, upper body} and {legs and root, trunk, left arm, right arm}.
///
/// Points that CMU's skeleton does not have make a single part, the whole; so do points that leave
/// a part empty.
#[doc(hidden)]
pub fn body_parts(points: &[String]) -> BodyParts {
    // 0 the trunk, 1 to 4 the limbs.
    let limb_of = |name: &String| {
        let mut at = CMU.iter().position(|c| c == name)?;
        loop {
            if let Some(limb) = LIMBS.iter().position(|l| *l == CMU[at]) {
                return Some(limb + 1);
            }
            if at == 0 {
                return Some(0);
            }
            at = CMU_PARENT[at];
        }
    };
    let coordinates_where = |wanted: &dyn Fn(usize) -> bool| -> Vec<usize> {
        let points = (0..points.len()).filter(|&p| wanted(p));
        points.flat_map(|p| 3 * p..3 * p + 3).collect()
    };
    let whole = BodyParts {
        parts: vec![coordinates_where(&|_| true)],
        factorizations: vec![vec![0]],
    };
    let Some(limbs) = points.iter().map(limb_of).collect::<Option<Vec<usize>>>() else {
        return whole;
    };
    let part = |list: &[usize], with_root: bool| {
        coordinates_where(&|p| {
            if points[p] == CMU[0] {
                with_root
            } else {
                list.contains(&limbs[p])
            }
        })
    };
    let parts = vec![
        whole.parts[0].clone(),
        part(&[1, 2], true),
        part(&[0, 3, 4], false),
        part(&[1], true),
        part(&[2], false),
        part(&[0], false),
        part(&[3], false),
        part(&[4], false),
    ];
    if parts.iter().any(Vec::is_empty) {
        return whole;
    }
    BodyParts {
        parts,
        factorizations: vec![vec![0], vec![1, 2], vec![3, 4, 2], vec![1, 5, 6, 7]],
    }
}

/// Which points are among [`PAPER_SIX`].
#[doc(hidden)]
pub fn few_observed(points: &[String]) -> Vec<bool> {
    let known = |name: &String| PAPER_SIX.contains(&name.as_str());
    points.iter().map(known).collect()
}

/// CMU's joints as owned names, as a table without a header is read.
pub fn cmu_names() -> Vec<String> {
    CMU.iter().map(|s| s.to_string()).collect()
}

/// The parent of each name among the same names, by CMU's hierarchy.
///
/// Bones that the names leave out are bridged: without `lhipjoint`, the parent of `lfemur` is
/// `root`. `None` for the root, for names CMU does not know and for those with no ancestor in the
/// list.
///
/// ```
/// use posing_core::pose::joints::parents_by_name;
///
/// let names = ["root", "lfemur", "ltibia", "hat"].map(String::from);
/// assert_eq!(parents_by_name(&names), [None, Some(0), Some(1), None]);
/// ```
pub fn parents_by_name(names: &[String]) -> Vec<Option<usize>> {
    names
        .iter()
        .map(|name| {
            let mut at = CMU.iter().position(|c| c == name)?;
            while at != 0 {
                at = CMU_PARENT[at];
                if let Some(found) = names.iter().position(|n| n == CMU[at]) {
                    return Some(found);
                }
            }
            None
        })
        .collect()
}

/// The pairs of points to join: those of CMU's hierarchy, to which a shipped map of names may lead.
///
/// ```
/// use posing_core::pose::joints;
///
/// let leg = ["lfoot", "lfemur", "ltibia"].map(String::from);
/// assert_eq!(joints::bones(&leg), [(2, 0), (1, 2)]);
/// ```
pub fn bones(points: &[String]) -> Vec<(usize, usize)> {
    let own = parents_by_name(points);
    let map = NameMap::fitting(points).filter(|_| own.iter().all(Option::is_none));
    let parents = map.map_or(own, |map| parents_by_name(&map.model_names(points)));
    let known = parents.iter().enumerate();
    known.filter_map(|(i, p)| p.map(|p| (p, i))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parents_come_first_and_make_the_papers_chains() {
        assert!(CMU_PARENT.iter().enumerate().skip(1).all(|(i, &p)| p < i));
        let chain = |mut j: usize| {
            let mut c = vec![j + 1];
            while j != 0 {
                j = CMU_PARENT[j];
                c.push(j + 1);
            }
            c.reverse();
            c
        };
        assert_eq!(chain(4), [1, 2, 3, 4, 5]);
        assert_eq!(chain(8), [1, 6, 7, 8, 9]);
        assert_eq!(chain(14), [1, 10, 11, 12, 13, 14, 15]);
        assert_eq!(chain(18), [1, 10, 11, 12, 16, 17, 18, 19]);
        assert_eq!(chain(22), [1, 10, 11, 12, 20, 21, 22, 23]);
    }

    #[test]
    fn left_out_bones_are_bridged() {
        let names: Vec<String> = ["lfemur", "root", "tail"]
            .iter()
            .map(|s| s.to_string())
            .collect();
        assert_eq!(parents_by_name(&names), [Some(1), None, None]);
    }

    #[test]
    fn each_factorization_covers_every_coordinate_once() {
        let body = body_parts(&cmu_names());
        assert_eq!(body.factorizations.len(), 4);
        for factorization in &body.factorizations {
            let parts = factorization.iter();
            let mut all: Vec<usize> = parts.flat_map(|&p| body.parts[p].clone()).collect();
            all.sort_unstable();
            assert_eq!(all, (0..69).collect::<Vec<_>>());
        }
        let unknown = body_parts(&["a".into(), "b".into()]);
        assert_eq!(unknown.parts, [(0..6).collect::<Vec<_>>()]);
        assert_eq!(unknown.factorizations, [[0]]);
    }
}

//! Which joint of a hierarchy is which of a body: by a map of names, else by the shape of the tree.

use super::hierarchy::Hierarchy;
use super::shape::{self, Limb};
use crate::pose::{NameFinder, NameMap};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// The joints of a body, left before right.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::ik) struct BodyJoints {
    /// The name of the map, or `shape`.
    pub map: String,
    pub legs: [Limb; 2],
    /// None where a map of somebody's own names none.
    pub arms: Option<[Limb; 2]>,
    pub head: Option<usize>,
    /// On which both legs hang.
    pub pelvis: usize,
    /// On which both arms hang.
    pub chest: Option<usize>,
    /// On which all limbs hang.
    pub base: usize,
    /// By joint, its name without what files put before it.
    pub bare_names: Vec<String>,
}

/// The points of both legs and arms: those of [`Limb::joints`], then the end.
const LEGS: [[&str; 4]; 2] = [
    ["lhipjoint", "lfemur", "ltibia", "lfoot"],
    ["rhipjoint", "rfemur", "rtibia", "rfoot"],
];
const ARMS: [[&str; 4]; 2] = [
    ["lclavicle", "lhumerus", "lradius", "lwrist"],
    ["rclavicle", "rhumerus", "rradius", "rwrist"],
];

/// CMU's bones in a BVH hierarchy, where a joint stands at the start of its bone: those of an ASF
/// file, and of what `xyz2bvh` writes.
const CMU_STARTS: [(&str, &str); 20] = [
    ("root", "root"),
    ("lhipjoint", "lfemur"),
    ("lfemur", "ltibia"),
    ("ltibia", "lfoot"),
    ("lfoot", "ltoes"),
    ("rhipjoint", "rfemur"),
    ("rfemur", "rtibia"),
    ("rtibia", "rfoot"),
    ("rfoot", "rtoes"),
    ("lclavicle", "lhumerus"),
    ("lhumerus", "lradius"),
    ("lradius", "lwrist|lhand"),
    ("lwrist", "lhand"),
    ("rclavicle", "rhumerus"),
    ("rhumerus", "rradius"),
    ("rradius", "rwrist|rhand"),
    ("rwrist", "rhand"),
    ("upperneck", "head"),
    ("lowerneck", "upperneck"),
    ("thorax", "lowerneck"),
];

/// The map of CMU's names for rigs in which a joint stands at the start of its bone, as in the BVH
/// files of `xyz2bvh`: the left knee, CMU's point `lfemur`, is there the joint `ltibia`.
pub fn cmu_map() -> NameMap {
    let own = |(point, joint): (&str, &str)| (point.to_string(), joint.to_string());
    NameMap {
        name: "cmu".into(),
        joints: CMU_STARTS.map(own).into(),
        trunk: [("Head", "head")].map(own).into(),
        ..NameMap::default()
    }
}

impl BodyJoints {
    /// The joints of a body by a map, else by the names of one that is shipped, else by the shape
    /// of the tree. `option` is that by which a map is given.
    ///
    /// # Errors
    /// [`Error::Unfit`]: nothing tells which joints are legs and arms, or what tells it cannot be.
    pub(in crate::ik) fn find(
        tree: &Hierarchy,
        map: Option<&NameMap>,
        option: &str,
    ) -> Result<Self> {
        if let Some(map) = map {
            return by_names(tree, map, option);
        }
        let cmu = cmu_map();
        let columns = cmu.columns(&tree.names);
        let is_core = |points: &[&str; 4]| points[..3].iter().all(|p| columns.contains_key(p));
        if LEGS.iter().chain(&ARMS).all(is_core) {
            return by_names(tree, &cmu, option);
        }
        if let Some(map) = NameMap::fitting(&tree.names) {
            return by_names(tree, map, option);
        }
        let by_shape = shape::find(tree).and_then(|(legs, arms)| {
            let names = NameFinder::new(&tree.names, std::iter::empty());
            BodyJoints::new(tree, ("shape", &names), legs, Some(arms), None)
        });
        by_shape.map_err(|why| {
            let nearest = match NameMap::nearest(&tree.names) {
                Some((map, found)) => format!(
                    "the nearest shipped map is {}, with {found} of its {} names",
                    map.name,
                    map.joints.len()
                ),
                None => "no shipped map has any of its names".into(),
            };
            Error::unfit(format!(
                "cannot tell its legs and arms: {nearest}, and by its shape {why}; say which \
                 joints are which with the option `{option} NAME|FILE.toml`"
            ))
        })
    }

    /// The body of these limbs, by the map of a name and the prefix of its names.
    ///
    /// # Errors
    /// What is wrong with them.
    pub(super) fn new(
        tree: &Hierarchy,
        (map, names): (&str, &NameFinder<'_>),
        legs: [Limb; 2],
        arms: Option<[Limb; 2]>,
        head: Option<usize>,
    ) -> Result<BodyJoints> {
        for limb in legs.iter().chain(arms.iter().flatten()) {
            let [a, b, c] = limb.joints;
            for (above, joint) in [(a, b), (b, c)] {
                if above == joint || !tree.is_below(joint, above) {
                    let (above, joint) = (&tree.names[above], &tree.names[joint]);
                    return Err(Error::unfit(format!("{joint} does not hang on {above}")));
                }
            }
        }
        let common = |limbs: &[Limb; 2]| tree.common(limbs[0].joints[0], limbs[1].joints[0]);
        let pelvis = common(&legs);
        if legs.iter().any(|leg| leg.joints[0] == pelvis) {
            return Err(Error::unfit("one leg hangs on the other"));
        }
        let chest = arms.as_ref().map(common);
        Ok(BodyJoints {
            base: chest.map_or(pelvis, |chest| tree.common(pelvis, chest)),
            map: map.to_string(),
            head: head.or_else(|| chest.and_then(|chest| shape::head(tree, chest, arms.as_ref()))),
            legs,
            arms,
            pelvis,
            chest,
            bare_names: names.bare_names(),
        })
    }

    /// Whether the hand bends at its end too: CMU's wrist only turns, its hand bends.
    pub(super) fn has_hand_joint(&self) -> bool {
        ["cmu", "cmu-bvh"].contains(&self.map.as_str())
    }
}

/// The body that a map tells.
fn by_names(tree: &Hierarchy, map: &NameMap, option: &str) -> Result<BodyJoints> {
    let columns = map.columns(&tree.names);
    let limb = |points: &[&str; 4]| limb(&columns, points);
    let legs = LEGS.iter().map(limb).collect::<Option<Vec<Limb>>>();
    let arms = ARMS.iter().map(limb).collect::<Option<Vec<Limb>>>();
    let Some(Ok(legs)) = legs.map(<[Limb; 2]>::try_from) else {
        return Err(Error::unfit(format!(
            "its joints are not those of the map {} (not {}); name another with the option \
             `{option} NAME|FILE.toml`",
            map.name,
            map.missing(&tree.names)
                .into_iter()
                .take(3)
                .collect::<Vec<_>>()
                .join(", ")
        )));
    };
    let arms = arms.and_then(|arms| <[Limb; 2]>::try_from(arms).ok());
    let names = NameFinder::new(&tree.names, map.joints.values().map(String::as_str));
    let head = head(&names, map).or_else(|| columns.get("upperneck").copied());
    BodyJoints::new(tree, (&map.name, &names), legs, arms, head).map_err(|why| {
        Error::unfit(format!(
            "its joints do not hang as those of the map {} ({why}); name another with the option \
             `{option} NAME|FILE.toml`",
            map.name
        ))
    })
}

fn limb(columns: &BTreeMap<&str, usize>, points: &[&str; 4]) -> Option<Limb> {
    let at = |point: &str| columns.get(point).copied();
    let joints = [at(points[0])?, at(points[1])?, at(points[2])?];
    let end = at(points[3]).filter(|end| !joints.contains(end));
    Some(Limb { joints, end })
}

/// The joint of the head: the last name that the map has for it; those before are of its top.
fn head(names: &NameFinder<'_>, map: &NameMap) -> Option<usize> {
    names.find(map.trunk.get("Head")?.split('|').next_back()?)
}

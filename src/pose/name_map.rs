//! Names of other skeletons: which of a file's points is which point of a model.

use super::bone_points::BonePoints;
use ndarray::ArrayView2;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// The maps that posing ships, by name.
static SHIPPED: LazyLock<Vec<NameMap>> = LazyLock::new(|| {
    let maps: BTreeMap<String, BTreeMap<String, String>> =
        toml::from_str(include_str!("name_maps.toml")).unwrap_or_default();
    let maps = maps.into_iter();
    maps.map(|(name, joints)| NameMap { name, joints })
        .collect()
});

/// Which of a file's points is which point of a model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NameMap {
    /// The name of the map, or of its file.
    pub name: String,
    /// By point of the model, the point of the file.
    pub joints: BTreeMap<String, String>,
}

impl NameMap {
    /// The maps that posing ships, in the order of their names.
    pub fn shipped() -> &'static [NameMap] {
        &SHIPPED
    }

    /// The shipped map of a name.
    pub fn find(name: &str) -> Option<&'static NameMap> {
        let mut maps = SHIPPED.iter();
        maps.find(|map| map.name.eq_ignore_ascii_case(name))
    }

    /// The shipped map with most names of those whose names are all among the `points`, each once: not where there are two people.
    pub fn fitting(points: &[String]) -> Option<&'static NameMap> {
        let once = |name: &String| points.iter().filter(|p| is_name(p, name)).count() == 1;
        let fits = SHIPPED.iter().filter(|map| map.joints.values().all(once));
        fits.max_by_key(|map| map.joints.len())
    }

    /// The names of the map that are not among the `points`.
    pub fn missing(&self, points: &[String]) -> Vec<&str> {
        let names = self.joints.values();
        let is_missing = |name: &&String| !points.iter().any(|p| is_name(p, name));
        names.filter(is_missing).map(String::as_str).collect()
    }

    /// The names by which the model knows the `points`; those that the map does not name are named as nothing is.
    pub fn model_names(&self, points: &[String]) -> Vec<String> {
        let name = |point: &String| {
            let mut joints = self.joints.iter();
            match joints.find(|(_, theirs)| is_name(point, theirs)) {
                Some((model, _)) => model.clone(),
                None => format!("{point} (other)"),
            }
        };
        points.iter().map(name).collect()
    }
}

/// How the points of a table are named.
#[derive(Debug, Clone, PartialEq)]
pub enum PointNaming {
    /// As the model's, by the bones at whose ends or starts they stand.
    Bones(BonePoints),
    /// As a map has them.
    Map(NameMap),
}

impl PointNaming {
    /// The naming of `points` (frames, 3 J; cm) for a model that knows the names `known`: that of the shipped map that fits, if it
    /// names more of them than the model knows by their own names.
    pub fn of(points: &[String], xyz: ArrayView2<'_, f64>, known: &[String]) -> PointNaming {
        let bones = BonePoints::of(points, xyz);
        let is_known = |name: &String| known.contains(name);
        let own = bones
            .bone_ends(points)
            .iter()
            .filter(|n| is_known(n))
            .count();
        let map = NameMap::fitting(points);
        let map = map.filter(|map| map.joints.len() > own && map.joints.keys().all(is_known));
        map.map_or(PointNaming::Bones(bones), |map| {
            PointNaming::Map(map.clone())
        })
    }

    /// The names by which a model of bone ends knows the points.
    pub fn model_names<'p>(&self, points: &'p [String]) -> Cow<'p, [String]> {
        match self {
            PointNaming::Bones(bones) => bones.bone_ends(points),
            PointNaming::Map(map) => Cow::Owned(map.model_names(points)),
        }
    }
}

/// Whether a point has this name, as it is or after its namespace, as in `mixamorig:Hips`.
fn is_name(point: &str, name: &str) -> bool {
    point == name || point.rsplit(':').next() == Some(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|n| n.to_string()).collect()
    }

    #[test]
    fn shipped_maps_name_points_of_the_skeleton_on_both_sides() {
        assert_eq!(NameMap::shipped().len(), 10);
        let points = joints::cmu_names();
        for map in NameMap::shipped() {
            for (point, joint) in &map.joints {
                let at = points.iter().position(|p| p == point);
                let at = at.unwrap_or_else(|| panic!("{}: {point}", map.name));
                if let Some(other) = joints::mirrored(&points, at) {
                    let theirs = &map.joints[&points[other]];
                    assert_ne!(theirs, joint, "{}: {point}", map.name);
                }
            }
            let mut theirs: Vec<&String> = map.joints.values().collect();
            theirs.sort();
            theirs.dedup();
            assert_eq!(theirs.len(), map.joints.len(), "{}", map.name);
        }
    }

    #[test]
    fn the_map_with_most_names_fits() {
        let mixamo = NameMap::find("Mixamo").unwrap();
        let theirs: Vec<String> = mixamo
            .joints
            .values()
            .map(|j| format!("mixamorig:{j}"))
            .collect();
        assert_eq!(NameMap::fitting(&theirs).unwrap().name, "mixamo");
        let fewer: Vec<String> = theirs
            .iter()
            .filter(|n| !n.contains("Middle"))
            .cloned()
            .collect();
        assert_eq!(NameMap::fitting(&fewer).unwrap().name, "hik");
        assert_eq!(
            mixamo.missing(&fewer),
            ["LeftHandMiddle1", "RightHandMiddle1"]
        );
        assert_eq!(NameMap::fitting(&names(&["a", "b"])), None);
        let second = theirs.iter().map(|n| n.replace("mixamorig:", "other:"));
        let two: Vec<String> = theirs.iter().cloned().chain(second).collect();
        assert_eq!(NameMap::fitting(&two), None);
        let own = NameMap {
            name: "own".into(),
            joints: [("lfemur".to_string(), "mixamorig:LeftLeg".to_string())].into(),
        };
        assert_eq!(own.model_names(&names(&["mixamorig:LeftLeg"])), ["lfemur"]);
        let renamed = mixamo.model_names(&names(&["mixamorig:LeftLeg", "mixamorig:LeftEye"]));
        assert_eq!(renamed, ["lfemur", "mixamorig:LeftEye (other)"]);
    }
}

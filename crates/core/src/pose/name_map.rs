//! Names of other skeletons: which of a file's points is which point of a model.

use super::bone_points::{BonePoints, is_bone};
use ndarray::ArrayView2;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::LazyLock;

/// The end of the names of points that are none of the model's.
const OTHER: &str = " (other)";

/// Whether a name is one that [`NameMap::model_names`] gives to a point that is none of the
/// model's.
#[doc(hidden)]
pub fn is_other(name: &str) -> bool {
    name.ends_with(OTHER)
}

/// The maps that posing ships, by name.
static SHIPPED: LazyLock<Vec<NameMap>> = LazyLock::new(|| {
    let maps: BTreeMap<String, BTreeMap<String, String>> =
        toml::from_str(include_str!("name_maps.toml")).unwrap_or_default();
    let maps = maps.into_iter();
    maps.map(|(name, lines)| shipped_map(name, lines)).collect()
});

/// A shipped map of some lines, each a name of a model's point, of [`TRUNK`] or of [`BONES`].
fn shipped_map(name: String, lines: BTreeMap<String, String>) -> NameMap {
    let is_one_of =
        |names: &'static [&str]| move |line: &(String, String)| names.contains(&line.0.as_str());
    let (trunk, lines): (_, BTreeMap<String, String>) =
        lines.into_iter().partition(is_one_of(&TRUNK));
    let (bones, joints) = lines.into_iter().partition(is_one_of(&BONES));
    NameMap {
        name,
        joints,
        trunk,
        bones,
    }
}

/// What shipped maps name besides the model's points: joints of the pose descriptor that CMU has at
/// other positions.
pub(crate) const TRUNK: [&str; 3] = ["Chest", "Neck", "Head"];

/// What shipped maps name for skeletons: the joints of the spine from the root on, the collar
/// bones, left and right, and the head where that is the middle of other points.
const BONES: [&str; 3] = ["Spine", "Collars", "Skull"];

/// The points that a map must find to be taken without being named: hips, knees, ankles, shoulders,
/// elbows and wrists.
const CORE: [&str; 12] = [
    "lhipjoint",
    "lfemur",
    "ltibia",
    "lclavicle",
    "lhumerus",
    "lradius",
    "rhipjoint",
    "rfemur",
    "rtibia",
    "rclavicle",
    "rhumerus",
    "rradius",
];

/// Which of a file's points is which point of a model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NameMap {
    /// The name of the map, or of its file.
    pub name: String,
    /// By point of the model, the point of the file; of names with `|` between them the first that
    /// is there.
    pub joints: BTreeMap<String, String>,
    /// By name of `TRUNK`, the point of the file likewise; empty for maps of others.
    pub trunk: BTreeMap<String, String>,
    /// By name of `BONES`, points of the file that a skeleton has for joints, with commas between
    /// them.
    #[doc(hidden)]
    pub bones: BTreeMap<String, String>,
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

    /// The shipped map that fits the `points` best: by the share of its names that are there, then
    /// by their number, then by its own name. It has hips, knees, ankles, shoulders, elbows and
    /// wrists; `None` also where two people have them.
    #[doc(hidden)]
    pub fn fitting(points: &[String]) -> Option<&'static NameMap> {
        let fits = SHIPPED.iter().filter_map(|map| {
            let columns = map.columns(points);
            let is_one = !map.finder(points).is_ambiguous();
            let is_whole = CORE.iter().all(|point| columns.contains_key(point));
            (is_one && is_whole).then_some((map, columns.len()))
        });
        best(fits)
    }

    /// The shipped map of which the `points` have most, as [`NameMap::fitting`] ranks them, and how
    /// many names; `None` where they have none.
    #[doc(hidden)]
    pub fn nearest(points: &[String]) -> Option<(&'static NameMap, usize)> {
        let found = |map: &'static NameMap| (map, map.columns(points).len());
        let map = best(SHIPPED.iter().map(found).filter(|(_, found)| *found > 0))?;
        Some(found(map))
    }

    /// Says what may help points that no model knows: the nearest shipped map, and the flag.
    #[doc(hidden)]
    pub fn advice(points: &[String]) -> String {
        let shipped: Vec<&str> = SHIPPED.iter().map(|map| map.name.as_str()).collect();
        let flag = "say which are which with the option `map NAME|FILE.toml`";
        match NameMap::nearest(points) {
            None => format!("{flag} (shipped maps: {})", shipped.join(", ")),
            Some((map, _)) if map.finder(points).is_ambiguous() => format!(
                "the names of the map {} stand there for two people; part them, or {flag}",
                map.name
            ),
            Some((map, found)) => format!(
                "the nearest shipped map is {}, with {found} of its {} names there (not {}); \
                 {flag}",
                map.name,
                map.joints.len(),
                map.missing(points)
                    .into_iter()
                    .take(3)
                    .collect::<Vec<_>>()
                    .join(", ")
            ),
        }
    }

    /// The column of each point of the model among the `points`.
    #[doc(hidden)]
    pub fn columns(&self, points: &[String]) -> BTreeMap<&str, usize> {
        let finder = self.finder(points);
        let joints = self.joints.iter();
        joints
            .filter_map(|(point, name)| Some((point.as_str(), finder.find(name)?)))
            .collect()
    }

    /// The columns of the points that a name of `TRUNK` or `BONES` lists, each a point or the
    /// middle of several; those that are not there are left out.
    #[doc(hidden)]
    pub fn bone_columns(&self, name: &str, points: &[String]) -> Vec<Vec<usize>> {
        let finder = self.finder(points);
        let middle = |names: &str| -> Option<Vec<usize>> {
            names.split('+').map(|name| finder.find(name)).collect()
        };
        let columns = |names: &str| names.split('|').find_map(middle);
        let listed = self.bones.get(name).or_else(|| self.trunk.get(name));
        let listed = listed.map_or("", String::as_str);
        listed
            .split(", ")
            .filter(|n| !n.is_empty())
            .filter_map(columns)
            .collect()
    }

    /// The column of a joint of the trunk among the `points`.
    #[doc(hidden)]
    pub fn trunk_column(&self, name: &str, points: &[String]) -> Option<usize> {
        self.finder(points).find(self.trunk.get(name)?)
    }

    fn finder<'p>(&self, points: &'p [String]) -> NameFinder<'p> {
        NameFinder::new(points, self.joints.values().map(String::as_str))
    }

    /// The names of the map that are not among the `points`.
    #[doc(hidden)]
    pub fn missing(&self, points: &[String]) -> Vec<&str> {
        let finder = self.finder(points);
        let names = self.joints.values();
        names
            .filter(|name| finder.find(name).is_none())
            .map(|name| name.split('|').next().unwrap_or(name))
            .collect()
    }

    /// The names by which the model knows the `points`; those that the map does not name are named
    /// as nothing is.
    #[doc(hidden)]
    pub fn model_names(&self, points: &[String]) -> Vec<String> {
        let columns = self.columns(points);
        let name = |(p, point): (usize, &String)| {
            let mut columns = columns.iter();
            match columns.find(|(_, column)| **column == p) {
                Some((model, _)) => model.to_string(),
                None => format!("{point}{OTHER}"),
            }
        };
        points.iter().enumerate().map(name).collect()
    }
}

/// The best of some maps, each with the number of its names that are there; of equal ones the
/// first.
fn best(maps: impl Iterator<Item = (&'static NameMap, usize)>) -> Option<&'static NameMap> {
    let better = |a: &(&NameMap, usize), b: &(&NameMap, usize)| {
        // Shares of whole numbers, compared exactly.
        let (of_a, of_b) = (a.1 * b.0.joints.len(), b.1 * a.0.joints.len());
        (of_a, a.1) > (of_b, b.1)
    };
    let found = maps.reduce(|best, map| if better(&map, &best) { map } else { best });
    found.map(|(map, _)| map)
}

/// Points by names that they may have after a prefix, as in `mixamorig:Hips`, `mixamorig_Hips` and
/// `Bip01 L Thigh`.
///
/// All names have one prefix: the one with which most of them are there. Case does not count, and
/// blanks, points and hyphens are as good as underscores.
#[derive(Debug, Clone)]
pub struct NameFinder<'p> {
    points: &'p [String],
    folded: Vec<String>,
    prefix: String,
    /// How many names are there with the prefix, and with the next best.
    found: [usize; 2],
}

impl<'p> NameFinder<'p> {
    /// A finder of `names`, each of which may be several with `|` between them.
    #[doc(hidden)]
    pub fn new<'n>(points: &'p [String], names: impl Iterator<Item = &'n str>) -> NameFinder<'p> {
        let folded: Vec<String> = points.iter().map(|p| fold(p)).collect();
        // By prefix, the names that are there, and where the first stands.
        let mut prefixes: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for name in names {
            let mut own: BTreeMap<&str, usize> = BTreeMap::new();
            for alternative in name.split('|').map(fold).filter(|n| !n.is_empty()) {
                for (p, point) in folded.iter().enumerate() {
                    let prefix = point.strip_suffix(alternative.as_str());
                    let is_prefix = |t: &&str| t.is_empty() || t.ends_with(['_', ':', '/']);
                    if let Some(prefix) = prefix.filter(is_prefix) {
                        own.entry(prefix).or_insert(p);
                    }
                }
            }
            for (prefix, p) in own {
                let (count, first) = prefixes.entry(prefix).or_insert((0, p));
                (*count, *first) = (*count + 1, p.min(*first));
            }
        }
        let mut ranked: Vec<(&str, (usize, usize))> = prefixes.into_iter().collect();
        ranked.sort_by_key(|(_, (count, first))| (std::cmp::Reverse(*count), *first));
        let count = |n: usize| ranked.get(n).map_or(0, |r| r.1.0);
        NameFinder {
            found: [count(0), count(1)],
            prefix: ranked.first().map_or("", |r| r.0).to_string(),
            points,
            folded,
        }
    }

    /// Whether the names stand there twice, or half of them: for two people.
    #[doc(hidden)]
    pub fn is_ambiguous(&self) -> bool {
        let [most, next] = self.found;
        next > 1 && 2 * next >= most
    }

    /// The point of a name, or of the first of several that is there.
    #[doc(hidden)]
    pub fn find(&self, name: &str) -> Option<usize> {
        let literal = self.points.iter().position(|p| p == name);
        let literal = literal.filter(|_| self.prefix.is_empty());
        literal.or_else(|| name.split('|').find_map(|name| self.find_one(name)))
    }

    /// The names of the points without the prefix (without one of their own up to a colon where
    /// they lack it), case, and what stands between words.
    #[doc(hidden)]
    pub fn bare_names(&self) -> Vec<String> {
        let bare = |name: &String| {
            let own = name.strip_prefix(&self.prefix).unwrap_or(name);
            let own = own.rsplit(':').next().unwrap_or(own);
            own.replace('_', "")
        };
        self.folded.iter().map(bare).collect()
    }

    fn find_one(&self, name: &str) -> Option<usize> {
        let wanted = if name.is_empty() {
            // The prefix itself: the root of a biped is called Bip01.
            self.prefix.trim_end_matches(['_', ':', '/']).to_string()
        } else {
            format!("{}{}", self.prefix, fold(name))
        };
        let named = |p: &usize| !wanted.is_empty() && self.folded[*p] == wanted;
        let all = || (0..self.points.len()).filter(named);
        let exact = all().find(|p| self.points[*p].ends_with(name));
        let own = exact.or_else(|| all().next());
        // A map of somebody's own may have names with several prefixes.
        let spaced = |p: &&String| p.rsplit(':').next() == Some(name);
        let other = || {
            let mut others = self.points.iter().filter(spaced);
            let one = others.next().filter(|_| others.next().is_none());
            one.and_then(|one| self.points.iter().position(|p| p == one))
        };
        own.or_else(|| other().filter(|_| self.prefix.is_empty() && !name.is_empty()))
    }
}

/// The place among `b` of each point of `a` that has the same name; where no names are the same, of
/// those that are so but for a prefix (`mixamorig:Hips` and Hips).
#[doc(hidden)]
pub fn same_points(a: &[String], b: &[String]) -> Vec<Option<usize>> {
    let at: HashMap<&String, usize> = b.iter().enumerate().map(|(p, name)| (name, p)).collect();
    let same: Vec<Option<usize>> = a.iter().map(|name| at.get(name).copied()).collect();
    if same.iter().any(Option::is_some) {
        return same;
    }
    let mut there = places_after_prefix(a, b);
    if there.iter().all(Option::is_none) {
        let back = places_after_prefix(b, a).into_iter().enumerate();
        back.for_each(|(q, place)| place.into_iter().for_each(|p| there[p] = Some(q)));
    }
    there
}

/// The place of each of the `names`, without what is before a colon, among points that may all have
/// a prefix; none where one of the two is of several people.
fn places_after_prefix(names: &[String], points: &[String]) -> Vec<Option<usize>> {
    let own = || names.iter().map(|n| n.rsplit(':').next().unwrap_or(n));
    let finder = NameFinder::new(points, own());
    let places: Vec<Option<usize>> = own().map(|name| finder.find(name)).collect();
    let mut taken = HashSet::new();
    let is_one = places.iter().flatten().all(|p| taken.insert(*p));
    if is_one && !finder.is_ambiguous() {
        places
    } else {
        vec![None; names.len()]
    }
}

/// A name without what does not count: case, and what stands between its words.
fn fold(name: &str) -> String {
    name.to_ascii_lowercase().replace([' ', '-', '.'], "_")
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
    /// The naming of `points` (frames, 3 J; cm) for a model that knows the names `known`: that of
    /// the shipped map that fits, if it names more of them than the model knows by their own
    /// names.
    #[doc(hidden)]
    pub fn of(points: &[String], xyz: ArrayView2<'_, f64>, known: &[String]) -> PointNaming {
        let bones = BonePoints::of(points, xyz);
        let is_known = |name: &String| known.contains(name);
        let own = bones
            .bone_ends(points)
            .iter()
            .filter(|n| is_known(n))
            .count();
        let map = NameMap::fitting(points);
        let is_better = |map: &&NameMap| map.columns(points).len() > own;
        let map = map.filter(|map| is_better(map) && map.joints.keys().all(is_known));
        map.map_or(PointNaming::Bones(bones), |map| {
            PointNaming::Map(map.clone())
        })
    }

    /// How many of the points are joints: of the map, or of CMU's bones by their own names, if
    /// hips, knees, ankles, shoulders, elbows and wrists are there.
    #[doc(hidden)]
    pub fn joints(&self, points: &[String]) -> usize {
        match self {
            PointNaming::Bones(_) => {
                let is_whole = CORE
                    .iter()
                    .all(|core| points.iter().any(|name| name == core));
                let bones = points.iter().filter(|name| is_whole && is_bone(name));
                bones.count()
            }
            PointNaming::Map(map) => map.columns(points).len(),
        }
    }

    /// The names by which a model of bone ends knows the points.
    #[doc(hidden)]
    pub fn model_names<'p>(&self, points: &'p [String]) -> Cow<'p, [String]> {
        match self {
            PointNaming::Bones(bones) => bones.bone_ends(points),
            PointNaming::Map(map) => Cow::Owned(map.model_names(points)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints;

    #[test]
    fn points_are_the_same_by_name_or_else_but_for_a_prefix() {
        let same = |a: &str, b: &str| {
            let [a, b] = [a, b].map(|all| all.split(' ').map(String::from).collect::<Vec<_>>());
            same_points(&a, &b)
        };
        assert_eq!(same("Hips Spine", "Spine rig:Hips"), [None, Some(0)]);
        for [a, b] in [
            ["mixamorig:Hips mixamorig:Head", "Head Hips"],
            ["Hips Head", "mixamorig_Head mixamorig_Hips"],
            ["Ann:Hips Ann:Head", "Ben:Head Ben:hips"],
        ] {
            assert_eq!(same(a, b), [Some(1), Some(0)], "{a} {b}");
        }
        // Nobody knows which of two people, or which side, is meant.
        assert_eq!(
            same("Hips Head", "Ann:Hips Ann:Head Ben:Hips Ben:Head"),
            [None; 2]
        );
        assert_eq!(
            same("hip knee", "left_hip left_knee right_hip right_knee"),
            [None; 2]
        );
        assert_eq!(
            same("left_hip left_knee", "right_hip right_knee"),
            [None; 2]
        );
    }
    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|n| n.to_string()).collect()
    }

    #[test]
    fn shipped_maps_name_points_of_the_skeleton_on_both_sides() {
        assert_eq!(NameMap::shipped().len(), 22);
        let points = joints::cmu_names();
        for map in NameMap::shipped() {
            for (point, joint) in &map.joints {
                let at = points.iter().position(|p| p == point);
                let at = at.unwrap_or_else(|| panic!("{}: {point}", map.name));
                if let Some(other) = crate::pose::sides::mirrored(&points, at) {
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
            ..NameMap::default()
        };
        assert_eq!(own.model_names(&names(&["mixamorig:LeftLeg"])), ["lfemur"]);
        let renamed = mixamo.model_names(&names(&["mixamorig:LeftLeg", "mixamorig:LeftEye"]));
        assert_eq!(renamed, ["lfemur", "mixamorig:LeftEye (other)"]);
    }

    /// The points of a skeleton, by words with `|` before and after which left and right stand.
    fn sided(trunk: &[&str], limbs: &[&str], sides: [&str; 2]) -> Vec<String> {
        let limbs = sides
            .into_iter()
            .flat_map(|s| limbs.iter().map(move |l| l.replace('|', s)));
        trunk.iter().map(|n| n.to_string()).chain(limbs).collect()
    }

    fn fits(points: &[String]) -> Option<(&'static str, Vec<&'static str>)> {
        let map = NameMap::fitting(points)?;
        let missing = map.missing(points);
        Some((map.name.as_str(), missing))
    }

    #[test]
    fn what_has_hips_and_limbs_fits_though_more_is_missing() {
        let hik = [
            "|UpLeg",
            "|Leg",
            "|Foot",
            "|Toe",
            "|Shoulder",
            "|Arm",
            "|ForeArm",
            "|Hand",
        ];
        let lafan = sided(
            &["Hips", "Spine", "Spine1", "Spine2", "Neck", "Head"],
            &hik,
            ["Left", "Right"],
        );
        assert_eq!(fits(&lafan), Some(("lafan", vec![])));
        let bases: Vec<String> = lafan.iter().map(|n| n.replace("Toe", "ToeBase")).collect();
        assert_eq!(fits(&bases), Some(("hik", vec![])));
        let without: Vec<String> = lafan
            .iter()
            .filter(|n| !n.contains("Toe"))
            .cloned()
            .collect();
        assert_eq!(fits(&without).unwrap().0, "hik");
        let prefixed: Vec<String> = lafan.iter().map(|n| format!("mixamorig1_{n}")).collect();
        assert_eq!(fits(&prefixed).unwrap().0, "lafan");
    }

    #[test]
    fn detectors_fit_though_a_middle_is_missing() {
        // Pose2Sim: OpenPose's names with another middle hip, or with none.
        let openpose = [
            "|Hip",
            "|Knee",
            "|Ankle",
            "|BigToe",
            "|Heel",
            "|Shoulder",
            "|Elbow",
            "|Wrist",
        ];
        let pose2sim = sided(&["Hip", "Neck", "Head", "Nose"], &openpose, ["L", "R"]);
        assert_eq!(fits(&pose2sim), Some(("halpe", vec![])));
        let without: Vec<String> = pose2sim.iter().skip(1).cloned().collect();
        assert_eq!(fits(&without), Some(("halpe", vec!["Hip"])));
        let body25 = sided(&["MidHip", "Neck", "Nose"], &openpose, ["L", "R"]);
        assert_eq!(fits(&body25), Some(("openpose", vec![])));
        let snake = [
            "|_hip",
            "|_knee",
            "|_ankle",
            "|_shoulder",
            "|_elbow",
            "|_wrist",
        ];
        let coco = sided(&["nose"], &snake, ["left", "right"]);
        assert_eq!(fits(&coco), Some(("coco", vec![])));
        let mediapipe = sided(
            &["nose"],
            &[&snake[..], &["|_foot_index"]].concat(),
            ["LEFT", "RIGHT"],
        );
        assert_eq!(fits(&mediapipe), Some(("mediapipe", vec![])));
        let smpl = sided(
            &["pelvis"],
            &[&snake[..], &["|_foot"]].concat(),
            ["left", "right"],
        );
        assert_eq!(fits(&smpl), Some(("smpl", vec![])));
    }

    #[test]
    fn rigs_fit_by_any_prefix() {
        let biped = [
            "| Thigh",
            "| Calf",
            "| Foot",
            "| Toe0",
            "| UpperArm",
            "| Forearm",
            "| Hand",
        ];
        for prefix in ["Bip01 ", "Bip001 ", "Bip02 "] {
            let bones = sided(&["Spine", "Spine1", "Neck", "Head"], &biped, ["L", "R"]);
            let bones = bones.iter().map(|n| format!("{prefix}{n}"));
            let mut bones: Vec<String> = bones.chain([prefix.trim_end().to_string()]).collect();
            assert_eq!(fits(&bones).unwrap(), ("biped", vec![]), "{prefix}");
            let root = NameMap::find("biped").unwrap().columns(&bones)["root"];
            assert_eq!(bones[root], prefix.trim_end());
            bones
                .iter_mut()
                .for_each(|n| *n = n.replace(' ', "_").replace("Forearm", "ForeArm"));
            assert_eq!(fits(&bones).unwrap(), ("biped", vec![]), "{prefix}");
        }
        let neuron = [
            "|UpLeg",
            "|Leg",
            "|Foot",
            "|Shoulder",
            "|Arm",
            "|ForeArm",
            "|Hand",
            "|HandThumb1",
            "|InHandMiddle",
            "|HandMiddle1",
        ];
        let neuron = sided(
            &[
                "Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Head",
            ],
            &neuron,
            ["Left", "Right"],
        );
        assert_eq!(fits(&neuron), Some(("neuron", vec![])));
        let robot: Vec<String> = neuron.iter().map(|n| format!("Robot_{n}")).collect();
        assert_eq!(fits(&robot), Some(("neuron", vec![])));
        let makehuman = [
            "Hip_|", "UpLeg_|", "LoLeg_|", "Foot_|", "Toe_|", "UpArm_|", "LoArm_|", "Hand_|",
        ];
        let makehuman = sided(
            &["Root", "Hips", "Spine1", "Neck", "Head"],
            &makehuman,
            ["L", "R"],
        );
        assert_eq!(fits(&makehuman).unwrap().0, "makehuman");
    }

    #[test]
    fn the_share_counts_before_the_number() {
        let mixamo = NameMap::find("mixamo").unwrap();
        let more = ["Spine", "Neck", "Head", "Spine1"].map(|n| format!("mixamorig:{n}"));
        let names = mixamo.joints.values().map(|j| format!("mixamorig:{j}"));
        let points: Vec<String> = names.chain(more).collect();
        let cmu = NameMap::find("cmu-bvh").unwrap();
        assert!(cmu.columns(&points).len() > mixamo.joints.len());
        assert_eq!(fits(&points), Some(("mixamo", vec![])));
    }

    #[test]
    fn no_half_of_a_body_and_no_two_people_fit() {
        let mixamo = NameMap::find("mixamo").unwrap();
        let one: Vec<String> = mixamo.joints.values().map(|j| format!("Ann:{j}")).collect();
        let is_leg = |n: &&String| n.contains("Leg") || n.contains("Foot");
        let legs: Vec<String> = one.iter().filter(is_leg).cloned().collect();
        assert_eq!(NameMap::fitting(&legs), None);
        assert!(
            NameMap::advice(&legs).contains("nearest shipped map is hik"),
            "{}",
            NameMap::advice(&legs)
        );
        let partial = one.iter().filter(|n| !n.contains("Toe"));
        let two = partial.map(|n| n.replace("Ann:", "Ben_"));
        let two: Vec<String> = one.iter().cloned().chain(two).collect();
        assert_eq!(NameMap::fitting(&two), None);
        assert!(NameMap::advice(&two).contains("two people"));
        // A thing with one name of the body is no second person.
        let with_thing: Vec<String> = one.iter().cloned().chain(["Box:Hips".into()]).collect();
        assert_eq!(NameMap::fitting(&with_thing), Some(mixamo));
        let none = NameMap::advice(&names(&["hipL", "kneeA"]));
        assert!(
            none.contains("the option `map ") && none.contains("mixamo"),
            "{none}"
        );
    }

    #[test]
    fn every_shipped_map_fits_its_own_names_with_any_prefix() {
        for map in NameMap::shipped() {
            for prefix in ["", "Ann:", "rig_", "a:b:"] {
                let first = |n: &String| n.split('|').next().unwrap().to_string();
                let points = map.joints.values().map(first);
                let points: Vec<String> = points.map(|n| format!("{prefix}{n}")).collect();
                let found = NameMap::fitting(&points).unwrap();
                assert_eq!(
                    found.columns(&points),
                    map.columns(&points),
                    "{} {prefix}",
                    map.name
                );
                assert_eq!(map.columns(&points).len(), map.joints.len(), "{}", map.name);
            }
            assert!(
                TRUNK.iter().all(|t| map.trunk.contains_key(*t)),
                "{}",
                map.name
            );
        }
    }
}

//! Which marker is on which landmark, by the names of a marker set.

use super::landmarks::{JointSet, Landmark, landmark};
use super::tuning::{SD, TRUE_SD};
use crate::label::unlabeled::{is_computed, is_unlabeled, own_name};
use crate::label::{LabelModel, PostureModel, PosturesInFile};
use crate::pose::Poses;
use crate::prior::rotations::bones::PAIRED;
use crate::{Error, Place, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

/// Names of markers and their landmarks.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerSet {
    /// Its name, or that of its file.
    pub name: String,
    /// The joints that its markers were placed by.
    pub(crate) joints: JointSet,
    /// By a marker's name, in small letters and without . _ and -.
    lines: BTreeMap<String, Line>,
    /// Labels without landmarks, as they are in some postures.
    pub(super) postures: Option<PostureModel>,
}

/// A line of a set.
#[derive(Debug, Clone, PartialEq)]
struct Line {
    /// The name as it stands there, `{S}` for the side.
    pattern: String,
    landmark: Landmark,
    is_right: bool,
    /// Whether most takes lack it.
    is_rare: bool,
}

/// A set that was learned, as its file has it.
#[derive(Serialize, Deserialize)]
struct Learned {
    kind: String,
    joints: JointSet,
    markers: BTreeMap<String, LearnedMarker>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    postures: Option<PosturesInFile>,
}

/// A marker of the left side or the middle: the bone, the share of it at which the offset begins,
/// and that offset and its standard deviations in the axes of the rest pose, cm.
#[derive(Serialize, Deserialize)]
struct LearnedMarker {
    bone: String,
    along: f64,
    offset: [f64; 3],
    sd: [f64; 3],
}

/// The most names of a set that a file has: several times those of the fullest body suits (some 300
/// markers). Pairs of them are kept.
const MOST_NAMES: usize = 1000;

/// The kind in the file of a learned set.
const KIND: &str = "marker-set";

/// A marker that is on a landmark.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NamedMarker {
    /// The point of the take.
    pub point: usize,
    pub landmark: Landmark,
    pub is_right: bool,
    /// Standard deviation of what is measured, cm.
    pub sd: f64,
}

impl NamedMarker {
    /// A joint that is known: the end of a bone.
    pub(crate) fn joint(point: usize, bone: &str) -> NamedMarker {
        NamedMarker {
            point,
            landmark: Landmark::joint(bone),
            is_right: false,
            sd: TRUE_SD,
        }
    }
}

static SHIPPED: LazyLock<Vec<MarkerSet>> = LazyLock::new(|| {
    let sets: BTreeMap<String, BTreeMap<String, String>> =
        toml::from_str(include_str!("marker_sets.toml")).unwrap_or_default();
    let set = |(name, lines)| MarkerSet::new(name, &lines).ok();
    sets.into_iter().filter_map(set).collect()
});

/// What stands for the letter of a side.
const SIDE: &str = "{S}";
/// What a landmark ends in where most takes have no marker on it.
const RARE: char = '?';

/// Fails for more names than a set has.
fn check_count(names: usize) -> std::result::Result<(), String> {
    if names > MOST_NAMES {
        Err(format!(
            "names {names} markers, and a marker set has {MOST_NAMES} at most: leave out those \
         that no take has"
        ))
    } else {
        Ok(())
    }
}

/// A name as it counts: case and . _ - do not.
fn plain(name: &str) -> String {
    let own = own_name(name).to_lowercase();
    own.chars().filter(|c| !"._- ".contains(*c)).collect()
}

impl MarkerSet {
    /// The sets that are built in.
    pub fn shipped() -> &'static [MarkerSet] {
        &SHIPPED
    }

    /// A set from a file: lines `name = "landmark"` (TOML), or a learned one (JSON).
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: it is no such file, or there is no
    /// such landmark or bone.
    pub fn open(path: impl AsRef<Path>) -> Result<MarkerSet> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
        let bad = |what: String| Error::data(Place::file(&name), what);
        if !text.trim_start().starts_with('{') {
            let lines: BTreeMap<String, String> = toml::from_str(&text)
                .map_err(|e| bad(format!("is no marker set: {}", e.message())))?;
            check_count(lines.len()).map_err(&bad)?;
            return MarkerSet::new(name.clone(), &lines).map_err(|e| bad(e.to_string()));
        }
        let learned: Learned = serde_json::from_str(&text)
            .ok()
            .filter(|l: &Learned| l.kind == KIND)
            .ok_or_else(|| bad("is no marker set that label or solve has learned".to_string()))?;
        check_count(learned.markers.len()).map_err(&bad)?;
        let postures = learned.postures.map(|postures| {
            check_count(postures.count()).map_err(&bad)?;
            let what = "is no marker set: its labels and postures do not fit each other";
            postures.model().ok_or_else(|| bad(what.to_string()))
        });
        let known = |(pattern, marker): (String, LearnedMarker)| {
            let offset_and_sd = [marker.offset, marker.sd].map(DVec3::from_array);
            (
                pattern,
                Landmark::new(&marker.bone, marker.along, offset_and_sd),
            )
        };
        let markers = learned.markers.into_iter().map(known);
        Ok(MarkerSet {
            joints: learned.joints,
            postures: postures.transpose()?,
            ..MarkerSet::of_landmarks(&name, markers)
        })
    }

    /// A set from lines "name = landmark", where `{S}` in a name stands for L and R.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such landmark.
    pub fn new(name: String, lines: &BTreeMap<String, String>) -> Result<MarkerSet> {
        let known = |(marker, at): (&String, &String)| {
            let what = || format!("there is no landmark {at}, where {marker} would be");
            let landmark = landmark(at.trim_end_matches(RARE));
            let landmark = landmark.ok_or_else(|| Error::usage(what()))?;
            Ok((marker.clone(), landmark.clone()))
        };
        let known: Vec<(String, Landmark)> = lines.iter().map(known).collect::<Result<_>>()?;
        let mut set = MarkerSet::of_landmarks(&name, known.into_iter());
        for line in set.lines.values_mut() {
            line.is_rare = lines[&line.pattern].ends_with(RARE);
        }
        Ok(set)
    }

    /// A set of markers, by their patterns.
    pub(crate) fn of_landmarks(
        name: &str,
        markers: impl Iterator<Item = (String, Landmark)>,
    ) -> MarkerSet {
        let mut lines = BTreeMap::new();
        for (pattern, landmark) in markers {
            let sides: &[(&str, bool)] = if pattern.contains(SIDE) {
                &[("l", false), ("r", true)]
            } else {
                &[("", false)]
            };
            for (side, is_right) in sides {
                let own = plain(&pattern.replace(SIDE, side));
                let is_right = *is_right || side.is_empty() && is_of_right(&own, &landmark);
                let line = Line {
                    pattern: pattern.clone(),
                    landmark: landmark.clone(),
                    is_right,
                    is_rare: false,
                };
                lines.insert(own, line);
            }
        }
        // Offsets of CMU's markers stand for CMU's joints, whose bones are not quite people's.
        let joints = if name == "cmu41" {
            JointSet::Cmu
        } else {
            JointSet::Anatomical
        };
        MarkerSet {
            name: name.to_string(),
            joints,
            lines,
            postures: None,
        }
    }

    /// A set of labels without landmarks, as they are in labeled takes.
    ///
    /// # Errors
    /// [`Error::Usage`]: too few labels.
    pub(super) fn of_postures(name: &str, takes: &[&Poses]) -> Result<MarkerSet> {
        Ok(MarkerSet {
            postures: Some(PostureModel::learn(takes)?),
            ..MarkerSet::of_landmarks(name, std::iter::empty())
        })
    }

    /// A learned set as a file (JSON).
    ///
    /// # Errors
    /// None for numbers that are finite.
    pub fn to_json(&self) -> Result<String> {
        let marker = |line: &Line| {
            let [offset, sd] = line.landmark.offset_and_sd(JointSet::Anatomical, false);
            let marker = LearnedMarker {
                bone: line.landmark.bone.to_string(),
                along: line.landmark.along,
                offset: offset.to_array(),
                sd: sd.to_array(),
            };
            (line.pattern.clone(), marker)
        };
        let learned = Learned {
            kind: KIND.to_string(),
            joints: self.joints,
            markers: self.lines.values().map(marker).collect(),
            postures: self.postures.as_ref().map(PosturesInFile::from),
        };
        let text = serde_json::to_string_pretty(&learned);
        text.map(|t| t + "\n")
            .map_err(|e| Error::usage(e.to_string()))
    }

    /// Whether a file is a learned set.
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be read.
    pub fn is_learned(path: impl AsRef<Path>) -> Result<bool> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        let json: Option<serde_json::Value> = serde_json::from_slice(&bytes).ok();
        Ok(json.is_some_and(|json| json["kind"] == KIND))
    }

    /// The markers, a line each: the name ({S} for the side), the bone, and where on it, cm.
    pub fn summary(&self) -> String {
        let mut lines = vec![
            format!("kind       {KIND}"),
            format!("name       {}", self.name),
        ];
        let mut known: Vec<&str> = Vec::new();
        for line in self.lines.values() {
            if known.contains(&line.pattern.as_str()) {
                continue;
            }
            known.push(&line.pattern);
            let Landmark { bone, along, .. } = &line.landmark;
            let [at, sd] = line.landmark.offset_and_sd(self.joints, false);
            let (at, sd) = (at.to_array().map(|v| format!("{v:.1}")), sd.to_array());
            let (at, sd) = (at.join(" "), sd.map(|v| format!("{v:.1}")).join(" "));
            let name = &line.pattern;
            lines.push(format!("{name:<10} {bone} {along}, {at} (sd {sd}) cm"));
        }
        if let Some(postures) = &self.postures {
            lines.push(format!("labels     {}", postures.labels().join(", ")));
        }
        lines.push(format!("markers    {}", known.len()));
        lines.join("\n") + "\n"
    }

    /// The pattern of a marker that the set knows; its name else.
    pub(crate) fn pattern<'a>(&'a self, name: &'a str) -> &'a str {
        self.lines
            .get(&plain(name))
            .map_or(name, |line| &line.pattern)
    }

    /// The built-in set of a name; `None` where there is none.
    ///
    /// ```
    /// use posing_joints::solve::MarkerSet;
    ///
    /// let set = MarkerSet::find("pig").ok_or("none")?;
    /// assert!(set.summary().contains("{S}KNE")); // LKNE and RKNE
    /// assert_eq!(MarkerSet::find("pigs"), None);
    /// # Ok::<(), &str>(())
    /// ```
    pub fn find(name: &str) -> Option<&'static MarkerSet> {
        MarkerSet::shipped().iter().find(|set| set.name == name)
    }

    /// The built-in set that knows most of some markers.
    #[doc(hidden)]
    pub fn of(points: &[String]) -> Option<&'static MarkerSet> {
        let count = |set: &MarkerSet| set.markers(points).len();
        MarkerSet::shipped()
            .iter()
            .rev()
            .max_by_key(|set| count(set))
    }

    /// How many of some points are markers that the built-in set knows which knows most.
    #[doc(hidden)]
    pub fn known(points: &[String]) -> usize {
        MarkerSet::of(points).map_or(0, |set| set.markers(points).len())
    }

    /// Whether it knows a marker of this name.
    pub(crate) fn knows(&self, name: &str) -> bool {
        self.lines.contains_key(&plain(name))
    }

    /// The markers that takes of it have, and the names of these.
    pub(crate) fn all(&self) -> (Vec<String>, Vec<NamedMarker>) {
        let mut names: Vec<String> = Vec::new();
        let mut markers: Vec<NamedMarker> = Vec::new();
        for line in self.lines.values().filter(|line| !line.is_rare) {
            let side = if line.is_right { "R" } else { "L" };
            markers.push(NamedMarker {
                point: names.len(),
                landmark: line.landmark.clone(),
                is_right: line.is_right,
                sd: SD,
            });
            names.push(line.pattern.replace(SIDE, side));
        }
        (names, markers)
    }

    /// The markers among some points that it knows; of several of one name the first.
    pub(crate) fn markers(&self, points: &[String]) -> Vec<NamedMarker> {
        let mut found: Vec<NamedMarker> = Vec::new();
        let mut known: Vec<String> = Vec::new();
        for (point, name) in points.iter().enumerate() {
            if is_unlabeled(name) || is_computed(name, points) {
                continue;
            }
            let own = plain(name);
            let Some(line) = self.lines.get(&own).filter(|_| !known.contains(&own)) else {
                continue;
            };
            known.push(own);
            found.push(NamedMarker {
                point,
                landmark: line.landmark.clone(),
                is_right: line.is_right,
                sd: SD,
            });
        }
        found
    }
}

/// Whether a marker whose pattern has no side is on the right, by its name: where its landmark is
/// on a limb.
fn is_of_right(plain: &str, landmark: &Landmark) -> bool {
    plain.starts_with('r') && PAIRED.contains(&landmark.bone.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_the_set_and_the_side() {
        let points = |names: &str| names.split(' ').map(String::from).collect::<Vec<_>>();
        assert_eq!(MarkerSet::shipped().len(), 7);
        let cmu = points("A:LFWT A:RFWT A:LKNE A:RKNE A:C7 A:RBAC *12");
        let set = MarkerSet::of(&cmu).unwrap();
        assert_eq!(set.name, "cmu41");
        let found = set.markers(&cmu);
        let sides: Vec<bool> = found.iter().map(|m| m.is_right).collect();
        assert_eq!(sides, [false, true, false, true, false, false]);
        let lab = points("r.ASIS L.ASIS r_knee L_knee r_mknee L_mknee");
        let set = MarkerSet::of(&lab).unwrap();
        assert_eq!((set.name.as_str(), set.markers(&lab).len()), ("opencap", 6));
        let lines = BTreeMap::from([("x".to_string(), "NOWHERE".to_string())]);
        assert!(MarkerSet::new("mine".into(), &lines).is_err());
    }

    #[test]
    fn a_set_of_a_file_has_no_more_names_than_a_body() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let open = |text: String| {
            std::fs::write(file.path(), text).unwrap();
            MarkerSet::open(file.path()).map_err(|e| e.to_string())
        };
        let toml = |n: usize| (0..n).map(|i| format!("M{i} = \"KNL\"\n")).collect();
        let json = |n: usize| {
            let mut set: serde_json::Value =
                serde_json::from_str(&MarkerSet::shipped()[0].to_json().unwrap()).unwrap();
            let markers = set["markers"].as_object_mut().unwrap();
            let one = markers.values().next().unwrap().clone();
            *markers = (0..n).map(|i| (format!("M{i}"), one.clone())).collect();
            set.to_string()
        };
        assert_eq!(open(toml(MOST_NAMES)).unwrap().lines.len(), MOST_NAMES);
        assert_eq!(open(json(MOST_NAMES)).unwrap().lines.len(), MOST_NAMES);
        for text in [toml(MOST_NAMES + 1), json(MOST_NAMES + 1)] {
            let said = open(text).unwrap_err();
            assert!(said.contains("1000 at most"), "{said}");
        }
    }
}

//! Which marker is on which landmark, by the names of a marker set.

use super::landmarks::{Landmark, landmark};
use crate::label::unlabeled::{is_computed, is_unlabeled, own_name};
use crate::{Error, Place, Result};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

/// Names of markers and their landmarks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkerSet {
    /// Its name, or that of its file.
    pub name: String,
    /// By a marker's name, in small letters and without . _ and -, the landmark, and whether it is
    /// on the right.
    landmarks: BTreeMap<String, (String, bool)>,
}

/// A marker that is on a landmark.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NamedMarker {
    /// The point of the take.
    pub point: usize,
    pub landmark: &'static Landmark,
    pub is_right: bool,
}

static SHIPPED: LazyLock<Vec<MarkerSet>> = LazyLock::new(|| {
    let sets: BTreeMap<String, BTreeMap<String, String>> =
        toml::from_str(include_str!("marker_sets.toml")).unwrap_or_default();
    let set = |(name, lines)| MarkerSet::new(name, &lines).ok();
    sets.into_iter().filter_map(set).collect()
});

/// What stands for the letter of a side.
const SIDE: &str = "{S}";

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

    /// A set from a file of lines `name = "landmark"` (TOML).
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: it is no such file, or there is no
    /// such landmark.
    pub fn open(path: impl AsRef<Path>) -> Result<MarkerSet> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let place = Place::file(&name);
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
        let lines = toml::from_str(&text).map_err(|e| {
            Error::data(place.clone(), format!("is no marker set: {}", e.message()))
        })?;
        MarkerSet::new(name, &lines).map_err(|e| e.at(place))
    }

    /// A set from lines "name = landmark", where `{S}` in a name stands for L and R.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such landmark.
    pub fn new(name: String, lines: &BTreeMap<String, String>) -> Result<MarkerSet> {
        let mut landmarks = BTreeMap::new();
        for (marker, at) in lines {
            if landmark(at).is_none() {
                let what = format!("{name}: there is no landmark {at}, where it puts {marker}");
                return Err(Error::usage(what));
            }
            if !marker.contains(SIDE) {
                let is_right = plain(marker).starts_with('r') && !is_central(at);
                landmarks.insert(plain(marker), (at.clone(), is_right));
                continue;
            }
            for (side, is_right) in [("l", false), ("r", true)] {
                let own = plain(&marker.replace(SIDE, side));
                landmarks.insert(own, (at.clone(), is_right));
            }
        }
        Ok(MarkerSet { name, landmarks })
    }

    /// The built-in set of a name; `None` where there is none.
    pub fn find(name: &str) -> Option<&'static MarkerSet> {
        MarkerSet::shipped().iter().find(|set| set.name == name)
    }

    /// The built-in set that knows most of some markers.
    pub(crate) fn of(points: &[String]) -> Option<&'static MarkerSet> {
        let count = |set: &MarkerSet| set.markers(points).len();
        MarkerSet::shipped()
            .iter()
            .rev()
            .max_by_key(|set| count(set))
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
            let Some((at, is_right)) = self.landmarks.get(&own) else {
                continue;
            };
            if let Some(landmark) = landmark(at).filter(|_| !known.contains(&own)) {
                known.push(own);
                found.push(NamedMarker {
                    point,
                    landmark,
                    is_right: *is_right,
                });
            }
        }
        found
    }
}

/// Whether a landmark has no side, or its name has it.
fn is_central(at: &str) -> bool {
    let bone = landmark(at).map_or("", |l| l.bone);
    ["thorax", "head", "root"].contains(&bone)
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
}

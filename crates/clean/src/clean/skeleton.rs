//! The skeleton of a cleaned take of markers: its motion as a BVH beside the result, or its joint
//! centers as a table.

use super::earlier_result::EarlierResult;
use super::name_source::digest;
use super::record::Fingerprint;
use crate::io::motion_folder::{EXTENSIONS, file_name_part, unpacked};
use crate::solve::{JointSet, MarkerSet};
use crate::{Error, Place, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How the markers of takes are solved for skeletons, or for joint centers.
#[derive(Debug, Clone, Default)]
pub struct SkeletonSettings {
    /// The marker set; `None`: of each file the built-in one that knows most of its markers.
    pub set: Option<MarkerSet>,
    /// Anatomical joints: a table of their centers stands beside the result, with columns of
    /// deviations; else skeleton and motion, as a BVH.
    pub joints: JointSet,
}

/// The ends of the names of skeletons and of centers.
const ENDS: [&str; 2] = [".bvh", ".centers.csv"];

/// A path with more at its end.
fn with_end(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    PathBuf::from(name)
}

/// What stands beside a result is called after it without its ending: `walk.bvh` beside `walk.c3d`.
pub(super) fn stem(output: &Path) -> PathBuf {
    unpacked(output).with_extension("")
}

/// What may stand beside a result, called after this.
pub(super) fn all_called(named: &Path) -> [PathBuf; 2] {
    ENDS.map(|end| with_end(named, end))
}

impl SkeletonSettings {
    /// What is known of the settings in a record.
    ///
    /// # Errors
    /// None for sets of finite numbers.
    pub(super) fn recorded(&self) -> Result<Value> {
        let set = match &self.set {
            None => json!("auto"),
            Some(set) => json!(digest(set)?),
        };
        Ok(match self.joints {
            JointSet::Cmu => set,
            JointSet::Anatomical => json!({ "anatomical": set }),
        })
    }

    /// Where the skeleton or the centers go, called after this.
    pub(super) fn path(&self, named: &Path) -> PathBuf {
        with_end(named, self.end())
    }

    /// Where those of one of several people go.
    pub(super) fn path_of_person(&self, named: &Path, person: &str) -> PathBuf {
        let end = format!("-{}{}", file_name_part(person), self.end());
        with_end(named, &end)
    }

    fn end(&self) -> &'static str {
        ENDS[usize::from(self.joints == JointSet::Anatomical)]
    }

    /// Whether the skeleton that a record tells of is there, or why there is none.
    pub(super) fn is_done(&self, earlier: &EarlierResult<'_>) -> bool {
        let of_people = people_of(earlier.solved());
        let is_done = |solved: &Value| {
            solved["in_the_way"].is_null() && solved["none"].is_string()
                || file_of(earlier, solved).is_some_and(|path| path.exists())
        };
        !earlier.solved().is_null() && of_people.iter().all(is_done)
    }

    /// Fails where a file of somebody else stands at the path of the skeleton.
    pub(super) fn check(&self, earlier: &EarlierResult<'_>, named: &Path) -> Result<()> {
        self.check_path(earlier, &self.path(named))
    }

    pub(super) fn check_path(&self, earlier: &EarlierResult<'_>, path: &Path) -> Result<()> {
        if !path.exists() || is_own(earlier, path) {
            return Ok(());
        }
        let what = "stands in the place of a skeleton and is none that clean wrote for this take, \
                    or somebody changed it since; move it";
        Err(Error::data(Place::file(path.display().to_string()), what))
    }
}

/// What a record says of the skeleton of each person.
pub(super) fn people_of(solved: &Value) -> Vec<Value> {
    match solved["people"].as_array() {
        Some(people) => people.clone(),
        None => vec![solved.clone()],
    }
}

/// The file of a skeleton that a record tells of, beside the result.
fn file_of(earlier: &EarlierResult<'_>, solved: &Value) -> Option<PathBuf> {
    let name = solved["output"]["file"].as_str()?;
    let path = earlier.output.with_file_name(name);
    is_own(earlier, &path).then_some(path)
}

/// Whether a file beside a result is there, and one that its record tells of.
fn is_own(earlier: &EarlierResult<'_>, path: &Path) -> bool {
    let Ok(found) = Fingerprint::read(path) else {
        return false;
    };
    let is_it = |solved: &Value| {
        let output = &solved["output"];
        output["sha256"] == json!(found.sha256) && output["file"] == json!(found.file)
    };
    people_of(earlier.solved()).iter().any(is_it)
}

/// Takes away the skeletons or the centers of a result that is made anew.
pub(super) fn remove_old(earlier: &EarlierResult<'_>) {
    for solved in people_of(earlier.solved()) {
        // Where that fails, it stands there as an old one.
        let _ = file_of(earlier, &solved).map(std::fs::remove_file);
    }
}

/// Whether a file is a skeleton or centers that stand beside a result.
pub(super) fn is_skeleton(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let Some(stem) = ENDS.iter().find_map(|end| name.strip_suffix(end)) else {
        return false;
    };
    // The result's name ends there, or at a dash before one of several people.
    let stems = stem.match_indices('-').map(|(at, _)| &stem[..at]);
    let ends = EXTENSIONS
        .iter()
        .flat_map(|e| [format!(".{e}"), format!(".{e}.gz")]);
    let ends: Vec<String> = ends.chain([String::new(), ".C3D".to_string()]).collect();
    let is_of = |stem: &str| {
        let result = |end: &String| path.with_file_name(format!("{stem}{end}"));
        ends.iter()
            .map(result)
            .any(|result| is_own(&EarlierResult::read(&result), path))
    };
    stems.chain([stem]).any(is_of)
}

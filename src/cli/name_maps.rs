//! `--map`: a shipped map of names by its name, or a TOML file.

use super::toml_file;
use crate::ik::retarget::cmu_map;
use crate::pose::{NameMap, joints};
use crate::{Error, Place, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// The map that a flag names, for a model that knows the points `known`.
///
/// # Errors
/// [`Error::Data`]: the file cannot be read, or names a point that the model does not have.
pub fn name_map(name: &str, known: &[String]) -> Result<NameMap> {
    if let Some(map) = NameMap::find(name) {
        return Ok(map.clone());
    }
    let (joints, name): (BTreeMap<String, String>, String) = toml_file::read(map_file(name)?)?;
    if let Some(unknown) = joints.keys().find(|point| !known.contains(point)) {
        let what = format!("names a point \"{unknown}\" that the model does not have");
        return Err(Error::data(Place::file(name), what));
    }
    Ok(NameMap {
        name,
        joints,
        ..NameMap::default()
    })
}

/// The map of a flag for the joints of a skeleton: `cmu` is that of its BVH files.
///
/// # Errors
/// Those of [`name_map`].
pub fn joint_map(name: Option<&str>) -> Result<Option<NameMap>> {
    match name {
        Some(name) if name.eq_ignore_ascii_case("cmu") => Ok(Some(cmu_map())),
        Some(name) => name_map(name, &joints::cmu_names()).map(Some),
        None => Ok(None),
    }
}

/// The file that a flag names which names no shipped map.
///
/// # Errors
/// [`Error::Usage`]: there is none, and the name looks like that of a map.
pub(crate) fn map_file(name: &str) -> Result<&Path> {
    let path = Path::new(name);
    if path.exists() || path.extension().is_some() {
        return Ok(path);
    }
    let what = format!(
        "--map {name}: neither a file nor one of {}",
        shipped_names()
    );
    Err(Error::usage(what))
}

/// The names of the shipped maps, in one line.
pub fn shipped_names() -> String {
    let names = NameMap::shipped().iter().map(|map| map.name.as_str());
    names.collect::<Vec<_>>().join(", ")
}

//! The skeleton of an AMC take, which is in a file of its own.

use super::ReadOptions;
use crate::input::take_name;
use crate::{Error, Place, Result};
use std::path::{Path, PathBuf};

/// The ASF file of an AMC take: the option's, else the one beside it whose name begins the take's,
/// else the only one there.
#[doc(hidden)]
pub fn skeleton_of(path: &Path, options: &ReadOptions) -> Result<PathBuf> {
    if let Some(asf) = &options.asf {
        return Ok(asf.clone());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let is_asf = |p: &PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("asf"));
    let mut all: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(is_asf).collect();
    all.sort();
    let take = take_name(path);
    // 07_01 is of 07, not of 0.
    let begins = |p: &&PathBuf| {
        let rest = take.strip_prefix(&take_name(p)).map(str::to_string);
        rest.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
    };
    match all.iter().filter(begins).max_by_key(|p| take_name(p).len()) {
        Some(own) => Ok(own.clone()),
        None => {
            let what = format!(
                "no skeleton beside the take begins its name ({} others are there); give it with \
                 the option `asf SUBJECT.asf`",
                all.len()
            );
            Err(Error::data(Place::file(path.display().to_string()), what))
        }
    }
}

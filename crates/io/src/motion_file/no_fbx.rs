//! In place of FBX where it was left out when this was built.

use super::{MotionFile, ReadOptions};
use crate::input::Input;
use crate::{Error, Place, Result};
use std::path::Path;

const WHAT: &str =
    "is an FBX file, which was left out when this was built: open it in Blender and export BVH";

/// # Errors
/// [`Error::Data`]: always.
pub(super) fn of_fbx(_path: &Path, input: Input, _options: &ReadOptions) -> Result<MotionFile> {
    Err(Error::data(Place::file(input.name), WHAT))
}

/// # Errors
/// [`Error::Data`]: always.
#[doc(hidden)]
pub fn rig_of_fbx(
    name: &str,
    _bytes: Vec<u8>,
    _skeleton: Option<&str>,
) -> Result<(Vec<u8>, Vec<String>)> {
    Err(Error::data(Place::file(name), WHAT))
}

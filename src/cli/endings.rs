//! The ending of a result's name: no file is called what it is not.

use crate::io::MotionFormat;
use crate::io::motion_folder::{EXTENSIONS, unpacked};
use crate::{Error, Result};
use std::path::Path;

/// Endings of motion files that are not written anew, or that no reader here knows.
const OTHERS: [&str; 3] = ["json", "glb", "gltf"];

/// The ending of files of a format; FBX becomes BVH, keypoints become a table.
pub fn ending_of(format: MotionFormat) -> String {
    match format {
        MotionFormat::Fbx => "bvh".into(),
        MotionFormat::Keypoints => "csv".into(),
        other => {
            let name = other.name().to_lowercase();
            name.rsplit(' ').next().unwrap_or_default().into()
        }
    }
}

/// The ending of a path without that of packed files, in small letters.
pub fn ending(path: &Path) -> Option<String> {
    let path = unpacked(path);
    let ending = path.extension()?;
    Some(ending.to_string_lossy().to_lowercase())
}

/// Fails where a result is called as a file of another format of motion than its own, `own`.
///
/// # Errors
/// [`Error::Usage`]: it is.
pub fn check_ending(output: Option<&Path>, own: &str) -> Result<()> {
    let Some((path, called)) = output.and_then(|path| Some((path, ending(path)?))) else {
        return Ok(());
    };
    let is_motion = EXTENSIONS.contains(&called.as_str()) || OTHERS.contains(&called.as_str());
    if is_motion && called != own && EXTENSIONS.contains(&own) {
        let (path, format) = (path.display(), own.to_uppercase());
        let what = format!("{path}: the result is {format}; call it .{own}");
        return Err(Error::usage(what));
    }
    Ok(())
}

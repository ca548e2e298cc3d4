//! A folder of keypoints with a frame a file, as OpenPose's `--write_json` makes it.

use super::file::{LARGEST_FRAME, syntax};
use super::frame::Frame;
use super::frames::Frames;
use crate::input::Input;
use crate::marker_take::MarkerTake;
use crate::{Error, Place, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Reads the JSON files of a folder, each a frame whose number ends its name.
///
/// # Errors
/// [`super::read`] has the same; the folder has no such files, or those of several takes.
pub fn read_folder(folder: &Path) -> Result<MarkerTake> {
    let name = folder.display().to_string();
    let bad = |what: String| Error::data(Place::file(&name), what);
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let paths = entries.flatten().map(|entry| entry.path());
    let is_json = |path: &PathBuf| path.extension().is_some_and(|e| e == "json");
    let (mut files, mut left) = (Vec::new(), 0);
    for path in paths.filter(is_json) {
        match numbered(&path) {
            Some((take, number)) => files.push((number, take, path)),
            None => left += 1,
        }
    }
    files.sort();
    let Some((_, first, _)) = files.first() else {
        let what = "is a directory, expected a file, or a folder with a frame a file \
                    (NAME_000000000012_keypoints.json)";
        return Err(bad(what.into()));
    };
    if let Some((_, other, _)) = files.iter().find(|(_, take, _)| take != first) {
        let what = format!("has the frames of several takes, {first} and {other}: one a folder");
        return Err(bad(what));
    }
    let mut frames = Frames::new(&name);
    for (number, _, path) in &files {
        let file = path.display().to_string();
        let bytes = Input::open(path)?.read_all(LARGEST_FRAME)?;
        let value: Value = serde_json::from_slice(&bytes).map_err(|e| syntax(&file, &e))?;
        let frame = Frame::read(&value).and_then(|frame| frames.push(frame, Some(*number)));
        frame.map_err(|e| e.at(Place::file(file)))?;
    }
    if left > 0 {
        let s = if left == 1 { "" } else { "s" };
        let what = format!("leaves out {left} file{s} without the number of a frame");
        frames.notes.push(what);
    }
    frames.take(None)
}

/// The take and the number that the name of a frame's file has.
fn numbered(path: &Path) -> Option<(String, u64)> {
    let stem = path.file_stem()?.to_str()?;
    let stem = stem.strip_suffix("_keypoints").unwrap_or(stem);
    let take = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = stem[take.len()..].parse().ok()?;
    Some((take.trim_end_matches(['_', '-']).to_string(), number))
}

//! Which files and folders hold keypoints as JSON, by how they begin; the files of a folder with a
//! frame a file, as OpenPose's `--write_json` makes it, as the JSON of a take.

use crate::{Error, Place, Result};
use serde_json::value::RawValue;
use serde_json::{Value, json};
use std::io;
use std::path::{Path, PathBuf};

/// The most bytes of a frame: its values take some twenty times the memory.
pub(crate) const LARGEST_FRAME: u64 = 1 << 22;
/// The fields of a frame that was a file: that file, and what it has.
pub(crate) const FILE: &str = "posing:file";
pub(crate) const CONTENT: &str = "posing:content";
/// The field of a line on the folder.
pub(crate) const NOTE: &str = "posing:note";

/// How lists of keypoints are called, and how such lists begin that are not called anything.
const CALLED: [&str; 6] = [
    "_keypoints_3d\":[",
    "_keypoints_2d\":[",
    "andmarks\":[",
    "andmark\":[",
    "\"keypoints\":[",
    "\"keypoints\":{",
];
const BEGINNINGS: [&str; 3] = ["[[[", "[[{\"x\":", "[{\"x\":"];

/// A file of a folder: the number of its frame, its take, its path.
type FrameFile = (u64, String, PathBuf);

/// Whether JSON that begins so has keypoints.
pub(crate) fn is_keypoints(start: &str) -> bool {
    let text: String = start.chars().filter(|c| !c.is_whitespace()).collect();
    let text = text.trim_start_matches('\u{feff}');
    let frames = text.split_once("\"frames\":").map(|(_, frames)| frames);
    let mut lists = [Some(text), frames].into_iter().flatten();
    let begins = lists.any(|list| BEGINNINGS.iter().any(|begin| list.starts_with(begin)));
    begins || CALLED.iter().any(|called| text.contains(called))
}

/// Whether a folder has keypoints with a frame a file.
#[doc(hidden)]
pub fn is_frame_folder(folder: &Path) -> bool {
    let Ok((files, _)) = frame_files(folder) else {
        return false;
    };
    let first = files.first().and_then(|(_, _, path)| text_of(path).ok());
    first.is_some_and(|text| {
        let value: Value = serde_json::from_str(&text).unwrap_or_default();
        let is_frame = value.is_object() && value.get("frames").is_none();
        is_frame && (value["people"].is_array() || is_keypoints(&text))
    })
}

/// The bytes of a file, or those of a folder's frames as the JSON of a take.
///
/// # Errors
/// Those of reading; [`Error::Data`]: the folder has no frames, those of several takes, or a file
/// that is no JSON.
#[doc(hidden)]
pub fn bytes_of(path: &Path) -> Result<Vec<u8>> {
    if path.is_dir() {
        joined(path)
    } else {
        std::fs::read(path).map_err(|e| Error::io(path, e))
    }
}

/// The frames of a folder as the JSON of a take; see [`bytes_of`].
pub(crate) fn joined(folder: &Path) -> Result<Vec<u8>> {
    let bad = |what: String| Error::data(Place::file(folder.display().to_string()), what);
    let (files, left) = frame_files(folder).map_err(|e| Error::io(folder, e))?;
    let Some((_, first, _)) = files.first() else {
        let what = "is a directory, expected a file, or a folder with a frame a file \
                    (NAME_000000000012_keypoints.json)";
        return Err(bad(what.into()));
    };
    if let Some((_, other, _)) = files.iter().find(|(_, take, _)| take != first) {
        let what = format!("has the frames of several takes, {first} and {other}: one a folder");
        return Err(bad(what));
    }
    let frame = |(number, _, path): &FrameFile| {
        let (file, text) = (path.display().to_string(), text_of(path)?);
        let content: &RawValue = serde_json::from_str(&text).map_err(|e| syntax(&file, &e))?;
        let file = json!(file);
        Ok(format!(
            "{{\"frame\":{number},\"{FILE}\":{file},\"{CONTENT}\":{content}}}"
        ))
    };
    let frames = files.iter().map(frame).collect::<Result<Vec<String>>>()?;
    let note = match left {
        0 => Value::Null,
        1 => json!("leaves out 1 file without the number of a frame"),
        n => json!(format!(
            "leaves out {n} files without the number of a frame"
        )),
    };
    Ok(format!("{{\"{NOTE}\":{note},\"frames\":[{}]}}", frames.join(",")).into_bytes())
}

/// The error of a text that is no JSON.
pub(crate) fn syntax(name: &str, e: &serde_json::Error) -> Error {
    let what = if e.is_eof() {
        "ends early, within its JSON; of a list of frames, the option `keep_whole` reads the whole \
         ones"
            .to_string()
    } else {
        let said = e.to_string();
        let said = said.split(" at line ").next().unwrap_or_default();
        format!(
            "is no JSON that is read: {said} (column {}); missing is null, not NaN",
            e.column()
        )
    };
    Error::data(Place::line(name, e.line().max(1) as u64), what)
}

/// The files of a folder that are frames by their names, in order, and how many others are JSON.
fn frame_files(folder: &Path) -> io::Result<(Vec<FrameFile>, usize)> {
    let paths = std::fs::read_dir(folder)?
        .flatten()
        .map(|entry| entry.path());
    let (mut files, mut left) = (Vec::new(), 0);
    for path in paths.filter(|path| path.extension().is_some_and(|e| e == "json")) {
        match numbered(&path) {
            Some((take, number)) => files.push((number, take, path)),
            None => left += 1,
        }
    }
    files.sort();
    Ok((files, left))
}

/// The take and the number that the name of a frame's file has.
fn numbered(path: &Path) -> Option<(String, u64)> {
    let stem = path.file_stem()?.to_str()?;
    let stem = stem.strip_suffix("_keypoints").unwrap_or(stem);
    let take = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = stem[take.len()..].parse().ok()?;
    Some((take.trim_end_matches(['_', '-']).to_string(), number))
}

/// The text of a frame's file.
fn text_of(path: &Path) -> Result<String> {
    let bad = |what: &str| Error::data(Place::file(path.display().to_string()), what);
    let about = path.metadata().map_err(|e| Error::io(path, e))?;
    if about.len() > LARGEST_FRAME {
        return Err(bad("is larger than 4 MiB, the most of a frame"));
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    String::from_utf8(bytes).map_err(|_| bad("is no UTF-8, as JSON is"))
}

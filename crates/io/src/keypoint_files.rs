//! The files of a folder of keypoints with a frame a file, as OpenPose's `--write_json` makes it,
//! as the JSON of a take.

use crate::keypoints::frame::Frame;
use crate::{Error, Place, Result};
use serde_json::value::RawValue;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};

/// The most bytes of a frame: its values take some twenty times the memory.
pub(crate) const LARGEST_FRAME: u64 = 1 << 22;
/// The fields of a frame that was a file: that file, and what it has.
pub(crate) const FILE: &str = "posing:file";
pub(crate) const CONTENT: &str = "posing:content";
/// The field of a line on the folder.
pub(crate) const NOTE: &str = "posing:note";

/// A file of a folder: the number of its frame, its name without that, its path.
type FrameFile = (u64, String, PathBuf);

/// The JSON of a folder.
struct FrameFiles {
    /// The files of frames, in order.
    frames: Vec<FrameFile>,
    /// The number of others.
    left: usize,
    /// Whether one of the frames has keypoints.
    are_keypoints: bool,
}

/// Whether a folder has keypoints with a frame a file.
#[doc(hidden)]
pub fn is_frame_folder(folder: &Path) -> bool {
    frame_files(folder).is_ok_and(|files| files.are_keypoints)
}

/// The files of the frames of a folder that has keypoints with a frame a file.
pub(crate) fn frames_in(folder: &Path) -> HashSet<PathBuf> {
    let files = frame_files(folder).ok().filter(|files| files.are_keypoints);
    let frames = files.into_iter().flat_map(|files| files.frames);
    frames.map(|(.., path)| path).collect()
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
    let files = frame_files(folder).map_err(|e| Error::io(folder, e))?;
    let Some((_, first, _)) = files.frames.first() else {
        return Err(bad("is a directory, expected a file".into()));
    };
    if let Some((_, other, _)) = files.frames.iter().find(|(_, take, _)| take != first) {
        let what = format!("has the frames of several takes, {first} and {other}: one a folder");
        return Err(bad(what));
    }
    let frame = |(number, _, path): &FrameFile| {
        let (name, text) = (path.display().to_string(), text_of(path)?);
        let content: &RawValue = serde_json::from_str(&text).map_err(|e| syntax(&name, &e, ""))?;
        // However the path is written, the bytes are the same.
        let file = json!(path.file_name().map(|name| name.to_string_lossy()));
        Ok(format!(
            "{{\"frame\":{number},\"{FILE}\":{file},\"{CONTENT}\":{content}}}"
        ))
    };
    let frames = files
        .frames
        .iter()
        .map(frame)
        .collect::<Result<Vec<String>>>()?;
    let note = match files.left {
        0 => Value::Null,
        1 => json!("leaves out 1 JSON file that is no frame of it"),
        n => json!(format!(
            "leaves out {n} JSON files that are no frames of it"
        )),
    };
    Ok(format!("{{\"{NOTE}\":{note},\"frames\":[{}]}}", frames.join(",")).into_bytes())
}

/// The error of a text that is no JSON, with `advice` where it ends early.
pub(crate) fn syntax(name: &str, e: &serde_json::Error, advice: &str) -> Error {
    let what = if e.is_eof() {
        format!("ends early, within its JSON{advice}")
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

/// The files of a folder that are frames: numbered, with the names of those that have keypoints if
/// there are such, and no take of their own; one that is broken is a frame by its name.
fn frame_files(folder: &Path) -> io::Result<FrameFiles> {
    let paths = std::fs::read_dir(folder)?.flatten().map(|e| e.path());
    let paths = paths.filter(|path| path.extension().is_some_and(|e| e == "json"));
    // A pipe would wait.
    let paths = paths.filter(|path| path.metadata().map_or(true, |about| about.is_file()));
    let (mut all, mut frames, mut known) = (0, Vec::new(), HashSet::new());
    for path in paths {
        all += 1;
        let Some((number, name)) = numbered(&path) else {
            continue;
        };
        let text = text_of(&path).unwrap_or_default();
        let value: Value = serde_json::from_str(&text).unwrap_or_default();
        if !value.is_array() && value.get("frames").is_none_or(Value::is_number) {
            if Frame::is_of(&value) {
                known.insert(name.clone());
            }
            frames.push((number, name, path));
        }
    }
    frames.retain(|(_, name, _)| known.is_empty() || known.contains(name));
    frames.sort();
    Ok(FrameFiles {
        left: all - frames.len(),
        frames,
        are_keypoints: !known.is_empty(),
    })
}

/// The number of the frame that the name of a file has, and the name with `*` for it.
fn numbered(path: &Path) -> Option<(u64, String)> {
    let stem = path.file_stem()?.to_str()?;
    let (stem, end) = match stem.strip_suffix("_keypoints") {
        Some(stem) => (stem, "_keypoints"),
        None => (stem, ""),
    };
    let take = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let number = stem[take.len()..].parse().ok()?;
    Some((number, format!("{take}*{end}.json")))
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

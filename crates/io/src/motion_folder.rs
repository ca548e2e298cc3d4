//! The files of motion in a folder and all below it.

use super::input::Input;
use super::keypoint_files::frames_in;
use super::keypoints::is_keypoints;
use super::npz_take::NpzTake;
use crate::Error;
use posing_core::error::is_hidden as is_hidden_letter;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// The names of files that a folder is searched for.
pub const EXTENSIONS: [&str; 11] = [
    "c3d", "trc", "bvh", "fbx", "amc", "csv", "tsv", "npy", "npz", "mot", "sto",
];

/// What a folder has of files of motion.
#[derive(Debug, Default)]
pub struct MotionFolder {
    /// The files and their paths within the folder, in the order of their names.
    pub files: Vec<(PathBuf, PathBuf)>,
    /// Folders that cannot be read, with their paths within the folder, whose own is the given
    /// one.
    pub unreadable: Vec<(PathBuf, PathBuf, Error)>,
    /// The number of files that are none of motion, or that were not wanted.
    pub left_out: usize,
    /// Whether keypoints as JSON are searched for.
    has_keypoints: bool,
}

impl MotionFolder {
    /// Searches a folder, but not what is in the folder `but` (without links); files that
    /// `is_wanted` refuses are left out, and hidden ones.
    pub fn search(
        folder: &Path,
        but: Option<&Path>,
        is_wanted: impl Fn(&Path) -> bool,
    ) -> MotionFolder {
        MotionFolder::default().searched(folder, but, is_wanted)
    }

    /// [`MotionFolder::search`], also for keypoints as JSON; a folder that has them with a frame a
    /// file is one of the files.
    pub fn with_keypoints(
        folder: &Path,
        but: Option<&Path>,
        is_wanted: impl Fn(&Path) -> bool,
    ) -> MotionFolder {
        let out = MotionFolder {
            has_keypoints: true,
            ..MotionFolder::default()
        };
        out.searched(folder, but, is_wanted)
    }

    fn searched(
        mut self,
        folder: &Path,
        but: Option<&Path>,
        is_wanted: impl Fn(&Path) -> bool,
    ) -> MotionFolder {
        let mut folders = vec![folder.to_path_buf()];
        // A link to a folder may lead back here.
        let mut seen: HashSet<PathBuf> = but.map(Path::to_path_buf).into_iter().collect();
        while let Some(next) = folders.pop() {
            let is_new = next.canonicalize().map_or(true, |path| seen.insert(path));
            if !is_new {
                continue;
            }
            let within = |path: &Path| path.strip_prefix(folder).unwrap_or(path).to_path_buf();
            let entries = match std::fs::read_dir(&next) {
                Ok(entries) => entries,
                Err(e) => {
                    let name = if next == folder {
                        next.clone()
                    } else {
                        within(&next)
                    };
                    let error = Error::io(&next, e);
                    self.unreadable.push((next, name, error));
                    continue;
                }
            };
            let asked = self.has_keypoints.then(|| frames_in(&next));
            let frames = asked.unwrap_or_default();
            if !frames.is_empty() {
                let name = if next == folder {
                    name_of(&next.canonicalize().unwrap_or_default())
                } else {
                    within(&next)
                };
                self.files.push((next.clone(), name));
            }
            for path in entries.flatten().map(|entry| entry.path()) {
                if path.is_dir() && !is_hidden(&path) {
                    folders.push(path);
                } else if frames.contains(&path) {
                    // A part of the take.
                } else if self.has_file(&path) && is_wanted(&path) && !is_model(&path) {
                    self.files.push((path.clone(), within(&path)));
                } else if path.is_file() {
                    self.left_out += 1;
                }
            }
        }
        self.files.sort();
        self
    }

    /// Whether a path is a file of motion that is searched for.
    fn has_file(&self, path: &Path) -> bool {
        let is_asked = || self.has_keypoints && is_json(path);
        let is_visible = || !is_hidden(path) && !is_special(path);
        let is_read = || Input::open(path).is_ok_and(is_keypoints);
        is_motion_file(path) || is_asked() && is_visible() && is_read()
    }
}

/// The files of motion in a folder itself, but for hidden ones, in the order of their names.
pub fn motion_files_in(folder: &Path) -> Vec<PathBuf> {
    // A name alone has no folder before it.
    let folder = match folder {
        empty if empty.as_os_str().is_empty() => Path::new("."),
        folder => folder,
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let is_wanted = |path: &PathBuf| is_motion_file(path) && !is_model(path);
    let mut files: Vec<PathBuf> = entries.map(|e| e.path()).filter(is_wanted).collect();
    files.sort();
    files
}

fn is_hidden(path: &Path) -> bool {
    name_of(path).to_string_lossy().starts_with('.')
}

/// Whether a path is a file of motion by its name, and not hidden.
fn is_motion_file(path: &Path) -> bool {
    is_motion(path) && !is_hidden(path) && !is_special(path)
}

fn is_json(path: &Path) -> bool {
    unpacked(path)
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("json"))
}

/// Whether an archive is a model of posing or holds meshes.
fn is_model(path: &Path) -> bool {
    let is_npz = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("npz"));
    is_npz
        && Input::open(path)
            .and_then(NpzTake::is_other)
            .is_ok_and(|is| is)
}

/// Whether a path is there and neither a file nor a folder.
pub fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// The last part of a path.
pub fn name_of(path: &Path) -> PathBuf {
    PathBuf::from(path.file_name().unwrap_or_default())
}

/// Whether the result of one file goes into a folder at `output`: it is one, ends in a slash, or is
/// not there and has no ending where the file has one.
pub fn is_results_folder(output: &Path, input: &Path) -> bool {
    let ends_in_slash = output.as_os_str().to_string_lossy().ends_with(['/', '\\']);
    let is_new = || output != Path::new("-") && output.symlink_metadata().is_err();
    let has_ending = |path: &Path| path.extension().is_some();
    output.is_dir() || ends_in_slash || is_new() && !has_ending(output) && has_ending(input)
}

/// A name as a part of a file's name: what no file name holds is written as its number.
pub fn file_name_part(name: &str) -> String {
    let is_held = |c: char| !is_hidden_letter(c) && !"/\\:*?\"<>|%".contains(c);
    let held = |c: char| {
        if is_held(c) {
            c.to_string()
        } else {
            format!("%{:X}", u32::from(c))
        }
    };
    name.chars().map(held).collect()
}

/// The name of a file without the ending of a packed one.
pub fn unpacked(path: &Path) -> PathBuf {
    match path.extension() {
        Some(e) if e.eq_ignore_ascii_case("gz") || e.eq_ignore_ascii_case("zst") => {
            path.with_extension("")
        }
        _ => path.to_path_buf(),
    }
}

fn is_motion(path: &Path) -> bool {
    let path = unpacked(path);
    let is = |e: &std::ffi::OsStr| EXTENSIONS.iter().any(|x| e.eq_ignore_ascii_case(x));
    path.extension().is_some_and(is)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_cannot_be_read_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let none = folder.path().join("none");
        let found = MotionFolder::search(&none, None, |_| true);
        assert_eq!(found.unreadable[0].1, none);
    }
}

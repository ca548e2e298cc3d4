//! The files that a command reads and writes, by identity: a result replaces no file that is read,
//! and no other result.

use super::output::{end_of_links, file_descriptor};
use crate::{Error, Result};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// What two paths have in common that lead to one file.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum FileId {
    /// A file that is there, by device and number: also by links of both kinds.
    #[cfg(unix)]
    Existing(u64, u64),
    /// A path without links, of what is not there yet or where files have no numbers.
    Path(PathBuf),
}

impl FileId {
    /// The identity of the file at `path`; `None` of a folder and of what is no file, such as a
    /// pipe or `/dev/null`.
    fn of(path: &Path) -> Option<FileId> {
        match fs::metadata(path) {
            Ok(found) if !found.is_file() => None,
            #[cfg(unix)]
            Ok(found) => {
                use std::os::unix::fs::MetadataExt;
                Some(FileId::Existing(found.dev(), found.ino()))
            }
            _ => Some(FileId::Path(without_links(path))),
        }
    }
}

/// The path without links and dots as far as it is there, and what is not there yet below that.
fn without_links(path: &Path) -> PathBuf {
    let path = end_of_links(path).unwrap_or(path.to_path_buf());
    let path = std::path::absolute(&path).unwrap_or(path);
    let found = path
        .ancestors()
        .find_map(|above| Some((above.canonicalize().ok()?, path.strip_prefix(above).ok()?)));
    match found {
        Some((folder, rest)) if rest.as_os_str().is_empty() => folder,
        Some((folder, rest)) => folder.join(rest),
        None => path,
    }
}

/// Whether two paths lead to one file.
pub fn are_one(a: &Path, b: &Path) -> bool {
    FileId::of(a).is_some_and(|id| FileId::of(b) == Some(id))
}

/// Files that are read, and files that are written, each with what the user calls it.
#[derive(Debug, Clone, Default)]
pub struct CommandFiles {
    read: HashMap<FileId, String>,
    written: HashMap<FileId, String>,
}

impl CommandFiles {
    /// Adds a file that is read; `called` is what messages call it: `the input walk.csv`. `-` is
    /// standard input.
    ///
    /// # Errors
    /// [`Error::Usage`]: it is a file that is written.
    pub fn read(&mut self, called: impl Into<String>, path: &Path) -> Result<()> {
        let path = if path == Path::new("-") {
            Path::new("/dev/stdin")
        } else {
            path
        };
        let Some(id) = FileId::of(path) else {
            return Ok(());
        };
        let called = called.into();
        match self.written.get(&id) {
            Some(output) => Err(replaced(output, &called)),
            None => {
                self.read.entry(id).or_insert(called);
                Ok(())
            }
        }
    }

    /// Fails where a file that is written is one that is read.
    ///
    /// # Errors
    /// [`Error::Usage`]: it is.
    pub fn check_not_read(&self, called: &str, path: &Path) -> Result<()> {
        let id = FileId::of(path).filter(|_| !is_stream(path));
        match id.and_then(|id| self.read.get(&id)) {
            Some(input) => Err(replaced(called, input)),
            None => Ok(()),
        }
    }

    /// Adds a file that is written; `called` is what messages call it: `-o walk.csv`. Streams are
    /// no files: `-`, an open file of the process (`/dev/stdout`), a pipe.
    ///
    /// # Errors
    /// [`Error::Usage`]: it is a file that is read, or another that is written.
    pub fn write(&mut self, called: impl Into<String>, path: &Path) -> Result<()> {
        let Some(id) = FileId::of(path).filter(|_| !is_stream(path)) else {
            return Ok(());
        };
        let called = called.into();
        self.check_not_read(&called, path)?;
        match self.written.get(&id) {
            Some(other) => Err(Error::usage(format!(
                "{called} and {other} are one file; name another for one of them"
            ))),
            None => {
                self.written.insert(id, called);
                Ok(())
            }
        }
    }
}

fn replaced(output: &str, input: &str) -> Error {
    Error::usage(format!(
        "{output} would be replaced, as it is {input}; name another file"
    ))
}

/// Whether what is written there goes to an open file of the process.
fn is_stream(path: &Path) -> bool {
    path == Path::new("-") || file_descriptor(path).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_replaces_no_input_and_no_result() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("in.csv"), "x").unwrap();
        fs::write(at("old.csv"), "x").unwrap();
        fs::create_dir(at("deep")).unwrap();
        let mut files = CommandFiles::default();
        files.read("the input in.csv", &at("in.csv")).unwrap();
        files
            .read("the file of --to none.bvh", &at("none.bvh"))
            .unwrap();
        let mut refused = vec!["in.csv", "./in.csv", "deep/../in.csv", "none.bvh"];
        let mut sound = vec!["old.csv", "new.csv", "deep/in.csv", "later/in.csv", "deep"];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("in.csv", at("link.csv")).unwrap();
            std::os::unix::fs::symlink("../none.bvh", at("deep/dangling")).unwrap();
            std::os::unix::fs::symlink("deep", at("folder")).unwrap();
            fs::hard_link(at("in.csv"), at("hard.csv")).unwrap();
            refused.extend(["link.csv", "deep/dangling", "hard.csv", "folder/../in.csv"]);
            sound.push("/dev/null");
        }
        for name in refused {
            let error = files.clone().write("-o", &at(name)).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{name}");
            assert!(error.to_string().contains("name another"), "{error}");
        }
        for name in &sound {
            files.write(*name, &at(name)).unwrap();
        }
        for name in ["new.csv", "./new.csv", "deep/../new.csv", "old.csv"] {
            let error = files.clone().write("--page", &at(name)).unwrap_err();
            assert!(error.to_string().contains("are one file"), "{error}");
        }
        let late = files.read("the input new.csv", &at("new.csv")).unwrap_err();
        assert!(late.to_string().contains("would be replaced"), "{late}");
        for stream in ["-", "/dev/null", "/dev/stdout", "/dev/fd/1"] {
            for _ in 0..2 {
                files.write("-o", Path::new(stream)).unwrap();
            }
        }
    }
}

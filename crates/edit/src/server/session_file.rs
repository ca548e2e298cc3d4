//! The file that keeps the session of `edit`: one program at a time has it.

use crate::io::output::{end_of_links, write_file};
use crate::{Error, Place, Result};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A file of a session, and the lock that keeps other programs from it.
///
/// The lock is on a file beside it, `.NAME.lock`, because the file itself is a new one whenever it
/// is saved. The system lets the lock go when the program ends, however that happens.
#[derive(Debug)]
pub(crate) struct SessionPath {
    path: PathBuf,
    lock_path: PathBuf,
    lock: File,
}

impl SessionPath {
    /// Takes the file, which need not be there yet.
    ///
    /// # Errors
    /// [`Error::Data`]: another program has it, or it is no file. [`Error::Io`]: its folder cannot
    /// be written to.
    pub fn open(path: &Path) -> Result<SessionPath> {
        let wrong = |what: &str| Error::data(Place::file(path.display().to_string()), what);
        if fs::metadata(path).is_ok_and(|m| !m.is_file()) {
            return Err(wrong("is no file that can keep a session"));
        }
        let lock_path = lock_path(path).ok_or_else(|| wrong("is no name of a file"))?;
        loop {
            let lock = OpenOptions::new()
                .create(true)
                // Windows locks no file that is opened for appending only.
                .write(true)
                .truncate(false)
                .open(&lock_path)
                .map_err(|e| Error::io(path, e))?;
            match lock.try_lock() {
                Ok(()) => {}
                // Some network drives know no locks.
                Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(wrong(
                        "is open in another posing edit; end that, or name another with the \
                         option `session`",
                    ));
                }
                Err(TryLockError::Error(e)) => return Err(Error::io(&lock_path, e)),
            }
            // Its last owner may have removed it just before.
            if is_at(&lock, &lock_path) {
                return Ok(SessionPath {
                    path: path.to_path_buf(),
                    lock_path,
                    lock,
                });
            }
        }
    }

    /// The name of the file without its folder.
    pub(crate) fn name(&self) -> Option<String> {
        Some(self.path.file_name()?.to_string_lossy().into_owned())
    }

    /// What it keeps; `None` if it is not there yet.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn read(&self) -> Result<Option<Vec<u8>>> {
        match fs::read(&self.path) {
            Ok(json) => Ok(Some(json)),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(Error::io(&self.path, e)),
        }
    }

    /// Keeps a session in it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn write(&self, json: &str) -> Result<()> {
        write_file(&self.path, json.as_bytes())
    }

    /// An error of what it keeps, with its name.
    pub(crate) fn refused(&self, error: &Error) -> Error {
        Error::data(
            Place::file(self.path.display().to_string()),
            error.to_string(),
        )
    }
}

impl Drop for SessionPath {
    fn drop(&mut self) {
        // Before the lock goes. A file that stays behind does no harm, and one with something in it
        // is somebody's.
        if self.lock.metadata().is_ok_and(|m| m.len() == 0) {
            let _ = fs::remove_file(&self.lock_path);
        }
    }
}

/// Where the lock of a file is, links resolved.
fn lock_path(path: &Path) -> Option<PathBuf> {
    let resolved = fs::canonicalize(path)
        .or_else(|_| end_of_links(path))
        .ok()?;
    let mut name = std::ffi::OsString::from(".");
    name.push(resolved.file_name()?);
    name.push(".lock");
    Some(resolved.with_file_name(name))
}

/// Whether an open file is the one at a path.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |m: fs::Metadata| (m.dev(), m.ino());
    file.metadata().map(id).ok() == fs::metadata(path).map(id).ok()
}

/// Whether a file is at the path of an open one: std knows no more of it here.
#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_file_has_one_owner_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let first = SessionPath::open(&path).unwrap();
        assert_eq!(first.read().unwrap(), None);
        first.write("{}").unwrap();
        let link = folder.path().join("link.json");
        std::os::unix::fs::symlink("a.json", &link).unwrap();
        for same in [&path, &link] {
            let refused = SessionPath::open(same).unwrap_err().to_string();
            assert!(refused.contains("another posing edit"), "{refused}");
        }
        let other = SessionPath::open(&folder.path().join("b.json")).unwrap();
        drop((first, other));
        let again = SessionPath::open(&path).unwrap();
        assert_eq!(again.read().unwrap().unwrap(), b"{}");
        drop(again);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_file_that_is_not_there_yet_has_its_lock() {
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a.json"), folder.path().join("l.json"));
        std::os::unix::fs::symlink("a.json", &link).unwrap();
        let first = SessionPath::open(&link).unwrap();
        assert!(SessionPath::open(&path).is_err());
        drop(first);
        assert!(SessionPath::open(&path).is_ok());
    }

    #[test]
    fn a_lock_file_of_somebody_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let lock = folder.path().join(".a.json.lock");
        fs::write(&lock, "mine").unwrap();
        drop(SessionPath::open(&folder.path().join("a.json")).unwrap());
        assert_eq!(fs::read(&lock).unwrap(), b"mine");
    }

    #[test]
    fn a_file_that_cannot_be_written_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none/a.json");
        assert!(matches!(SessionPath::open(&path), Err(Error::Io { .. })));
        assert!(SessionPath::open(folder.path()).is_err());
    }
}

//! Writing an output so that nothing is ever half written.

use crate::{Error, Result};
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::NamedTempFile;

/// A file being written: a temporary file in the same folder, renamed over the target by [`OutputFile::finish`].
/// Dropped before that, it leaves nothing behind.
///
/// A target that exists and is no regular file (a pipe, `/dev/null`), or that is what the process has open (`/dev/stdout`), is
/// written to directly; a link stays, and the file that it names is written.
pub struct OutputFile {
    path: PathBuf,
    sink: Sink,
    _unfinished: Option<UnfinishedFile>,
}

/// Links are followed so far.
const MOST_LINKS: usize = 40;

/// The temporary files that are being written.
static UNFINISHED_FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// One of them.
struct UnfinishedFile(PathBuf);

impl UnfinishedFile {
    fn written(path: &Path) -> UnfinishedFile {
        let mut all = UNFINISHED_FILES
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        all.push(path.to_path_buf());
        UnfinishedFile(path.to_path_buf())
    }
}

impl Drop for UnfinishedFile {
    fn drop(&mut self) {
        let mut all = UNFINISHED_FILES
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        all.retain(|path| *path != self.0);
    }
}

/// Removes what is half written, before the process is ended by a signal.
pub fn remove_unfinished_files() {
    let all = UNFINISHED_FILES
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    for path in &*all {
        // It is gone already where it was just finished.
        let _ = fs::remove_file(path);
    }
}

enum Sink {
    Temporary(BufWriter<NamedTempFile>),
    Direct(BufWriter<File>),
}

impl OutputFile {
    /// Starts writing the file that will stand at `path`.
    pub fn create(path: &Path) -> Result<OutputFile> {
        let fail = |e| Error::io(path, e);
        let (named, file_descriptor) = resolved(path).map_err(fail)?;
        let is_file = fs::metadata(&named).map_or(true, |m| m.is_file());
        let sink = if file_descriptor.is_some() || !is_file {
            // What is there already, of a file that others write to as well, stays.
            let file = fs::OpenOptions::new()
                .append(true)
                .open(path)
                .map_err(fail)?;
            Sink::Direct(BufWriter::new(file))
        } else {
            let path = &named;
            let folder = match path.parent() {
                Some(p) if !p.as_os_str().is_empty() => p,
                _ => Path::new("."),
            };
            let file = tempfile::Builder::new()
                .prefix(".posing-")
                .suffix(".tmp")
                .permissions(permissions(path))
                .tempfile_in(folder)
                .map_err(fail)?;
            Sink::Temporary(BufWriter::with_capacity(1 << 16, file))
        };
        let unfinished = match &sink {
            Sink::Temporary(file) => Some(UnfinishedFile::written(file.get_ref().path())),
            Sink::Direct(_) => None,
        };
        Ok(OutputFile {
            path: named,
            sink,
            _unfinished: unfinished,
        })
    }

    /// Whether [`OutputFile::rewrite_start`] can be: what is written to a pipe is gone.
    pub fn can_rewrite(&self) -> bool {
        matches!(self.sink, Sink::Temporary(_))
    }

    /// Writes `bytes` over the first ones. Nothing can be appended after that.
    pub fn rewrite_start(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.sink {
            Sink::Temporary(file) => {
                file.rewind()?;
                file.write_all(bytes)
            }
            Sink::Direct(_) => Err(io::ErrorKind::NotSeekable.into()),
        }
    }

    /// Flushes, syncs and renames: only now is the file there.
    pub fn finish(self) -> Result<()> {
        let path = self.path;
        let fail = |e| Error::io(&path, e);
        match self.sink {
            Sink::Direct(mut file) => file.flush().map_err(fail),
            Sink::Temporary(file) => {
                let file = file.into_inner().map_err(|e| fail(e.into_error()))?;
                file.as_file().sync_all().map_err(fail)?;
                file.persist(&path).map_err(|e| fail(e.error))?;
                Ok(())
            }
        }
    }
}

/// What a path names, links followed, and its number if it is what the process has open.
fn resolved(path: &Path) -> io::Result<(PathBuf, Option<u32>)> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let open = own_descriptor(&path);
        let Some(target) = fs::read_link(&path).ok().filter(|_| open.is_none()) else {
            return Ok((path, open));
        };
        path = match path.parent() {
            Some(folder) => folder.join(target),
            None => target,
        };
    }
    Err(io::Error::other("too many links, or they lead round"))
}

/// The number of what the process has open, if a path leads there: 1 is standard output.
pub fn file_descriptor(path: &Path) -> Option<u32> {
    resolved(path).ok()?.1
}

/// The same, where the path itself says so.
fn own_descriptor(path: &Path) -> Option<u32> {
    let text = path.to_str()?;
    match text {
        "/dev/stdout" => return Some(1),
        "/dev/stderr" => return Some(2),
        _ => {}
    }
    let own = format!("/proc/{}/fd/", std::process::id());
    let folders = ["/dev/fd/", "/proc/self/fd/", "/proc/thread-self/fd/", &own];
    let number = folders.iter().find_map(|f| text.strip_prefix(f))?;
    number.parse().ok()
}

/// The mode the file has now, or what the umask leaves of 0666 (a temporary file would be 0600).
#[cfg(unix)]
fn permissions(path: &Path) -> fs::Permissions {
    use std::os::unix::fs::PermissionsExt;
    fs::metadata(path)
        .map(|m| m.permissions())
        .unwrap_or(fs::Permissions::from_mode(0o666))
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.sink {
            Sink::Temporary(f) => f.write(bytes),
            Sink::Direct(f) => f.write(bytes),
        }
    }
    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::Temporary(f) => f.flush(),
            Sink::Direct(f) => f.flush(),
        }
    }
}

/// Writes a whole file at once, atomically.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = OutputFile::create(path)?;
    file.write_all(bytes).map_err(|e| Error::io(path, e))?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_there_only_when_finished() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.csv");
        let mut file = OutputFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        write_file(&path, b"whole").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        write_file(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(OutputFile::create(&dir.path().join("no/where")).is_err());
        let mut file = OutputFile::create(&path).unwrap();
        file.write_all(b"count: ?, all").unwrap();
        assert!(file.can_rewrite());
        file.rewrite_start(b"count: 3").unwrap();
        file.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"count: 3, all");
    }

    #[cfg(unix)]
    #[test]
    fn a_full_device_is_an_error() {
        assert!(write_file(Path::new("/dev/full"), &[0; 100_000]).is_err());
        assert!(write_file(Path::new("/dev/null"), b"x").is_ok());
    }
}

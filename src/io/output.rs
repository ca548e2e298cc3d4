//! Outputs that are never left half written.

use crate::{Error, Result};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::{NamedTempFile, TempPath};

/// Where bytes are written: a file, or a stream such as standard output.
///
/// A file is written as a temporary file in the same folder, which [`Output::finish`] renames to its path. An output
/// that is dropped before that leaves nothing behind.
///
/// A name that ends in `.gz` or `.zst` gets what it says.
///
/// A path that exists and is no regular file (a pipe, `/dev/null`), or that names an open file of the process
/// (`/dev/stdout`), is written directly. A symbolic link stays; the file it points to is written.
pub struct Output {
    /// The name that messages use.
    name: String,
    target: Target,
}

enum Target {
    Temporary {
        file: Packer,
        /// The path of the finished file, links resolved.
        path: PathBuf,
        _unfinished: UnfinishedFile,
    },
    Stream(Box<dyn Write + Send>),
}

/// Packs what is written as the name of the file says: `.gz`, `.zst`.
enum Packer {
    Plain(BufWriter<NamedTempFile>),
    Gzip(Box<GzEncoder<BufWriter<NamedTempFile>>>),
    Zstd(Box<zstd::Encoder<'static, BufWriter<NamedTempFile>>>),
}

impl Packer {
    fn new(file: NamedTempFile, path: &Path) -> io::Result<Packer> {
        let file = BufWriter::with_capacity(1 << 16, file);
        let ends_in = |end: &str| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case(end))
        };
        Ok(match () {
            _ if ends_in("gz") => {
                Packer::Gzip(Box::new(GzEncoder::new(file, Compression::default())))
            }
            _ if ends_in("zst") => Packer::Zstd(Box::new(zstd::Encoder::new(file, 0)?)),
            _ => Packer::Plain(file),
        })
    }

    fn into_file(self) -> io::Result<NamedTempFile> {
        let file = match self {
            Packer::Plain(file) => file,
            Packer::Gzip(packed) => packed.finish()?,
            Packer::Zstd(packed) => packed.finish()?,
        };
        file.into_inner().map_err(|e| e.into_error())
    }
}

impl Write for Packer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Packer::Plain(file) => file.write(bytes),
            Packer::Gzip(packed) => packed.write(bytes),
            Packer::Zstd(packed) => packed.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Packer::Plain(file) => file.flush(),
            Packer::Gzip(packed) => packed.flush(),
            Packer::Zstd(packed) => packed.flush(),
        }
    }
}

/// The longest chain of links that is followed.
const MOST_LINKS: usize = 40;

/// The temporary files that exist now.
static UNFINISHED_FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// An entry of [`UNFINISHED_FILES`] for as long as the file is being written.
struct UnfinishedFile(PathBuf);

impl UnfinishedFile {
    /// Makes a temporary file. Both are one step: no signal comes between that would leave the file.
    fn make(
        make: impl FnOnce() -> io::Result<NamedTempFile>,
    ) -> io::Result<(NamedTempFile, UnfinishedFile)> {
        let mut all = UNFINISHED_FILES
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let file = make()?;
        all.push(file.path().to_path_buf());
        let path = file.path().to_path_buf();
        Ok((file, UnfinishedFile(path)))
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

/// Removes the temporary files of outputs that are not finished, and lets no more be made. For use before a signal ends the process.
pub fn remove_unfinished_files() {
    let all = UNFINISHED_FILES
        .lock()
        .unwrap_or_else(PoisonError::into_inner);
    for path in &*all {
        // A file that was finished just now is gone already.
        let _ = fs::remove_file(path);
    }
    std::mem::forget(all);
}

impl Output {
    /// Starts writing the file that will be at `path`.
    ///
    /// # Errors
    /// [`Error::Io`]: the folder does not exist or cannot be written to.
    pub fn file(path: impl AsRef<Path>) -> Result<Output> {
        let path = path.as_ref();
        let fail = |e| Error::io(path, e);
        let name = path.display().to_string();
        let (resolved, descriptor) = resolved(path).map_err(fail)?;
        let is_file = fs::metadata(&resolved).map_or(true, |m| m.is_file());
        if descriptor.is_some() || !is_file {
            // Appending keeps what other processes have written to the same open file.
            let file = fs::OpenOptions::new().append(true).open(path);
            return Ok(Output::stream(name, BufWriter::new(file.map_err(fail)?)));
        }
        let folder = match resolved.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let permissions = permissions(&resolved);
        let make = || {
            tempfile::Builder::new()
                .prefix(".posing-")
                .suffix(".tmp")
                .permissions(permissions)
                .tempfile_in(folder)
        };
        let (file, unfinished) = UnfinishedFile::make(make).map_err(fail)?;
        let target = Target::Temporary {
            _unfinished: unfinished,
            file: Packer::new(file, path).map_err(fail)?,
            path: resolved,
        };
        Ok(Output { name, target })
    }

    /// Writes to a stream that is already open; `name` is for messages. The caller buffers it.
    pub fn stream(name: impl Into<String>, stream: impl Write + Send + 'static) -> Output {
        Output {
            name: name.into(),
            target: Target::Stream(Box::new(stream)),
        }
    }

    fn writer(&mut self) -> &mut dyn Write {
        match &mut self.target {
            Target::Temporary { file, .. } => file,
            Target::Stream(stream) => stream,
        }
    }

    /// Writes all `bytes`.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let done = self.writer().write_all(bytes);
        done.map_err(|e| Error::io(&self.name, e))
    }

    /// Passes what is buffered on to the system.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn flush(&mut self) -> Result<()> {
        let done = self.writer().flush();
        done.map_err(|e| Error::io(&self.name, e))
    }

    /// Whether [`Output::rewrite_start`] is possible: what was written to a pipe is gone.
    pub fn can_rewrite(&self) -> bool {
        match &self.target {
            Target::Temporary { file, .. } => matches!(file, Packer::Plain(_)),
            Target::Stream(_) => false,
        }
    }

    /// Writes `bytes` over the first ones of a file. Nothing can be appended after that.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails, or the output is a stream.
    pub fn rewrite_start(&mut self, bytes: &[u8]) -> Result<()> {
        let done = match &mut self.target {
            Target::Temporary {
                file: Packer::Plain(file),
                ..
            } => file.rewind().and_then(|()| file.write_all(bytes)),
            _ => Err(io::ErrorKind::NotSeekable.into()),
        };
        done.map_err(|e| Error::io(&self.name, e))
    }

    /// Flushes; syncs and renames a file, which exists only from now on.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn finish(self) -> Result<()> {
        self.complete()?.publish()
    }

    /// Flushes, and syncs a file, which is not yet at its path: of several, none appears before all are complete.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn complete(mut self) -> Result<CompleteOutput> {
        self.flush()?;
        let name = self.name;
        let Target::Temporary {
            file,
            path,
            _unfinished: unfinished,
        } = self.target
        else {
            return Ok(CompleteOutput::default());
        };
        let fail = |e| Error::io(&name, e);
        let file = file.into_file().map_err(fail)?;
        file.as_file().sync_all().map_err(fail)?;
        let file = Some((file.into_temp_path(), path, unfinished));
        Ok(CompleteOutput { name, file })
    }
}

/// An output that is written whole. Dropped, it leaves nothing behind.
#[derive(Default)]
pub struct CompleteOutput {
    name: String,
    /// The temporary file and the path that it gets; `None` for streams.
    file: Option<(TempPath, PathBuf, UnfinishedFile)>,
}

impl CompleteOutput {
    /// Renames the file to its path.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn publish(self) -> Result<()> {
        let Some((file, path, _unfinished)) = self.file else {
            return Ok(());
        };
        file.persist(path)
            .map_err(|e| Error::io(&self.name, e.error))
    }
}

/// The path with links resolved, and the number of the open file of this process that it names, if it names one.
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
    Err(io::Error::other(
        "too many symbolic links, or a cycle of links",
    ))
}

/// The number of the open file of this process that a path leads to, links followed: 1 is standard output.
pub fn file_descriptor(path: &Path) -> Option<u32> {
    resolved(path).ok()?.1
}

/// The number of the open file of this process that the path itself names.
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

/// Writes a whole file at once: complete or not at all.
///
/// # Errors
/// [`Error::Io`], with the path.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let mut file = Output::file(path)?;
    file.write(bytes)?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_name_says_is_what_the_file_holds() {
        let dir = tempfile::tempdir().unwrap();
        for (name, start) in [
            ("a.csv.gz", &b"\x1f\x8b"[..]),
            ("a.csv.ZST", b"\x28\xb5\x2f\xfd"),
            ("a.csv", b"a.x"),
        ] {
            let path = dir.path().join(name);
            write_file(&path, b"a.x,a.y,a.z\n").unwrap();
            assert!(fs::read(&path).unwrap().starts_with(start), "{name}");
            let read = crate::io::Input::open(&path)
                .unwrap()
                .read_all(100)
                .unwrap();
            assert_eq!(read, b"a.x,a.y,a.z\n");
        }
    }

    #[test]
    fn a_file_exists_only_when_finished() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.csv");
        let mut file = Output::file(&path).unwrap();
        file.write(b"half").unwrap();
        drop(file);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        write_file(&path, b"whole").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        write_file(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(Output::file(dir.path().join("no/where")).is_err());
        let mut file = Output::file(&path).unwrap();
        file.write(b"count: ?, all").unwrap();
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

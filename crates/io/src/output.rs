//! Outputs that are never left half written.

pub use super::unfinished_file::{TemporaryFile, remove_unfinished_files};
use super::unfinished_file::{UnfinishedFile, WholeFile};
use crate::{Error, Result};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Complete files that are put at their paths together.
static WAITING: Mutex<Vec<CompleteOutput>> = Mutex::new(Vec::new());

/// Puts all files at their paths that are complete and wait for each other.
///
/// # Errors
/// [`Error::Io`]: that fails for one; those before it are at their paths.
#[doc(hidden)]
pub fn publish_waiting() -> Result<()> {
    let mut waiting = take_waiting().into_iter();
    waiting.try_for_each(CompleteOutput::move_to_path)
}

/// Drops the files that are complete and wait: nothing is left of them.
#[doc(hidden)]
pub fn drop_waiting() {
    drop(take_waiting());
}

fn take_waiting() -> Vec<CompleteOutput> {
    std::mem::take(&mut WAITING.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Where bytes are written: a file, or a stream such as standard output.
///
/// A file is at its path only when [`Output::finish`] puts it there. An output that is dropped
/// before that leaves nothing behind, nor does, where the system has files without names, a process
/// that is killed.
///
/// A name that ends in `.gz` or `.zst` gets what it says.
///
/// A path that exists and is no regular file (a pipe, `/dev/null`), or that names an open file of
/// the process (`/dev/stdout`), is written directly. A symbolic link stays; the file it points to
/// is written.
#[must_use = "without `finish` the file is not put at its path"]
pub struct Output {
    /// The name that messages use.
    name: String,
    target: Target,
    /// Whether the file waits for [`publish_waiting`] when it is complete.
    waits: bool,
}

/// What was written to memory.
#[derive(Clone, Default)]
pub(crate) struct Written(Arc<Mutex<Vec<u8>>>);

impl Written {
    fn bytes(&self) -> MutexGuard<'_, Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn into_bytes(self) -> Vec<u8> {
        std::mem::take(&mut self.bytes())
    }
}

impl Write for Written {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.bytes().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

enum Target {
    File(Packer),
    Stream(Box<dyn Write + Send>),
}

/// Packs what is written as the name of the file says: `.gz`, `.zst`.
enum Packer {
    Plain(BufWriter<UnfinishedFile>),
    Gzip(Box<Blocks<GzEncoder<BufWriter<UnfinishedFile>>>>),
    Zstd(Box<Blocks<zstd::Encoder<'static, BufWriter<UnfinishedFile>>>>),
}

impl Packer {
    fn new(file: UnfinishedFile, path: &Path) -> io::Result<Packer> {
        let file = BufWriter::with_capacity(BLOCK, file);
        let ends_in = |end: &str| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case(end))
        };
        Ok(if ends_in("gz") {
            let packer = GzEncoder::new(file, Compression::default());
            Packer::Gzip(Box::new(Blocks::new(packer)))
        } else if ends_in("zst") {
            Packer::Zstd(Box::new(Blocks::new(zstd::Encoder::new(file, 0)?)))
        } else {
            Packer::Plain(file)
        })
    }

    fn into_file(self) -> io::Result<UnfinishedFile> {
        let file = match self {
            Packer::Plain(file) => file,
            Packer::Gzip(packed) => packed.into_packer()?.finish()?,
            Packer::Zstd(packed) => packed.into_packer()?.finish()?,
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

/// Bytes that are written or packed at once.
const BLOCK: usize = 1 << 16;

/// Packs whole blocks: how bytes come, and when they are flushed, depends on threads, and packed
/// bytes depend on both.
struct Blocks<W> {
    waiting: Vec<u8>,
    packer: W,
}

impl<W: Write> Blocks<W> {
    fn new(packer: W) -> Self {
        Blocks {
            waiting: Vec::with_capacity(BLOCK),
            packer,
        }
    }

    fn into_packer(mut self) -> io::Result<W> {
        self.packer.write_all(&self.waiting)?;
        Ok(self.packer)
    }
}

impl<W: Write> Write for Blocks<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(BLOCK - self.waiting.len());
        self.waiting.extend_from_slice(&bytes[..taken]);
        if self.waiting.len() == BLOCK {
            self.packer.write_all(&self.waiting)?;
            self.waiting.clear();
        }
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The longest chain of links that is followed.
const MOST_LINKS: usize = 40;

impl Output {
    /// Starts writing the file that will be at `path`.
    ///
    /// # Errors
    /// [`Error::Io`]: the folder does not exist or cannot be written to.
    #[doc(hidden)]
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
        let file = UnfinishedFile::create(resolved).map_err(fail)?;
        let target = Target::File(Packer::new(file, path).map_err(fail)?);
        Ok(Output {
            name,
            target,
            waits: false,
        })
    }

    /// The output, whose file is put at its path by [`publish_waiting`], not as soon as it is
    /// complete: of several results, none appears before all are.
    #[doc(hidden)]
    pub fn waiting(self) -> Output {
        Output {
            waits: true,
            ..self
        }
    }

    /// Writes to a stream that is already open; `name` is for messages. The caller buffers it.
    #[doc(hidden)]
    pub fn stream(name: impl Into<String>, stream: impl Write + Send + 'static) -> Output {
        Output {
            name: name.into(),
            target: Target::Stream(Box::new(stream)),
            waits: false,
        }
    }

    /// Writes to memory; `name` is for messages.
    pub(crate) fn memory(name: &str) -> (Output, Written) {
        let written = Written::default();
        (Output::stream(name, written.clone()), written)
    }

    fn writer(&mut self) -> &mut dyn Write {
        match &mut self.target {
            Target::File(file) => file,
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
    pub(crate) fn flush(&mut self) -> Result<()> {
        let done = self.writer().flush();
        done.map_err(|e| Error::io(&self.name, e))
    }

    /// Whether [`Output::rewrite_start`] is possible: what was written to a pipe is gone.
    pub(crate) fn can_rewrite(&self) -> bool {
        match &self.target {
            Target::File(file) => matches!(file, Packer::Plain(_)),
            Target::Stream(_) => false,
        }
    }

    /// Writes `bytes` over the first ones of a file. Nothing can be appended after that.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails, or the output is a stream.
    pub(crate) fn rewrite_start(&mut self, bytes: &[u8]) -> Result<()> {
        let done = match &mut self.target {
            Target::File(Packer::Plain(file)) => file.rewind().and_then(|()| file.write_all(bytes)),
            _ => Err(io::ErrorKind::NotSeekable.into()),
        };
        done.map_err(|e| Error::io(&self.name, e))
    }

    /// Flushes; syncs a file and puts it at its path: it exists only from now on, or where it waits
    /// for others, from when they are complete.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn finish(self) -> Result<()> {
        self.complete()?.publish()
    }

    /// Flushes, and syncs a file, which is not yet at its path: of several, none appears before all
    /// are complete.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub(crate) fn complete(mut self) -> Result<CompleteOutput> {
        self.flush()?;
        let (name, waits) = (self.name, self.waits);
        let Target::File(file) = self.target else {
            return Ok(CompleteOutput::default());
        };
        let whole = file.into_file().and_then(UnfinishedFile::complete);
        let file = Some(whole.map_err(|e| Error::io(&name, e))?);
        Ok(CompleteOutput { name, file, waits })
    }
}

/// An output that is written whole. Dropped, it leaves nothing behind.
#[derive(Default)]
pub struct CompleteOutput {
    name: String,
    /// `None` for streams.
    file: Option<WholeFile>,
    waits: bool,
}

impl CompleteOutput {
    /// Puts the file at its path, or lets it wait for the other results of a command.
    ///
    /// # Errors
    /// [`Error::Io`], with the name of the output.
    pub fn publish(self) -> Result<()> {
        if self.waits {
            let mut waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
            waiting.push(self);
            return Ok(());
        }
        self.move_to_path()
    }

    fn move_to_path(self) -> Result<()> {
        let Some(file) = self.file else {
            return Ok(());
        };
        file.publish().map_err(|e| Error::io(&self.name, e))
    }
}

/// The path with links resolved, and the number of the open file of this process that it names, if
/// it names one.
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

/// Where a path leads, links followed also where nothing is there yet.
///
/// # Errors
/// The links are too many, or a cycle.
pub fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    resolved(path).map(|(path, _)| path)
}

/// The number of the open file of this process that a path leads to, links followed: 1 is standard
/// output.
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
            let read = crate::Input::open(&path).unwrap().read_all(100).unwrap();
            assert_eq!(read, b"a.x,a.y,a.z\n");
        }
    }

    #[test]
    fn packed_bytes_are_the_same_however_they_come() {
        let dir = tempfile::tempdir().unwrap();
        let text: Vec<u8> = (0..90_000_u32)
            .flat_map(|i| format!("{i},").into_bytes())
            .collect();
        for name in ["a.csv.gz", "a.csv.zst"] {
            let path = dir.path().join(name);
            write_file(&path, &text).unwrap();
            let whole = fs::read(&path).unwrap();
            let mut file = Output::file(&path).unwrap();
            for part in text.chunks(777) {
                file.write(part).unwrap();
                file.flush().unwrap();
            }
            file.finish().unwrap();
            assert!(fs::read(&path).unwrap() == whole, "{name}");
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

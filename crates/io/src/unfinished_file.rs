//! A file that is being written. Where the system allows it, the file has no name before it is
//! whole, so that nothing is left of it however the process ends; else it has a temporary name in
//! the same folder, and [`remove_unfinished_files`] removes it.

use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
#[cfg(target_os = "linux")]
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::{Builder, NamedTempFile, TempPath};

/// Files without a name stay open until they are whole: with a larger number, a file gets a name.
#[cfg(target_os = "linux")]
const MOST_OPEN: i32 = 64;

/// The temporary files that exist now.
static UNFINISHED_FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the temporary files that are not finished, and lets no more be made. For use before a
/// signal ends the process.
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

/// A temporary name, as long as it is one.
struct TemporaryName(PathBuf);

impl TemporaryName {
    /// Makes a temporary file. Both are one step: no signal comes between that would leave the
    /// file.
    fn make<F>(
        make: impl FnOnce() -> io::Result<NamedTempFile<F>>,
    ) -> io::Result<(NamedTempFile<F>, TemporaryName)> {
        let mut all = UNFINISHED_FILES
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let file = make()?;
        let path = file.path().to_path_buf();
        all.push(path.clone());
        Ok((file, TemporaryName(path)))
    }
}

impl Drop for TemporaryName {
    fn drop(&mut self) {
        let mut all = UNFINISHED_FILES
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        all.retain(|path| *path != self.0);
    }
}

/// A file for another program, in the system's folder for such files. It goes when it is dropped,
/// or a signal ends the process.
pub struct TemporaryFile {
    file: NamedTempFile,
    _name: TemporaryName,
}

impl TemporaryFile {
    /// A file that nobody else can read (mode 600), with `bytes` in it; its name ends in `suffix`.
    ///
    /// # Errors
    /// The file cannot be made or written.
    pub fn new(suffix: &str, bytes: &[u8]) -> io::Result<TemporaryFile> {
        let mut builder = Builder::new();
        let builder = builder.prefix("posing-").suffix(suffix);
        let (mut file, _name) = TemporaryName::make(|| builder.tempfile())?;
        file.write_all(bytes)?;
        Ok(TemporaryFile { file, _name })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}

/// The file that will be at a path. Dropped, it leaves nothing behind.
pub(crate) struct UnfinishedFile {
    file: Unfinished,
    path: PathBuf,
}

// Dropped in this order: a name is one until its file is removed.
enum Unfinished {
    #[cfg(target_os = "linux")]
    Nameless(File),
    Named(NamedTempFile, TemporaryName),
}

/// A file that is written whole, and not yet at its path. Dropped, it leaves nothing behind.
pub(crate) struct WholeFile {
    file: Whole,
    path: PathBuf,
}

enum Whole {
    #[cfg(target_os = "linux")]
    Nameless(File),
    Named(TempPath, TemporaryName),
}

impl UnfinishedFile {
    /// Starts a file in the folder of `path`, with the mode that the file there has, or that a new
    /// one gets.
    pub(crate) fn create(path: PathBuf) -> io::Result<UnfinishedFile> {
        let old = fs::metadata(&path).ok();
        let mut file = UnfinishedFile::start(path)?;
        if let Some(old) = old {
            // The umask is for new files. Some file systems have no modes.
            let _ = file.file().set_permissions(old.permissions());
        }
        Ok(file)
    }

    fn start(path: PathBuf) -> io::Result<UnfinishedFile> {
        #[cfg(target_os = "linux")]
        if let Some(file) = nameless(&path) {
            let file = Unfinished::Nameless(file);
            return Ok(UnfinishedFile { file, path });
        }
        let (file, name) = named(&path)?;
        let file = Unfinished::Named(file, name);
        Ok(UnfinishedFile { file, path })
    }

    fn file(&mut self) -> &mut File {
        match &mut self.file {
            #[cfg(target_os = "linux")]
            Unfinished::Nameless(file) => file,
            Unfinished::Named(file, _) => file.as_file_mut(),
        }
    }

    /// Waits until all that was written is on the disk. A file that has a name is closed.
    pub(crate) fn complete(mut self) -> io::Result<WholeFile> {
        self.file().sync_all()?;
        let file = match self.file {
            #[cfg(target_os = "linux")]
            Unfinished::Nameless(file) => Whole::Nameless(file),
            Unfinished::Named(file, name) => Whole::Named(file.into_temp_path(), name),
        };
        let path = self.path;
        Ok(WholeFile { file, path })
    }
}

impl Write for UnfinishedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

impl Seek for UnfinishedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file().seek(to)
    }
}

impl WholeFile {
    /// Puts the file at its path, in place of what is there.
    pub(crate) fn publish(self) -> io::Result<()> {
        let path = self.path;
        match self.file {
            #[cfg(target_os = "linux")]
            Whole::Nameless(file) => match link(&file, &path) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => replace(&file, &path),
                Err(_) => copy(file, &path),
                Ok(()) => Ok(()),
            },
            Whole::Named(file, _name) => Ok(file.persist(path)?),
        }
    }
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn builder() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(".posing-").suffix(".tmp");
    builder
}

/// A file with a temporary name in the folder of `path`.
fn named(path: &Path) -> io::Result<(NamedTempFile, TemporaryName)> {
    let mut builder = builder();
    set_mode(&mut builder, path);
    TemporaryName::make(|| builder.tempfile_in(folder(path)))
}

/// A file without a name in the folder of `path`; `None` where there is no such thing, or it could
/// get no name later.
#[cfg(target_os = "linux")]
fn nameless(path: &Path) -> Option<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let mut options = fs::OpenOptions::new();
    let options = options.read(true).write(true).mode(mode(path));
    let flag = rustix::fs::OFlags::TMPFILE.bits();
    let file = options.custom_flags(flag as i32).open(folder(path)).ok()?;
    let can_be_named = file.as_raw_fd() < MOST_OPEN && fs::read_link(open_path(&file)).is_ok();
    can_be_named.then_some(file)
}

/// The path by which the system gives a name to an open file.
#[cfg(target_os = "linux")]
fn open_path(file: &File) -> String {
    format!("/proc/self/fd/{}", file.as_raw_fd())
}

/// Gives a name to a file without one; fails where something has it.
#[cfg(target_os = "linux")]
fn link(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    let flags = AtFlags::SYMLINK_FOLLOW;
    Ok(linkat(CWD, open_path(file), CWD, path, flags)?)
}

/// Puts a file without a name in place of what is at `path`: by way of another name, as no link
/// replaces a file.
#[cfg(target_os = "linux")]
fn replace(file: &File, path: &Path) -> io::Result<()> {
    let make = || builder().make_in(folder(path), |name| link(file, name));
    let (linked, _name) = TemporaryName::make(make)?;
    Ok(linked.persist(path).map(|_| ())?)
}

/// Copies a file without a name to `path`: where the folder has no links.
#[cfg(target_os = "linux")]
fn copy(mut file: File, path: &Path) -> io::Result<()> {
    let (mut copy, _name) = named(path)?;
    let _ = copy
        .as_file()
        .set_permissions(file.metadata()?.permissions());
    file.rewind()?;
    io::copy(&mut file, &mut copy)?;
    copy.as_file().sync_all()?;
    Ok(copy.persist(path).map(|_| ())?)
}

/// The mode the file has now, or what the umask leaves of 0666 (a temporary file would be 0600).
#[cfg(unix)]
fn mode(path: &Path) -> u32 {
    use std::os::unix::fs::PermissionsExt;
    fs::metadata(path).map_or(0o666, |m| m.permissions().mode())
}

/// Lets the builder make files with the mode of the file at `path`.
#[cfg(unix)]
fn set_mode(builder: &mut Builder, path: &Path) {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(fs::Permissions::from_mode(mode(path)));
}

/// Files have no modes here.
#[cfg(not(unix))]
fn set_mode(_: &mut Builder, _: &Path) {}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(path: &Path, bytes: &[u8]) -> UnfinishedFile {
        let mut file = UnfinishedFile::create(path.to_path_buf()).unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let names = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_file_has_no_name_before_it_is_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        if nameless(&path).is_none() {
            return; // This file system has no files without names.
        }
        for text in [&b"first"[..], b"second"] {
            let whole = written(&path, text).complete().unwrap();
            let before = fs::read(&path).unwrap_or_default();
            assert_ne!(before, text);
            assert!(names(dir.path()).iter().all(|name| name == "a"));
            whole.publish().unwrap();
            assert_eq!(fs::read(&path).unwrap(), text);
            assert_eq!(names(dir.path()), ["a"]);
        }
        // Where links are refused.
        let Unfinished::Nameless(file) = written(&path, b"third").file else {
            panic!("it has a name");
        };
        copy(file, &path).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"third");
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn many_files_at_a_time_appear_together() {
        let dir = tempfile::tempdir().unwrap();
        let path = |i: usize| dir.path().join(format!("{i:03}"));
        let whole = |i: usize| written(&path(i), &[i as u8]).complete().unwrap();
        let all: Vec<WholeFile> = (0..200).map(whole).collect();
        assert!((0..200).all(|i| !path(i).exists()));
        all.into_iter().for_each(|file| file.publish().unwrap());
        assert!((0..200).all(|i| fs::read(path(i)).unwrap() == [i as u8]));
        assert_eq!(names(dir.path()).len(), 200);
        drop(written(&path(300), b"half"));
        assert_eq!(names(dir.path()).len(), 200);
    }

    #[cfg(unix)]
    #[test]
    fn the_mode_of_a_file_stays() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        fs::write(&path, b"").unwrap();
        // The usual umask (022) would take a bit of the last two.
        for kept in [0o600, 0o664, 0o666] {
            fs::set_permissions(&path, fs::Permissions::from_mode(kept)).unwrap();
            let whole = written(&path, b"new").complete().unwrap();
            whole.publish().unwrap();
            assert_eq!(mode(&path) & 0o777, kept);
            assert_eq!(fs::read(&path).unwrap(), b"new");
        }
    }
}

//! Whether standard output was closed when the program was started, as by `>&-`.
//!
//! Rust's runtime opens `/dev/null` in its place before `main`, where results would vanish. A file
//! opened there cannot be told from one that a parent opened so (Python's `subprocess.DEVNULL` is
//! `/dev/null` for reading and writing too): so it is looked at before.

use crate::{Error, Place, Result};
use std::io::{Stdout, stdout};
#[cfg(target_os = "linux")]
use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(target_os = "linux")]
static WAS_CLOSED: AtomicBool = AtomicBool::new(false);

// SAFETY: the loader calls the functions that this section lists, once each, before `main`; this
// one needs nothing of the runtime.
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = {
    extern "C" fn look() {
        // Where there is no /proc nothing is told.
        let is_missing = |path: &str| std::fs::symlink_metadata(path).is_err();
        let is_closed = is_missing("/proc/self/fd/1") && !is_missing("/proc/self/fd");
        WAS_CLOSED.store(is_closed, Ordering::Relaxed);
    }
    look
};

/// Whether it was closed.
#[cfg(target_os = "linux")]
fn was_closed() -> bool {
    WAS_CLOSED.load(Ordering::Relaxed)
}

/// Not known on other systems.
#[cfg(not(target_os = "linux"))]
fn was_closed() -> bool {
    false
}

/// Standard output.
///
/// # Errors
/// [`Error::Data`]: it was closed when the program was started.
pub(crate) fn open_stdout() -> Result<Stdout> {
    if !was_closed() {
        return Ok(stdout());
    }
    let what = "closed when the command was started; send it to a file or a pipe";
    Err(Error::data(Place::file("standard output"), what))
}

/// Closes it again in a program that takes the place of this one, which then sees it as this one
/// did.
#[cfg(target_os = "linux")]
pub(crate) fn pass_on() {
    if was_closed() {
        let _ = rustix::io::fcntl_setfd(stdout(), rustix::io::FdFlags::CLOEXEC);
    }
}

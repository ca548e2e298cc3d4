//! What happens when a signal ends the process, or ctrl-C on Windows.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

use crate::io::output::remove_unfinished_files;
use std::sync::{Mutex, PoisonError};
#[cfg(unix)]
pub(crate) use unix::watch;
#[cfg(windows)]
pub(crate) use windows::watch;

type Stop = Box<dyn FnOnce() + Send>;

/// The stack of the thread that handles signals, bytes.
const STACK: usize = 256 << 10;

/// What the next signal calls instead of ending the process.
static STOP: Mutex<Option<Stop>> = Mutex::new(None);

/// Lets the next signal that ends a process call `stop`, after which the process ends by itself.
/// One more ends it as `watch` does.
pub fn on_stop(stop: impl FnOnce() + Send + 'static) {
    *STOP.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(stop));
    watch();
}

/// Handles a signal: calls what `on_stop` was given, else removes unfinished files and lets `end`
/// end the process.
fn handle_one(end: impl FnOnce()) {
    let stop = STOP.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some(stop) = stop {
        return stop();
    }
    remove_unfinished_files();
    end();
}

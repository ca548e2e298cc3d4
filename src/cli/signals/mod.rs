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

/// Lets this process end with the one that started it, as by SIGTERM, where the variable
/// `POSING_PARENT` has the number of that one or of one before it: however a wrapper ends, its
/// child does too. On Linux only.
#[cfg(target_os = "linux")]
pub(crate) fn end_with_parent() {
    use rustix::process::{Pid, Signal, set_parent_process_death_signal, test_kill_process};
    let number = std::env::var("POSING_PARENT").unwrap_or_default();
    let Some(parent) = number.parse().ok().and_then(Pid::from_raw) else {
        return;
    };
    let _ = set_parent_process_death_signal(Some(Signal::TERM));
    if test_kill_process(parent).is_err() || is_zombie(&number) {
        std::process::exit(1); // it ended before the signal was set
    }
}

/// Whether a process has ended, and waits for its parent to ask how.
#[cfg(target_os = "linux")]
fn is_zombie(number: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
    // The name of the program, in parentheses, may hold any character.
    let state = stat.rsplit_once(") ").map(|(_, rest)| rest);
    state.is_some_and(|rest| rest.starts_with(['Z', 'X']))
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

//! What happens when a signal ends the process.

use crate::io::output::remove_unfinished_files;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;
use std::sync::{Mutex, Once, PoisonError};

type Stop = Box<dyn FnOnce() + Send>;

/// What the next signal calls instead of ending the process.
static STOP: Mutex<Option<Stop>> = Mutex::new(None);

/// Handles SIGHUP, SIGINT and SIGTERM from now on: unfinished files are removed, then the process ends as by default.
pub fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        let heeded = [SIGHUP, SIGINT, SIGTERM]
            .into_iter()
            .filter(|s| !is_ignored(*s));
        let Ok(mut signals) = Signals::new(heeded) else {
            return;
        };
        std::thread::spawn(move || {
            for signal in signals.forever() {
                let stop = STOP.lock().unwrap_or_else(PoisonError::into_inner).take();
                if let Some(stop) = stop {
                    stop();
                    continue;
                }
                remove_unfinished_files();
                let _ = emulate_default_handler(signal);
            }
        });
    });
}

/// Lets the next SIGHUP, SIGINT or SIGTERM call `stop`, after which the process ends by itself. One more ends it as [`watch`] does.
pub fn on_stop(stop: impl FnOnce() + Send + 'static) {
    *STOP.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(stop));
    watch();
}

/// Whether the process was started with the signal ignored, as shells do for background jobs. Known on Linux only.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok());
    ignored.is_some_and(|bits| bits >> (signal - 1) & 1 == 1)
}

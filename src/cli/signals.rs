//! Removal of unfinished output files when a signal ends the process.

use crate::io::output::remove_unfinished_files;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;
use std::sync::Once;

/// Handles SIGINT and SIGTERM from now on: unfinished files are removed, then the process ends as by default.
pub fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        let heeded = [SIGINT, SIGTERM].into_iter().filter(|s| !is_ignored(*s));
        let Ok(mut signals) = Signals::new(heeded) else {
            return;
        };
        std::thread::spawn(move || {
            if let Some(signal) = signals.forever().next() {
                remove_unfinished_files();
                let _ = emulate_default_handler(signal);
            }
        });
    });
}

/// Whether the process was started with the signal ignored, as shells do for background jobs. Known on Linux only.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok());
    ignored.is_some_and(|bits| bits >> (signal - 1) & 1 == 1)
}

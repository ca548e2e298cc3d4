//! Signals that end a process.

use super::{STACK, handle_one};
use signal_hook::consts::{
    SIGABRT, SIGALRM, SIGHUP, SIGINT, SIGPROF, SIGQUIT, SIGSYS, SIGTERM, SIGTRAP, SIGUSR1, SIGUSR2,
    SIGVTALRM, SIGXCPU, SIGXFSZ,
};
use signal_hook::flag;
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Once, mpsc};

/// The signals that end a process and are handled.
const ENDING: [i32; 12] = [
    SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGALRM, SIGUSR1, SIGUSR2, SIGVTALRM, SIGPROF, SIGXCPU,
    SIGTRAP, SIGSYS,
];

/// Handles the signals that end a process from now on: unfinished files are removed, then the
/// process ends as by default. A file that grows over its limit (SIGXFSZ) is an error of writing.
/// Memory that cannot be had, after which Rust aborts, is exit 1.
pub(crate) fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        if !is_ignored(SIGXFSZ) {
            let _ = flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
        }
        let _ = flag::register_conditional_shutdown(SIGABRT, 1, Arc::new(AtomicBool::new(true)));
        let (signals, handed_over) = mpsc::channel::<Signals>();
        let handle = move || {
            if let Ok(signals) = handed_over.recv() {
                handle_all(signals);
            }
        };
        let thread = std::thread::Builder::new().stack_size(STACK);
        if thread.spawn(handle).is_err() {
            // Without a thread that handles them, signals do what they do by default.
            return;
        }
        if let Ok(heeded) = Signals::new(ENDING.into_iter().filter(|s| !is_ignored(*s))) {
            let _ = signals.send(heeded);
        }
    });
}

fn handle_all(mut signals: Signals) {
    for signal in signals.forever() {
        handle_one(|| {
            let _ = emulate_default_handler(signal);
        });
    }
}

/// Whether the process was started with the signal ignored, as shells do for background jobs. Known
/// on Linux only.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok());
    ignored.is_some_and(|bits| bits >> (signal - 1) & 1 == 1)
}

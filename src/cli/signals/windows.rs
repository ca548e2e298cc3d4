//! Ctrl-C in a console.

use super::{STACK, handle_one};
use std::process::exit;
use std::sync::Once;
use std::thread;
use tokio::runtime;
use tokio::signal::windows::{CtrlC, ctrl_c};

/// The exit code of a process that ctrl-C ends by default: STATUS_CONTROL_C_EXIT.
const ENDED: u32 = 0xc000_013a;

/// Handles ctrl-C from now on: unfinished files are removed, then the process ends as by default.
pub(crate) fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        // Where this fails, ctrl-C does what it does by default.
        if let Ok(presses) = ctrl_c() {
            let thread = thread::Builder::new().stack_size(STACK);
            let _ = thread.spawn(move || handle_all(presses));
        }
    });
}

fn handle_all(mut presses: CtrlC) {
    let Ok(runtime) = runtime::Builder::new_current_thread().build() else {
        return;
    };
    while runtime.block_on(presses.recv()).is_some() {
        handle_one(|| exit(ENDED as i32));
    }
}

//! Messages on standard error: one line each, after the command's name.

use std::io::Write;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

static NAME: OnceLock<String> = OnceLock::new();
/// 0 quiet, 1 as usual, 2 verbose.
static LEVEL: AtomicU8 = AtomicU8::new(1);

/// Sets the name that begins every line.
pub fn set_name(name: &str) {
    let _ = NAME.set(name.to_string());
}

/// `-q` and `-v`.
pub fn set_verbosity(quiet: bool, verbose: bool) {
    LEVEL.store(
        if quiet {
            0
        } else if verbose {
            2
        } else {
            1
        },
        Ordering::Relaxed,
    );
}

/// Whether `-q` was given.
pub fn is_quiet() -> bool {
    LEVEL.load(Ordering::Relaxed) == 0
}

/// Replaces control characters, which text from files may contain: a message is one line without terminal escapes.
fn visible(text: &str) -> String {
    text.replace(char::is_control, "\u{fffd}")
}

fn line(text: &str) {
    let name = NAME.get().map_or("posing", String::as_str);
    // A failure to write to standard error cannot be reported.
    let _ = writeln!(std::io::stderr(), "{name}: {}", visible(text));
}

/// Prints why the command failed, at every verbosity.
pub fn error(text: &str) {
    line(text);
}

/// Prints a message about a run that goes on, unless `-q` is given.
pub fn info(text: &str) {
    if LEVEL.load(Ordering::Relaxed) >= 1 {
        line(text);
    }
}

/// Prints a message if `-v` is given.
pub fn debug(text: &str) {
    if LEVEL.load(Ordering::Relaxed) >= 2 {
        line(text);
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn what_a_file_says_is_one_line_and_no_escape() {
        let said = super::visible("take \"a\nb\u{1b}[2J\": é");
        assert_eq!(said, "take \"a\u{fffd}b\u{fffd}[2J\": é");
    }
}

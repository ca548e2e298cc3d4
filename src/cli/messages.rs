//! Words to the user, on standard error, one line each, with the command's name before them.

use std::io::Write;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

static NAME: OnceLock<String> = OnceLock::new();
/// 0 quiet, 1 as usual, 2 verbose.
static LEVEL: AtomicU8 = AtomicU8::new(1);

/// The name that stands before every line.
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

/// Text from files may hold line ends and escapes: they are not for a terminal, and a message is one line.
fn visible(text: &str) -> String {
    text.replace(char::is_control, "\u{fffd}")
}

fn line(text: &str) {
    let name = NAME.get().map_or("posing", String::as_str);
    // Nowhere is left to tell that telling failed.
    let _ = writeln!(std::io::stderr(), "{name}: {}", visible(text));
}

/// Why the command failed: always said.
pub fn error(text: &str) {
    line(text);
}

/// What the user should know of a run that goes on; silenced by `-q`.
pub fn info(text: &str) {
    if LEVEL.load(Ordering::Relaxed) >= 1 {
        line(text);
    }
}

/// What only `-v` shows.
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

//! Messages on standard error: one line each, after the command's name.

use crate::error::OptionNames;
use crate::error::is_hidden;
use std::io::Write;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

static NAME: OnceLock<String> = OnceLock::new();
static OPTION_NAMES: OnceLock<OptionNames> = OnceLock::new();
/// 0 quiet, 1 as usual, 2 verbose.
static LEVEL: AtomicU8 = AtomicU8::new(1);
/// The lines that a report repeats, once they are kept.
static KEPT: Mutex<Option<Vec<String>>> = Mutex::new(None);

/// Sets the name that begins every line.
pub(crate) fn set_name(name: &str) {
    let _ = NAME.set(name.to_string());
}

/// Sets what options are called in lines.
pub(crate) fn set_option_names(names: OptionNames) {
    let _ = OPTION_NAMES.set(names);
}

/// What options are called: as flags, in a command.
pub fn option_names() -> OptionNames {
    OPTION_NAMES.get().copied().unwrap_or_default()
}

/// `-q` and `-v`.
pub(crate) fn set_verbosity(quiet: bool, verbose: bool) {
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

/// The name that begins every line.
pub(crate) fn name() -> String {
    NAME.get().map_or_else(|| "posing".into(), String::clone)
}

/// Keeps the lines that follow, also those that are not printed.
pub(crate) fn keep() {
    kept_lines().get_or_insert_default();
}

/// The lines that were kept.
pub(crate) fn kept() -> Vec<String> {
    kept_lines().clone().unwrap_or_default()
}

fn kept_lines() -> MutexGuard<'static, Option<Vec<String>>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whether `-q` was given.
pub fn is_quiet() -> bool {
    LEVEL.load(Ordering::Relaxed) == 0
}

/// The longest row of digits in a message, and the longest word of it.
const MOST_DIGITS: usize = 24;
const MOST_LETTERS: usize = 240;

/// Replaces control characters and marks of direction, which text from files may contain: a message
/// is one line without terminal escapes, and reads as it was written. Numbers and words from files
/// that are longer than anyone reads are cut.
fn visible(text: &str) -> String {
    let text = text.replace(is_hidden, "\u{fffd}");
    let text = cut_runs(&text, |c| c.is_ascii_digit(), MOST_DIGITS);
    cut_runs(&text, |c| !c.is_whitespace(), MOST_LETTERS)
}

/// The text with each run of such characters that is longer than `most` cut to a third of that.
fn cut_runs(text: &str, is_part: impl Fn(char) -> bool, most: usize) -> String {
    let mut out = String::new();
    let mut rest = text;
    while !rest.is_empty() {
        let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        let (run, after) = rest.split_at(end);
        if run.chars().count() > most {
            out.extend(run.chars().take(most / 3));
            out.push('…');
        } else {
            out.push_str(run)
        }
        let between = after.find(&is_part).unwrap_or(after.len());
        out.push_str(&after[..between]);
        rest = &after[between..];
    }
    out
}

/// Keeps a line and, where it `is_printed`, prints it.
fn line(text: &str, is_printed: bool) {
    let text = visible(&option_names().in_text(text));
    if is_printed {
        // A failure to write to standard error cannot be reported.
        let _ = writeln!(std::io::stderr(), "{}: {text}", name());
    }
    if let Some(kept) = kept_lines().as_mut() {
        kept.push(text);
    }
}

/// Prints why the command failed, at every verbosity.
pub fn error(text: &str) {
    line(text, true);
}

/// Prints a message about a run that goes on, unless `-q` is given.
pub fn info(text: &str) {
    line(text, !is_quiet());
}

/// Prints a message if `-v` is given.
pub fn debug(text: &str) {
    if LEVEL.load(Ordering::Relaxed) >= 2 {
        line(text, true);
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn what_a_file_says_is_one_line_and_no_escape() {
        let said = super::visible("take \"a\nb\u{1b}[2J\": é");
        assert_eq!(said, "take \"a\u{fffd}b\u{fffd}[2J\": é");
        // Marks that turn the direction of writing; letters of such a direction stay.
        let turned = super::visible("a\u{202e}vsc.exe\u{2066} \u{5e9}\u{2028}");
        assert_eq!(turned, "a\u{fffd}vsc.exe\u{fffd} \u{5e9}\u{fffd}");
    }

    #[test]
    fn what_nobody_reads_is_cut() {
        let said = super::visible(&format!("{:e} is {}, {}!", 1e300, 1e300, "né".repeat(3000)));
        assert!(said.starts_with("1e300 is 10000000…, né"), "{said}");
        assert!(said.chars().count() < 120 && said.ends_with('…'), "{said}");
    }
}

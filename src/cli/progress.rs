//! A progress bar on standard error, on a terminal only, never with `-q`.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;

/// A bar that may be invisible.
pub struct Progress(ProgressBar);

impl Progress {
    /// The steps of a bar that shows a share.
    pub const SHARES: u64 = 1000;

    /// A bar of `steps` steps with the label `what`.
    pub fn new(what: &str, steps: u64) -> Progress {
        if super::messages::is_quiet() || !std::io::stderr().is_terminal() {
            return Progress(ProgressBar::hidden());
        }
        let style = ProgressStyle::with_template("{msg} [{bar:32}] {pos}/{len}  {elapsed} + {eta}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(steps).with_style(style.progress_chars("━╸ "));
        bar.set_message(what.to_string());
        Progress(bar)
    }
    /// Sets the number of finished steps.
    pub fn set(&self, done: u64) {
        self.0.set_position(done);
    }
    /// Sets the number of finished steps, and of all.
    pub fn set_of(&self, done: u64, all: u64) {
        self.0.set_length(all);
        self.0.set_position(done);
    }
    /// Changes the label, and sets how much is done, 0 to 1, of a bar of [`Progress::SHARES`].
    pub fn set_share(&self, what: &str, share: f64) {
        self.set_message(what.to_string());
        self.set((Progress::SHARES as f64 * share) as u64);
        super::messages::debug(what);
    }
    /// Changes the label.
    pub fn set_message(&self, what: String) {
        self.0.set_message(what);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

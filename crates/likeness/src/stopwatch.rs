//! Seconds of the steps of a training.

use std::time::Instant;

/// Seconds of one step after another.
pub(super) struct Stopwatch {
    last: Instant,
    /// Each step's name and seconds.
    pub laps: Vec<(&'static str, f64)>,
}

impl Default for Stopwatch {
    fn default() -> Self {
        Stopwatch {
            last: Instant::now(),
            laps: Vec::new(),
        }
    }
}

impl Stopwatch {
    /// Ends a step.
    pub(crate) fn lap(&mut self, name: &'static str) {
        self.laps.push((name, self.last.elapsed().as_secs_f64()));
        self.last = Instant::now();
    }
}

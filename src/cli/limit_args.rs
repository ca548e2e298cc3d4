//! The limits of `audit` as flags.

use crate::audit::Limits;
use clap::Args;

/// What is still as it should be.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Limits")]
pub struct LimitArgs {
    /// Longest gap, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5)]
    max_gap: f64,
    /// Largest share of a point's frames that are missing, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.1)]
    max_missing: f64,
    /// Largest speed of a point, in meters per second (99% of its steps)
    #[arg(long, value_name = "M/S", default_value_t = 15.0)]
    max_speed: f64,
    /// Farthest jump of a point off its path, in centimeters
    #[arg(long, value_name = "CM", default_value_t = 3.0)]
    max_jump: f64,
    /// Largest drift of a distance between points that go together, in centimeters
    #[arg(long, value_name = "CM", default_value_t = 2.0)]
    max_drift: f64,
}

impl LimitArgs {
    /// The limits of the library.
    pub fn limits(&self) -> Limits {
        Limits {
            gap: self.max_gap,
            missing: self.max_missing,
            speed: 100.0 * self.max_speed,
            jump: self.max_jump,
            drift: self.max_drift,
            ..Limits::default()
        }
    }
}

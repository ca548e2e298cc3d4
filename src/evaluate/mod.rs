//! Damage to clean poses, scores of restored ones, figures, and the benchmark that compares models.

pub mod alignment;
pub mod benchmark;
pub mod corruption;
pub mod error_breakdown;
pub mod error_stats;
pub mod gap_injection;
#[cfg(feature = "published")]
pub mod metric;
pub mod motion_quality;
pub mod pair_label;
pub mod report;
pub mod score;
mod score_report;
pub mod takes;

pub use score::{Score, ScoreReport};

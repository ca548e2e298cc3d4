//! Damage to clean poses, scores of restored ones, figures, and the benchmark that compares models.

pub mod alignment;
pub mod benchmark;
pub mod damage;
pub mod error_breakdown;
pub mod error_stats;
pub mod motion_quality;
pub mod pair_label;
pub mod report;
pub mod restoration;
#[cfg(feature = "published")]
pub mod retrieval;
pub mod score;
mod score_report;

pub use score::{Score, ScoreReport};

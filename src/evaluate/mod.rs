//! Damage to clean poses, scores of restored ones, figures, and the benchmark that compares models.

pub mod alignment;
pub mod benchmark;
pub mod damage;
pub(crate) mod error_breakdown;
pub(crate) mod error_stats;
pub(crate) mod motion_quality;
pub mod pair_label;
pub mod report;
pub mod restoration;
#[cfg(feature = "published")]
pub mod retrieval;
pub(crate) mod score;
mod score_report;

pub use score::{Score, ScoreReport};

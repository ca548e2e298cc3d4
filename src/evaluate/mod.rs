//! Damage to clean poses, scores of restored ones, figures, and the benchmark that compares models.

pub mod benchmark;
pub mod corruption;
pub mod error_breakdown;
pub mod error_stats;
pub mod figure;
pub mod frames;
pub mod gap_injection;
pub(crate) mod html;
pub mod mesh_scene;
pub mod metric;
pub mod motion_quality;
pub mod pair_label;
pub(crate) mod plain_page;
pub mod player;
pub mod report;
pub mod scene;
mod scene_geometry;
pub mod score;
mod score_report;
pub mod takes;
pub(crate) mod text_table;

pub use score::{Score, ScoreReport};

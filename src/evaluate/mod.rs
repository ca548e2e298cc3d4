//! Corruptions, scores, figures.

pub mod figure;
mod markup;
pub mod player;
pub mod scene;
mod shapes;
mod stance;

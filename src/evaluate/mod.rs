//! Corruptions, scores, figures, and the bench that compares models.

pub mod bench;
pub mod corruption;
pub mod damage;
pub mod figure;
pub mod gaps;
mod markup;
pub mod motion;
pub mod player;
pub mod scene;
pub mod score;
pub mod score_text;
mod shapes;
mod stance;
pub mod tally;

//! Corruptions, scores, figures.

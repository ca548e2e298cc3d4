//! Priors that keep the training poses themselves and answer from those that resemble the observation.

pub mod box_tree;
mod exemplar_weights;
pub mod local_pca;
pub mod nearest_neighbor;
pub mod nlm;

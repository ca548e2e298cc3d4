//! Hierarchical k-means.

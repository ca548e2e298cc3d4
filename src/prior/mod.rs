//! Models of what poses look like.

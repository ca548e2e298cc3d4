//! Restoring poses.

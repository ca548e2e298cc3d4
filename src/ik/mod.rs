//! Inverse kinematics: a skeleton's degrees of freedom from the positions of its joints.

pub(crate) mod bone_normalization;
mod channel_paths;
pub mod correspondence;
pub(crate) mod fit_quality;
pub(crate) mod initial_pose;
mod missing_channels;
pub mod retarget;
mod rotation_paths;
pub mod sequence;
pub(crate) mod skeleton_estimation;
mod skeleton_fit;
pub mod solver;
mod tree_cholesky;
mod tuning;
mod two_bone;

pub use fit_quality::{FitQuality, FitVerdict};
pub use missing_channels::{PositionSd, solve_missing_channels};
pub use rotation_paths::mix_with_paths;
pub use skeleton_estimation::estimate_skeleton;
pub use skeleton_fit::{FittedTake, SkeletonFit};

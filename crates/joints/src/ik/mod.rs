//! Inverse kinematics: a skeleton's degrees of freedom from the positions of its joints.

pub(crate) mod bone_normalization;
pub mod correspondence;
pub(crate) mod fit_quality;
pub(crate) mod frame_solver;
pub mod ground;
#[doc(hidden)]
pub mod initial_pose;
mod least_turns;
mod missing_channels;
mod named_skeleton;
pub mod retarget;
pub mod rotation_cleaning;
pub mod sequence;
pub(crate) mod skeleton_estimation;
mod skeleton_fit;
pub mod solver;
mod tree_cholesky;
mod tuning;

pub use fit_quality::{FitQuality, FitVerdict};
pub use missing_channels::solve_missing_channels;
pub use named_skeleton::{NamedSkeleton, named_skeleton};
pub use skeleton_estimation::estimate_skeleton;
pub use skeleton_fit::{FittedTake, SkeletonFit};

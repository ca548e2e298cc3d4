//! Inverse kinematics: a skeleton's degrees of freedom from the positions of its joints.

pub mod bone_normalization;
pub mod correspondence;
pub mod initial_pose;
pub mod sequence;
pub mod skeleton_estimation;
pub mod solver;

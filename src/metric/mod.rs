//! How alike two poses are: geometric pose descriptors, and metrics learnt from labelled pairs.
//!
//! After C. Chen, Y. Zhuang, F. Nie, Y. Yang, F. Wu, J. Xiao: Learning a 3D Human Pose Distance Metric from Geometric Pose
//! Descriptor. IEEE TVCG 17 (11), 2011.
//!
//! [`joint_map`] finds sixteen joints among the points of any skeleton, [`body_frame`] removes place, heading and size, and
//! [`gpd`] describes the pose. [`pair_proposal`] proposes pairs of poses for people to label.

pub mod body_frame;
pub mod gpd;
pub mod joint_map;
pub mod pair_proposal;

pub use body_frame::BodyFramePoses;
pub use gpd::{Family, Gpd};
pub use joint_map::JointMap;

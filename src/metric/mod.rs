//! How alike two poses are: geometric pose descriptors, and metrics learnt from labelled pairs.
//!
//! After C. Chen, Y. Zhuang, F. Nie, Y. Yang, F. Wu, J. Xiao: Learning a 3D Human Pose Distance Metric from Geometric Pose
//! Descriptor. IEEE TVCG 17 (11), 2011.
//!
//! [`joint_map`] finds sixteen joints among the points of any skeleton, [`body_frame`] removes place, heading and size, and
//! [`gpd`] describes the pose. [`learners`] learn a distance from pairs of poses that are labelled alike or unlike.

pub mod baselines;
pub mod body_frame;
mod boost;
pub mod features;
pub mod file;
mod game;
pub mod gpd;
pub mod joint_map;
pub mod learners;
mod local_pairs;
pub mod nearest;
mod orientation;
pub mod pairs;
pub mod pose_metric;
pub mod rdsr;
mod reduction;
pub mod scaling;
pub mod sparse_graph;
mod stopwatch;
pub mod trace_ratio;
pub mod train;
mod weights;

pub use baselines::Baseline;
pub use body_frame::BodyFramePoses;
pub use features::PoseFeatures;
pub use gpd::{Family, Gpd};
pub use joint_map::JointMap;
pub use nearest::PoseDatabase;
pub use pairs::{FrameRef, LabelledPair};
pub use pose_metric::PoseMetric;
pub use train::{TrainSettings, Trained, train};

#![deny(unsafe_code)]
#![warn(missing_docs)]
//! How alike two poses are: geometric pose descriptors, and metrics learned from labeled pairs.
//!
//! After C. Chen, Y. Zhuang, F. Nie, Y. Yang, F. Wu, J. Xiao: Learning a 3D Human Pose Distance
//! Metric from Geometric Pose Descriptor. IEEE TVCG 17 (11), 2011.
//!
//! `joint_map` finds sixteen joints among the points of any skeleton, `body_frame` removes
//! position, heading and size, and `gpd` describes the pose; `features` and [`scaling`] say what
//! of it is compared. [`pair_proposal`] proposes pairs of poses for people to label,
//! [`train`](mod@train) learns a distance from them by `rdsr` or a learner of papers,
//! and [`pose_metric`] is what was learned. [`nearest`] searches with it. [`transition`] finds
//! frames at which one clip can go over into another, [`Blend`] joins the clips there, and
//! [`blend_test`] tells whether the result moves as the clips do; [`index`] keeps takes described,
//! and [`events`] finds motions in them.
//!
//! ```
//! use posing_likeness::{JointMap, PoseMetric};
//!
//! // The rival of every metric: coordinates and velocities of the joints, without learning.
//! let metric = PoseMetric::of_coordinates(JointMap::cmu());
//! assert!(metric.is_of_coordinates() && metric.needs_rate());
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, numeric, pose};
use posing_draw as draw;
use posing_io as io;

mod blend;
pub mod blend_test;
#[doc(hidden)]
pub mod body_frame;
pub mod clip;
#[doc(hidden)]
pub mod cross_fade;
pub mod events;
#[doc(hidden)]
pub mod features;
pub(crate) mod file;
pub(crate) mod gpd;
pub mod index;
pub mod joint_map;
mod local_pairs;
mod motion_matching;
pub mod nearest;
mod orientation;
pub mod pair_label;
pub mod pair_proposal;
pub mod pairs;
pub mod pose_metric;
pub mod rdsr;
mod reduction;
pub mod scaling;
pub mod sparse_graph;
mod stopwatch;
pub mod time_alignment;
pub(crate) mod trace_ratio;
pub mod train;
pub mod transition;

pub use blend::{Blend, Blender};
pub use blend_test::{BlendQuality, BlendedClips, ClipRange};
pub use body_frame::BodyFramePoses;
pub use clip::Clip;
pub use events::{Event, EventSearch, Examples};
pub use features::PoseFeatures;
pub use gpd::{Family, Gpd};
pub use index::FrameRows;
pub use index::{IndexedTake, PoseIndex};
pub use joint_map::JointMap;
pub use nearest::PoseDatabase;
pub use pairs::{FrameRef, LabeledPair};
pub use pose_metric::PoseMetric;
pub use time_alignment::{TimeAlignment, TimeAlignmentOptions};
pub use train::{TrainSettings, Trained, train};
pub use transition::{Candidate, TransitionSearch};

#[cfg(test)]
use crate as metric;
#[cfg(test)]
mod testdata;

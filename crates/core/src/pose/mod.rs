//! The spine: points, skeletons, poses, rotations, kinematics. No I/O, no flags.

#[doc(hidden)]
pub mod body;
#[doc(hidden)]
pub mod bone_points;
#[doc(hidden)]
pub mod computed;
#[doc(hidden)]
pub mod foot_contacts;
#[doc(hidden)]
pub mod head_and_feet;
pub(crate) mod joint_angles;
pub mod joints;
pub mod kinematics;
pub(crate) mod name_map;
pub(crate) mod observation;
pub mod one_take;
#[doc(hidden)]
pub mod orientation;
pub(crate) mod placement;
#[doc(hidden)]
pub mod poses;
mod ranges;
#[doc(hidden)]
pub mod repeated_frames;
pub(crate) mod resampling;
pub mod rotation;
pub(crate) mod rotation_resampling;
mod segment;
pub mod sides;
pub mod similarity;
pub(crate) mod skeleton;
mod smpl_joints;
pub(crate) mod status;
#[doc(hidden)]
pub mod stray;
pub(crate) mod transform;
#[doc(hidden)]
pub mod two_bone;
pub mod units;
pub(crate) mod wrong_unit;
#[doc(hidden)]
pub mod zeros;

pub use body::Body;
pub use bone_points::BonePoints;
pub use joint_angles::{JointAngles, JointChannels};
pub use kinematics::Space;
pub use name_map::{NameFinder, NameMap, PointNaming};
#[doc(hidden)]
pub use name_map::{is_other, same_points};
pub use observation::Observation;
pub use one_take::one_take;
pub use placement::Anchor;
pub use poses::Poses;
#[doc(hidden)]
pub use poses::point_at;
#[doc(hidden)]
pub use ranges::ranges;
pub use rotation_resampling::{Retiming, resampled_motion, without_jumps};
pub use segment::Segment;
pub use similarity::{Similarity, fit_similarity};
pub use skeleton::{Bone, Channel, Dof, Skeleton};
pub use smpl_joints::smpl_names;
pub use status::{FillMethod, Status};
pub use transform::PoseTransform;
pub use units::{LengthUnit, Units, UpAxis};
pub use wrong_unit::check_unit;

/// Centimeters in one unit of CMU's raw ASF files (`length 0.45`): 2.54 / 0.45 = 5.644.
///
/// Lai et al.'s errors are mean squares in this unit, and so is its "standard Gaussian noise".
pub const ASF_UNIT_CM: f64 = 2.54 / 0.45;

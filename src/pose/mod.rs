//! The spine: points, skeletons, poses, rotations, kinematics. No I/O, no flags.

pub mod body;
pub mod bone_points;
pub mod joint_angles;
pub mod joints;
pub mod kinematics;
pub mod name_map;
pub mod observation;
pub mod one_take;
pub mod placement;
pub mod poses;
pub mod rotation;
pub mod similarity;
pub mod skeleton;
mod smpl_joints;
pub mod status;
pub mod stray;
pub mod transform;
pub mod trimming;
pub mod units;

pub use body::Body;
pub use bone_points::BonePoints;
pub use joint_angles::JointAngles;
pub use kinematics::Space;
pub use name_map::{NameFinder, NameMap, PointNaming};
pub use observation::Observation;
pub use one_take::one_take;
pub use placement::Anchor;
pub use poses::Poses;
pub use similarity::{Similarity, fit_similarity};
pub use skeleton::{Bone, Channel, Dof, Skeleton};
pub use smpl_joints::smpl_names;
pub use status::{FillMethod, Status};
pub use transform::PoseTransform;
pub use units::{LengthUnit, Units, UpAxis};

/// Centimeters in one unit of CMU's raw ASF files (`length 0.45`): 2.54 / 0.45 = 5.644.
///
/// The paper's errors are mean squares in this unit, and so is its "standard Gaussian noise".
pub const ASF_UNIT_CM: f64 = 2.54 / 0.45;

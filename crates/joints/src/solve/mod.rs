//! From markers to joints: the bones of the person, where on them the markers are, and the pose of
//! every frame, fitted together.
//!
//! A marker is on a landmark of a bone, of which a dictionary knows where it is about, as the
//! marker set says by the marker's name. The bones of the body and the positions of the markers are
//! fitted with the poses of some frames, then every frame by itself.

mod body;
mod body_labels;
mod body_points;
mod calibration;
mod deviations;
mod fitted;
mod gait_curves;
mod landmarks;
mod learning;
mod marker_sets;
mod marker_solver;
mod naming_model;
mod page;
mod person;
mod plug_in_gait;
mod solved_take;
mod tuning;
mod unseen_limbs;

pub use body_labels::BodyModel;
#[doc(hidden)]
pub use body_points::body_points;
pub use landmarks::JointSet;
pub use marker_sets::MarkerSet;
#[doc(hidden)]
pub use marker_solver::doubt;
pub use marker_solver::{SolveSettings, solve};
pub use naming_model::{naming_model, on_body};
pub use plug_in_gait::Centers;
pub use solved_take::{SolvedTake, UsedMarker};
pub use unseen_limbs::UnseenLimb;

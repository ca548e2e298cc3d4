//! Restoring poses: one function of a pose and the variances of its coordinates; `denoise` and `complete` are two
//! settings of it.

pub mod body_adaptation;
pub mod bound_model;
pub mod complete;
pub mod denoise;
pub mod frame_restorer;
pub mod ik;
mod kalman_smoother;
mod noise_estimation;
pub mod outliers;

pub mod placement;
pub mod rigid;
pub mod take;

pub use bound_model::BoundModel;
pub use frame_restorer::{FrameRestorer, RestoredFrame, RestoredFrames};
pub use rigid::{Corrected, OutlierMode, RigidModel};

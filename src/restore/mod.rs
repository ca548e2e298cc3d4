//! Restoring poses: one function of a pose and the variances of its coordinates; `denoise` and `complete` are two
//! settings of it.

pub mod body_adaptation;
pub mod bones;
pub mod bound_model;
pub mod complete;
pub mod denoise;
pub mod fit;
pub mod frame_restorer;
pub mod greedy;
pub mod ik;
mod kalman_smoother;
pub mod measured;
mod noise_estimation;
pub mod observed;
pub mod outliers;

pub mod placement;
pub mod report;
pub mod rigid;
pub mod take;
mod turn;

pub use bound_model::BoundModel;
pub use frame_restorer::{FrameRestorer, RestoredFrame, RestoredFrames};
pub use observed::Observed;
pub use rigid::{Corrected, OutlierMode, RigidModel};

//! Restoring poses: one function of a pose and the variances of its coordinates; `denoise` and `complete` are two
//! settings of it.

pub mod adapt;
pub mod bones;
mod climb;
pub mod complete;
pub mod denoise;
pub mod fit;
pub mod frame;
pub mod greedy;
pub mod ik;
pub mod job;
pub mod measured;
mod noise;
pub mod observed;
pub mod planar;
mod rejects;
pub mod report;
pub mod smooth;
mod strays;
pub mod suspects;
pub mod synthesis;
pub mod take;
pub mod treat;
mod turn;

pub use frame::{Restoration, Restored, Restorer};
pub use job::Job;
pub use observed::Observed;
pub use treat::{Seek, Treated, Treatment};

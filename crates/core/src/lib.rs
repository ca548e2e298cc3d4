#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Poses, skeletons, rotations and units, and the numerics that all other crates of `posing` share.
//!
//! A take is a table of [`pose::Poses`]: frames x points, in centimeters, y up, NaN for a missing
//! value. [`pose::Skeleton`] turns joint angles into positions ([`pose::kinematics`]);
//! [`pose::Observation`] is a frame whose values have variances. [`numeric`] has linear algebra,
//! Gaussians and parallel work whose result does not depend on the number of threads. What can go
//! wrong is an [`Error`] with a [`Place`].
//!
//! ```
//! use ndarray::Array2;
//! use posing_core::pose::{Body, Poses, joints};
//!
//! let mut poses = Poses { points: joints::cmu_names(), ..Poses::default() };
//! poses.xyz = Array2::zeros((2, 69));
//! assert_eq!(poses.runs(), [0..2]); // one run: no jump in time
//! let body = Body::measure(&joints::parents_by_name(&poses.points), poses.xyz.view());
//! assert_eq!(body.lengths[1], 0.0); // the length of the left hip bone
//! ```

#[macro_use]
mod names;

pub mod error;
mod message;
pub mod numeric;
pub mod pose;

pub use error::{Error, Place, Result};
#[doc(hidden)]
pub use message::often;

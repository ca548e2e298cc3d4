#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Restoring poses: missing points filled, noise and outliers removed.
//!
//! An observation y ~ N(x, diag(r)) of a pose x (3 J coordinates, cm) has one noise variance r a
//! coordinate: 0 is exact, infinity is missing. A single frame is completed or denoised by one
//! estimate, E[x | y] under a prior of poses; a take also by regression over its gaps and by Kalman
//! smoothing.
//!
//! The path of a take:
//!
//! 1. [`Restorer`] opens the [`PoseModel`], finds its points in the table, and walks the takes
//!    (`take`).
//! 2. `outliers` finds tracks that jump off and back (`label`) and spikes, adapts the prior
//!    to the body (`adapted_prior`) and finds the other outliers.
//! 3. `denoise` puts back what is exchanged left and right (`label`), sifts the outliers from the
//!    take (`sifted_take`), of whose other points it measures the noise (`capture_noise`) and
//!    smooths each path over time (`adaptive_smoothing`), draws them to the model's estimates
//!    (`model_estimates`, at `knots`), and holds the limbs' bones to their lengths
//!    (`bone_lengths`); `complete` assumes that seen values are exact, but for those whose
//!    deviation the table says.
//! 4. `gap` fills gaps from the frames around them, [`FrameEstimator`] estimates each frame where
//!    these say nothing: [`placement`] finds rotation and shift, the prior gives the posterior in
//!    the model's space, `rigid` projects it onto the known distances. Where few points are seen
//!    and y is up, `upright` poses stand in for placement and prior.
//! 5. `clean` denoises the takes that are noisy and completes the others.
//! 6. [`Restoration`] holds the values in the table's order, with a status for each point.
//!
//! ```
//! use ndarray::array;
//! use posing_core::pose::Poses;
//! use posing_io::Table;
//! use posing_restore::{Complete, Restorer};
//!
//! // A marker that goes at an even pace, missing in one frame.
//! let mut xyz = ndarray::Array2::from_shape_fn((9, 3), |(t, c)| (10 * t + c) as f64);
//! xyz.row_mut(4).fill(f64::NAN);
//! let time = Some((0..9).map(|t| f64::from(t) / 100.0).collect());
//! let poses = Poses { points: vec!["knee".into()], xyz, time, ..Poses::default() };
//! let table = Table::from_poses(poses);
//! let done = Restorer::without_model().complete(&table, &Complete::default())?;
//! assert_eq!(done.filled(), 1);
//! assert!((done.xyz()[[4, 0]] - 40.0).abs() < 1e-6);
//! # Ok::<(), posing_core::Error>(())
//! ```

use posing_core::{Error, Place, Result, numeric, pose};
/// What fills gaps of a whole body.
#[doc(hidden)]
pub use posing_inbetween as inbetween;
use posing_io as io;
use posing_label as label;
use posing_models::prior;

mod adapted_prior;
mod adaptive_smoothing;
#[doc(hidden)]
pub mod body_size;
mod bone_lengths;
mod capture_noise;
pub(crate) mod clean;
pub(crate) mod complete;
mod cuts;
pub(crate) mod denoise;
mod denoised_frame;
mod exchanged;
#[doc(hidden)]
pub mod frame_estimator;
mod gap;
pub mod gap_report;
mod kalman_smoother;
mod keypoints;
mod knots;
mod known_motion;
mod model_estimates;
mod noise_estimation;
#[doc(hidden)]
pub mod outliers;
pub mod placement;
mod pose_model;
pub(crate) mod restoration;
mod restorer;
pub(crate) mod rigid;
mod sifted_take;
mod steady_distances;
mod take;
mod tuning;
mod upright;

pub use clean::Clean;
pub use complete::Complete;
pub use denoise::Denoise;
pub use frame_estimator::{FrameEstimate, FrameEstimator};
pub use gap::{LocalPoses, local_anchor};
pub use keypoints::keypoint_noise;
pub use known_motion::BodyGap;
pub use noise_estimation::typical_noise;
pub use pose_model::PoseModel;
pub use restoration::{Restoration, RestorationCounts, RestoredGap};
pub use restorer::Restorer;
#[doc(hidden)]
pub use rigid::Corrected;
#[doc(hidden)]
pub use rigid::OutlierMode;
pub use rigid::RigidModel;

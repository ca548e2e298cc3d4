//! Restoring poses: missing points filled, noise and outliers removed.
//!
//! An observation y ~ N(x, diag(r)) of a pose x (3 J coordinates, cm) has one noise variance r a
//! coordinate: 0 is exact, infinity is missing. A single frame is completed or denoised by one
//! estimate, E[x | y] under a prior of poses; a take also by regression over its gaps and by Kalman
//! smoothing.
//!
//! The path of a take:
//!
//! 1. [`Restorer`] opens the model, binds it to the table's points and walks the takes
//!    (`restored_frames`).
//! 2. [`outliers`] finds spikes, adapts the model to the body ([`body_adaptation`]) and finds the
//!    other outliers.
//! 3. [`denoise`] smooths each coordinate over time (`kalman_smoother`); [`complete`] takes seen
//!    values for exact.
//! 4. `gap` fills gaps from the frames around them, [`FrameRestorer`] restores each frame where
//!    these say nothing: [`placement`] finds rotation and shift, the prior gives the posterior in
//!    the model's space, [`rigid`] projects it onto the known distances.
//! 5. `frame_fill` makes the restored frames continuous over the gaps of [`complete`].
//! 6. [`clean`] denoises the takes that are noisy and completes the others.
//! 7. [`Restoration`] holds the values in the table's order, with a status for each point.

mod adaptive_smoothing;
pub mod body_adaptation;
pub mod body_size;
pub mod clean;
pub mod complete;
mod cuts;
pub mod denoise;
mod frame_fill;
pub mod frame_restorer;
mod gap;
pub mod gap_report;
mod kalman_smoother;
mod loaded_model;
mod noise_estimation;
pub mod outliers;
mod placed_prior;
pub mod placement;
pub mod restoration;
mod restored_frames;
mod restorer;
pub mod rigid;

pub use clean::Clean;
pub use complete::Complete;
pub use denoise::Denoise;
pub use frame_restorer::{FrameRestorer, RestoredFrame};
pub(crate) use gap::{LocalPoses, local_anchor};
pub use noise_estimation::typical_noise;
pub use placed_prior::PlacedPrior;
pub use restoration::{Restoration, RestorationCounts, RestoredGap};
pub use restorer::Restorer;
pub use rigid::{Corrected, OutlierMode, RigidModel};

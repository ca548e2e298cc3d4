//! Placement: the rotation R (3, 3) and shift t (3, cm) from the model's space to the world, found together with the
//! pose.
//!
//! [`alternating`] solves P1 of the posing paper; `evidence` maximizes the evidence of priors that give its
//! gradient; [`orthographic`] places 2-D input.

pub mod alternating;
mod evidence;
pub mod orthographic;

pub use alternating::{PlacementSolution, PlacementSolver};

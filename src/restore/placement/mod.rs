//! Where a captured pose stands in the model's space: rotation, shift and pose are found together.

pub mod alternating;
mod evidence;
pub mod orthographic;

pub use alternating::{PlacementSolution, PlacementSolver};

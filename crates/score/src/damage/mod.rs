//! Seeded damage to poses: noise and missing points frame by frame, and gaps in time.

pub(crate) mod gaps;
mod noise;

pub use gaps::GapInjection;
pub use noise::{Corruption, Corruptor, MAX_NOISE};

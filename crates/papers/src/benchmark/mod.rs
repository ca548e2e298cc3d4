//! The benchmark: models x tasks x splits x seeds, each model tested on poses it was not trained
//! from.
//!
//! [`Dataset`] holds the poses, `splits` divides it, [`leakage`] finds takes that must stay on
//! one side, `task` damages the test poses, [`method`] trains and restores, [`runner`] does all
//! of this for each case, `shard` divides the cases among machines, and `summary` averages over
//! seeds with bootstrap intervals. [`report`](super::report) writes the results down.
//!
//! All poses are in body space: root at the origin, no global rotation. Errors are mean squares of
//! a coordinate in asf² (1 asf = 5.644 cm), Lai et al.'s measure, beside the RMS in centimeters.

pub mod dataset;
pub mod examples;
pub mod leakage;
pub mod method;
pub mod result;
pub mod result_cache;
pub mod runner;
pub(crate) mod settings;
pub(crate) mod shard;
pub(crate) mod splits;
pub(crate) mod summary;
pub(crate) mod task;

pub use dataset::Dataset;
pub use method::Method;
pub use result::BenchmarkResult;
pub use runner::Benchmark;
pub use settings::Settings;
pub use shard::Shard;
pub use splits::{Partition, Split};
pub use task::Task;

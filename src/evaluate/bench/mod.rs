//! The bench: models x tasks x splits x seeds on poses that the models have not learnt from.
//!
//! [`Data`] is what there is, [`splits`] divides it, [`leaks`] sees to it that nothing tested was learnt from, [`tasks`]
//! damages the test poses, [`methods`] trains and restores, [`run`] does all of it cell by cell, [`summary`] says what
//! came out and how sure that is, and [`tables`] and [`report`] write it down.
//!
//! Everything is in body space: root at the origin, no global rotation. Errors are mean squares a coordinate in asf²
//! (1 asf = 5.644 cm), the paper's measure, beside the RMS in centimetres.

pub mod cell;
mod charts;
mod curves;
pub mod data;
pub mod examples;
mod findings;
pub mod leaks;
pub mod methods;
pub mod paper;
pub mod report;
pub mod reproduction;
pub mod run;
pub mod settings;
mod showing;
pub mod splits;
pub mod summary;
pub mod tables;
pub mod tasks;

pub use cell::Cell;
pub use data::Data;
pub use methods::Method;
pub use run::Bench;
pub use settings::{Config, Settings};
pub use splits::{Partition, Split};
pub use tasks::Task;

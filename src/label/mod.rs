//! Which track is which point: what the distances within a body say of the labels of a take.

mod changes;
pub(crate) mod distances;
mod evidence;
pub(crate) mod exchanges;
mod file;
mod identities;
mod links;
mod mirror;
pub(crate) mod out_and_back;
pub(crate) mod pieces;
pub(crate) mod repair;
pub(crate) mod take;
mod tuning;
pub(crate) mod unlabeled;

pub use file::{LabelReport, check_labels};

//! Which track is which point: what the distances within a body say of the labels of a take.

mod changes;
pub(crate) mod distances;
mod evidence;
pub(crate) mod exchanges;
mod file;
mod identities;
mod labeled_take;
mod links;
mod mirror;
pub(crate) mod out_and_back;
mod paths;
pub(crate) mod people;
pub(crate) mod pieces;
mod relabeling;
pub(crate) mod repair;
mod sides;
mod tuning;
pub(crate) mod unlabeled;

pub use changes::ChangeKind;
pub use file::{LabelChange, LabelReport, UnsureLabels, check_labels};
pub use relabeling::LabelSettings;
pub use sides::SideBy;

//! Which track is which point: what the distances within a body say of the labels of a take.

pub(crate) mod changes;
mod chirality;
pub(crate) mod distances;
mod evidence;
pub(crate) mod exchanges;
mod file;
mod handedness;
mod hosts;
mod identities;
mod label_model;
mod labeled_take;
mod links;
mod loose_tracks;
mod mirror;
mod named_tracks;
pub(crate) mod naming;
pub(crate) mod out_and_back;
mod paths;
pub(crate) mod people;
pub(crate) mod pieces;
pub(crate) mod relabeling;
pub(crate) mod repair;
pub(crate) mod sides;
mod template;
pub(crate) mod templates;
mod tuning;
pub(crate) mod unlabeled;
mod whole_take;

pub use changes::ChangeKind;
pub use file::{LabelChange, LabelReport, UnsureLabels, check_labels, label_from_nothing};
pub use label_model::{FittedLabels, LabelModel, NamedFrame};
pub use named_tracks::{FoundLabel, MovedPiece, NamedTracks, UnsureTrack};
pub use people::points_of_person;
pub use relabeling::LabelSettings;
pub use sides::SideBy;
pub use templates::Templates;

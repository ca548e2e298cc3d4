#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Which track is which point: what the distances within a body say of the labels of a take.
//!
//! ```
//! // Two people in one capture, told apart by what stands before the names of their markers.
//! let names = ["LFHD", "RFHD", "C7", "CLAV", "LASI", "RASI"];
//! let of = |person: &str| names.map(|name| format!("{person}:{name}"));
//! let points = [of("Ann"), of("Ben")].concat();
//! let ben = posing_label::points_of_person(&points, "Ben")?;
//! assert_eq!(ben[0], (6, "LFHD".to_string()));
//! # Ok::<(), posing_core::Error>(())
//! ```

use posing_core::{Error, Place, Result, error, numeric, pose};
use posing_io as io;

mod body_evidence;
mod body_exchanges;
#[doc(hidden)]
pub mod changes;
mod chirality;
mod evidence;
#[doc(hidden)]
pub mod exchanges;
mod file;
pub(crate) mod fragments;
mod handedness;
mod hosts;
mod identities;
mod label_model;
mod label_settings;
mod labeled_take;
mod links;
mod loose_tracks;
#[doc(hidden)]
pub mod marker_distances;
mod mirror;
mod named_tracks;
#[doc(hidden)]
pub mod nameless;
mod naming;
mod next_fragments;
#[doc(hidden)]
pub mod out_and_back;
mod paths;
#[doc(hidden)]
pub mod people;
mod person_template;
mod posture_file;
mod posture_fit;
mod posture_labels;
mod posture_model;
mod posture_search;
#[doc(hidden)]
pub mod relabeling;
pub(crate) mod repair;
#[doc(hidden)]
pub mod sides;
#[doc(hidden)]
pub mod templates;
mod tuning;
#[doc(hidden)]
pub mod unlabeled;
mod whole_take;

pub use changes::ChangeKind;
pub use file::{LabelChange, LabelReport, UnsureLabels, check_labels, label_from_nothing};
#[doc(hidden)]
pub use file::{labeled_as, name_file};
pub use label_model::{FittedLabels, LabelModel, NamedFrame};
pub use label_settings::LabelSettings;
pub use named_tracks::{FoundLabel, MovedFragment, NamedTracks, UnsureTrack};
pub use people::points_of_person;
#[doc(hidden)]
pub use posture_file::PosturesInFile;
pub use posture_model::PostureModel;
pub use sides::SideBy;
pub use templates::Templates;

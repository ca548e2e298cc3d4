#![deny(unsafe_code)]
#![warn(missing_docs)]
//! In-betweens: whole bodies over gaps of a quarter of a second to two seconds, from motion that
//! is known.
//!
//! Nothing is trained. A [`MotionLibrary`] keeps takes; [`MotionFiller`] cuts windows of a gap's
//! length from it and from the take itself (`windows`), carried to the take's bones (`body_tree`),
//! and adds to the cubic that bridges the gap what the nearest windows have over theirs
//! (`regression`), where gaps that are simulated in them say that it helps (`evidence`).
//! [`through_keys`] does so between key poses.
//!
//! ```
//! use posing_core::pose::Poses;
//! use posing_inbetween::MotionLibrary;
//!
//! let mut library = MotionLibrary::default();
//! let table = Poses { points: vec!["hat".into()], ..Poses::default() };
//! assert!(library.add(&table, &[], None, "hats").is_err()); // no body
//! assert_eq!((library.people(), library.seconds()), (0, 0.0));
//! ```

use posing_core::{Error, Place, Result, numeric, pose};
use posing_io as io;

mod body_tree;
mod evidence;
mod fill;
mod key_poses;
mod library;
mod prediction;
mod regression;
mod sampling;
mod windows;

pub use fill::{LONGEST, MotionFill, MotionFiller, NO_BODY, Verdict, knows_body};
pub use key_poses::{KeySpan, KeyedMotion, through_keys};
pub use library::{KIND, LibraryClip, LibraryTake, MotionLibrary};
pub use prediction::MotionSource;

/// Frames a second of a library, and of the windows that are compared.
pub const RATE: f64 = 30.0;

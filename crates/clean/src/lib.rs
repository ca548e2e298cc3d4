#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Whole takes: what is wrong in them, and the same takes with it mended.
//!
//! [`audit`] finds faults and changes nothing: rates, units, gaps, swaps, held frames. [`clean`]
//! takes files and folders of any format, puts labels right, fills, smooths where noise is
//! measured, solves joints, and writes a record beside each result. [`TrialFile`] computes gait.
//!
//! ```
//! use posing_clean::audit::{FindingKind, Limits, audit};
//! use posing_core::pose::Poses;
//!
//! let mut poses = Poses { points: vec!["head".into()], ..Poses::default() };
//! poses.xyz = ndarray::Array2::from_elem((40, 3), 100.0);
//! poses.xyz.row_mut(7).fill(0.0);
//! let takes = audit(&poses, Some(120.0), &Limits::default());
//! assert!(takes[0].findings.iter().any(|f| f.kind == FindingKind::Zeros));
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, error, numeric, pose};
use posing_draw as draw;
use posing_gait as gait;
use posing_io as io;
use posing_joints::{ik, solve};
use posing_label as label;
use posing_models::prior;
use posing_restore as restore;

pub mod audit;
pub mod clean;
mod trial_file;

pub use trial_file::TrialFile;

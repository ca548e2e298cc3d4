#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Whole takes: what is wrong in them, and the same takes with it mended.
//!
//! [`audit`] finds faults and changes nothing: rates, units, gaps, swaps, held frames. [`clean`]
//! takes files and folders of any format, puts labels right, fills, smooths where noise is measured,
//! solves joints, and writes a record beside each result.
//!
//! ```
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, error, numeric, pose};
use posing_draw as draw;
use posing_io as io;
use posing_joints::{ik, solve};
use posing_label as label;
use posing_models::prior;
use posing_restore as restore;

pub mod audit;
pub mod clean;

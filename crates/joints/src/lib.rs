#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Joint angles: from points to the rotations of a skeleton, and from one skeleton to another.
//!
//! [`solve`] finds the joints of a person under labeled markers. [`ik`] has the solvers: a skeleton's
//! degrees of freedom from positions of its joints ([`ik::SkeletonFit`]), rotations whose pops and
//! noise are taken out ([`ik::rotation_cleaning`]), and motion on another rig ([`ik::retarget`]).
//!
//! ```
//! ```

use posing_core::{Error, Place, Result, numeric, pose};
use posing_draw as draw;
use posing_io as io;
use posing_label as label;
use posing_models::prior;

pub mod ik;
pub mod solve;

#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Joint angles: from points to the rotations of a skeleton, and from one skeleton to another.
//!
//! [`solve`] finds the joints of a person under labeled markers. [`ik`] has the solvers: a
//! skeleton's degrees of freedom from positions of its joints ([`ik::SkeletonFit`]), rotations
//! whose pops and noise are taken out ([`ik::rotation_cleaning`]), motion on another rig
//! ([`ik::retarget`]), and takes put on their floor ([`ik::ground`], of files [`ground_file`]).
//!
//! ```
//! use posing_io::{Amc, Asf};
//! use posing_joints::ik::SkeletonFit;
//!
//! let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
//! let take = Amc::open("../../testdata/cmu/09/09_06.amc", &asf)?.to_poses(120.0)?;
//! let fit = SkeletonFit::new(&asf.skeleton).fit(&take.slice(0..3))?;
//! assert!(fit.sequence.mean <= 0.1); // centimeters
//! let bvh = fit.to_bvh()?;
//! # Ok::<(), posing_core::Error>(())
//! ```

use posing_core::{Error, Place, Result, numeric, pose};
use posing_draw as draw;
use posing_gait as gait;
use posing_io as io;
use posing_label as label;
use posing_models::prior;

pub mod ground_file;
pub mod ik;
pub mod solve;

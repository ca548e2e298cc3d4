#![deny(unsafe_code)]
#![warn(missing_docs)]
//! What the papers that methods come from (Lai et al., Chen et al.) compare with, and how: pose
//! models ([`published`]), learners and distances of poses ([`PublishedLearner`], [`Baseline`]),
//! the [`benchmark`] on unseen takes with its [`report`], and the test of distances by
//! [`retrieval`].
//!
//! ```
//! use posing_models::prior::Kind;
//!
//! assert!("pca".parse::<Kind>().is_err());
//! posing_papers::published::register();
//! assert_eq!("pca".parse::<Kind>()?.name(), "pca");
//! # Ok::<(), posing_core::Error>(())
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, numeric, pose};
use posing_draw as draw;
use posing_io as io;
use posing_likeness as metric;
use posing_models::{cluster, prior, sparse};
use posing_restore as restore;
use posing_score as score;

pub mod baselines;
pub mod benchmark;
pub(crate) mod learners;
pub mod published;
pub mod report;
pub mod retrieval;

pub use baselines::Baseline;
pub use learners::PublishedLearner;

// What the kinds of prior in posing-models keep to, those here keep to; and a person who stands.
#[cfg(test)]
#[path = "../../models/src/prior/kind_checks.rs"]
mod kind_checks;
#[cfg(test)]
#[path = "../../likeness/src/testdata.rs"]
mod standing;
#[cfg(test)]
mod testdata;

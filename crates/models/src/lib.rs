#![deny(unsafe_code)]
#![warn(missing_docs)]
//! What is learned from poses: clusters, dictionaries of atoms, and models of what poses look like.
//!
//! [`cluster`] groups poses by k-means, in levels where they are many. [`sparse`] learns a
//! dictionary by K-SVD, so that each pose is approximately a sum of a few atoms, and merges
//! dictionaries. [`prior`] trains pose models, saves and opens them; each answers one question
//! behind the trait [`prior::Prior`]: given noisy and missing coordinates, which pose is it, and
//! how sure is that?
//!
//! ```
//! use posing_core::pose::Observation;
//! use posing_models::prior::{self, OpenOptions, Prior, Want, builtin_model};
//!
//! let prior = prior::open(&builtin_model()?, &OpenOptions::default(), "built in")?;
//! let coordinates = prior.residual_variance().len();
//! let (values, variance) = (vec![0.0; coordinates], vec![f64::INFINITY; coordinates]);
//! // Nothing is known: the posterior is the prior.
//! let observation = Observation { values: &values, variance: &variance };
//! let pose = prior.posterior(&observation, Want::Mean);
//! assert_eq!(pose.mean.len(), coordinates);
//! # Ok::<(), posing_core::Error>(())
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, numeric, pose};
use posing_io as io;

pub mod cluster;
pub mod prior;
pub mod sparse;

#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Clean, complete, compare and pose human motion with sparse codes learnt from real captures.

pub mod cli;
pub mod cluster;
pub mod error;
pub mod evaluate;
pub mod io;
pub mod linalg;
pub mod par;
pub mod pose;
pub mod prior;
pub mod restore;
pub mod sparse;

pub use error::{Error, Place, Result};

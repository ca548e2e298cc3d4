#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Posing by hand: sessions of drags, pins and key poses ([`edit`]), and with the feature `server`
//! the page and the local server behind it.
//!
//! ```
//! use posing_edit::edit::Session;
//! use posing_models::prior::builtin_model;
//!
//! let mut session = Session::of_model(&builtin_model()?)?;
//! let wrist = session.joint("lwrist").unwrap();
//! let target = session.position(wrist) + glam::DVec3::Y * 10.0;
//! session.drag(wrist, target)?;
//! session.release();
//! assert!((session.position(wrist) - target).length() < 0.5);
//! # Ok::<(), posing_core::Error>(())
//! ```

#[cfg(feature = "server")]
use posing_core::Place;
use posing_core::{Error, Result, numeric, pose};
#[cfg(feature = "server")]
use posing_draw as draw;
use posing_io as io;
use posing_joints::ik;
use posing_models::prior;
use posing_restore as restore;

pub mod edit;
#[cfg(feature = "server")]
pub mod server;

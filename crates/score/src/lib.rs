#![deny(unsafe_code)]
#![warn(missing_docs)]
//! How good a restoration is: damage of a known kind, and scores against the truth.
//!
//! [`damage`] puts noise and gaps into clean poses, [`Score`] compares restored poses with the
//! truth (position, [`error_breakdown`] by joint and by what was damaged, [`motion_quality`]), and
//! [`restoration`] cuts gaps into the user's own takes, restores them and reports what is left.
//!
//! ```
//! use ndarray::array;
//! use posing_core::pose::Poses;
//! use posing_score::Score;
//!
//! let table = |xyz| Poses { points: vec!["root".into()], xyz, ..Poses::default() };
//! let truth = table(array![[0.0, 90.0, 0.0], [1.0, 90.0, 0.0]]);
//! let result = table(array![[0.0, 90.0, 0.0], [1.0, 90.0, 3.0]]);
//! assert_eq!(Score::new(&truth, &result)?.finish().all.max, Some(3.0));
//! # Ok::<(), posing_core::Error>(())
//! ```

use posing_core::{Error, Place, Result, numeric, pose};
use posing_draw as draw;
use posing_io as io;
use posing_models::prior;
use posing_restore as restore;

pub mod alignment;
pub mod damage;
pub mod error_breakdown;
pub mod error_stats;
pub mod motion_quality;
pub mod restoration;
pub mod score;
mod score_report;

pub use score::{Score, ScoreReport};

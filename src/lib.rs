#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Clean, complete, compare and pose human motion with sparse codes learnt from real captures.
//!
//! This is the library under the commands of the same project; what a user types is told by `posing help` and the
//! README. Here is the way of a captured take through it, and where to change what.
//!
//! # The way of a take
//!
//! A take comes as angles of a skeleton. [`io::asf`] reads the skeleton, [`io::amc`] the angles frame by frame,
//! [`pose::kinematics`] turns them into places of joints: [`pose::Poses`], frames x points, in centimetres with y up,
//! where NaN is a missing value. [`io::table`] reads and writes them, one row at a time where that is enough.
//!
//! ```
//! use posing::pose::{Body, Poses, joints};
//! use ndarray::Array2;
//!
//! let mut poses = Poses { points: joints::cmu_names(), ..Poses::default() };
//! poses.xyz = Array2::zeros((2, 69));
//! assert_eq!(poses.runs(), [0..2]); // frames that follow one another
//! let body = Body::measure(&joints::parents_by_name(&poses.points), poses.xyz.view());
//! assert_eq!(body.lengths[1], 0.0); // the hip joint's bone, here at the root
//! ```
//!
//! To learn what poses look like, each is carried to the model's space by its placement ([`pose::Anchor`],
//! [`prior::training`]): root at the origin, no global rotation, one body. [`cluster`] groups poses,
//! [`sparse::Ksvd`] learns a dictionary such that each pose is a sum of a few atoms, [`sparse::Concat`] joins
//! dictionaries; [`io::Model`] is the file.
//!
//! To restore, [`restore::Job`] puts a model and a table together. A frame is an observation: numbers, each with the
//! variance of its noise, 0 exact, infinite missing. [`restore::synthesis`] finds the placement and the code in turn,
//! [`prior::Prior::posterior`] answers, and [`restore::complete`] and [`restore::denoise`] carry the answers through
//! time. [`restore::bones`] and [`restore::ik`] turn points back into the angles of a skeleton, [`io::bvh`] and
//! [`io::amc`] write them.
//!
//! To know how good that is, [`evaluate`] damages poses on purpose, scores results and draws them.
//!
//! # Letters, shapes, units
//!
//! | letter | what | shape | unit |
//! |---|---|---|---|
//! | J, D | points; numbers a pose, D = 3 J | | |
//! | m, n | poses; atoms | | |
//! | kappa, k | atoms a pose at most | | |
//! | Y | poses; rows are frames (the paper's Y is the transpose) | (m, D) | cm |
//! | A | atoms; rows of unit norm (the paper's A is the transpose) | (n, D) | |
//! | X, x | codes; the code of one pose | (m, k) | cm |
//! | R, t, s | a placement's rotation, shift, scale: world = s R model + t | 3 x 3, 3, 1 | cm |
//! | tau | rotation about x, then y, then z: R = Rz Ry Rx | 3 | radians |
//! | q | values of a skeleton's degrees of freedom | | radians, cm |
//! | C, M, L, G | a bone's own axes; its motion there; in global axes, L = C M C^-1; its global rotation | 3 x 3 | |
//! | S | covariance of what codes leave | (D, D) | cm^2 |
//! | W, w | precisions: 1 / variance of a coordinate's noise | D | 1/cm^2 |
//!
//! The paper's errors are mean squares in raw ASF units of 5.644 cm ([`pose::ASF_UNIT_CM`]).
//!
//! # The rooms
//!
//! Arrows run one way: `pose` <- {`cluster`, `sparse`} <- `prior` <- `restore` <- `evaluate`; `io` knows `pose` alone;
//! `cli` and the binaries stand on top, and only they print, read flags or know standard input. A test holds this.
//! Everything random is seeded, everything parallel works in fixed chunks answered in order ([`numeric::parallel`]): the same input and
//! seed give the same bytes for any number of threads.

pub mod cli;
pub mod cluster;
pub mod error;
pub mod evaluate;
pub mod io;
pub mod numeric;
pub mod pose;
pub mod prior;
pub mod restore;
pub mod sparse;

pub use error::{Error, Place, Result};

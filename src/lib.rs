#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Cleans, completes, compares and poses human motion capture with pose models trained on real
//! captures.
//!
//! This library is what the commands of the project call. The README lists the commands.
//!
//! # Tour
//!
//! **Read.** A take is a table of poses: [`pose::Poses`], frames x points, in centimeters, y up,
//! NaN for a missing value. [`io::Table`] reads it from CSV or NPY; [`io::MotionFile`] opens a file
//! of any format (C3D, TRC, BVH, AMC, CSV, NPY), with its unit and axes, and writes it back. Joint
//! angles become positions by forward kinematics ([`pose::kinematics`]).
//!
//! ```
//! use posing::pose::{Body, Poses, joints};
//! use ndarray::Array2;
//!
//! let mut poses = Poses { points: joints::cmu_names(), ..Poses::default() };
//! poses.xyz = Array2::zeros((2, 69));
//! assert_eq!(poses.runs(), [0..2]); // one run: no jump in time
//! let body = Body::measure(&joints::parents_by_name(&poses.points), poses.xyz.view());
//! assert_eq!(body.lengths[1], 0.0); // the length of the left hip bone
//! ```
//!
//! **Train.** Each training pose is moved to the model's space: root at the origin, no global
//! rotation, one body size. [`cluster`] groups poses. [`sparse`] learns a dictionary by K-SVD, so
//! that each pose is approximately a sum of a few atoms. [`prior`] trains this and other pose
//! models. A trained model is one NPZ file ([`io::Model`]).
//!
//! **Restore.** A frame is an observation: values, each with the variance of its noise (0: exact;
//! infinity: missing). [`restore`] finds the placement of the pose in the world, asks the [`prior`]
//! for the posterior of the pose, rejects outliers, keeps rigid distances, and smooths over time.
//! Single frames are completed and denoised by the same posterior; takes by regression over their
//! gaps, and by smoothing over time. The built-in model knows the joints of the CMU database;
//! markers and other points are restored by [`restore::Restorer::without_model`]. Inverse
//! kinematics ([`ik`]) turns points back into joint
//! angles, which [`io`] writes as BVH or AMC.
//!
//! **Evaluate.** [`evaluate`] damages poses with known noise and gaps, scores restorations against
//! the truth, compares models on unseen takes, and draws figures.
//!
//! # Symbols
//!
//! | symbol | meaning | shape | unit |
//! |---|---|---|---|
//! | J | points of a pose | | |
//! | D | coordinates of a pose, D = 3 J | | |
//! | m | poses | | |
//! | n | atoms of a dictionary | | |
//! | kappa, k | largest number of atoms in a code (sparsity) | | |
//! | Y | poses, one per row (the transpose of Lai et al.'s Y) | (m, D) | cm |
//! | A | atoms, one per row, unit norm (the transpose of Lai et al.'s A) | (n, D) | none |
//! | X, x | sparse codes; of one pose: Y is about X A | (m, n) stored as (m, k); (k) | cm |
//! | R, t, s | placement: world = s R model + t | (3, 3); (3); 1 | none; cm; none |
//! | tau | Euler angles, about x, then y, then z: R = Rz Ry Rx | (3) | radians |
//! | q | degrees of freedom of a skeleton | (dofs) | radians or cm |
//! | C | axes of a bone in the rest pose | (3, 3) | none |
//! | M | rotation of a bone in its own axes | (3, 3) | none |
//! | L | rotation of a bone relative to its parent, L = C M C^-1 | (3, 3) | none |
//! | G | rotation of a bone in the world: G = G_parent L | (3, 3) | none |
//! | S | covariance of the residual of sparse coding | (D, D) | cm^2 |
//! | W, w | precisions: 1 / variance of each coordinate's noise | (D) | 1/cm^2 |
//!
//! Rows are frames, atoms and centroids everywhere. Angles are in radians, except in files.
//! Lai et al. give errors as mean squares in raw ASF units of 5.644 cm ([`pose::ASF_UNIT_CM`]).
//!
//! # Modules
//!
//! | module | contents |
//! |---|---|
//! | [`numeric`] | linear algebra, Gaussians, SIMD, deterministic parallelism |
//! | [`pose`] | poses, skeletons, kinematics, rotations, placements, units |
//! | [`io`] | motion files (ASF, AMC, BVH, C3D, TRC, CSV, NPY), meshes, models |
//! | [`draw`] | figures as SVG, pages that play poses and meshes |
//! | [`cluster`] | k-means, hierarchical k-means |
//! | [`sparse`] | orthogonal matching pursuit, K-SVD, dictionaries, search over atoms |
//! | [`prior`] | pose models behind one trait, a registry by name |
//! | [`label`] | which track is which point: swaps, pieces without a label |
//! | [`restore`] | completion, denoising, outliers, gaps, rigid distances |
//! | [`ik`] | joint angles of a skeleton from its joints, clean rotations, other rigs |
//! | [`solve`] | joints and their angles under markers |
//! | [`audit`] | what is wrong in a take: rate, unit, axis, gaps, swaps |
//! | [`clean`] | whole takes of any format, cleaned, with a record beside each |
//! | [`metric`] | pose descriptors, how alike two poses are, transitions |
//! | [`body`] | body meshes: parts, pose and shape, skinning |
//! | [`edit`] | posing by hand: sessions of drags, pins, key poses, photographs |
//! | [`server`] | the page of posing by hand, and the local server behind it |
//! | [`evaluate`] | damage, scores, benchmark, report, page of pairs to label |
//! | [`cli`] | arguments, streams, messages, manual pages of the commands |
//!
//! Each is shown from a crate of the workspace, by whose name the examples call it:
//! `posing_io::Table` is `posing::io::Table`.
//!
//! | crate | modules | imports |
//! |---|---|---|
//! | posing-core | error, numeric, pose |  |
//! | posing-io | io | core |
//! | posing-draw | draw | core, io |
//! | posing-models | cluster, prior, sparse | core, io |
//! | posing-label | label | core, io |
//! | posing-restore | restore | core, io, label, models |
//! | posing-joints | ik, solve | core, draw, io, label, models |
//! | posing-clean | audit, clean | core, draw, io, joints, label, models, restore |
//! | posing-likeness | metric | core, draw, io |
//! | posing-body | body | core, io |
//! | posing-edit | edit, server | core, draw, io, joints, models, restore |
//! | posing-score | evaluate | core, draw, io, models, restore |
//! | posing-papers | evaluate, metric, prior | core, draw, io, likeness, models, restore, score |
//!
//! Only [`cli`] and the program read arguments, read standard input, or print.
//!
//! Random numbers are seeded, and parallel work is split into fixed chunks that are combined in
//! order ([`numeric::parallel`]). The same input and seed therefore give the same bytes with any
//! number of threads.
//!
//! # Features
//!
//! | feature | adds |
//! |---|---|
//! | `openblas` (default) | dense decompositions by the system's OpenBLAS; without it, by faer |
//! | `cli` (default) | the program and [`cli`]; brings `server` |
//! | `server` | [`server`] |
//! | `papers` (default) | what papers compare with: [`prior::published`], learners besides RDSR, distances, the benchmark |
//!
//! # Contributing
//!
//! A name runs through the tree: `src/bin/posing/denoise.rs` parses the flags,
//! `crates/restore/src/denoise.rs` is the method, `tests/it/denoise.rs` tests the command,
//! `man/denoise.1` is its manual page. A new pose model is a file in [`prior`] and a line in its
//! registry. A new format is a file in [`io`].
//!
//! `make test` runs all tests, `make bless` writes the manual pages again, `make bench` measures
//! speed.

#[cfg(feature = "cli")]
pub mod cli;
pub mod prelude;

/// Pose models behind one trait, with those that papers compare with.
pub mod prior {
    #[doc(inline)]
    pub use posing_models::prior::*;
    #[cfg(feature = "papers")]
    #[doc(inline)]
    pub use posing_papers::published;
}

/// How alike two poses are: descriptors, metrics, transitions; with the distances and learners that
/// papers compare with.
pub mod metric {
    #[doc(inline)]
    pub use posing_likeness::*;
    #[cfg(feature = "papers")]
    #[doc(inline)]
    pub use posing_papers::{Baseline, PublishedLearner, baselines};
}

/// Inverse kinematics: a skeleton's degrees of freedom from the positions of its joints.
pub mod ik {
    #[doc(inline)]
    pub use posing_joints::ik::*;
    #[doc(inline)]
    pub use posing_likeness::{Blend, Blender};
}

/// Damage to clean poses, scores of restored ones, figures, and the benchmark that compares models.
pub mod evaluate {
    #[doc(inline)]
    pub use posing_likeness::pair_label;
    #[cfg(feature = "papers")]
    #[doc(inline)]
    pub use posing_papers::{benchmark, report, retrieval};
    #[doc(inline)]
    pub use posing_score::*;
}

#[doc(inline)]
pub use posing_body as body;
#[doc(inline)]
pub use posing_clean::{audit, clean};
#[doc(inline)]
pub use posing_core::{Error, Place, Result, error, numeric, pose};
#[doc(inline)]
pub use posing_draw as draw;
#[doc(inline)]
pub use posing_edit::edit;
#[cfg(feature = "server")]
#[doc(inline)]
pub use posing_edit::server;
#[doc(inline)]
pub use posing_io as io;
#[doc(inline)]
pub use posing_joints::solve;
#[doc(inline)]
pub use posing_label as label;
#[doc(inline)]
pub use posing_models::{cluster, sparse};
#[doc(inline)]
pub use posing_restore as restore;

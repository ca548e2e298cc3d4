#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Cleans, completes, compares and poses human motion capture with pose models trained on real
//! captures.
//!
//! This library is what the commands of the project call. The README lists the commands.
//!
//! # Tour
//!
//! **Read.** [`io::MotionFile`] opens a file of any format (C3D, TRC, BVH, AMC, CSV, NPY, ...) with
//! its unit, its axes and its rate, and writes it back with all else that it holds. Its points are
//! [`pose::Poses`]: frames x points, in centimeters, y up, NaN for a missing value.
//!
//! ```
//! use posing::prelude::*;
//!
//! let gait = "testdata/examples/biomechanist/gait.c3d";
//! let file = MotionFile::open(gait, &ReadOptions::default())?;
//! assert_eq!((file.poses().frames(), file.rate()), (158, Some(60.0)));
//! # Ok::<(), posing::Error>(())
//! ```
//!
//! **Label.** [`label`] finds markers that changed places, and tracks without a name; the moves are
//! made in memory or written. **Solve.** [`solve`] puts a skeleton under the markers: joints, their
//! deviations and their angles.
//!
//! ```
//! # use posing::prelude::*;
//! # let gait = "testdata/examples/biomechanist/gait.c3d";
//! # let file = MotionFile::open(gait, &ReadOptions::default())?;
//! let report = check_labels(&file, &LabelSettings::default())?;
//! let labeled = file.moved(&report.moves)?;
//! let settings = SolveSettings { joints: JointSet::Anatomical, ..SolveSettings::default() };
//! let solved = solve(labeled.poses(), &settings, &mut |_frames| {})?;
//! let knee = solved.joints.angle(["LHJC", "LKJC", "LAJC"])?;
//! assert_eq!(knee.len(), 158);
//! let bvh = solved.to_bvh(60.0)?;
//! # assert_eq!(bvh.motion.nrows(), 158);
//! # Ok::<(), posing::Error>(())
//! ```
//!
//! **Clean.** Positions: a frame is an observation, values each with the variance of its noise (0:
//! exact; infinity: missing). [`restore`] finds the placement of the pose in the world, asks the
//! [`prior`] for the posterior of the pose, rejects outliers, keeps rigid distances, fills gaps and
//! smooths over time; without a model it learns from the take itself. Rotations of BVH and AMC
//! files are cleaned as such ([`ik::rotation_cleaning`]). [`clean`] does both to whole folders,
//! with a record beside each file; [`audit`] only says what is wrong.
//!
//! ```
//! # use posing::prelude::*;
//! # let gait = "testdata/examples/biomechanist/gait.c3d";
//! # let file = MotionFile::open(gait, &ReadOptions::default())?;
//! let method = Clean { fps: file.rate(), ..Clean::default() };
//! let cleaned = Restorer::without_model().clean(&file.table, &method)?;
//! assert_eq!(cleaned.xyz(), file.poses().xyz); // there is nothing to clean
//! let (c3d, out_of_range) = file.bytes_with_points(cleaned.xyz())?;
//! # assert_eq!(out_of_range, 0);
//! # assert!(c3d == std::fs::read(gait).unwrap());
//! # Ok::<(), posing::Error>(())
//! ```
//!
//! ```
//! # use posing::prelude::*;
//! # let walk = std::fs::read("testdata/examples/animator/goblin.bvh").unwrap();
//! let file = MotionFile::from_bytes("walk.bvh", walk, &ReadOptions::default())?;
//! let (motion, rate) = file.motion().zip(file.rate()).ok_or("no rotations")?;
//! let how = RotationCleaning::default();
//! let cleaned = clean_rotations(&file.channels(), motion, rate, &how);
//! let bvh: Vec<u8> = file.bytes_with_motion(cleaned.motion.view())?;
//! # Ok::<(), posing::Error>(())
//! ```
//!
//! **Retarget.** [`ik::retarget`] carries a motion over to another rig: directions of limbs stay,
//! feet stand where they stood.
//!
//! ```
//! # use posing::prelude::*;
//! # let asf = Asf::open("testdata/cmu/07/07.asf")?;
//! # let walk = Amc::open("testdata/cmu/07/07_01.amc", &asf)?.to_bvh(120.0)?;
//! let rig = Bvh::open("testdata/examples/animator/goblin.bvh")?;
//! let rig = Retargeter::new(rig, UpAxis::Y, None)?;
//! let done = rig.retarget(&walk, &RetargetOptions::default())?;
//! assert_eq!(done.bvh.motion.nrows(), walk.motion.nrows());
//! # Ok::<(), posing::Error>(())
//! ```
//!
//! **Ground.** [`ik::ground`] finds the floor under a take, levels it and keeps feet from sliding.
//!
//! ```
//! # use posing::prelude::*;
//! # use posing::ik::ground::{GroundOptions, ground_rotations};
//! # let asf = Asf::open("testdata/cmu/07/07.asf")?;
//! # let walk = Amc::open("testdata/cmu/07/07_01.amc", &asf)?.to_bvh(120.0)?;
//! let grounded = ground_rotations(&walk, &GroundOptions::default())?;
//! let floor = grounded.report.floor.ok_or("never stands")?;
//! assert!(floor.slope < 2.0 && grounded.report.slide[1] < 0.2); // degrees, centimeters
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **Train.** The built-in model knows the joints of the CMU database. One of your own: each pose
//! is moved to the model's space (root at the origin, no global rotation, one body size);
//! [`cluster`] groups poses, [`sparse`] learns a dictionary by K-SVD, so that each pose is nearly a
//! sum of a few atoms, and [`prior`] trains this and other pose models. A model is one NPZ file
//! ([`io::Model`]).
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
//! | [`io`] | motion files (ASF, AMC, BVH, FBX, C3D, TRC, CSV, NPY), meshes, models |
//! | [`draw`] | figures as SVG, pages that play poses and meshes |
//! | [`cluster`] | k-means, hierarchical k-means |
//! | [`sparse`] | orthogonal matching pursuit, K-SVD, dictionaries, search over atoms |
//! | [`prior`] | pose models behind one trait, a registry by name |
//! | [`label`] | which track is which point: swaps, pieces without a label |
//! | [`inbetween`] | whole bodies over gaps, from motion that is known |
//! | [`restore`] | completion, denoising, outliers, gaps, rigid distances |
//! | [`ik`] | joint angles of a skeleton from its joints, clean rotations, other rigs, floors |
//! | [`ground_file`] | takes of any format, put on their floor |
//! | [`solve`] | joints and their angles under markers |
//! | [`audit`] | what is wrong in a take: rate, unit, axis, gaps, swaps |
//! | [`clean`] | whole takes of any format, cleaned, with a record beside each |
//! | [`gait`] | Plug-in Gait: angles, moments, events, cycles, values |
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
//! | posing-fbx | io | core |
//! | posing-io | io | core, fbx |
//! | posing-glb | io | core, io |
//! | posing-draw | draw | core, io |
//! | posing-models | cluster, prior, sparse | core, io |
//! | posing-label | label | core, io |
//! | posing-inbetween | inbetween | core, io |
//! | posing-restore | restore | core, inbetween, io, label, models |
//! | posing-joints | ground_file, ik, solve | core, draw, gait, io, label, models |
//! | posing-clean | audit, clean, gait | core, draw, gait, io, joints, label, models, restore |
//! | posing-gait | gait | core, draw, io |
//! | posing-likeness | evaluate, ik, metric | core, draw, io |
//! | posing-body | body | core, glb, io |
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
//! | `fbx` (default) | FBX files, by ufbx, which is C |
//! | `cli` (default) | the program and [`cli`]; brings `server` |
//! | `server` | [`server`] |
//! | `papers` (default) | models, learners and distances of papers, the benchmark |
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

/// Motion files, meshes and models.
pub mod io {
    #[cfg(feature = "fbx")]
    #[doc(inline)]
    pub use posing_fbx::{FbxChoice, FbxFile, FbxJoint, FbxMotion, FbxTake};
    #[doc(inline)]
    pub use posing_glb as glb;
    #[doc(inline)]
    pub use posing_glb::SkinnedMesh;
    #[doc(inline)]
    pub use posing_io::*;
}

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

/// Gait by Vicon's Plug-in Gait: angles, moments, events, cycles and values; files of trials.
pub mod gait {
    #[doc(inline)]
    pub use posing_clean::TrialFile;
    #[doc(inline)]
    pub use posing_gait::*;
}

/// In-betweens: whole bodies over gaps, from motion that is known.
pub mod inbetween {
    #[doc(inline)]
    pub use posing_inbetween::*;
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
pub use posing_joints::{ground_file, solve};
#[doc(inline)]
pub use posing_label as label;
#[doc(inline)]
pub use posing_models::{cluster, sparse};
#[doc(inline)]
pub use posing_restore as restore;

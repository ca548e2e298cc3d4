#![deny(unsafe_code)]
#![warn(missing_docs)]
//! Bodies: meshes whose pose and shape are learned from registered meshes.
//!
//! After D. Anguelov, P. Srinivasan, D. Koller, S. Thrun, J. Rodgers, J. Davis: SCAPE: Shape
//! Completion and Animation of People. SIGGRAPH 2005.
//!
//! A `template` is a mesh in rigid parts; [`decomposition`] describes another mesh of its topology
//! by a rotation per part and a matrix per triangle; [`pose_model`] predicts these matrices from
//! the rotations at the joints, `shape_model` what is left between people. `body_model` holds all
//! of them, and makes meshes; [`train`](mod@train) learns it. [`skinning`] fits what animation
//! software plays: linear blend skinning with corrective shapes. [`registration`] lays the template
//! on a raw scan.
//!
//! ```
//! use glam::DVec3;
//! use posing_body::surface::Surface;
//!
//! let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
//! let surface = Surface::new(corners, vec![[0, 1, 2]]);
//! let nearest = surface.nearest(DVec3::new(0.2, 0.3, 5.0)).unwrap();
//! assert!((nearest.at - DVec3::new(0.2, 0.3, 0.0)).length() < 1e-12);
//! ```

#[macro_use]
extern crate posing_core;

use posing_core::{Error, Place, Result, numeric, pose};
use posing_io as io;

pub mod animation;
pub(crate) mod body_model;
pub mod completion;
pub mod correspondence;
pub mod decomposition;
pub(crate) mod deformation_gradient;
#[doc(hidden)]
pub mod file;
pub mod fit;
pub mod fit_doubts;
pub mod fit_prior;
pub mod glb;
pub(crate) mod gradient_energy;
mod held_out;
pub mod joint_markers;
pub mod marker_model;
pub mod part_finding;
pub mod pose_model;
pub mod registration;
pub mod scan_fit;
pub(crate) mod scan_match;
pub mod shape_model;
pub mod skinning;
pub mod surface;
pub mod take;
pub mod template;
pub mod train;
pub(crate) mod vertex_jacobian;
mod warp;

pub use body_model::{BodyModel, HeldOutErrors};
pub use decomposition::Decomposer;
pub use marker_model::{Marker, MarkerModel};
pub use pose_model::PoseModel;
pub use shape_model::ShapeModel;
pub use skinning::{JointSkinning, Skinning};
pub use template::Template;

#[cfg(test)]
mod testdata;

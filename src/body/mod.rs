//! Bodies: meshes whose pose and shape are learnt from registered meshes.
//!
//! After D. Anguelov, P. Srinivasan, D. Koller, S. Thrun, J. Rodgers, J. Davis: SCAPE: Shape Completion and Animation of People.
//! SIGGRAPH 2005.
//!
//! A [`template`] is a mesh in rigid parts; [`decomposition`] describes another mesh of its topology by a rotation a part and a matrix a
//! triangle; [`pose_model`] predicts these matrices from the rotations at the joints.
//! [`skinning`] fits what animation software plays: linear blend skinning with corrective shapes.

pub mod decomposition;
pub mod pose_model;
pub mod skinning;
pub mod template;

pub use decomposition::Decomposer;
pub use pose_model::PoseModel;
pub use skinning::{JointSkinning, Skinning};
pub use template::Template;

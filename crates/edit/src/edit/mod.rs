//! Posing by hand: a pose follows the joints that are dragged, holds what is pinned, and stays
//! plausible under a pose model.

mod history;
pub mod in_betweens;
pub mod keys;
pub mod other_poses;
pub mod photograph;
pub mod pose_solver;
#[cfg(feature = "server")]
pub(crate) mod protocol;
mod rig;
mod rig_prior;
pub mod session;
mod start_poses;

pub use history::History;
pub use rig::Rig;
pub use rig_prior::{for_rig, open_model};
pub use session::{Drags, LARGEST_SESSION, Pins, Session, rows_of_table};
pub use start_poses::StartPose;

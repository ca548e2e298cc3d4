//! Takes put on a level floor: its height, slope and slow drift taken out, feet held where they
//! stand.
//!
//! Points of feet stand where they are slow (`stance`); a plane with a slow drift is fitted to them
//! (`floor`) and carried to y = 0, and the whole body with it. Then each foot is held on the middle
//! of each contact by the legs, with the solver of [`retarget`](super::retarget) (`hold`). Lengths
//! of bones stay, and whatever is not moved keeps its values.
//!
//! Two takes are left as they are: one that never stands, and one on whose floor fewer than six of
//! ten stances fit, as on stairs.

mod contacts;
mod feet;
mod floor;
mod hold;
mod legs;
mod motion;
mod points;
mod report;
mod rotations;
mod stance;
mod tuning;

pub use points::ground_points;
pub use report::{Contact, FloorReport, GroundReport, Grounded, Standing};
pub use rotations::{GroundOptions, ground_rotations};

//! Posing by hand: a pose follows the points that are dragged, and stays plausible under a pose model.

mod session;

pub use session::Session;

//! Readers and writers, nothing else: they know `pose` and no flags.

pub mod amc;
pub mod asf;
pub mod bvh;
pub mod cells;
pub mod csv;
pub mod input;
mod matrix;
pub mod model;
pub mod npy;
pub mod output;
pub mod table;
pub mod text;

pub use input::Input;
pub use model::Model;
pub use table::{Columns, Row, Table};

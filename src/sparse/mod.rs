//! Sparse coding: a pose as a sum of a few atoms of a dictionary, and dictionaries learnt from poses.
//!
//! | file | what it is |
//! |---|---|
//! | [`dictionary`] | atoms in rows, of unit norm |
//! | [`pursuit`] | the parameters of coding; one pose at a time |
//! | [`batch`] | many poses at a time, by matrix products |
//! | [`ksvd`] | learning a dictionary from poses |
//! | [`size`] | how many atoms a given error asks for |
//! | [`mod@concat`] | joining dictionaries, finding and dropping near duplicates |
//! | `tile`, `fit` | the scan over all atoms for a tile of poses; the growing fit of one pose |
//! | `draw`, `update`, `rank_one`, `replace` | the atoms that learning starts from, their update, new ones for useless ones |
//! | `nearness` | how close atoms are to each other |

pub mod batch;
pub mod concat;
pub mod dictionary;
mod draw;
mod fit;
pub mod ksvd;
mod nearness;
pub mod pursuit;
mod rank_one;
mod replace;
pub mod size;
mod tile;
mod update;

pub use batch::{Codes, UNUSED};
pub use concat::{Closeness, Concat, Joined};
pub use dictionary::Dictionary;
pub use ksvd::{Ksvd, Report, State, draw};
pub use pursuit::{Code, Pursuit, Rule, Stop, Tolerance, refit};
pub use size::{SizeSearch, Start, Tried};

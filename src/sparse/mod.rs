//! Sparse coding: a pose as a sum of a few atoms of a dictionary, and dictionaries learnt from poses.
//!
//! | file | what it is |
//! |---|---|
//! | [`dictionary`] | atoms in rows, of unit norm |
//! | [`pursuit`] | the parameters of coding; one pose at a time |
//! | [`batch`] | many poses at a time, by matrix products |
//! | [`weighted`] | a dictionary as poses with the same weights see it |
//! | [`code`] | what coding a pose gives; the best coefficients of given atoms |
//! | [`ksvd`], [`state`] | learning a dictionary from poses; how far it has come |
//! | [`size`] | how many atoms a given error asks for |
//! | [`mod@concat`] | joining dictionaries, finding and dropping near duplicates |
//! | `desk` | poses of a batch shared among threads; room that is kept from batch to batch |
//! | `tile`, `group` | atoms found by scans for a tile of poses; by bounds for a group of them |
//! | `fit` | the growing fit of one pose |
//! | `draw`, `update`, `rank_one`, `replace`, `keep` | the atoms that learning starts from, their update, new ones for useless ones, old codes that are better |
//! | `nearness` | how close atoms are to each other |

pub mod batch;
pub mod code;
mod column;
pub mod concat;
mod desk;
pub mod dictionary;
mod draw;
mod fit;
mod group;
mod keep;
pub mod ksvd;
mod nearness;
pub mod pursuit;
mod rank_one;
mod replace;
mod scan;
pub mod size;
pub mod state;
#[cfg(test)]
mod testdata;
mod tile;
mod update;
pub mod weighted;

pub use batch::{Codes, Search, UNUSED};
pub use code::{Code, Stop, refit};
pub use concat::{Closeness, Concat, Joined};
pub use desk::Coder;
pub use dictionary::Dictionary;
pub use ksvd::{Ksvd, draw};
pub use pursuit::{Pursuit, Rule, Tolerance};
pub use size::{SizeSearch, Start, Tried};
pub use state::{Report, State};
pub use weighted::Weighted;

//! The best atom of a pose, by a dense scan, the Gram matrix, or a ball tree over the atoms.
//!
//! | file | content |
//! |---|---|
//! | [`packed_atoms`], [`panel_kernel`], [`argmax`] | atoms side by side, products, the best |
//! | [`dense_scan`] | compares all atoms, for a tile of poses |
//! | [`gram`], [`gram_omp`] | products of atoms with one another, and steps of pursuit by them |
//! | [`pca_projection`], [`ball_tree`], [`tree_search`] | near atoms together, search by bounds |
//! | [`index_cache`] | the structures of a dictionary, built when first used |

mod argmax;
mod ball_tree;
mod dense_scan;
mod gram;
mod gram_omp;
mod index_cache;
mod packed_atoms;
mod panel_kernel;
mod pca_projection;
mod tree_search;

pub(crate) use ball_tree::BallTree;
pub(crate) use dense_scan::DenseScan;
pub(crate) use gram::{LazyGram, Term, products};
pub(crate) use gram_omp::GramOmp;
pub(crate) use index_cache::IndexCache;
pub(crate) use packed_atoms::PackedAtoms;
pub(crate) use panel_kernel::UNSEEN;
pub(crate) use tree_search::{MOST_ATOMS, TreeSearch};

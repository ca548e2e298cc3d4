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

pub use ball_tree::BallTree;
pub use dense_scan::DenseScan;
pub use gram::{LazyGram, Term, products};
pub use gram_omp::GramOmp;
pub use index_cache::IndexCache;
pub use packed_atoms::PackedAtoms;
pub use panel_kernel::UNSEEN;
pub use tree_search::{MOST_ATOMS, TreeSearch};

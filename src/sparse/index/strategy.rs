//! A search by bounds: by leaves, or of fewer atoms by a sieve.

use super::ball_tree::BallTree;
use super::branch_and_bound::{self, BranchAndBound, Query, SearchResult};
use super::cost_model::PruningStats;
use super::filter_refine::{self, FilterRefine};
use super::pca_projection::PcaProjection;
use super::quantized_table::{QuantizedTable, SHORT};
use crate::numeric::simd;
use ndarray::ArrayView2;

/// A sieve serves up to so many atoms a lane of the machine's vectors, measured; of more most need not be looked at, as leaves
/// tell.
const SIEVED: usize = 1280;

/// Which bounds. What is found is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    BallTree,
    QuantizedTable,
}

impl Kind {
    /// For n atoms of d numbers.
    pub fn of(n: usize, d: usize) -> Kind {
        // Of fewer numbers the first of a head are no small part.
        match n <= SIEVED * simd::widest_lanes() && d >= 2 * SHORT {
            true => Kind::QuantizedTable,
            false => Kind::BallTree,
        }
    }
}

/// What was made of a dictionary's atoms.
pub enum Made {
    BallTree(BallTree),
    QuantizedTable(QuantizedTable),
}

impl Made {
    /// Of atoms (n, D) of unit norm.
    pub fn of(atoms: ArrayView2<'_, f32>) -> Made {
        match Kind::of(atoms.nrows(), atoms.ncols()) {
            Kind::BallTree => Made::BallTree(BallTree::new(atoms)),
            Kind::QuantizedTable => Made::QuantizedTable(QuantizedTable::new(atoms)),
        }
    }

    /// The same, to search by.
    pub fn bounds(&self) -> Bounds<'_> {
        match self {
            Made::BallTree(leaves) => Bounds::BallTree(leaves),
            Made::QuantizedTable(sieve) => Bounds::QuantizedTable(sieve),
        }
    }
}

/// What is known of all atoms to search them by bounds.
#[derive(Clone, Copy)]
pub enum Bounds<'a> {
    BallTree(&'a BallTree),
    QuantizedTable(&'a QuantizedTable),
}

/// Room for such searches.
pub enum Searcher<'a> {
    BallTree(BranchAndBound<'a>),
    QuantizedTable(Box<FilterRefine<'a>>),
}

impl<'a> Bounds<'a> {
    /// Room for searches of so many poses at most, together. `atoms` are (n, D).
    pub fn searcher(self, atoms: &'a [f32], poses: usize) -> Searcher<'a> {
        match self {
            Bounds::BallTree(leaves) => Searcher::BallTree(BranchAndBound::new(leaves)),
            Bounds::QuantizedTable(sieve) => {
                Searcher::QuantizedTable(Box::new(FilterRefine::new(sieve, atoms, poses)))
            }
        }
    }

    /// Poses that are best sought for together.
    pub fn together(self) -> usize {
        match self {
            Bounds::BallTree(_) => branch_and_bound::TOGETHER,
            Bounds::QuantizedTable(_) => filter_refine::POSES,
        }
    }

    /// The directions of heads.
    pub fn basis(self) -> &'a PcaProjection {
        match self {
            Bounds::BallTree(leaves) => &leaves.basis,
            Bounds::QuantizedTable(sieve) => &sieve.basis,
        }
    }

    /// What searches have cost.
    pub fn tally(self) -> &'a PruningStats {
        match self {
            Bounds::BallTree(leaves) => &leaves.tally,
            Bounds::QuantizedTable(sieve) => &sieve.tally,
        }
    }

    /// Rows of lanes that a scan of atoms of `d` numbers multiplies a step.
    pub fn scan(self, d: usize) -> usize {
        match self {
            Bounds::BallTree(leaves) => leaves.scan(),
            Bounds::QuantizedTable(sieve) => sieve.scan(d),
        }
    }
}

impl Searcher<'_> {
    /// A pose begins in a slot.
    pub fn begin(&mut self, slot: usize) {
        match self {
            Searcher::BallTree(_) => {}
            Searcher::QuantizedTable(sift) => sift.begin(slot),
        }
    }

    /// The best atoms of poses that have taken equally many.
    pub fn best(&mut self, sought: &[Query<'_>], found: &mut Vec<SearchResult>) {
        match self {
            Searcher::BallTree(pruned) => pruned.best(sought, found),
            Searcher::QuantizedTable(sift) => sift.best(sought, found),
        }
    }
}

//! A search by bounds: by leaves, or of fewer atoms by a sieve.

use super::heads::Basis;
use super::leaves::Leaves;
use super::pruned::{self, Found, Pruned, Sought};
use super::sieve::{SHORT, Sieve};
use super::sift::{self, Sift};
use super::tally::Tally;
use crate::numeric::simd;
use ndarray::ArrayView2;

/// A sieve serves up to so many atoms a lane of the machine's vectors, measured; of more most need not be looked at, as leaves
/// tell.
const SIEVED: usize = 1280;

/// Which bounds. What is found is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Leaves,
    Sieve,
}

impl Kind {
    /// For n atoms of d numbers.
    pub fn of(n: usize, d: usize) -> Kind {
        // Of fewer numbers the first of a head are no small part.
        match n <= SIEVED * simd::widest_lanes() && d >= 2 * SHORT {
            true => Kind::Sieve,
            false => Kind::Leaves,
        }
    }
}

/// What was made of a dictionary's atoms.
pub enum Made {
    Leaves(Leaves),
    Sieve(Sieve),
}

impl Made {
    /// Of atoms (n, D) of unit norm.
    pub fn of(atoms: ArrayView2<'_, f32>) -> Made {
        match Kind::of(atoms.nrows(), atoms.ncols()) {
            Kind::Leaves => Made::Leaves(Leaves::new(atoms)),
            Kind::Sieve => Made::Sieve(Sieve::new(atoms)),
        }
    }

    /// The same, to search by.
    pub fn bounds(&self) -> Bounds<'_> {
        match self {
            Made::Leaves(leaves) => Bounds::Leaves(leaves),
            Made::Sieve(sieve) => Bounds::Sieve(sieve),
        }
    }
}

/// What is known of all atoms to search them by bounds.
#[derive(Clone, Copy)]
pub enum Bounds<'a> {
    Leaves(&'a Leaves),
    Sieve(&'a Sieve),
}

/// Room for such searches.
pub enum Searcher<'a> {
    Leaves(Pruned<'a>),
    Sieve(Box<Sift<'a>>),
}

impl<'a> Bounds<'a> {
    /// Room for searches of so many poses at most, together. `atoms` are (n, D).
    pub fn searcher(self, atoms: &'a [f32], poses: usize) -> Searcher<'a> {
        match self {
            Bounds::Leaves(leaves) => Searcher::Leaves(Pruned::new(leaves)),
            Bounds::Sieve(sieve) => Searcher::Sieve(Box::new(Sift::new(sieve, atoms, poses))),
        }
    }

    /// Poses that are best sought for together.
    pub fn together(self) -> usize {
        match self {
            Bounds::Leaves(_) => pruned::TOGETHER,
            Bounds::Sieve(_) => sift::POSES,
        }
    }

    /// The directions of heads.
    pub fn basis(self) -> &'a Basis {
        match self {
            Bounds::Leaves(leaves) => &leaves.basis,
            Bounds::Sieve(sieve) => &sieve.basis,
        }
    }

    /// What searches have cost.
    pub fn tally(self) -> &'a Tally {
        match self {
            Bounds::Leaves(leaves) => &leaves.tally,
            Bounds::Sieve(sieve) => &sieve.tally,
        }
    }

    /// Rows of lanes that a scan of atoms of `d` numbers multiplies a step.
    pub fn scan(self, d: usize) -> usize {
        match self {
            Bounds::Leaves(leaves) => leaves.scan(),
            Bounds::Sieve(sieve) => sieve.scan(d),
        }
    }
}

impl Searcher<'_> {
    /// A pose begins in a slot.
    pub fn begin(&mut self, slot: usize) {
        match self {
            Searcher::Leaves(_) => {}
            Searcher::Sieve(sift) => sift.begin(slot),
        }
    }

    /// The best atoms of poses that have taken equally many.
    pub fn best(&mut self, sought: &[Sought<'_>], found: &mut Vec<Found>) {
        match self {
            Searcher::Leaves(pruned) => pruned.best(sought, found),
            Searcher::Sieve(sift) => sift.best(sought, found),
        }
    }
}

//! Atoms laid out for searches.

use super::strategy::{Bounds, Kind, Made};
use super::{LazyGram, PackedAtoms};
use ndarray::ArrayView2;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// BallTree are made for so many poses, and a sieve for so many: it costs what so many scans do,
const WORTH_LEAVES: usize = 1024;
const WORTH_SIEVE: usize = 384;
/// one that is coded alone counted as so many, as it shares its scans with none,
pub const ALONE: usize = 16;
/// of poses with up to so many numbers: it grows with their square.
const MOST_NUMBERS: usize = 384;

/// Atoms laid out for searches, each layout made when it is first asked for.
pub struct IndexCache {
    panels: OnceLock<PackedAtoms>,
    /// Room for rows of the Gram matrix, where it is not too large: they serve so few atoms better than bounds.
    pub gram: Option<LazyGram>,
    bounds: OnceLock<Made>,
    /// Whether a thread has begun to make those.
    begun: AtomicBool,
    /// Poses that were coded so far.
    coded: AtomicUsize,
}

impl IndexCache {
    /// For n atoms.
    pub fn new(n: usize) -> IndexCache {
        IndexCache {
            panels: OnceLock::new(),
            gram: LazyGram::new(n),
            bounds: OnceLock::new(),
            begun: AtomicBool::new(false),
            coded: AtomicUsize::new(0),
        }
    }

    /// Poses are coded: `poses` of them as part of many, or one that counts for as many.
    pub fn count(&self, poses: usize) {
        self.coded.fetch_add(poses, Ordering::Relaxed);
    }

    /// The atoms (n, D) as scans read them.
    pub fn panels(&self, atoms: ArrayView2<'_, f32>) -> &PackedAtoms {
        self.panels.get_or_init(|| PackedAtoms::new(atoms))
    }

    /// Makes all rows of the Gram matrix, where there is one and so many poses more, each with up to `sparsity` atoms, will have
    /// asked for many of them.
    pub fn fill_gram(&self, atoms: ArrayView2<'_, f32>, poses: usize, sparsity: usize) {
        let coded = self.coded.load(Ordering::Relaxed).saturating_add(poses);
        let asked = coded.saturating_mul(sparsity - 1);
        if let (Some(gram), Some(flat)) = (&self.gram, atoms.as_slice())
            && asked >= atoms.nrows() / 2
        {
            gram.fill(self.panels(atoms), flat);
        }
    }

    /// How so many more poses of `d` numbers are sought by bounds, if that is worth it.
    pub fn has_bounds(&self, poses: usize, n: usize, d: usize) -> Option<Kind> {
        let kind = Kind::of(n, d);
        let is_worth = match self.bounds.get() {
            Some(made) => !made.bounds().tally().is_useless(),
            None => {
                let all = self.coded.load(Ordering::Relaxed).saturating_add(poses);
                let enough = match kind {
                    Kind::BallTree => WORTH_LEAVES,
                    Kind::QuantizedTable => WORTH_SIEVE,
                };
                self.gram.is_none() && all >= enough && d <= MOST_NUMBERS
            }
        };
        is_worth.then_some(kind)
    }

    /// What bounds need of the atoms (n, D), made now if it is not; none while another thread is at it, which need not be
    /// waited for: scans find the same.
    pub fn bounds(&self, atoms: ArrayView2<'_, f32>) -> Option<Bounds<'_>> {
        // Not within the lock: a thread that waits for parts of this may take up other work, which may ask for it too.
        if self.bounds.get().is_none() && !self.begun.swap(true, Ordering::Relaxed) {
            let _ = self.bounds.set(Made::of(atoms));
        }
        self.bounds.get().map(Made::bounds)
    }
}

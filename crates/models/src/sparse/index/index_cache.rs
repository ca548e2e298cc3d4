//! The search structures of a dictionary. Each is built when it is first used, and kept.

use super::ball_tree::BallTree;
use super::gram::LazyGram;
use super::packed_atoms::PackedAtoms;
use ndarray::ArrayView2;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The ball tree is built for this many poses: building it costs what as many dense scans cost.
const WORTH_TREE: usize = 1024;
/// The ball tree serves poses of up to this many coordinates: the cost of its basis grows with
/// their square.
const MOST_NUMBERS: usize = 384;

/// The search structures of a dictionary, and the number of poses coded with it, which decides when
/// to build them.
pub(crate) struct IndexCache {
    panels: OnceLock<PackedAtoms>,
    /// The Gram matrix; `None` if it would be too large.
    pub gram: Option<LazyGram>,
    tree: OnceLock<BallTree>,
    /// Whether a thread has begun to build the tree.
    begun: AtomicBool,
    /// The number of poses coded so far.
    coded: AtomicUsize,
}

impl IndexCache {
    /// An empty cache for n atoms.
    pub(crate) fn new(n: usize) -> IndexCache {
        IndexCache {
            panels: OnceLock::new(),
            gram: LazyGram::new(n),
            tree: OnceLock::new(),
            begun: AtomicBool::new(false),
            coded: AtomicUsize::new(0),
        }
    }

    /// Adds to the number of poses coded.
    pub fn count(&self, poses: usize) {
        self.coded.fetch_add(poses, Ordering::Relaxed);
    }

    /// The atoms (n, D), packed for dense scans.
    pub(crate) fn panels(&self, atoms: ArrayView2<'_, f32>) -> &PackedAtoms {
        self.panels.get_or_init(|| PackedAtoms::new(atoms))
    }

    /// Computes all rows of the Gram matrix, if coding `poses` more poses with up to `sparsity`
    /// atoms is likely to use many.
    pub(crate) fn fill_gram(&self, atoms: ArrayView2<'_, f32>, poses: usize, sparsity: usize) {
        let coded = self.coded.load(Ordering::Relaxed).saturating_add(poses);
        let asked = coded.saturating_mul(sparsity - 1);
        if let (Some(gram), Some(flat)) = (&self.gram, atoms.as_slice())
            && asked >= atoms.nrows() / 2
        {
            gram.fill(self.panels(atoms), flat);
        }
    }

    /// Whether the ball tree pays off for this many more poses of `d` coordinates.
    pub(crate) fn wants_tree(&self, poses: usize, d: usize) -> bool {
        let all = self.coded.load(Ordering::Relaxed).saturating_add(poses);
        self.gram.is_none() && all >= WORTH_TREE && d <= MOST_NUMBERS
    }

    /// The ball tree over the atoms (n, D), built by the first caller; `None` while another thread
    /// builds it.
    pub(crate) fn tree(&self, atoms: ArrayView2<'_, f32>) -> Option<&BallTree> {
        // Not inside the lock: a thread that waits for the parallel build may take up other work
        // that asks for the tree.
        if self.tree.get().is_none() && !self.begun.swap(true, Ordering::Relaxed) {
            let _ = self.tree.set(BallTree::new(atoms));
        }
        self.tree.get()
    }
}

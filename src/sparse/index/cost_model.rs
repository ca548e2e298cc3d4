//! Whether searches by bounds are worth it.

use std::sync::atomic::{AtomicU64, Ordering};

/// The number of searches before the statistics are used.
const TRIED: u64 = 64;

/// Compares the cost of tree searches with that of dense scans, in rows of lanes multiplied. The codes do not depend on it.
/// Aligned, because threads write to it while others read the fields beside it.
#[repr(align(128))]
pub struct PruningStats {
    /// Cost of a row in a dense scan relative to a row in a search.
    worth: f64,
    spent: AtomicU64,
    scans: AtomicU64,
    searches: AtomicU64,
}

impl PruningStats {
    /// Empty statistics; `worth` is the cost of a row in a dense scan relative to a row in a search.
    pub fn new(worth: f64) -> PruningStats {
        PruningStats {
            worth,
            spent: AtomicU64::new(0),
            scans: AtomicU64::new(0),
            searches: AtomicU64::new(0),
        }
    }

    /// Adds `count` searches that multiplied `spent` rows in place of the `scans` rows of dense scans.
    pub fn searches(&self, count: usize, spent: usize, scans: usize) {
        self.spent.fetch_add(spent as u64, Ordering::Relaxed);
        self.scans.fetch_add(scans as u64, Ordering::Relaxed);
        self.searches.fetch_add(count as u64, Ordering::Relaxed);
    }

    /// Adds dense scans that were needed after a search.
    pub fn scans(&self, count: usize, scan: usize) {
        let rows = (count * scan) as u64;
        self.spent.fetch_add(rows, Ordering::Relaxed);
    }

    /// Whether dense scans would have cost less.
    pub fn is_useless(&self) -> bool {
        let [spent, scans, searches] =
            [&self.spent, &self.scans, &self.searches].map(|n| n.load(Ordering::Relaxed));
        searches >= TRIED && spent as f64 > self.worth * scans as f64
    }
}

//! Whether searches by bounds are worth it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Searches that are made in any case.
const TRIED: u64 = 64;

/// What searches of a dictionary have cost, and what scans in their place would have, in rows of lanes multiplied. What is
/// found does not depend on it. In lines of the cache of its own: threads write to it while others read what is beside it.
#[repr(align(128))]
pub struct PruningStats {
    /// A row multiplied in a scan costs as much as so many in a search.
    worth: f64,
    spent: AtomicU64,
    scans: AtomicU64,
    searches: AtomicU64,
}

impl PruningStats {
    /// Nothing yet; a row multiplied in a scan costs as much as `worth` of a search.
    pub fn new(worth: f64) -> PruningStats {
        PruningStats {
            worth,
            spent: AtomicU64::new(0),
            scans: AtomicU64::new(0),
            searches: AtomicU64::new(0),
        }
    }

    /// So many searches that multiplied `spent` rows, where as many scans multiply `scans`.
    pub fn searches(&self, count: usize, spent: usize, scans: usize) {
        self.spent.fetch_add(spent as u64, Ordering::Relaxed);
        self.scans.fetch_add(scans as u64, Ordering::Relaxed);
        self.searches.fetch_add(count as u64, Ordering::Relaxed);
    }

    /// Scans that had to be made after all.
    pub fn scans(&self, count: usize, scan: usize) {
        let rows = (count * scan) as u64;
        self.spent.fetch_add(rows, Ordering::Relaxed);
    }

    /// Whether scans cost less: they multiply a row for several poses at once.
    pub fn is_useless(&self) -> bool {
        let [spent, scans, searches] =
            [&self.spent, &self.scans, &self.searches].map(|n| n.load(Ordering::Relaxed));
        searches >= TRIED && spent as f64 > self.worth * scans as f64
    }
}

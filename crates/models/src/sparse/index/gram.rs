//! The Gram matrix of the atoms, <a_i, a_j>, and matching pursuit with its rows. Rows are computed
//! when first used, or all at once if many poses are coded.
//!
//! The direction that an atom adds is a combination of the atoms taken, q = Σ w_j a_j. So its
//! products with all atoms are the same combination of rows of the Gram matrix: k multiplications
//! per atom, where a dense scan needs D (Rubinstein, Zibulevsky, Elad 2008).

use super::dense_scan::DenseScan;
use super::packed_atoms::{PackedAtoms, Row};
use crate::numeric::parallel;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// The largest Gram matrix in bytes: that of 2,048 atoms. Rows of a larger one are so far from the
/// cache that a dense scan is as fast.
const MEMORY: usize = 16 << 20;
/// The number of rows computed together on demand: as many as the kernel holds in registers.
const TOGETHER: usize = 6;
/// The number of rows computed together if all are: the atoms are read once for all of them.
const MANY: usize = 60;

/// A term of a direction: the weight of an atom, and its products with all atoms.
pub(crate) type Term<'a> = (f32, &'a [Row]);

/// The rows of the Gram matrix; each is as long as all panels.
pub(crate) struct LazyGram {
    rows: Vec<OnceLock<StoredRow>>,
    /// All rows before this one are computed, or about to be.
    begun: AtomicUsize,
}

/// A row, stored with those computed together: allocating row by row is slow.
struct StoredRow {
    rows: Arc<Vec<Row>>,
    from: usize,
    panels: usize,
}

impl StoredRow {
    fn row(&self) -> &[Row] {
        &self.rows[self.from..][..self.panels]
    }
}

impl LazyGram {
    /// A matrix without rows; `None` if all rows would take more than [`MEMORY`].
    pub(crate) fn new(n: usize) -> Option<LazyGram> {
        let fits = n.saturating_mul(n).saturating_mul(size_of::<f32>()) <= MEMORY;
        fits.then(|| LazyGram {
            rows: (0..n).map(|_| OnceLock::new()).collect(),
            begun: AtomicUsize::new(0),
        })
    }

    /// The products of an atom with all atoms. `atoms` (n, D) are those of `panels`.
    pub(crate) fn row(&self, panels: &PackedAtoms, atoms: &[f32], atom: u32) -> &[Row] {
        let stored = self.rows[atom as usize].get_or_init(|| StoredRow {
            rows: Arc::new(products(panels, row_of(panels, atoms, atom))),
            from: 0,
            panels: panels.iter().len(),
        });
        stored.row()
    }

    /// Computes all missing rows on all threads, but those that other threads compute already.
    pub(crate) fn fill(&self, panels: &PackedAtoms, atoms: &[f32]) {
        let n = self.rows.len();
        if self.begun.load(Ordering::Relaxed) >= n {
            return;
        }
        let scan = || DenseScan::new(panels, MANY);
        parallel::map_chunks_with(n, MANY, scan, |scan, _| {
            let from = self.begun.fetch_add(MANY, Ordering::Relaxed).min(n);
            let rows = from as u32..n.min(from + MANY) as u32;
            self.compute(scan, atoms, rows.collect());
        });
    }

    /// Computes the missing rows of some atoms together, which is faster than one by one.
    pub(crate) fn prepare(&self, panels: &PackedAtoms, atoms: &[f32], some: Vec<u32>) {
        if !some.iter().all(|a| self.is_stored(*a)) {
            self.compute(&mut DenseScan::new(panels, TOGETHER), atoms, some);
        }
    }

    fn is_stored(&self, atom: u32) -> bool {
        self.rows[atom as usize].get().is_some()
    }

    /// Computes missing rows, as many at a time as the scan has poses.
    fn compute(&self, scan: &mut DenseScan<'_>, atoms: &[f32], mut some: Vec<u32>) {
        some.retain(|a| !self.is_stored(*a));
        some.sort_unstable();
        some.dedup();
        for few in some.chunks(scan.poses()) {
            let directions: Vec<&[f32]> =
                few.iter().map(|a| row_of(scan.panels, atoms, *a)).collect();
            scan_directions(scan, &directions.concat());
            let panels = scan.panels.iter().len();
            let mut rows = Vec::with_capacity(few.len() * panels);
            (0..few.len()).for_each(|i| rows.extend(scan.of_pose(i)));
            let rows = Arc::new(rows);
            for (i, atom) in few.iter().enumerate() {
                let rows = Arc::clone(&rows);
                // If another thread was faster, its row has the same bits.
                let _ = self.rows[*atom as usize].set(StoredRow {
                    rows,
                    from: i * panels,
                    panels,
                });
            }
        }
    }
}

fn row_of<'a>(panels: &PackedAtoms, atoms: &'a [f32], atom: u32) -> &'a [f32] {
    let d = panels.width();
    &atoms[atom as usize * d..][..d]
}

/// The products of a direction (D) with all atoms.
pub(crate) fn products(panels: &PackedAtoms, direction: &[f32]) -> Vec<Row> {
    let mut scan = DenseScan::new(panels, 1);
    scan_directions(&mut scan, direction);
    scan.correlations
}

/// Scans for some directions, D numbers each, at most as many as the scan has poses.
fn scan_directions(scan: &mut DenseScan<'_>, directions: &[f32]) {
    let (some, none) = scan.directions.split_at_mut(directions.len());
    some.copy_from_slice(directions);
    none.fill(0.0);
    scan.begin();
    scan.first();
}

//! Products of atoms with each other: rows of the Gram matrix, made when they are first asked for, or all at once where
//! there are poses enough to ask for most of them, and kept.
//!
//! The direction that an atom adds is a sum of the atoms taken, q = Σ w_j a_j; so its product with every atom is the same
//! sum of rows of the Gram matrix, and costs a few multiplications an atom where a scan costs D.

use super::packed_atoms::Row;
use super::{DenseScan, PackedAtoms};
use crate::numeric::parallel;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// No Gram matrix is larger, bytes: 2,048 atoms. A row of a larger one comes from so far that a scan is as quick.
const MEMORY: usize = 16 << 20;
/// Rows that are made together: as many as the kernel has in registers.
const TOGETHER: usize = 6;
/// And so many where all are made: the atoms are read once for all of them.
const MANY: usize = 60;

/// A part of a direction: its weight, and the products of an atom with all atoms.
pub type Term<'a> = (f32, &'a [Row]);

/// Rows of <a_i, a_j> by atoms; as long as all panels.
pub struct LazyGram {
    rows: Vec<OnceLock<Made>>,
    /// All before this one are made, or about to be, since all were asked for.
    begun: AtomicUsize,
}

/// A row, among those that were made with it: a thread that asks for memory row by row asks the system each time.
struct Made {
    rows: Arc<Vec<Row>>,
    from: usize,
    panels: usize,
}

impl Made {
    fn row(&self) -> &[Row] {
        &self.rows[self.from..][..self.panels]
    }
}

impl LazyGram {
    /// Without rows; nothing for so many atoms that all rows would be larger than [`MEMORY`].
    pub fn new(n: usize) -> Option<LazyGram> {
        let fits = n.saturating_mul(n).saturating_mul(size_of::<f32>()) <= MEMORY;
        fits.then(|| LazyGram {
            rows: (0..n).map(|_| OnceLock::new()).collect(),
            begun: AtomicUsize::new(0),
        })
    }

    /// The products of an atom. `atoms` are (n, D), those of `panels`.
    pub fn row(&self, panels: &PackedAtoms, atoms: &[f32], atom: u32) -> &[Row] {
        let made = self.rows[atom as usize].get_or_init(|| Made {
            rows: Arc::new(products(panels, of(panels, atoms, atom))),
            from: 0,
            panels: panels.iter().len(),
        });
        made.row()
    }

    /// Makes all rows that are not there yet, on all threads; what other threads have begun to make is left to them.
    pub fn fill(&self, panels: &PackedAtoms, atoms: &[f32]) {
        let n = self.rows.len();
        if self.begun.load(Ordering::Relaxed) >= n {
            return;
        }
        let scan = || DenseScan::new(panels, MANY);
        parallel::map_chunks_with(n, MANY, scan, |scan, _| {
            let from = self.begun.fetch_add(MANY, Ordering::Relaxed).min(n);
            let rows = from as u32..n.min(from + MANY) as u32;
            self.make(scan, atoms, rows.collect());
        });
    }

    /// Makes the rows of some atoms: sooner together than one by one.
    pub fn prepare(&self, panels: &PackedAtoms, atoms: &[f32], some: Vec<u32>) {
        if !some.iter().all(|a| self.is_made(*a)) {
            self.make(&mut DenseScan::new(panels, TOGETHER), atoms, some);
        }
    }

    fn is_made(&self, atom: u32) -> bool {
        self.rows[atom as usize].get().is_some()
    }

    /// As many at a time as the scan has room for.
    fn make(&self, scan: &mut DenseScan<'_>, atoms: &[f32], mut some: Vec<u32>) {
        some.retain(|a| !self.is_made(*a));
        some.sort_unstable();
        some.dedup();
        for few in some.chunks(scan.poses()) {
            let directions: Vec<&[f32]> = few.iter().map(|a| of(scan.panels, atoms, *a)).collect();
            meet(scan, &directions.concat());
            let panels = scan.panels.iter().len();
            let mut rows = Vec::with_capacity(few.len() * panels);
            (0..few.len()).for_each(|i| rows.extend(scan.of_pose(i)));
            let rows = Arc::new(rows);
            for (i, atom) in few.iter().enumerate() {
                let rows = Arc::clone(&rows);
                // Another thread may have been sooner: its row has the same bits.
                let _ = self.rows[*atom as usize].set(Made {
                    rows,
                    from: i * panels,
                    panels,
                });
            }
        }
    }
}

fn of<'a>(panels: &PackedAtoms, atoms: &'a [f32], atom: u32) -> &'a [f32] {
    let d = panels.width();
    &atoms[atom as usize * d..][..d]
}

/// The products of a direction, D numbers, with all atoms.
pub fn products(panels: &PackedAtoms, direction: &[f32]) -> Vec<Row> {
    let mut scan = DenseScan::new(panels, 1);
    meet(&mut scan, direction);
    scan.correlations
}

/// Scans for some directions, D numbers each: as many as there is room for, or fewer.
fn meet(scan: &mut DenseScan<'_>, directions: &[f32]) {
    let (some, none) = scan.directions.split_at_mut(directions.len());
    some.copy_from_slice(directions);
    none.fill(0.0);
    scan.begin();
    scan.first();
}

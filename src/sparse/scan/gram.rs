//! Products of atoms with each other: rows of the Gram matrix, made when they are first asked for, or all at once where
//! there are poses enough to ask for most of them, and kept.
//!
//! The direction that an atom adds is a sum of the atoms taken, q = Σ w_j a_j; so its product with every atom is the same
//! sum of rows of the Gram matrix, and costs a few multiplications an atom where a scan costs D.

use super::panels::Row;
use super::{Panels, Scan};
use crate::par;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// No Gram matrix is larger, bytes: 2,048 atoms. A row of a larger one comes from so far that a scan is as quick.
const MEMORY: usize = 16 << 20;
/// Rows that are made together: as many as the kernel has in registers.
const TOGETHER: usize = 6;
/// And so many where all are made: the atoms are read once for all of them.
const MANY: usize = 60;

/// A part of a direction: its weight, and the products of an atom with all atoms.
pub type Term<'a> = (f32, &'a [Row]);

/// Rows of <a_i, a_j> by atoms; as long as all panels.
pub struct Gram {
    rows: Vec<OnceLock<Box<[Row]>>>,
    /// All before this one are made, or about to be, since all were asked for.
    begun: AtomicUsize,
}

impl Gram {
    /// Without rows; nothing for so many atoms that all rows would be larger than [`MEMORY`].
    pub fn new(n: usize) -> Option<Gram> {
        let fits = n.saturating_mul(n).saturating_mul(size_of::<f32>()) <= MEMORY;
        fits.then(|| Gram {
            rows: (0..n).map(|_| OnceLock::new()).collect(),
            begun: AtomicUsize::new(0),
        })
    }

    /// The products of an atom. `atoms` are (n, D), those of `panels`.
    pub fn row(&self, panels: &Panels, atoms: &[f32], atom: u32) -> &[Row] {
        self.rows[atom as usize]
            .get_or_init(|| products(panels, of(panels, atoms, atom)).swap_remove(0))
    }

    /// Makes all rows that are not there yet, on all threads; what other threads have begun to make is left to them.
    pub fn fill(&self, panels: &Panels, atoms: &[f32]) {
        let n = self.rows.len();
        if self.begun.load(Ordering::Relaxed) >= n {
            return;
        }
        par::map_chunks(n, MANY, |_| {
            let from = self.begun.fetch_add(MANY, Ordering::Relaxed).min(n);
            let rows = from as u32..n.min(from + MANY) as u32;
            self.make(panels, atoms, rows.collect(), MANY);
        });
    }

    /// Makes the rows of some atoms: sooner together than one by one.
    pub fn prepare(&self, panels: &Panels, atoms: &[f32], some: Vec<u32>) {
        self.make(panels, atoms, some, TOGETHER);
    }

    fn make(&self, panels: &Panels, atoms: &[f32], mut some: Vec<u32>, together: usize) {
        some.retain(|a| self.rows[*a as usize].get().is_none());
        some.sort_unstable();
        some.dedup();
        for few in some.chunks(together) {
            let directions: Vec<&[f32]> = few.iter().map(|a| of(panels, atoms, *a)).collect();
            for (atom, row) in few.iter().zip(products(panels, &directions.concat())) {
                // Another thread may have been sooner: its row has the same bits.
                let _ = self.rows[*atom as usize].set(row);
            }
        }
    }
}

fn of<'a>(panels: &Panels, atoms: &'a [f32], atom: u32) -> &'a [f32] {
    let d = panels.width();
    &atoms[atom as usize * d..][..d]
}

/// The products of each of some directions, D numbers each, with all atoms.
pub fn products(panels: &Panels, directions: &[f32]) -> Vec<Box<[Row]>> {
    let count = directions.len() / panels.width();
    let mut scan = Scan::new(panels, count);
    scan.begin();
    scan.directions.copy_from_slice(directions);
    scan.first();
    (0..count)
        .map(|i| scan.of_pose(i).copied().collect())
        .collect()
}

//! How close atoms are to one another: |<a, b>|, 1 for copies (up to sign), by blocks of products.

use super::Dictionary;
use crate::numeric::parallel;
use crate::{Error, Result};
use ndarray::{Array2, ArrayView2, s};
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Atoms whose products with a block of others are held at one time.
const TILE: usize = 128;
/// The others: 128 x 512 products take 256 kB.
const BLOCK: usize = 512;

/// Atoms with a coherence above this are copies: products of f32 unit vectors have an error of
/// about 1e-7.
const COPIES: f64 = 1.0 - 1e-6;

impl Dictionary {
    /// For each atom its greatest closeness |<a, b>| to any atom b of `others`, which is as wide.
    ///
    /// O(n n' D) time by blocks, O(n) memory.
    ///
    /// # Errors
    /// Dictionaries of different widths.
    pub(crate) fn nearest(&self, others: &Dictionary) -> Result<Vec<f32>> {
        if self.width() != others.width() {
            let widths = (self.width(), others.width());
            return Err(Error::usage(format!(
                "atoms of {} and of {} numbers",
                widths.0, widths.1
            )));
        }
        Ok(greatest(self.atoms(), others.atoms(), |_, _| true))
    }

    /// The coherence: the greatest closeness |<a, b>| of two different atoms; 0 for a single atom.
    ///
    /// O(n^2 D) time by blocks, O(n) memory.
    ///
    /// ```
    /// use posing_models::sparse::Dictionary;
    ///
    /// // The cosine of the angle between the atoms that are nearest to parallel.
    /// let dictionary = Dictionary::from_rows(ndarray::array![[1.0, 0.0], [0.6, 0.8]].view())?;
    /// assert!((dictionary.coherence() - 0.6).abs() < 1e-6);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    pub fn coherence(&self) -> f32 {
        let each = greatest(self.atoms(), self.atoms(), |i, j| i != j);
        each.into_iter().fold(0.0, f32::max)
    }

    /// The atoms that are exact copies, up to sign, of one before them, each with the first of its
    /// kind. O(n D).
    pub(crate) fn copies(&self) -> Vec<(usize, usize)> {
        let mut first = HashMap::new();
        let mut copies = Vec::new();
        for (i, atom) in self.atoms().outer_iter().enumerate() {
            let sign = if atom.iter().find(|&&a| a != 0.0).is_some_and(|&a| a < 0.0) {
                -1.0
            } else {
                1.0
            };
            // Adding 0 makes -0 and 0 one number.
            let key: Vec<u32> = atom.iter().map(|a| (a * sign + 0.0).to_bits()).collect();
            match first.entry(key) {
                Entry::Occupied(earlier) => copies.push((i, *earlier.get())),
                Entry::Vacant(entry) => {
                    entry.insert(i);
                }
            }
        }
        copies
    }
}

/// For each row its greatest |product| with any of the others that `counts`.
fn greatest(
    atoms: ArrayView2<f32>,
    others: ArrayView2<f32>,
    counts: impl Fn(usize, usize) -> bool + Sync,
) -> Vec<f32> {
    parallel::map_chunks(atoms.nrows(), TILE, |rows| {
        let tile = atoms.slice(s![rows.clone(), ..]);
        let mut greatest = vec![0f32; tile.nrows()];
        for from in (0..others.nrows()).step_by(BLOCK) {
            let to = (from + BLOCK).min(others.nrows());
            let products = tile.dot(&others.slice(s![from..to, ..]).t());
            for ((i, j), p) in products.indexed_iter() {
                if p.abs() > greatest[i] && counts(rows.start + i, from + j) {
                    greatest[i] = p.abs();
                }
            }
        }
        greatest
    })
    .concat()
}

/// Goes through the atoms (n, D) in the given order and keeps each that is not closer than `limit`
/// to one kept before.
///
/// A limit of 1 drops copies alone. Gives one answer an atom, by its index: whether it is kept. O(n
/// n_kept D) time, O(n D) memory.
pub(super) fn spread(atoms: ArrayView2<f32>, order: &[usize], limit: f64) -> Vec<bool> {
    let d = atoms.ncols();
    let limit = limit.min(COPIES) as f32;
    let mut kept = vec![false; atoms.nrows()];
    let mut rows = Vec::new(); // of the atoms kept, one after the other
    for tile in order.chunks(TILE) {
        let tile_atoms = atoms.select(ndarray::Axis(0), tile);
        let before = ArrayView2::from_shape((rows.len() / d, d), &rows).expect("whole rows");
        let free = far_from(tile_atoms.view(), before, limit);
        let within: Array2<f32> = tile_atoms.dot(&tile_atoms.t());
        let mut here: Vec<usize> = Vec::new();
        for i in (0..tile.len()).filter(|&i| free[i]) {
            if here.iter().all(|&j| within[[i, j]].abs() <= limit) {
                here.push(i);
                kept[tile[i]] = true;
            }
        }
        here.iter().for_each(|&i| rows.extend(tile_atoms.row(i)));
    }
    kept
}

/// Which atoms of a tile have no closeness above `limit` to any of `others`.
fn far_from(tile: ArrayView2<f32>, others: ArrayView2<f32>, limit: f32) -> Vec<bool> {
    let parts = parallel::map_chunks(others.nrows(), BLOCK, |range| {
        let products = tile.dot(&others.slice(s![range, ..]).t());
        products
            .outer_iter()
            .map(|row| row.iter().all(|p| p.abs() <= limit))
            .collect::<Vec<_>>()
    });
    (0..tile.nrows())
        .map(|i| parts.iter().all(|part| part[i]))
        .collect()
}

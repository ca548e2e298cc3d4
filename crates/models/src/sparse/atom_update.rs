//! The update of a dictionary: each atom and its coefficients in turn, from the residual without
//! it.

use super::Dictionary;
use super::codes::UNUSED;
use super::rank_one_svd::{add, refine};
use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

/// Poses that one task takes at least.
const CHUNK: usize = 512;

/// Which codes use each atom: lists one after the other, as in a sparse matrix by columns.
pub(super) struct AtomUsage {
    start: Vec<usize>,        // (n + 1)
    indices: Vec<(u32, u32)>, // row and column in the codes
}

impl AtomUsage {
    pub(crate) fn of(support: &Array2<u32>, n: usize) -> Self {
        let mut start = vec![0usize; n + 1];
        for &atom in support.iter().filter(|&&a| a != UNUSED) {
            start[atom as usize + 1] += 1;
        }
        for j in 0..n {
            start[j + 1] += start[j];
        }
        let mut next = start.clone();
        let mut indices = vec![(0, 0); start[n]];
        for ((i, k), &atom) in support.indexed_iter().filter(|&(_, &a)| a != UNUSED) {
            indices[next[atom as usize]] = (i as u32, k as u32);
            next[atom as usize] += 1;
        }
        AtomUsage { start, indices }
    }

    pub(crate) fn of_atom(&self, j: usize) -> &[(u32, u32)] {
        &self.indices[self.start[j]..self.start[j + 1]]
    }
}

/// Y - A X (m, D), row by row.
pub(super) fn residuals(
    dictionary: &Dictionary,
    support: &Array2<u32>,      // (m, k)
    coefficients: &Array2<f32>, // (m, k)
    poses: ArrayView2<f32>,     // (m, D)
) -> Vec<f32> {
    let d = poses.ncols();
    let mut all = vec![0f32; poses.len()];
    // Rows are apart from each other: the number of threads changes nothing.
    all.par_chunks_exact_mut(d)
        .with_min_len(CHUNK)
        .enumerate()
        .for_each(|(i, r)| {
            r.iter_mut().zip(poses.row(i)).for_each(|(r, &y)| *r = y);
            for (&atom, &x) in support.row(i).iter().zip(coefficients.row(i)) {
                if atom != UNUSED {
                    add(r, -x, dictionary.row(atom));
                }
            }
        });
    all
}

/// Updates each used atom and its coefficients in turn; `residual` (m, D) is kept current.
pub(super) fn update(
    dictionary: &mut Dictionary,
    uses: &AtomUsage,
    coefficients: &mut Array2<f32>,
    residual: &mut [f32],
) {
    let d = dictionary.width();
    let (mut e, mut x) = (Vec::new(), Vec::new());
    for j in 0..dictionary.len() {
        let indices = uses.of_atom(j);
        if indices.is_empty() {
            continue;
        }
        e.clear();
        x.clear();
        let atom = dictionary.atom_mut(j);
        for &(i, k) in indices {
            let (i, k) = (i as usize, k as usize);
            let from = e.len();
            e.extend_from_slice(&residual[i * d..(i + 1) * d]);
            add(&mut e[from..], coefficients[[i, k]], atom);
        }
        x.resize(indices.len(), 0.0);
        refine(&e, atom, &mut x);
        for ((&(i, k), &x), e) in indices.iter().zip(&x).zip(e.chunks_exact(d)) {
            let (i, k) = (i as usize, k as usize);
            coefficients[[i, k]] = x;
            let r = &mut residual[i * d..(i + 1) * d];
            r.copy_from_slice(e);
            add(r, -x, atom);
        }
    }
}

//! The sparse codes of many poses.

use super::active_set::ActiveSet;
use super::{Dictionary, StopReason};
use crate::{Error, Place, Result};
use ndarray::Array2;

/// Marks a slot of [`SparseCodes::atoms`] that holds no atom.
pub const UNUSED: u32 = u32::MAX;

/// The codes of m poses, at most k atoms each.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseCodes {
    /// The atoms of each pose (m, k) in the order in which they were taken, then [`UNUSED`].
    /// k = min(sparsity, n, D): more atoms are never independent.
    pub atoms: Array2<u32>,
    /// Their coefficients (m, k) in the poses' unit, 0 where there is no atom.
    pub coefficients: Array2<f32>,
    /// sum_i w_i (y_i - (A x)_i)^2 of each pose (m), for the coefficients before they were rounded
    /// to f32.
    pub squared_residuals: Vec<f64>,
    /// Why each pose has no more atoms (m).
    pub stops: Vec<StopReason>,
}

impl SparseCodes {
    /// Empty codes of `m` poses.
    pub(super) fn empty(m: usize, k: usize) -> Self {
        SparseCodes {
            atoms: Array2::from_elem((m, k), UNUSED),
            coefficients: Array2::zeros((m, k)),
            squared_residuals: vec![0.0; m],
            stops: vec![StopReason::Nothing; m],
        }
    }

    /// The number of poses, m.
    pub fn len(&self) -> usize {
        self.atoms.nrows()
    }

    /// Whether there are no poses.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The number of atoms of pose `i`.
    pub fn count(&self, i: usize) -> usize {
        self.entries(i).count()
    }

    /// The atoms and coefficients of pose `i`.
    pub fn entries(&self, i: usize) -> impl Iterator<Item = (u32, f32)> {
        let pairs = self.atoms.row(i).into_iter().zip(self.coefficients.row(i));
        pairs
            .map(|(&a, &x)| (a, x))
            .take_while(|&(a, _)| a != UNUSED)
    }

    /// The mean number of atoms a pose; 0 if there are no poses.
    pub fn mean_sparsity(&self) -> f64 {
        let used = self.atoms.iter().filter(|&&a| a != UNUSED).count();
        used as f64 / self.len().max(1) as f64
    }

    /// The mean squared residual a coordinate, sum / (m D); 0 if there are no poses.
    pub fn mean_squared_error(&self, d: usize) -> f64 {
        self.squared_residuals.iter().sum::<f64>() / (self.len() * d).max(1) as f64
    }

    /// The poses (m, D) that the codes represent, A x, missing coordinates included.
    ///
    /// # Errors
    /// [`Error::Data`] if an atom is not below the dictionary's length.
    pub fn decode(&self, dictionary: &Dictionary) -> Result<Array2<f32>> {
        let (n, d) = (dictionary.len(), dictionary.width());
        let worst = self.atoms.iter().filter(|&&a| a != UNUSED).max();
        if let Some(atom) = worst.filter(|&&a| a as usize >= n) {
            return Err(Error::data(
                Place::file("codes"),
                format!("atom {atom} of a dictionary of {n}: they do not belong together"),
            ));
        }
        let mut poses = Array2::zeros((self.len(), d));
        for (i, mut pose) in poses.outer_iter_mut().enumerate() {
            for (atom, x) in self.entries(i) {
                pose.scaled_add(x, &dictionary.atom(atom as usize));
            }
        }
        Ok(poses)
    }

    /// Copies the codes of `part` to `rows`, in order.
    pub(super) fn put(&mut self, rows: &[u32], part: &SparseCodes) {
        for (i, row) in rows.iter().enumerate() {
            let row = *row as usize;
            self.atoms.row_mut(row).assign(&part.atoms.row(i));
            (self.coefficients.row_mut(row)).assign(&part.coefficients.row(i));
            self.squared_residuals[row] = part.squared_residuals[i];
            self.stops[row] = part.stops[i];
        }
    }

    /// Copies several parts to `rows`, in order.
    pub(super) fn put_parts(&mut self, rows: &[u32], parts: &[SparseCodes]) {
        let mut rows = rows;
        for part in parts {
            let (here, after) = rows.split_at(part.len());
            self.put(here, part);
            rows = after;
        }
    }

    /// Writes the code of `fit` to row `i`. `x` is scratch memory for the coefficients.
    pub(super) fn set(&mut self, i: usize, fit: &ActiveSet, x: &mut [f64]) {
        fit.coefficients(x);
        self.atoms.row_mut(i).fill(UNUSED);
        self.coefficients.row_mut(i).fill(0.0);
        for (j, (&atom, &x)) in fit.support.iter().zip(x.iter()).enumerate() {
            self.atoms[[i, j]] = atom;
            self.coefficients[[i, j]] = x as f32;
        }
        self.squared_residuals[i] = fit.squared_residual();
        self.stops[i] = fit.stop.unwrap_or(StopReason::Sparsity);
    }
}

//! Dictionaries: the atoms that poses are built from.

use super::index::IndexCache;
use crate::{Error, Place, Result};
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis};
use std::fmt;
use std::sync::{Arc, OnceLock};

/// How far from 1 the norm of a row may be for the row to be taken as it is.
///
/// Rounding a unit vector to f32 moves its norm by up to half of `f32::EPSILON`. A row that close
/// is left alone, so that a dictionary written to a file and read again has the same bits.
const UNIT: f64 = f32::EPSILON as f64;

/// Atoms in rows, each of unit norm: the transpose of Lai et al.'s `A` (D x n), equation (3).
///
/// Every row is finite and has norm 1 to single precision, and there is at least one row and one
/// column: the code that uses a dictionary relies on it and does not look again.
#[derive(Clone)]
pub struct Dictionary {
    atoms: Array2<f32>, // (n, D)
    /// Search structures, built when first used, and dropped when an atom changes.
    index_cache: OnceLock<Arc<IndexCache>>,
}

impl PartialEq for Dictionary {
    fn eq(&self, other: &Self) -> bool {
        self.atoms == other.atoms
    }
}

impl fmt::Debug for Dictionary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Dictionary").field(&self.atoms).finish()
    }
}

impl Dictionary {
    /// Makes a dictionary of `rows` (n, D), each scaled to unit norm; their order and signs are
    /// kept.
    ///
    /// A row that has unit norm already keeps its bits.
    ///
    /// ```
    /// use posing_models::sparse::Dictionary;
    ///
    /// let dictionary = Dictionary::from_rows(ndarray::array![[3.0, 4.0], [0.0, -2.0]].view())?;
    /// assert_eq!(dictionary.atoms(), ndarray::array![[0.6, 0.8], [0.0, -1.0]]);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// No rows or no columns, 2^32 - 1 rows or more, or a row that is zero or not finite (named,
    /// counted from 0).
    pub fn from_rows<T: Into<f64> + Copy>(rows: ArrayView2<T>) -> Result<Self> {
        let (n, d) = rows.dim();
        if n == 0 || d == 0 {
            return Err(wrong(
                None,
                format!("{n} atoms of {d} numbers: at least one of each is needed"),
            ));
        }
        if n >= u32::MAX as usize {
            return Err(wrong(
                None,
                format!("{n} atoms: at most {} can be counted", u32::MAX - 1),
            ));
        }
        let mut atoms = Array2::zeros((n, d));
        for (i, (row, mut atom)) in rows.outer_iter().zip(atoms.outer_iter_mut()).enumerate() {
            let scale = unit_scale(row).map_err(|what| wrong(Some(i), what.to_string()))?;
            atom.zip_mut_with(&row, |a, &value| *a = (value.into() * scale) as f32);
        }
        Ok(Dictionary::of(atoms))
    }

    /// Takes atoms (n, D) in standard layout that are finite and of unit norm.
    pub(super) fn of(atoms: Array2<f32>) -> Self {
        Dictionary {
            atoms,
            index_cache: OnceLock::new(),
        }
    }

    /// The search structures of the atoms.
    pub(super) fn index_cache(&self) -> &IndexCache {
        self.index_cache
            .get_or_init(|| Arc::new(IndexCache::new(self.len())))
    }

    /// The atoms (n, D), of unit norm.
    pub fn atoms(&self) -> ArrayView2<'_, f32> {
        self.atoms.view()
    }

    /// One atom (D).
    ///
    /// # Panics
    /// If there is no atom `i`.
    pub fn atom(&self, i: usize) -> ArrayView1<'_, f32> {
        self.atoms.row(i)
    }

    /// The sum of atoms times coefficients: a pose (D), in the unit of the coefficients.
    ///
    /// # Panics
    /// If an atom is not below [`Dictionary::len`].
    pub fn combine(&self, atoms: &[u32], coefficients: &[f64]) -> Array1<f64> {
        let mut pose = Array1::zeros(self.width());
        for (&atom, &x) in atoms.iter().zip(coefficients) {
            pose.zip_mut_with(&self.atom(atom as usize), |p, &a| *p += x * f64::from(a));
        }
        pose
    }

    /// Turns the dictionary into its atoms (n, D).
    pub fn into_atoms(self) -> Array2<f32> {
        self.atoms
    }

    /// The number of atoms, n: at least 1.
    pub fn len(&self) -> usize {
        self.atoms.nrows()
    }

    /// Never true: a dictionary has at least one atom.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The number of coordinates of a pose, D: at least 1.
    pub fn width(&self) -> usize {
        self.atoms.ncols()
    }

    /// The largest number of atoms in a code of at most `sparsity`: more than n or D atoms are
    /// never independent.
    pub(super) fn capacity(&self, sparsity: usize) -> usize {
        sparsity.min(self.len()).min(self.width())
    }

    /// The rows `keep`, in that order.
    pub(super) fn select(&self, keep: &[usize]) -> Self {
        Dictionary::of(self.atoms.select(Axis(0), keep))
    }

    /// Atom `i` for changing it. The caller leaves it finite and of unit norm.
    pub(super) fn atom_mut(&mut self, i: usize) -> &mut [f32] {
        let d = self.width();
        self.index_cache.take();
        let all = self
            .atoms
            .as_slice_mut()
            .expect("rows are made in one piece");
        &mut all[i * d..(i + 1) * d]
    }

    /// One atom (D) as a slice.
    pub(super) fn row(&self, atom: u32) -> &[f32] {
        let d = self.width();
        &self.flat()[atom as usize * d..][..d]
    }

    /// All atoms, one after the other.
    pub(super) fn flat(&self) -> &[f32] {
        self.atoms.as_slice().expect("rows are made in one piece")
    }

    /// Joins the rows of several dictionaries of one width.
    pub(super) fn stack(parts: &[Dictionary]) -> Result<Self> {
        let views: Vec<_> = parts.iter().map(|p| p.atoms.view()).collect();
        let atoms = ndarray::concatenate(Axis(0), &views)
            .map_err(|_| Error::usage("dictionaries of different widths cannot be joined"))?;
        Ok(Dictionary::of(atoms.as_standard_layout().into_owned()))
    }
}

/// What to multiply a row by to give it unit norm: 1 if it has it already. Safe from overflow and
/// underflow.
pub(super) fn unit_scale<T: Into<f64> + Copy>(
    row: ArrayView1<T>,
) -> std::result::Result<f64, &'static str> {
    let mut largest = 0f64;
    for &value in row {
        let value: f64 = value.into();
        if !value.is_finite() {
            return Err("an atom has a coordinate that is missing or not finite");
        }
        largest = largest.max(value.abs());
    }
    if largest == 0.0 {
        return Err("all its coordinates are zero");
    }
    if !(1e-300..=1e300).contains(&largest) {
        return Err("its largest number is not between 1e-300 and 1e300");
    }
    let norm = row
        .iter()
        .map(|&v| (v.into() / largest).powi(2))
        .sum::<f64>()
        .sqrt()
        * largest;
    if (norm - 1.0).abs() <= UNIT {
        Ok(1.0)
    } else {
        Ok(1.0 / norm)
    }
}

fn wrong(atom: Option<usize>, what: String) -> Error {
    let place = Place::file("dictionary");
    let place = match atom {
        Some(i) => place.part(format!("atom {i}")),
        None => place,
    };
    Error::data(place, what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use ndarray::array;
    use rand::Rng;

    #[test]
    fn rows_get_unit_norm_and_keep_order_and_sign() {
        let d = Dictionary::from_rows(array![[3.0, -4.0], [0.0, -2.0]].view()).unwrap();
        assert_eq!(d.atoms(), array![[0.6f32, -0.8], [0.0, -1.0]]);
        assert_eq!((d.len(), d.width()), (2, 2));
    }

    #[test]
    fn a_dictionary_made_of_its_own_atoms_has_the_same_bits() {
        let mut g = parallel::rng(1, 0);
        let rows = Array2::from_shape_fn((200, 69), |_| g.random::<f64>() - 0.5);
        let once = Dictionary::from_rows(rows.view()).unwrap();
        assert_eq!(Dictionary::from_rows(once.atoms()).unwrap(), once);
        for atom in once.atoms().outer_iter() {
            let norm = atom
                .iter()
                .map(|&a| f64::from(a).powi(2))
                .sum::<f64>()
                .sqrt();
            assert!((norm - 1.0).abs() <= 1e-6);
        }
    }

    #[test]
    fn a_row_without_direction_is_an_error_that_names_it() {
        for bad in [0.0, f64::NAN, f64::INFINITY] {
            let said = Dictionary::from_rows(array![[1.0, 0.0], [bad, 0.0]].view()).unwrap_err();
            assert!(said.to_string().contains("atom 1"), "{said}");
        }
        assert!(Dictionary::from_rows(Array2::<f32>::zeros((0, 3)).view()).is_err());
        assert!(Dictionary::from_rows(Array2::<f32>::zeros((3, 0)).view()).is_err());
    }

    #[test]
    fn huge_and_tiny_rows_do_not_overflow() {
        let rows = array![[1e300, 1e300], [1e-299, -1e-299]];
        let d = Dictionary::from_rows(rows.view()).unwrap();
        let half = 0.5f32.sqrt();
        assert_eq!(d.atoms(), array![[half, half], [half, -half]]);
    }

    #[test]
    fn both_layouts_give_the_same_atoms() {
        let rows = array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]];
        let f = Array2::from_shape_fn((2, 3), |(i, j)| rows[[j, i]]);
        let a = Dictionary::from_rows(rows.view()).unwrap();
        assert_eq!(a, Dictionary::from_rows(f.t()).unwrap());
        assert_eq!(a.flat().len(), 6);
    }
}

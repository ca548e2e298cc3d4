//! SparseCodes of many poses, by tiles of poses that share the products with the atoms.

use super::active_set::ActiveSet;
use super::encoder::{Batch, Encoder};
use super::index::DIRECTIONS;
use super::omp::Omp;
use super::{Dictionary, StopReason};
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, Axis};
use std::fmt;

/// Marks a place of [`SparseCodes::atoms`] that holds no atom.
pub const UNUSED: u32 = u32::MAX;

/// The codes of m poses, at most k atoms each.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseCodes {
    /// The atoms of each pose (m, k) in the order in which they were taken, then [`UNUSED`].
    /// k = min(sparsity, n, D): more atoms are never independent.
    pub atoms: Array2<u32>,
    /// Their coefficients (m, k) in the poses' unit, 0 where there is no atom.
    pub coefficients: Array2<f32>,
    /// sum_i w_i (y_i - (A x)_i)^2 of each pose (m), for the coefficients before they were rounded to f32.
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

    /// How many poses there are.
    pub fn len(&self) -> usize {
        self.atoms.nrows()
    }

    /// Whether there are no poses.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How many atoms pose `i` has.
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

    /// A x of each pose (m, D), missing coordinates included.
    ///
    /// # Errors
    /// A code that names an atom the dictionary does not have.
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

    /// Puts the codes of `part` in some rows, one after another.
    pub(super) fn put(&mut self, rows: &[u32], part: &SparseCodes) {
        for (i, row) in rows.iter().enumerate() {
            let row = *row as usize;
            self.atoms.row_mut(row).assign(&part.atoms.row(i));
            (self.coefficients.row_mut(row)).assign(&part.coefficients.row(i));
            self.squared_residuals[row] = part.squared_residuals[i];
            self.stops[row] = part.stops[i];
        }
    }

    /// Puts parts in some rows, one after another.
    pub(super) fn put_parts(&mut self, rows: &[u32], parts: &[SparseCodes]) {
        let mut rows = rows;
        for part in parts {
            let (here, after) = rows.split_at(part.len());
            self.put(here, part);
            rows = after;
        }
    }

    /// Writes what `fit` found in row `i`. `x` is room for the coefficients.
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

/// Whether all weights of a pose are equal.
fn is_even(weights: Option<ArrayView2<f32>>, i: usize) -> bool {
    weights.is_none_or(|w| {
        let row = w.index_axis(Axis(0), i);
        row.iter().all(|v| *v == row[0])
    })
}

/// How the best atom is found. The codes are the same, but where rounding leaves two atoms equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchStrategy {
    /// The first atom by a scan of all, the others by rows of the Gram matrix: of up to 2,048 atoms.
    Gram,
    /// By scans of all atoms.
    DenseScan,
    /// By bounds of atoms in leaves, so that of poses like them most atoms need not be looked at: the same.
    BallTree,
}

impl fmt::Display for SearchStrategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SearchStrategy::Gram => "by a scan and by rows of their Gram matrix",
            SearchStrategy::DenseScan => "by scans",
            SearchStrategy::BallTree => {
                "by bounds; by scans where poses have gaps or are unlike the atoms"
            }
        })
    }
}

impl Omp {
    /// How [`Omp::code_batch`] goes about `m` poses. Poses with weights that differ are coded by scans all the same.
    pub fn search(&self, dictionary: &Dictionary, m: usize) -> SearchStrategy {
        let ground = dictionary.ground();
        if ground.gram.is_some() {
            return SearchStrategy::Gram;
        }
        let tree = ground.wants_tree(m, dictionary.width());
        match tree && self.capacity(dictionary) <= DIRECTIONS {
            true => SearchStrategy::BallTree,
            false => SearchStrategy::DenseScan,
        }
    }

    /// SparseCodes many poses (m, D) with weights (m, D, not negative; all 1 if not given), on all of rayon's threads.
    ///
    /// Where a weight is 0 the pose may be NaN. The codes do not depend on the number of threads, nor on which
    /// poses are coded together. Memory: beside the codes, 4 to 12 bytes for each atom and each pose of a tile (60
    /// poses) a thread. With the dictionary stay its atoms as they are scanned, some (D + 80) numbers an
    /// atom where they are searched by bounds, and up to 2,048 atoms the rows of their Gram matrix that were asked for, or
    /// all where poses will have asked for many: up to 16 MiB.
    ///
    /// # Errors
    /// A parameter or a shape that cannot be used; a number that is not finite where it is observed, or a weight that is
    /// negative or not finite (the row is named, counted from 1; of several one, always the same).
    pub fn code_batch(
        &self,
        dictionary: &Dictionary,
        poses: ArrayView2<f32>,
        weights: Option<ArrayView2<f32>>,
    ) -> Result<SparseCodes> {
        self.coder(dictionary)?.code_batch(poses, weights)
    }

    /// The same for batch after batch.
    ///
    /// # Errors
    /// A parameter that cannot be used.
    pub fn coder<'a>(&self, dictionary: &'a Dictionary) -> Result<Encoder<'a>> {
        self.check()?;
        Ok(Encoder::new(dictionary, *self))
    }
}

impl Encoder<'_> {
    /// SparseCodes many poses, as [`Omp::code_batch`] does.
    ///
    /// # Errors
    /// The same, but of the parameters, which were checked.
    pub fn code_batch(
        &self,
        poses: ArrayView2<f32>,
        weights: Option<ArrayView2<f32>>,
    ) -> Result<SparseCodes> {
        let (dictionary, pursuit) = (self.dictionary, &self.pursuit);
        let (m, d) = poses.dim();
        if d != dictionary.width() {
            let said = format!(
                "{d} numbers a pose, but the atoms have {}",
                dictionary.width()
            );
            return Err(Error::data(Place::file("poses"), said));
        }
        if let Some(shape) = weights.map(|w| w.dim()).filter(|&shape| shape != (m, d)) {
            let said = format!("shape {shape:?}, but the poses have {:?}", (m, d));
            return Err(Error::data(Place::file("weights"), said));
        }
        if u32::try_from(m).is_err() {
            let said = format!("{m} poses: at most 4,294,967,295 are coded at once");
            return Err(Error::data(Place::file("poses"), said));
        }
        let ground = dictionary.ground();
        // Poses that are seen whole are coded with each other, as they would be alone.
        let (whole, part): (Vec<u32>, Vec<u32>) =
            (0..m as u32).partition(|i| is_even(weights, *i as usize));
        let tree = match pursuit.search(dictionary, m) {
            SearchStrategy::BallTree if !whole.is_empty() => ground.tree(dictionary.atoms()),
            _ => None,
        };
        ground.fill_gram(dictionary.atoms(), whole.len(), pursuit.sparsity);
        ground.count(whole.len());
        let batch = Batch {
            coder: self,
            poses,
            weights,
        };
        let mut codes = SparseCodes::empty(m, pursuit.capacity(dictionary));
        let left = match tree {
            Some(tree) => batch.by_bounds(tree, &whole, &mut codes)?,
            None => whole,
        };
        batch.by_scans(&left, &mut codes)?;
        batch.by_scans(&part, &mut codes)?;
        Ok(codes)
    }
}

#[cfg(test)]
mod tests {
    use super::super::omp::{SelectionRule, Tolerance};
    use super::*;
    use crate::numeric::parallel;
    use ndarray::{ShapeBuilder, s};
    use rand::Rng;

    fn random(n: usize, d: usize, seed: u64) -> Array2<f32> {
        let mut g = parallel::rng(seed, 0);
        Array2::from_shape_fn((n, d), |(_, j)| g.random::<f32>() - 0.5 + (j as f32).sin())
    }

    fn pursuits() -> impl Iterator<Item = Omp> {
        let rules = [SelectionRule::Oomp, SelectionRule::Omp].into_iter();
        rules.flat_map(|rule| {
            [Tolerance::Never, Tolerance::Rms(0.2)].map(|tolerance| Omp {
                sparsity: 4,
                rule,
                tolerance,
            })
        })
    }

    #[test]
    fn many_poses_get_the_codes_that_each_gets_alone() {
        // With a Gram matrix and without, more poses than a tile, and a last tile and panel that are not full.
        for n in [300, 2100] {
            let d = Dictionary::from_rows(random(n, 21, 1).view()).unwrap();
            assert_eq!(d.ground().gram.is_some(), n == 300);
            alone_as_together(&d, &random(150, 21, 2), &weights(150, 21), 4);
        }
    }

    #[test]
    fn poses_sought_by_bounds_get_the_codes_that_scans_give() {
        for (d, search) in [(21, SearchStrategy::BallTree), (60, SearchStrategy::BallTree)] {
            by_bounds_as_by_scans(d, search);
        }
    }

    fn by_bounds_as_by_scans(d: usize, search: SearchStrategy) {
        let (n, m) = (2_100, 1_300);
        let atoms = Dictionary::from_rows(random(n, d, 5).view()).unwrap();
        let (noise, other) = (random(m, d, 6), random(m, d, 7));
        // Near an atom, like nothing, and nothing.
        let y = Array2::from_shape_fn((m, d), |(i, j)| match (i % 50, i % 7) {
            (0, _) => 0.0,
            (_, 0) => other[[i, j]],
            _ => 9.0 * atoms.atoms()[[i * 37 % n, j]] + 0.05 * noise[[i, j]],
        });
        let mut w = Array2::ones(y.dim());
        w.slice_mut(s![..;11, ..4]).fill(0.0);
        let p = Omp::default();
        let code = |rows: ndarray::Slice, threads| {
            // Its own: few poses at a time are scanned, as it does not know of the others.
            let atoms = Dictionary::from_rows(atoms.atoms()).unwrap();
            let (y, w) = (y.slice_axis(Axis(0), rows), w.slice_axis(Axis(0), rows));
            let expected = if y.nrows() == m {
                search
            } else {
                SearchStrategy::DenseScan
            };
            assert_eq!(p.search(&atoms, y.nrows()), expected);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().unwrap();
            pool.install(|| p.code_batch(&atoms, y, Some(w)).unwrap())
        };
        let parts = [0, 325, 650, 975].map(|from| code((from..from + 325).into(), 2));
        let by_bounds = code((..).into(), 1);
        for i in 0..m {
            let (part, k) = (&parts[i / 325], i % 325);
            assert_eq!(by_bounds.atoms.row(i), part.atoms.row(k), "{i}");
            assert_eq!(by_bounds.coefficients.row(i), part.coefficients.row(k));
            assert_eq!(by_bounds.squared_residuals[i], part.squared_residuals[k]);
            assert_eq!(by_bounds.stops[i], part.stops[k]);
        }
        for threads in [2, 7] {
            assert_eq!(code((..).into(), threads), by_bounds);
        }
    }

    #[test]
    fn so_do_poses_whose_last_atom_is_refused() {
        // Copies of six directions, nearer to each other than f32 tells, and poses that five of them nearly reach.
        for n in [100, 2100] {
            let (six, noise) = (random(6, 12, 30), random(n, 12, 31));
            let atoms = Array2::from_shape_fn((n, 12), |(i, j)| {
                six[[i % 6, j]] + 5e-6 * (noise[[i, j]] - (j as f32).sin())
            });
            let d = Dictionary::from_rows(atoms.view()).unwrap();
            let parts = random(120, 5, 32);
            let y = parts.dot(&six.slice(s![..5, ..])) + random(120, 12, 33) * 1e-3;
            for sparsity in [4, 5, 6, 7] {
                let mut w = Array2::ones(y.dim());
                w.slice_mut(s![.., ..3]).fill(0.0);
                alone_as_together(&d, &y, &w, sparsity);
            }
        }
    }

    /// Some poses are seen whole, all weights of some are equal.
    fn weights(m: usize, d: usize) -> Array2<f32> {
        let mut w = random(m, d, 3).mapv(|v| if v > 0.2 { 0.0 } else { v.abs() });
        w.slice_mut(s![..;5, ..]).fill(1.0);
        w.slice_mut(s![1..;5, ..]).fill(0.3);
        w
    }

    fn alone_as_together(d: &Dictionary, y: &Array2<f32>, w: &Array2<f32>, sparsity: usize) {
        for p in pursuits() {
            let p = Omp { sparsity, ..p };
            for weights in [None, Some(w.view())] {
                let codes = p.code_batch(d, y.view(), weights).unwrap();
                for i in 0..y.nrows() {
                    let weights = weights.map(|w| w.row(i).mapv(f64::from));
                    let weights = weights.as_ref().map(|w| w.view());
                    let one = p.code(d, y.row(i).mapv(f64::from).view(), weights).unwrap();
                    let (atoms, x): (Vec<u32>, Vec<f32>) = codes.entries(i).unzip();
                    assert_eq!(atoms, one.atoms);
                    assert_eq!(
                        x,
                        one.coefficients
                            .iter()
                            .map(|&x| x as f32)
                            .collect::<Vec<_>>()
                    );
                    assert_eq!(codes.squared_residuals[i], one.squared_residual);
                    assert_eq!(
                        (codes.stops[i], codes.count(i)),
                        (one.stop, one.atoms.len())
                    );
                }
            }
        }
    }

    #[test]
    fn threads_and_layouts_change_nothing() {
        let d = Dictionary::from_rows(random(200, 9, 4).view()).unwrap();
        let y = random(2500, 9, 5);
        let w = random(2500, 9, 6).mapv(f32::abs);
        let mut f = Array2::zeros((2500, 9).f());
        f.assign(&y);
        for weights in [None, Some(w.view())] {
            let of = |threads, y: ArrayView2<f32>| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                pool.install(|| Omp::default().code_batch(&d, y, weights).unwrap())
            };
            let one = of(1, y.view());
            assert!([2, 7].iter().all(|&t| of(t, y.view()) == one));
            assert_eq!(of(2, f.view()), one);
        }
    }

    #[test]
    fn decoding_gives_back_what_the_residuals_say() {
        let d = Dictionary::from_rows(random(100, 12, 7).view()).unwrap();
        let y = random(90, 12, 8);
        let codes = Omp::default().code_batch(&d, y.view(), None).unwrap();
        let back = codes.decode(&d).unwrap();
        for (i, r) in (&y - &back).outer_iter().enumerate() {
            let left = r.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>();
            assert!((left - codes.squared_residuals[i]).abs() <= 1e-5);
        }
        let mse = codes.squared_residuals.iter().sum::<f64>() / (90.0 * 12.0);
        assert!((codes.mean_squared_error(12) - mse).abs() <= 1e-12);
        assert!((codes.mean_sparsity() - 3.0).abs() <= 1e-12);
        let fewer = Dictionary::from_rows(random(2, 12, 7).view()).unwrap();
        assert!(codes.decode(&fewer).is_err());
    }

    #[test]
    fn no_poses_and_zero_poses() {
        let d = Dictionary::from_rows(random(10, 6, 9).view()).unwrap();
        let none = Omp::default()
            .code_batch(&d, Array2::zeros((0, 6)).view(), None)
            .unwrap();
        assert!(
            none.is_empty() && none.mean_sparsity() == 0.0 && none.mean_squared_error(6) == 0.0
        );
        let zero = Omp::default()
            .code_batch(&d, Array2::zeros((3, 6)).view(), None)
            .unwrap();
        assert_eq!(zero.stops, vec![StopReason::Nothing; 3]);
        assert!(zero.atoms.iter().all(|&a| a == UNUSED));
    }

    #[test]
    fn a_bad_number_is_refused_with_its_row_unless_it_has_no_weight() {
        let d = Dictionary::from_rows(random(10, 6, 10).view()).unwrap();
        for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
            let mut y = random(500, 6, 11);
            y[[432, 2]] = bad;
            let said = Omp::default().code_batch(&d, y.view(), None).unwrap_err();
            assert!(said.to_string().contains(":433"), "{said}");
            let mut w = Array2::ones((500, 6));
            w[[432, 2]] = 0.0;
            assert!(
                Omp::default()
                    .code_batch(&d, y.view(), Some(w.view()))
                    .is_ok()
            );
            w[[7, 0]] = -1.0;
            let said = Omp::default()
                .code_batch(&d, y.view(), Some(w.view()))
                .unwrap_err();
            assert!(said.to_string().contains(":8"), "{said}");
        }
        let y = random(5, 7, 12);
        assert!(Omp::default().code_batch(&d, y.view(), None).is_err());
        let w = Array2::ones((4, 6));
        assert!(
            Omp::default()
                .code_batch(&d, random(5, 6, 1).view(), Some(w.view()))
                .is_err()
        );
    }
}

//! Codes many poses with one dictionary, on all threads.
//!
//! How [`Encoder`] chooses a search strategy (codes differ only where atoms are equally good within
//! rounding):
//!
//! - **Weights that differ within a pose**: a dense scan, because each pose sees other atoms. 60
//!   poses share each scan.
//! - **Up to 2,048 atoms**: a dense scan for the first atom, then rows of the Gram matrix.
//! - **More atoms**: a dense scan, until 1,024 poses were coded with the dictionary or are to be
//!   coded now. From then on a ball tree, which costs about as much to build as that many scans.
//! - **Codes of more than four atoms, poses of more than 384 coordinates, or a single pose**: a
//!   dense scan.

use super::active_set::ActiveSet;
use super::code::{finished, started};
use super::index::{BallTree, MOST_ATOMS};
use super::omp_dense::{DenseOmp, POSES};
use super::omp_indexed::IndexedOmp;
use super::{Dictionary, Omp, SparseCode, SparseCodes};
use crate::numeric::parallel::{self, ScratchPool};
use crate::{Error, Place, Result};
use ndarray::{ArrayView1, ArrayView2, Axis};
use std::fmt;

/// The largest number of poses in one task of the ball tree: their active sets should stay in the
/// cache.
const LARGEST_TASK: usize = 512;
/// The smallest number of poses in one task of the ball tree.
const SMALLEST_TASK: usize = 64;
/// Tasks per thread, if there are enough poses: threads are not equally fast.
const TASKS_PER_THREAD: usize = 8;
/// The largest number of tiles in one task of dense scans.
const TILES_PER_TASK: usize = 32;

/// How the best atom is found. Every strategy finds the same atom, up to ties within rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchStrategy {
    /// A dense scan for the first atom, then rows of the Gram matrix. Up to 2,048 atoms.
    Gram,
    /// A dense scan of all atoms for each atom of a code.
    DenseScan,
    /// A ball tree over the atoms. Fast for poses near the atoms.
    BallTree,
}

impl fmt::Display for SearchStrategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SearchStrategy::Gram => "by a dense scan and the Gram matrix",
            SearchStrategy::DenseScan => "by dense scans",
            SearchStrategy::BallTree => "by a ball tree; by dense scans for poses with gaps",
        })
    }
}

/// Codes poses with one dictionary.
///
/// An encoder keeps its working memory from call to call. The codes of a pose do not depend on the
/// number of threads. Where atoms are equally good within rounding, they can depend on the search
/// strategy, and so on how many poses are coded.
///
/// Memory per thread: 4 to 12 bytes for each atom and each of 60 poses. The dictionary keeps its
/// search structures: up to 16 MiB for the Gram matrix, or about 40 numbers per atom for the ball
/// tree.
///
/// ```
/// use ndarray::array;
/// use posing_models::sparse::{Dictionary, Encoder, Omp};
///
/// let atoms = array![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let dictionary = Dictionary::from_rows(atoms.view())?;
/// let poses = array![[3.0f32, 0.0, 4.0], [0.0, 2.0, 0.0]]; // (m, D)
/// let encoder = Encoder::new(&dictionary, Omp { sparsity: 2, ..Omp::default() })?;
/// let codes = encoder.encode(poses.view())?;
/// assert_eq!(codes.atoms.row(0).to_vec(), [2, 0]); // the best atom first
/// assert_eq!(codes.decode(&dictionary)?, poses);
/// # Ok::<(), posing_core::Error>(())
/// ```
pub struct Encoder<'a> {
    dictionary: &'a Dictionary,
    omp: Omp,
    dense: ScratchPool<(DenseOmp<'a>, Vec<ActiveSet>)>,
    indexed: ScratchPool<(IndexedOmp<'a>, Vec<ActiveSet>)>,
}

/// The poses of one call.
#[derive(Clone, Copy)]
struct Poses<'b> {
    /// (m, D)
    values: ArrayView2<'b, f32>,
    /// (m, D)
    weights: Option<ArrayView2<'b, f32>>,
}

impl Poses<'_> {
    /// Whether all weights of pose `i` are equal.
    fn has_equal_weights(&self, i: usize) -> bool {
        self.weights.is_none_or(|weights| {
            let row = weights.index_axis(Axis(0), i);
            row.iter().all(|w| *w == row[0])
        })
    }

    /// # Errors
    /// The shapes do not fit each other or the dictionary.
    fn check(&self, dictionary: &Dictionary) -> Result<()> {
        let (m, d) = self.values.dim();
        if d != dictionary.width() {
            let what = format!(
                "{d} coordinates per pose, but the atoms have {}",
                dictionary.width()
            );
            return Err(Error::data(Place::file("poses"), what));
        }
        let shape = self.weights.map(|w| w.dim());
        if let Some(shape) = shape.filter(|&shape| shape != (m, d)) {
            let what = format!("shape {shape:?}, but the poses have {:?}", (m, d));
            return Err(Error::data(Place::file("weights"), what));
        }
        if u32::try_from(m).is_err() {
            let what = format!("{m} poses: at most 4,294,967,295 are coded at once");
            return Err(Error::data(Place::file("poses"), what));
        }
        Ok(())
    }
}

impl<'a> Encoder<'a> {
    /// An encoder for these parameters.
    ///
    /// # Errors
    /// [`Error::Usage`] if a parameter is out of its range.
    pub fn new(dictionary: &'a Dictionary, omp: Omp) -> Result<Self> {
        omp.check()?;
        Ok(Encoder {
            dictionary,
            omp,
            dense: ScratchPool::default(),
            indexed: ScratchPool::default(),
        })
    }

    /// The strategy that the next call with `m` poses uses for poses whose weights are equal.
    pub fn strategy(&self, m: usize) -> SearchStrategy {
        let cache = self.dictionary.index_cache();
        if cache.gram.is_some() {
            return SearchStrategy::Gram;
        }
        let tree = cache.wants_tree(m, self.dictionary.width());
        if tree && self.dictionary.capacity(self.omp.sparsity) <= MOST_ATOMS {
            SearchStrategy::BallTree
        } else {
            SearchStrategy::DenseScan
        }
    }

    /// Codes poses (m, D) on all of rayon's threads.
    ///
    /// # Errors
    /// [`Error::Data`] if D is not the dictionary's width, or a number is not finite (the first
    /// such row is named, from 1).
    pub fn encode(&self, poses: ArrayView2<f32>) -> Result<SparseCodes> {
        self.encode_weighted(poses, None)
    }

    /// Codes poses (m, D) with weights (m, D), not negative; `None`: all weights are 1. Where a
    /// weight is 0 the pose may be NaN.
    ///
    /// # Errors
    /// [`Error::Data`] as [`Encoder::encode`]; also if the weights have another shape than the
    /// poses, or a weight is negative or not finite. Numbers with weight 0 are not checked.
    pub fn encode_weighted(
        &self,
        poses: ArrayView2<f32>,
        weights: Option<ArrayView2<f32>>,
    ) -> Result<SparseCodes> {
        let poses = Poses {
            values: poses,
            weights,
        };
        poses.check(self.dictionary)?;
        let m = poses.values.nrows();
        let (even, uneven): (Vec<u32>, Vec<u32>) =
            (0..m as u32).partition(|i| poses.has_equal_weights(*i as usize));
        let (cache, atoms) = (self.dictionary.index_cache(), self.dictionary.atoms());
        let tree = match self.strategy(m) {
            SearchStrategy::BallTree if !even.is_empty() => cache.tree(atoms),
            _ => None,
        };
        cache.fill_gram(atoms, even.len(), self.omp.sparsity);
        cache.count(even.len());
        let mut codes = SparseCodes::empty(m, self.dictionary.capacity(self.omp.sparsity));
        match tree {
            Some(tree) => self.encode_with_tree(tree, poses, &even, &mut codes)?,
            None => self.encode_with_scans(poses, &even, &mut codes)?,
        }
        self.encode_with_scans(poses, &uneven, &mut codes)?;
        Ok(codes)
    }

    /// Codes one pose (D) with weights (D), not negative; `None`: all weights are 1. Where a weight
    /// is 0 the pose may be NaN. The code is that of [`Encoder::encode_weighted`] by dense
    /// scans, with coefficients in double precision.
    ///
    /// # Errors
    /// [`Error::Data`] if a length is not the dictionary's width, an observed number is not finite,
    /// or a weight is negative or not finite.
    pub fn encode_one(
        &self,
        pose: ArrayView1<f64>,
        weights: Option<ArrayView1<f64>>,
    ) -> Result<SparseCode> {
        let (dictionary, omp) = (self.dictionary, &self.omp);
        let capacity = dictionary.capacity(omp.sparsity);
        let mut fit = started(dictionary, capacity, pose, weights, omp.tolerance)?;
        DenseOmp::new(dictionary, omp.rule, 1).code(std::slice::from_mut(&mut fit), omp.sparsity);
        Ok(finished(&fit))
    }

    /// Codes the poses `rows`, whose weights are equal, with the ball tree.
    fn encode_with_tree(
        &self,
        tree: &'a BallTree,
        poses: Poses<'_>,
        rows: &[u32],
        codes: &mut SparseCodes,
    ) -> Result<()> {
        let scratch = || {
            let indexed = IndexedOmp::new(self.dictionary, tree, self.omp.rule);
            (indexed, Vec::new())
        };
        let parts = in_tasks(rows, SMALLEST_TASK, LARGEST_TASK, |rows| {
            self.indexed.with(scratch, |(indexed, fits)| {
                self.start(fits, poses, rows)?;
                for fit in fits.iter_mut().filter(|fit| fit.stop.is_none()) {
                    indexed.code(fit, self.omp.sparsity);
                }
                Ok(self.codes(fits))
            })
        })?;
        codes.put_parts(rows, &parts);
        Ok(())
    }

    /// Codes the poses `rows` with dense scans, or with the Gram matrix.
    fn encode_with_scans(
        &self,
        poses: Poses<'_>,
        rows: &[u32],
        codes: &mut SparseCodes,
    ) -> Result<()> {
        let capacity = POSES.min(rows.len());
        let scratch = || {
            let dense = DenseOmp::new(self.dictionary, self.omp.rule, capacity);
            (dense, Vec::new())
        };
        // Scratch for fewer poses than usual is not kept.
        let small = ScratchPool::default();
        let pool = if capacity == POSES {
            &self.dense
        } else {
            &small
        };
        let parts = in_tasks(rows, POSES, POSES * TILES_PER_TASK, |rows| {
            pool.with(scratch, |(dense, fits)| {
                let tiles = rows.chunks(capacity).map(|tile| {
                    self.start(fits, poses, tile)?;
                    dense.code(fits, self.omp.sparsity);
                    Ok(self.codes(fits))
                });
                tiles.collect::<Result<Vec<SparseCodes>>>()
            })
        })?;
        codes.put_parts(rows, &parts.concat());
        Ok(())
    }

    /// Starts an active set for each of the poses `rows`.
    fn start(&self, fits: &mut Vec<ActiveSet>, poses: Poses<'_>, rows: &[u32]) -> Result<()> {
        let (capacity, d) = (
            self.dictionary.capacity(self.omp.sparsity),
            self.dictionary.width(),
        );
        fits.resize_with(rows.len(), || ActiveSet::new(capacity, d));
        for (row, fit) in rows.iter().zip(fits) {
            let i = *row as usize;
            let weights = poses.weights.as_ref().map(|w| w.index_axis(Axis(0), i));
            fit.start(poses.values.row(i), weights, self.omp.tolerance)
                .map_err(|e| e.at(Place::line("poses", i as u64 + 1)))?;
        }
        Ok(())
    }

    fn codes(&self, fits: &[ActiveSet]) -> SparseCodes {
        let k = self.dictionary.capacity(self.omp.sparsity);
        let (mut codes, mut x) = (SparseCodes::empty(fits.len(), k), vec![0.0; k]);
        for (i, fit) in fits.iter().enumerate() {
            codes.set(i, fit, &mut x);
        }
        codes
    }
}

/// Runs `work` on tasks of `smallest` to `largest` rows, a multiple of `smallest`, on all threads.
fn in_tasks<T: Send>(
    rows: &[u32],
    smallest: usize,
    largest: usize,
    work: impl Fn(&[u32]) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let share = rows.len() / (TASKS_PER_THREAD * rayon::current_num_threads());
    let task = (share - share % smallest).clamp(smallest, largest);
    let parts = parallel::map_chunks(rows.len(), task, |part| work(&rows[part]));
    parts.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::super::testdata::{encode, encode_one};
    use super::super::{SelectionRule, StopReason, Tolerance, UNUSED};
    use super::*;
    use crate::numeric::parallel;
    use ndarray::{Array2, ShapeBuilder, s};
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
        // With a Gram matrix and without, more poses than a tile, and a last tile and panel that
        // are not full.
        for n in [300, 2100] {
            let d = Dictionary::from_rows(random(n, 21, 1).view()).unwrap();
            assert_eq!(d.index_cache().gram.is_some(), n == 300);
            alone_as_together(&d, &random(150, 21, 2), &weights(150, 21), 4);
        }
    }

    #[test]
    fn the_ball_tree_gives_the_codes_of_dense_scans_on_any_number_of_threads() {
        let (n, m, d) = (2_100, 1_300, 60);
        let rows = random(n, d, 5);
        let (noise, other) = (random(m, d, 6), random(m, d, 7));
        let new = || Dictionary::from_rows(rows.view()).unwrap();
        let atoms = new();
        // Near an atom, like nothing, and nothing.
        let y = Array2::from_shape_fn((m, d), |(i, j)| match (i % 50, i % 7) {
            (0, _) => 0.0,
            (_, 0) => other[[i, j]],
            _ => 9.0 * atoms.atoms()[[i * 37 % n, j]] + 0.05 * noise[[i, j]],
        });
        let mut w = Array2::ones(y.dim());
        w.slice_mut(s![..;11, ..4]).fill(0.0);
        let by_tree = |threads| {
            let atoms = new();
            let encoder = Encoder::new(&atoms, Omp::default()).unwrap();
            assert_eq!(encoder.strategy(m), SearchStrategy::BallTree);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let coded = || encoder.encode_weighted(y.view(), Some(w.view())).unwrap();
            pool.build().unwrap().install(coded)
        };
        let codes = by_tree(1);
        assert!([2, 7].iter().all(|threads| by_tree(*threads) == codes));
        let encoder = Encoder::new(&atoms, Omp::default()).unwrap();
        let differ = |i: &usize| {
            let (y, w) = (y.row(*i).mapv(f64::from), w.row(*i).mapv(f64::from));
            let scanned = encoder.encode_one(y.view(), Some(w.view())).unwrap();
            let (was, now) = (scanned.squared_residual, codes.squared_residuals[*i]);
            assert!((was - now).abs() <= 1e-4 * (was + 1e-6), "{i}: {was} {now}");
            !codes.entries(*i).map(|(atom, _)| atom).eq(scanned.atoms)
        };
        assert!((0..m).filter(differ).count() <= m / 200);
    }

    #[test]
    fn poses_whose_last_atom_is_refused_get_the_codes_that_each_gets_alone() {
        // Copies of six directions, nearer to each other than f32 tells, and poses that five of
        // them nearly reach.
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
                let codes = encode(&p, d, y.view(), weights).unwrap();
                for i in 0..y.nrows() {
                    let weights = weights.map(|w| w.row(i).mapv(f64::from));
                    let weights = weights.as_ref().map(|w| w.view());
                    let one = encode_one(&p, d, y.row(i).mapv(f64::from).view(), weights).unwrap();
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
                pool.install(|| encode(&Omp::default(), &d, y, weights).unwrap())
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
        let codes = encode(&Omp::default(), &d, y.view(), None).unwrap();
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
        let none = encode(&Omp::default(), &d, Array2::zeros((0, 6)).view(), None).unwrap();
        assert!(
            none.is_empty() && none.mean_sparsity() == 0.0 && none.mean_squared_error(6) == 0.0
        );
        let zero = encode(&Omp::default(), &d, Array2::zeros((3, 6)).view(), None).unwrap();
        assert_eq!(zero.stops, vec![StopReason::Nothing; 3]);
        assert!(zero.atoms.iter().all(|&a| a == UNUSED));
    }

    #[test]
    fn a_bad_number_is_refused_with_its_row_unless_it_has_no_weight() {
        let d = Dictionary::from_rows(random(10, 6, 10).view()).unwrap();
        for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
            let mut y = random(500, 6, 11);
            y[[432, 2]] = bad;
            let said = encode(&Omp::default(), &d, y.view(), None).unwrap_err();
            assert!(said.to_string().contains(":433"), "{said}");
            let mut w = Array2::ones((500, 6));
            w[[432, 2]] = 0.0;
            assert!(encode(&Omp::default(), &d, y.view(), Some(w.view())).is_ok());
            w[[7, 0]] = -1.0;
            let said = encode(&Omp::default(), &d, y.view(), Some(w.view())).unwrap_err();
            assert!(said.to_string().contains(":8"), "{said}");
        }
        let y = random(5, 7, 12);
        assert!(encode(&Omp::default(), &d, y.view(), None).is_err());
        let w = Array2::ones((4, 6));
        assert!(encode(&Omp::default(), &d, random(5, 6, 1).view(), Some(w.view())).is_err());
    }
}

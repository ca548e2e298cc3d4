//! The scan of all atoms for a tile of poses: which atom does each of them take next?
//!
//! For a pose with residual r (after k atoms, weighted and of unit norm at the start) and the orthonormal directions
//! q_1..q_k of its chosen atoms, an atom a (weighted too) has
//!
//! ```text
//! c = <a, r>              the correlation:      c <- c - <q_k, r> <a, q_k>
//! e = |(I - P) a|^2       what is left of it:   e <- e - <a, q_k>^2
//! ```
//!
//! and taking it lowers the squared residual by c^2 / e. The optimised rule takes the largest c^2 / e, the plain rule the
//! largest c^2 / |a|^2. Either way a step needs one product <a, q_k> an atom: a matrix product for a block of atoms and
//! the whole tile of poses, used up while it is in the cache.
//!
//! Rows are atoms and columns are poses here, so that eight poses go through the comparison side by side. A pose's
//! numbers do not depend on the poses beside it: one pose alone gives the same bits as one of many.

use super::fit::Fit;
use super::pursuit::Rule;
use super::{Dictionary, Stop};
use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, ArrayView2, s};
use std::array::from_fn;

/// Poses that are compared side by side: a register of eight f32 or two of four.
const LANES: usize = 8;
type Lanes = [f32; LANES];

/// Atoms in a block of the product: with 64 poses its result takes 32 kB.
const BLOCK: usize = 128;

/// What is left of an atom counts as at least this share of its squared norm. Below it the difference of f32 numbers
/// is rounding; a smaller value would let a copy of a chosen atom win by noise.
const FLOOR: f32 = 1e-6;

/// An atom with at most this share of its squared norm (1) on what is observed is not seen at all.
const UNSEEN: f32 = 1e-20;

/// How often a pose may find that the atom it took depends on the others before it gives up: only rounding lets such an
/// atom win, and only where nothing of use is left.
const RETRIES: usize = 4;

/// How many poses to code together: the two or three numbers kept for each pair of pose and atom should stay in the
/// cache, but a product with few poses wastes its time on packing the atoms.
pub(super) fn poses_at_once(n: usize) -> usize {
    match n {
        0..=16_384 => 64, // measured: 128 is no faster at 1,000 atoms, and a fifth slower at 5,000
        16_385..=65_536 => 32,
        _ => 16,
    }
}

/// The state of a tile. Made once for many tiles.
pub(super) struct Tile<'a> {
    dictionary: &'a Dictionary,
    rule: Rule,
    poses: usize,            // a multiple of LANES
    correlation: Vec<f32>,   // (n, poses): c
    remainder: Vec<f32>,     // (n, poses): e; infinite once the atom is taken, or if it is not seen
    floor: Vec<f32>,         // (n, poses): FLOOR |a|^2; empty without weights
    product: Array2<f32>,    // (BLOCK, poses): <a, q>
    directions: Array2<f32>, // (poses, D): the newest q, or r before the first
    part: Vec<Lanes>,        // <q, r>, by groups of LANES poses
    best: Vec<Best>,         // by groups of LANES poses
}

/// The best atom so far for LANES poses: compared as fractions, since dividing costs more.
#[derive(Clone, Copy)]
struct Best {
    over: Lanes,
    under: Lanes,
    atom: [u32; LANES],
}

const NONE: Best = Best {
    over: [0.0; LANES],
    under: [1.0; LANES],
    atom: [u32::MAX; LANES],
};

impl Best {
    /// An atom with c^2 = `over` and e = `under`. The first of equals wins.
    #[inline(always)]
    fn meet(&mut self, over: Lanes, under: Lanes, atom: u32) {
        let mut better = 0u32;
        for l in 0..LANES {
            better |= u32::from(over[l] * self.under[l] > self.over[l] * under[l]);
        }
        // Seldom, after the first few atoms: a branch costs less than choosing in every lane.
        if better != 0 {
            for l in 0..LANES {
                if over[l] * self.under[l] > self.over[l] * under[l] {
                    (self.over[l], self.under[l], self.atom[l]) = (over[l], under[l], atom);
                }
            }
        }
    }
}

impl<'a> Tile<'a> {
    /// Room for `poses` poses.
    pub fn new(dictionary: &'a Dictionary, rule: Rule, poses: usize) -> Self {
        let poses = poses.next_multiple_of(LANES);
        let (n, d) = (dictionary.len(), dictionary.width());
        Tile {
            dictionary,
            rule,
            poses,
            correlation: vec![0.0; n * poses],
            remainder: vec![0.0; n * poses],
            floor: Vec::new(),
            product: Array2::zeros((BLOCK.min(n), poses)),
            directions: Array2::zeros((poses, d)),
            part: vec![[0.0; LANES]; poses / LANES],
            best: vec![NONE; poses / LANES],
        }
    }

    /// Codes the poses that `fits` were started on, with at most `sparsity` atoms each.
    pub fn code(&mut self, fits: &mut [Fit], sparsity: usize) {
        debug_assert!(fits.len() <= self.poses);
        self.load(fits);
        let most = sparsity
            .min(self.dictionary.len())
            .min(self.dictionary.width());
        for step in 0..most + RETRIES {
            if fits.iter().all(|f| f.stop.is_some()) {
                break;
            }
            match (step, self.rule, self.floor.is_empty()) {
                (0, _, _) => self.scan::<true, false, true>(),
                (_, Rule::Plain, _) => self.scan::<false, false, true>(),
                (_, Rule::Optimised, true) => self.scan::<false, true, true>(),
                (_, Rule::Optimised, false) => self.scan::<false, true, false>(),
            }
            self.take(fits);
            for fit in fits
                .iter_mut()
                .filter(|f| f.stop.is_none() && f.support.len() == most)
            {
                fit.stop = Some(if most == sparsity {
                    Stop::Sparsity
                } else {
                    Stop::Dependent
                });
            }
        }
        fits.iter_mut()
            .for_each(|f| f.stop = f.stop.or(Some(Stop::Dependent)));
    }

    /// Puts the residuals in place of the directions, and |a|^2 in place of what is left of the atoms.
    fn load(&mut self, fits: &[Fit]) {
        self.directions.fill(0.0);
        for (fit, mut row) in fits.iter().zip(self.directions.outer_iter_mut()) {
            if fit.stop.is_none() {
                weigh(
                    &fit.residual,
                    fit.root.as_deref(),
                    row.as_slice_mut().expect("a row"),
                );
            }
        }
        if fits.iter().all(|f| f.root.is_none()) {
            self.floor.clear();
            self.remainder.fill(1.0);
        } else {
            self.load_norms(fits);
        }
    }

    /// |a|^2 under each pose's weights.
    fn load_norms(&mut self, fits: &[Fit]) {
        let (n, d) = (self.dictionary.len(), self.dictionary.width());
        let mut weights = Array2::<f32>::ones((self.poses, d));
        for (fit, mut row) in fits.iter().zip(weights.outer_iter_mut()) {
            if let Some(root) = &fit.root {
                row.iter_mut()
                    .zip(root)
                    .for_each(|(w, r)| *w = (r * r) as f32);
            }
        }
        self.floor.resize(n * self.poses, 0.0);
        let mut squares = Array2::<f32>::zeros((BLOCK.min(n), d));
        for from in (0..n).step_by(BLOCK) {
            let to = (from + BLOCK).min(n);
            let mut squares = squares.slice_mut(s![..to - from, ..]);
            squares.zip_mut_with(&self.dictionary.atoms().slice(s![from..to, ..]), |s, a| {
                *s = a * a
            });
            let range = from * self.poses..to * self.poses;
            let rest = &mut self.remainder[range.clone()];
            let shape = (to - from, self.poses);
            let mut view = ndarray::ArrayViewMut2::from_shape(shape, rest).expect("rows of poses");
            general_mat_mul(1.0, &squares, &weights.t(), 0.0, &mut view);
            for (e, floor) in rest.iter_mut().zip(&mut self.floor[range]) {
                *floor = *e * FLOOR;
                if *e <= UNSEEN {
                    *e = f32::INFINITY;
                }
            }
        }
    }

    /// Brings c and e up to date and finds each pose's best atom.
    ///
    /// `FIRST`: c is the product itself. `SHRINK`: e falls (the optimised rule). `UNIT`: all atoms have norm 1.
    fn scan<const FIRST: bool, const SHRINK: bool, const UNIT: bool>(&mut self) {
        let (n, groups) = (self.dictionary.len(), self.poses / LANES);
        self.best.fill(NONE);
        for from in (0..n).step_by(BLOCK) {
            let to = (from + BLOCK).min(n);
            let atoms: ArrayView2<f32> = self.dictionary.atoms().slice_move(s![from..to, ..]);
            let mut product = self.product.slice_mut(s![..to - from, ..]);
            general_mat_mul(1.0, &atoms, &self.directions.t(), 0.0, &mut product);
            let product = product
                .into_slice()
                .expect("whole rows")
                .as_chunks::<LANES>()
                .0;
            let range = from * self.poses..to * self.poses;
            let correlation = self.correlation[range.clone()].as_chunks_mut::<LANES>().0;
            let remainder = self.remainder[range.clone()].as_chunks_mut::<LANES>().0;
            let floor = if UNIT {
                &[]
            } else {
                self.floor[range].as_chunks::<LANES>().0
            };
            for group in 0..groups {
                let (part, mut best) = (self.part[group], self.best[group]);
                // By value: written through references, the lanes would be taken one by one.
                for a in 0..to - from {
                    let at = a * groups + group;
                    let p = product[at];
                    let f = if UNIT { [FLOOR; LANES] } else { floor[at] };
                    let c = if FIRST {
                        p
                    } else {
                        from_fn(|l| correlation[at][l] - part[l] * p[l])
                    };
                    correlation[at] = c;
                    let mut e = remainder[at];
                    if SHRINK {
                        e = from_fn(|l| e[l] - p[l] * p[l]);
                        remainder[at] = e;
                        e = from_fn(|l| if e[l] > f[l] { e[l] } else { f[l] });
                    }
                    best.meet(from_fn(|l| c[l] * c[l]), e, (from + a) as u32);
                }
                self.best[group] = best;
            }
        }
    }

    /// Gives each pose its best atom, and makes the direction that this adds ready for the next scan.
    fn take(&mut self, fits: &mut [Fit]) {
        for (i, fit) in fits.iter_mut().enumerate() {
            let (group, lane) = (i / LANES, i % LANES);
            let mut row = self.directions.row_mut(i);
            self.part[group][lane] = 0.0;
            if fit.stop.is_none() {
                let atom = self.best[group].atom[lane];
                if atom == u32::MAX {
                    fit.stop = Some(Stop::Dependent);
                } else {
                    // Taken, or found in f64 to depend on those taken: not to be looked at again either way.
                    self.remainder[atom as usize * self.poses + i] = f32::INFINITY;
                    if fit.push(atom, super::code::row(self.dictionary, atom)) {
                        let (q, z) = fit.newest();
                        weigh(q, fit.root.as_deref(), row.as_slice_mut().expect("a row"));
                        self.part[group][lane] = z as f32;
                        continue;
                    }
                }
            }
            row.fill(0.0);
        }
    }
}

/// √w∘v in f32: an unweighted atom's product with it is the weighted atom's with v.
fn weigh(v: &[f64], root: Option<&[f64]>, out: &mut [f32]) {
    match root {
        Some(root) => {
            out.iter_mut()
                .zip(v)
                .zip(root)
                .for_each(|((o, v), w)| *o = (v * w) as f32);
        }
        None => out.iter_mut().zip(v).for_each(|(o, v)| *o = *v as f32),
    }
}

//! Atoms by sixteens that are near one another, each told by a few of its numbers: what a pruned search looks at first.
//!
//! Poses fill few dimensions. In the basis of the atoms' principal directions the first K coordinates of an atom, its head,
//! are nearly all of it, and with the length t of the rest, its tail, they bound its product with any direction q:
//!
//! ```text
//! |<a, q>| <= |<head(a), head(q)>| + t(a) t(q)
//! ```
//!
//! A leaf is 16 atoms of neighbouring heads; all of them lie in a ball about its centre, which bounds them together.

use super::kernel;
use crate::par;
use ndarray::{Array2, ArrayView2, Axis, s};
use pulp::{Simd, WithSimd};
use std::sync::atomic::{AtomicU64, Ordering};

/// Atoms in a leaf, and leaves beside one another.
pub const LEAF: usize = 16;
/// Coordinates are multiplied by so many.
pub const PART: usize = 8;
/// Parts of a head, and of a centre: more would not tell leaves apart better, as they are wider than that.
pub const PARTS: usize = HEAD / PART;
const CENTRE_PARTS: usize = CENTRE / PART;
/// Coordinates of a head, and of a centre.
const HEAD: usize = 32;
const CENTRE: usize = 16;
/// Bounds are tried after so many parts.
pub const LEVELS: [usize; 3] = [1, 2, PARTS];
/// Marks a place of a leaf without an atom.
pub const NO_ATOM: u32 = u32::MAX;

/// Atoms that the basis is learnt from, at most.
const SAMPLE: usize = 4_096;
/// Steps towards the principal directions.
const ITERATIONS: usize = 6;
/// Atoms of a branch that its split is learnt from, at most.
const SPLIT_SAMPLE: usize = 1024;
/// Branches of more atoms are split beside one another.
const LARGE: usize = 4096;
/// Searches that are made in any case.
const TRIED: u64 = 64;
/// A row multiplied in a search costs as much as so many in a scan, measured: 1 / 2.5.
const WORTH: f64 = 0.4;
/// Added to lengths that are to be bounds: more than f32 rounds of numbers up to 1.
const ROUNDING: f64 = 1e-6;
/// A ball that is within this of what the chosen atoms span is always looked into: what is left of its atoms there is
/// little, and rounding tells in it.
pub const NEAR: f32 = 0.03;
/// Beyond this rounding hardly tells.
pub const FAR: f32 = 0.15;

/// One number of each atom of a leaf, or of each of sixteen leaves.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Lanes(pub [f32; LEAF]);

impl Lanes {
    pub const ZERO: Lanes = Lanes([0.0; LEAF]);
}

/// Sixteen atoms.
#[derive(Clone)]
pub struct Leaf {
    pub heads: [[Lanes; PART]; PARTS],
    /// The lengths of what is beyond each of [`LEVELS`].
    pub tails: [Lanes; LEVELS.len()],
    pub atoms: [u32; LEAF],
}

/// Sixteen balls, each about the atoms of a leaf or a branch.
#[derive(Clone)]
pub struct Balls {
    pub heads: [[Lanes; PART]; CENTRE_PARTS],
    /// |m|²; infinite where there is no leaf.
    pub norms: Lanes,
    /// All atoms of the leaf are within this of m.
    pub radii: Lanes,
    /// (radius + [`NEAR`])².
    pub near: Lanes,
    /// (radius + [`FAR`])².
    pub far: Lanes,
}

/// All atoms of a dictionary.
pub struct Leaves {
    /// The directions of heads, orthonormal: of each of the D coordinates a row. Fewer than HEAD if D is less; 0 then.
    basis: Vec<[f64; HEAD]>,
    pub leaves: Vec<Leaf>,
    /// Of each leaf D rows: its atoms as they are.
    pub whole: Vec<Lanes>,
    /// Of each leaf a ball.
    pub balls: Vec<Balls>,
    /// Of each sixteen leaves one.
    pub branches: Vec<Balls>,
    /// Of each atom, in which leaf it is.
    places: Vec<u32>,
    pub tally: Tally,
}

/// What searches of a dictionary have cost, and what scans in their place would have, in rows of lanes multiplied. What is
/// found does not depend on it.
#[derive(Default)]
pub struct Tally {
    spent: AtomicU64,
    scans: AtomicU64,
    searches: AtomicU64,
}

impl Tally {
    /// A search that multiplied `spent` rows, where a scan multiplies `scan`.
    pub fn search(&self, spent: usize, scan: usize) {
        self.spent.fetch_add(spent as u64, Ordering::Relaxed);
        self.scans.fetch_add(scan as u64, Ordering::Relaxed);
        self.searches.fetch_add(1, Ordering::Relaxed);
    }

    /// Scans that had to be made after all.
    pub fn scans(&self, count: usize, scan: usize) {
        let rows = (count * scan) as u64;
        self.spent.fetch_add(rows, Ordering::Relaxed);
    }

    /// Whether scans cost less: they multiply a row for several poses at once.
    pub fn is_useless(&self) -> bool {
        let [spent, scans, searches] =
            [&self.spent, &self.scans, &self.searches].map(|n| n.load(Ordering::Relaxed));
        searches >= TRIED && spent as f64 > WORTH * scans as f64
    }
}

impl Leaves {
    /// Of atoms (n, D) of unit norm.
    pub fn new(atoms: ArrayView2<'_, f32>) -> Leaves {
        let basis = principal(atoms);
        let n = atoms.nrows();
        let heads: Vec<Head> = par::map_chunks(n, 1024, |rows| {
            let mut atom = vec![0.0; basis.len()];
            let mut of = |i| {
                (atom.iter_mut().zip(atoms.row(i))).for_each(|(to, a)| *to = f64::from(*a));
                Turned::along(&basis, &atom).head()
            };
            rows.map(&mut of).collect::<Vec<_>>()
        })
        .concat();
        let mut order: Vec<u32> = (0..n as u32).collect();
        split(&mut order, &heads);
        let leaves: Vec<Leaf> = par::map_chunks(n, LEAF, |places| leaf(&order[places], &heads));
        let about = |atoms: usize| -> Vec<Balls> {
            let balls = par::map_chunks(n, atoms, |places| ball(&order[places], &heads));
            balls.chunks(LEAF).map(beside).collect()
        };
        let whole = par::map_chunks(n, LEAF, |places| whole(&order[places], atoms)).concat();
        let mut places = vec![0; n];
        for (place, atom) in order.iter().enumerate() {
            places[*atom as usize] = (place / LEAF) as u32;
        }
        Leaves {
            basis,
            leaves,
            whole,
            balls: about(LEAF),
            branches: about(LEAF * LEAF),
            places,
            tally: Tally::default(),
        }
    }

    /// Rows of lanes that a scan multiplies a step.
    pub fn scan(&self) -> usize {
        self.whole.len()
    }

    /// In which leaf an atom is; neighbouring leaves have neighbouring numbers.
    pub fn place(&self, atom: u32) -> u32 {
        self.places[atom as usize]
    }
}

/// A vector's coordinates along the basis, and the lengths of what is beyond each of [`LEVELS`]: bounds from above.
#[derive(Clone, Copy)]
pub struct Head {
    pub along: [[f32; PART]; PARTS],
    pub beyond: [f32; LEVELS.len()],
}

impl Head {
    /// The coordinates that a centre has.
    fn centre(&self) -> &[f32] {
        &self.along.as_flattened()[..CENTRE]
    }
}

/// A vector's coordinates along the basis, and its squared length.
#[derive(Clone, Copy)]
pub struct Turned {
    along: [f64; HEAD],
    squared: f64,
}

impl Turned {
    /// Of nothing.
    pub const NONE: Turned = Turned {
        along: [0.0; HEAD],
        squared: 0.0,
    };

    /// Of a vector (D).
    pub fn of(leaves: &Leaves, vector: &[f64]) -> Turned {
        Turned::along(&leaves.basis, vector)
    }

    fn along(basis: &[[f64; HEAD]], vector: &[f64]) -> Turned {
        let mut turned = Turned::NONE;
        kernel::widest(Turn {
            basis,
            vector,
            turned: &mut turned,
        });
        turned
    }

    /// Takes `times` another vector off it; its squared length is known then.
    pub fn less(&mut self, times: f64, other: &Turned, squared: f64) {
        (self.along.iter_mut().zip(&other.along)).for_each(|(a, b)| *a -= times * b);
        self.squared = squared;
    }

    /// The head, and bounds of the tails.
    pub fn head(&self) -> Head {
        let mut left = self.squared;
        let mut beyond = [0.0; LEVELS.len()];
        let mut from = 0;
        for (beyond, to) in beyond.iter_mut().zip(LEVELS) {
            let to = to * PART;
            left -= self.along[from..to].iter().map(|a| a * a).sum::<f64>();
            // What rounding may have taken off, some D 2^-53, is below what is added up to hundreds of numbers; the noise
            // that searches allow for is larger by far.
            *beyond = ((left.max(0.0) + 1e-13).sqrt() * (1.0 + ROUNDING)) as f32;
            from = to;
        }
        let part = |p: usize| std::array::from_fn(|k| self.along[p * PART + k] as f32);
        Head {
            along: std::array::from_fn(part),
            beyond,
        }
    }
}

/// A vector times the basis.
struct Turn<'a> {
    basis: &'a [[f64; HEAD]],
    vector: &'a [f64],
    turned: &'a mut Turned,
}

impl WithSimd for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F64_LANES {
            8 => self.go::<S, 4>(simd),
            4 => self.go::<S, 8>(simd),
            2 => self.go::<S, 16>(simd),
            _ => self.go::<S, HEAD>(simd),
        }
    }
}

impl Turn<'_> {
    /// V vectors hold a head.
    #[inline(always)]
    fn go<S: Simd, const V: usize>(self, simd: S) {
        let mut sums = [simd.splat_f64s(0.0); V];
        let mut squared = 0.0;
        for (row, value) in self.basis.iter().zip(self.vector) {
            let row = S::as_simd_f64s(row).0;
            let by = simd.splat_f64s(*value);
            for v in 0..V {
                sums[v] = simd.mul_add_e_f64s(row[v], by, sums[v]);
            }
            squared += value * value;
        }
        S::as_mut_simd_f64s(&mut self.turned.along)
            .0
            .copy_from_slice(&sums);
        self.turned.squared = squared;
    }
}

/// The principal directions of the atoms about 0: of each coordinate a row.
fn principal(atoms: ArrayView2<'_, f32>) -> Vec<[f64; HEAD]> {
    let (n, d) = atoms.dim();
    let some = atoms.slice_axis(
        Axis(0),
        ndarray::Slice::from(..).step_by(n.div_ceil(SAMPLE) as isize),
    );
    let moments = par::map_chunks(some.nrows(), 1024, |rows| {
        let part = some.slice(s![rows, ..]).mapv(f64::from);
        part.t().dot(&part)
    });
    let moment = moments
        .into_iter()
        .fold(Array2::zeros((d, d)), |sum, part| sum + part);
    orthogonal_iteration(&moment)
}

/// The largest eigenvectors of a symmetric matrix, nearly, in columns: [`HEAD`] of them, 0 beyond its rank. How near does
/// not matter, but they are orthonormal. (LAPACK would be exact, but a command that loads it starts 4 ms later.)
fn orthogonal_iteration(matrix: &Array2<f64>) -> Vec<[f64; HEAD]> {
    let d = matrix.nrows();
    let mut axes: Vec<usize> = (0..d).collect();
    axes.sort_by(|a, b| matrix[[*b, *b]].total_cmp(&matrix[[*a, *a]]));
    let mut vectors = Array2::zeros((HEAD.min(d), d));
    for (mut vector, axis) in vectors.outer_iter_mut().zip(axes) {
        vector[axis] = 1.0;
    }
    for _ in 0..ITERATIONS {
        vectors = vectors.dot(matrix);
        orthonormalise(&mut vectors);
    }
    let mut columns = vec![[0.0; HEAD]; d];
    for (k, vector) in vectors.outer_iter().enumerate() {
        (columns.iter_mut().zip(vector)).for_each(|(column, v)| column[k] = *v);
    }
    columns
}

/// Gram and Schmidt's way, each vector twice: what rounding leaves the first time is gone the second.
fn orthonormalise(vectors: &mut Array2<f64>) {
    for i in 0..vectors.nrows() {
        let (before, mut rest) = vectors.view_mut().split_at(Axis(0), i);
        let mut vector = rest.row_mut(0);
        let whole = vector.dot(&vector).sqrt();
        for other in before.outer_iter().chain(before.outer_iter()) {
            let along = other.dot(&vector);
            vector.scaled_add(-along, &other);
        }
        let left = vector.dot(&vector).sqrt();
        match left > whole * 1e-9 {
            true => vector.mapv_inplace(|v| v / left),
            false => vector.fill(0.0),
        }
    }
}

/// Orders atoms so that each sixteen are neighbours: halves by where they are along their widest direction, and so on.
fn split(order: &mut [u32], heads: &[Head]) {
    if order.len() <= LEAF {
        return;
    }
    let widest = widest(order, heads);
    let at = |atom: &u32| -> f32 {
        let head = heads[*atom as usize].centre();
        head.iter().zip(&widest).map(|(h, w)| h * w).sum()
    };
    let mut placed: Vec<(f32, u32)> = order.iter().map(|a| (at(a), *a)).collect();
    let half = (order.len() / 2).next_multiple_of(LEAF);
    placed.select_nth_unstable_by(half.min(order.len() - 1), |a, b| {
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    order.iter_mut().zip(&placed).for_each(|(o, p)| *o = p.1);
    let large = order.len() > LARGE;
    let (low, high) = order.split_at_mut(half);
    match large {
        true => {
            rayon::join(|| split(low, heads), || split(high, heads));
        }
        false => {
            split(low, heads);
            split(high, heads);
        }
    }
}

/// The direction in which heads differ most, nearly: a few steps of the power method.
fn widest(order: &[u32], heads: &[Head]) -> [f32; CENTRE] {
    let some = order.iter().step_by(order.len().div_ceil(SPLIT_SAMPLE));
    let rows: Vec<&[f32]> = some.map(|a| heads[*a as usize].centre()).collect();
    let mean: [f32; CENTRE] =
        std::array::from_fn(|k| rows.iter().map(|r| r[k]).sum::<f32>() / rows.len() as f32);
    let mut spread = [[0.0f32; CENTRE]; CENTRE];
    for row in rows {
        let apart: [f32; CENTRE] = std::array::from_fn(|k| row[k] - mean[k]);
        for (line, a) in spread.iter_mut().zip(apart) {
            line.iter_mut().zip(apart).for_each(|(s, b)| *s += a * b);
        }
    }
    let longest = (0..CENTRE).max_by(|a, b| spread[*a][*a].total_cmp(&spread[*b][*b]));
    let mut widest = spread[longest.unwrap_or(0)];
    for _ in 0..8 {
        let longest = widest.iter().fold(f32::MIN_POSITIVE, |m, w| m.max(w.abs()));
        widest.iter_mut().for_each(|w| *w /= longest);
        widest = spread.map(|line| line.iter().zip(widest).map(|(s, w)| s * w).sum());
    }
    widest
}

fn leaf(atoms: &[u32], heads: &[Head]) -> Leaf {
    let mut leaf = Leaf {
        heads: [[Lanes::ZERO; PART]; PARTS],
        tails: [Lanes::ZERO; LEVELS.len()],
        atoms: [NO_ATOM; LEAF],
    };
    for (lane, atom) in atoms.iter().enumerate() {
        let head = &heads[*atom as usize];
        let rows = leaf.heads.as_flattened_mut().iter_mut();
        rows.zip(head.along.as_flattened())
            .for_each(|(row, h)| row.0[lane] = *h);
        (leaf.tails.iter_mut().zip(head.beyond)).for_each(|(row, t)| row.0[lane] = t);
        leaf.atoms[lane] = *atom;
    }
    leaf
}

/// The atoms of a leaf as they are, a row of lanes a coordinate.
fn whole(some: &[u32], atoms: ArrayView2<'_, f32>) -> Vec<Lanes> {
    let mut rows = vec![Lanes::ZERO; atoms.ncols()];
    for (lane, atom) in some.iter().enumerate() {
        for (row, a) in rows.iter_mut().zip(atoms.row(*atom as usize)) {
            row.0[lane] = *a;
        }
    }
    rows
}

struct Ball {
    centre: [f32; CENTRE],
    radius: f64,
}

/// The ball of a leaf about the mean of its heads: what is beyond them counts for its radius.
fn ball(atoms: &[u32], heads: &[Head]) -> Ball {
    let heads = || atoms.iter().map(|a| &heads[*a as usize]);
    let centre: [f32; CENTRE] =
        std::array::from_fn(|k| heads().map(|h| h.centre()[k]).sum::<f32>() / atoms.len() as f32);
    let squared = heads().map(|h| {
        let apart = h
            .centre()
            .iter()
            .zip(centre)
            .map(|(a, c)| f64::from(a - c).powi(2));
        apart.sum::<f64>() + f64::from(h.beyond[1]).powi(2)
    });
    let radius = squared.fold(0.0, f64::max).sqrt() * (1.0 + ROUNDING) + ROUNDING;
    Ball { centre, radius }
}

fn beside(balls: &[Ball]) -> Balls {
    let mut all = Balls {
        heads: [[Lanes::ZERO; PART]; CENTRE_PARTS],
        norms: Lanes([f32::INFINITY; LEAF]),
        radii: Lanes::ZERO,
        near: Lanes::ZERO,
        far: Lanes::ZERO,
    };
    for (lane, ball) in balls.iter().enumerate() {
        let rows = all.heads.as_flattened_mut().iter_mut();
        rows.zip(ball.centre).for_each(|(row, c)| row.0[lane] = c);
        let norm: f64 = ball.centre.iter().map(|c| f64::from(*c).powi(2)).sum();
        all.norms.0[lane] = norm as f32;
        all.radii.0[lane] = ball.radius as f32;
        for (row, gap) in [(&mut all.near, NEAR), (&mut all.far, FAR)] {
            let reach = ball.radius + f64::from(gap) + ROUNDING;
            row.0[lane] = (reach * reach + 10.0 * ROUNDING) as f32;
        }
    }
    all
}

//! Branch-and-bound search of the ball tree for the best atom of a pose.
//!
//! With r̂ the residual of unit length, q_1..q_k the orthonormal directions of the atoms taken, and
//! a⊥ the part of an atom a outside their span, the score of a is the squared cosine of the angle
//! between a⊥ and r̂:
//!
//! ```text
//! <a, r̂>² / |a⊥|²,     |a⊥|² = 1 - Σ_i <a, q_i>²
//!     (plain OMP: <a, r̂>², without directions)
//! ```
//!
//! 1. The best leaf of the previous pose, and the leaf found by descending to the best center, give
//!    a first score.
//! 2. Atoms that reach the score cos²α lie in the cone of angle α around ±r̂. A ball of radius ρ
//!    around m is skipped if it lies outside: if (|<m, r̂>| + ρ sin α)² < cos²α (|m⊥|² - ρ²).
//! 3. In each leaf that is left, the leading PCA coordinates, then all of them, bound the scores of
//!    the atoms from above.
//! 4. Atoms that may still be the best are scored in double precision. The first of equal atoms is
//!    taken.
//!
//! Bounds are computed in single precision and widened by more than their rounding, so the result
//! is always the best atom. Poses that follow one another in time visit nearly the same leaves,
//! which are then in the cache.

use super::super::SelectionRule;
use super::super::active_set::ActiveSet;
use super::ball_tree::{BallTree, Balls, LEAF, Lanes};
use super::panel_kernel::{FLOOR, add_product};
use super::pca_projection::{LEADING, Projected};
use crate::numeric::simd;
use pulp::{Simd, WithSimd};

/// The largest number of atoms of a code: with more directions, dense scans cost less.
pub(crate) const MOST_ATOMS: usize = 4;
/// More than the rounding of both sides of a bound, which are at most about 1: sums of up to 32
/// products of unit vectors err by at most 40 · 2^-24 (Higham, Accuracy and Stability of Numerical
/// Algorithms, 3.1).
const SLACK: f32 = 2e-5;
/// Centers nearer to the span of the directions count as this far, as a squared distance, when a
/// start is chosen.
const NEAR_SPAN: f32 = 1e-3;

/// Searches for one pose after the other, with their scratch memory.
pub(crate) struct TreeSearch<'a> {
    tree: &'a BallTree,
    /// (n, D)
    atoms: &'a [f32],
    rule: SelectionRule,
    /// r̂ (D).
    residual: Vec<f64>,
    /// The PCA coordinates of the directions taken.
    directions: Vec<Projected>,
    /// The leaf of each atom of the previous pose.
    previous: [usize; MOST_ATOMS],
    /// The groups of balls still to visit: layer and index.
    open: Vec<(usize, usize)>,
}

impl<'a> TreeSearch<'a> {
    /// A search of the tree over `atoms` (n, D).
    pub(crate) fn new(tree: &'a BallTree, atoms: &'a [f32], rule: SelectionRule) -> TreeSearch<'a> {
        TreeSearch {
            tree,
            atoms,
            rule,
            residual: Vec::new(),
            directions: Vec::new(),
            previous: [0; MOST_ATOMS],
            open: Vec::new(),
        }
    }

    /// Starts with a pose that has no atoms.
    pub(crate) fn start(&mut self) {
        self.directions.clear();
    }

    /// Adds the direction of the newest atom of `fit`.
    pub(crate) fn add_direction(&mut self, fit: &ActiveSet) {
        let (direction, _) = fit.newest();
        self.directions.push(self.tree.basis.project(direction));
    }

    /// The best atom for a pose, without the excluded ones; `None` if no score is above 0.
    pub(crate) fn best(&mut self, fit: &ActiveSet, excluded: &[u32]) -> Option<u32> {
        let best = simd::dispatch_widest(self.search(fit, excluded));
        self.previous[self.directions.len()] = best.leaf;
        best.atom
    }

    fn search<'s>(&'s mut self, fit: &'s ActiveSet, excluded: &'s [u32]) -> Search<'s> {
        let scale = 1.0 / fit.left().sqrt();
        self.residual.clear();
        self.residual
            .extend(fit.residual().iter().map(|r| r * scale));
        Search {
            tree: self.tree,
            atoms: self.atoms,
            fit,
            excluded,
            residual: &self.residual,
            projected: self.tree.basis.project(&self.residual),
            directions: match self.rule {
                SelectionRule::Oomp => &self.directions,
                SelectionRule::Omp => &[],
            },
            start: self.previous[self.directions.len()],
            open: &mut self.open,
            best: Best::NONE,
        }
    }
}

/// The best atom so far, and the cone of atoms that are as good.
#[derive(Clone, Copy)]
struct Best {
    /// cos²α
    score: f64,
    atom: Option<u32>,
    leaf: usize,
    /// cos²α in single precision, and sin α.
    cos2: f32,
    sin: f32,
}

impl Best {
    const NONE: Best = Best {
        score: 0.0,
        atom: None,
        leaf: 0,
        cos2: 0.0,
        sin: 1.0,
    };
}

/// The search for the next atom of a pose.
struct Search<'s> {
    tree: &'s BallTree,
    /// (n, D)
    atoms: &'s [f32],
    fit: &'s ActiveSet,
    excluded: &'s [u32],
    /// r̂ (D), and its PCA coordinates.
    residual: &'s [f64],
    projected: Projected,
    /// The directions that count: none for plain OMP.
    directions: &'s [Projected],
    /// The leaf to visit first.
    start: usize,
    open: &'s mut Vec<(usize, usize)>,
    best: Best,
}

impl WithSimd for Search<'_> {
    type Output = Best;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Best {
        // The number of vectors that hold the lanes of a leaf.
        match S::F32_LANES {
            16 => self.run::<S, 1>(simd),
            8 => self.run::<S, 2>(simd),
            4 => self.run::<S, 4>(simd),
            _ => self.run::<S, LEAF>(simd),
        }
    }
}

/// Upper bound of <a, r̂>² and lower bound of |a⊥|², for the atoms of a leaf.
type ScoreBounds<S, const V: usize> = [(<S as Simd>::f32s, <S as Simd>::f32s); V];

/// The products of a leaf's atoms with the residual and the directions.
type Products<S, const V: usize> = [[<S as Simd>::f32s; V]; MOST_ATOMS + 1];

impl Search<'_> {
    #[inline(always)]
    fn run<S: Simd, const V: usize>(mut self, simd: S) -> Best {
        self.visit::<S, V>(simd, self.start);
        let descent = self.descend::<S, V>(simd);
        self.visit::<S, V>(simd, descent);
        let top = self.tree.layers.len() - 1;
        self.open.clear();
        (self.open).extend((0..self.tree.layers[top].len()).map(|group| (top, group)));
        while let Some((layer, group)) = self.open.pop() {
            let mut balls = self.reachable::<S, V>(simd, &self.tree.layers[layer][group]);
            while balls != 0 {
                let ball = group * LEAF + balls.trailing_zeros() as usize;
                balls &= balls - 1;
                match layer {
                    0 => self.visit::<S, V>(simd, ball),
                    _ => self.open.push((layer - 1, ball)),
                }
            }
        }
        self.best
    }

    /// The leaf found by descending to the ball with the best center.
    #[inline(always)]
    fn descend<S: Simd, const V: usize>(&self, simd: S) -> usize {
        let mut groups = 0..self.tree.layers.last().map_or(0, Vec::len);
        for layer in self.tree.layers.iter().rev() {
            let (mut most, mut best) = (-1.0, 0);
            for group in groups {
                let (along, left) = self.centers::<S, V>(simd, &layer[group]);
                let mut scores = Lanes::ZERO;
                for v in 0..V {
                    let left = simd.max_f32s(left[v], simd.splat_f32s(NEAR_SPAN));
                    let score = simd.div_f32s(simd.mul_f32s(along[v], along[v]), left);
                    S::as_mut_simd_f32s(&mut scores.0).0[v] = score;
                }
                for (lane, score) in scores.0.into_iter().enumerate() {
                    if score > most {
                        (most, best) = (score, group * LEAF + lane);
                    }
                }
            }
            groups = best..best + 1;
        }
        groups.start
    }

    /// |<m, r̂>| and |m⊥|² of a group of centers m.
    #[inline(always)]
    fn centers<S: Simd, const V: usize>(
        &self,
        simd: S,
        balls: &Balls,
    ) -> ([S::f32s; V], [S::f32s; V]) {
        let mut along = products::<S, V>(simd, &balls.centers, self.projected.leading());
        let mut left = lanes::<S, V>(&balls.norms);
        for direction in self.directions {
            let part = products::<S, V>(simd, &balls.centers, direction.leading());
            for v in 0..V {
                left[v] = add_product(simd, simd.neg_f32s(part[v]), part[v], left[v]);
            }
        }
        for v in 0..V {
            along[v] = simd.abs_f32s(along[v]);
        }
        (along, left)
    }

    /// The mask of balls that may hold an atom as good as the best so far.
    #[inline(always)]
    fn reachable<S: Simd, const V: usize>(&self, simd: S, balls: &Balls) -> u32 {
        let (along, left) = self.centers::<S, V>(simd, balls);
        let radii = lanes::<S, V>(&balls.radii);
        let sin = simd.splat_f32s(self.best.sin);
        let mut bounds = [(along[0], left[0]); V];
        for v in 0..V {
            let reach = add_product(simd, radii[v], sin, along[v]);
            bounds[v].0 = add_product(simd, reach, reach, simd.splat_f32s(SLACK));
            bounds[v].1 = add_product(simd, simd.neg_f32s(radii[v]), radii[v], left[v]);
        }
        self.passing::<S, V>(simd, &bounds)
    }

    /// The mask of bounds that allow a score as good as the best so far. Empty slots never pass:
    /// their |m|² is infinite.
    #[inline(always)]
    fn passing<S: Simd, const V: usize>(&self, simd: S, bounds: &ScoreBounds<S, V>) -> u32 {
        let cos2 = simd.splat_f32s(self.best.cos2);
        let mut mask = 0;
        for v in 0..V {
            let (over, under) = bounds[v];
            let passes = simd.greater_than_or_equal_f32s(over, simd.mul_f32s(cos2, under));
            mask |= bits::<S>(passes) << (v * S::F32_LANES);
        }
        mask
    }

    /// Scores the atoms of a leaf that may be as good as the best so far.
    #[inline(always)]
    fn visit<S: Simd, const V: usize>(&mut self, simd: S, leaf: usize) {
        let mut sums: Products<S, V> = [[simd.splat_f32s(0.0); V]; MOST_ATOMS + 1];
        let atoms = &self.tree.leaves[leaf];
        let bounds = self.bounds::<S, V, 0>(simd, &atoms.leading, &atoms.beyond, &mut sums);
        if self.passing::<S, V>(simd, &bounds) == 0 {
            return;
        }
        let atoms = &self.tree.details[leaf];
        let bounds = self.bounds::<S, V, 1>(simd, &atoms.others, &atoms.beyond, &mut sums);
        let mut open = self.passing::<S, V>(simd, &bounds);
        let mut scores = Lanes::ZERO;
        for v in 0..V {
            S::as_mut_simd_f32s(&mut scores.0).0[v] = simd.div_f32s(bounds[v].0, bounds[v].1);
        }
        // The highest bound first: few atoms are then scored.
        while open != 0 {
            let mut lane = open.trailing_zeros() as usize;
            for other in lane + 1..LEAF {
                if open >> other & 1 == 1 && scores.0[other] > scores.0[lane] {
                    lane = other;
                }
            }
            if scores.0[lane] < self.best.cos2 {
                break;
            }
            open &= !(1 << lane);
            self.consider(atoms.atoms[lane], leaf);
        }
    }

    /// Bounds of the scores of a leaf's atoms. Adds the products of the PCA coordinates in `rows`
    /// to `sums`; `beyond` are norms of the atoms beyond the coordinates summed. `LEVEL` 0: the
    /// leading coordinates; 1: the others.
    #[inline(always)]
    fn bounds<S: Simd, const V: usize, const LEVEL: usize>(
        &self,
        simd: S,
        rows: &[Lanes],
        beyond: &Lanes,
        sums: &mut Products<S, V>,
    ) -> ScoreBounds<S, V> {
        let [of_residual, of_directions @ ..] = sums;
        let mut left = [simd.splat_f32s(1.0); V];
        for (direction, sums) in self.directions.iter().zip(of_directions) {
            let most = most_product::<S, V, LEVEL>(simd, rows, beyond, direction, sums);
            for v in 0..V {
                left[v] = add_product(simd, simd.neg_f32s(most[v]), most[v], left[v]);
            }
        }
        let vector = &self.projected;
        let most = most_product::<S, V, LEVEL>(simd, rows, beyond, vector, of_residual);
        let mut bounds = [(left[0], left[0]); V];
        for v in 0..V {
            bounds[v].0 = add_product(simd, most[v], most[v], simd.splat_f32s(SLACK));
            bounds[v].1 = simd.max_f32s(left[v], simd.splat_f32s(FLOOR));
        }
        bounds
    }

    /// Takes an atom if it is better than the best so far, or as good and before it.
    #[inline(always)]
    fn consider(&mut self, atom: u32, leaf: usize) {
        let d = self.residual.len();
        let Some(row) = (self.atoms.get(atom as usize * d..)).and_then(|rows| rows.get(..d)) else {
            return; // an empty slot
        };
        let score = self.score(row);
        let is_first = self.best.atom.is_some_and(|best| atom < best);
        let is_better = score > self.best.score || (score == self.best.score && is_first);
        if is_better && !self.excluded.contains(&atom) {
            self.best = Best {
                score,
                atom: Some(atom),
                leaf,
                cos2: score as f32,
                sin: (1.0 - score).max(0.0).sqrt() as f32,
            };
        }
    }

    /// The score of an atom (D).
    #[inline(always)]
    fn score(&self, atom: &[f32]) -> f64 {
        let along = dot(atom, self.residual);
        let mut left = 1.0;
        for i in 0..self.directions.len() {
            left -= dot(atom, self.fit.direction(i)).powi(2);
        }
        along * along / left.max(f64::from(FLOOR))
    }
}

/// Upper bounds of |<a, v>| for the atoms of a leaf, v a vector; see [`Search::bounds`].
#[inline(always)]
fn most_product<S: Simd, const V: usize, const LEVEL: usize>(
    simd: S,
    rows: &[Lanes],
    beyond: &Lanes,
    vector: &Projected,
    sums: &mut [S::f32s; V],
) -> [S::f32s; V] {
    let mut most = products::<S, V>(simd, rows, &vector.coordinates[LEVEL * LEADING..]);
    let (beyond, of_vector) = (lanes::<S, V>(beyond), simd.splat_f32s(vector.beyond[LEVEL]));
    for v in 0..V {
        sums[v] = simd.add_f32s(sums[v], most[v]);
        most[v] = add_product(simd, beyond[v], of_vector, simd.abs_f32s(sums[v]));
    }
    most
}

/// The products of the atoms or balls of a group with a vector, as four sums that do not wait for
/// one another.
#[inline(always)]
fn products<S: Simd, const V: usize>(simd: S, rows: &[Lanes], vector: &[f32]) -> [S::f32s; V] {
    let mut sums = [[simd.splat_f32s(0.0); V]; 4];
    for (rows, values) in (rows.as_chunks::<4>().0.iter()).zip(vector.as_chunks::<4>().0) {
        for i in 0..4 {
            let (row, value) = (lanes::<S, V>(&rows[i]), simd.splat_f32s(values[i]));
            for v in 0..V {
                sums[i][v] = add_product(simd, row[v], value, sums[i][v]);
            }
        }
    }
    let mut all = sums[0];
    for v in 0..V {
        let [a, b, c, d] = [sums[0][v], sums[1][v], sums[2][v], sums[3][v]];
        all[v] = simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d));
    }
    all
}

/// The vectors that hold the lanes of a group.
#[inline(always)]
fn lanes<S: Simd, const V: usize>(lanes: &Lanes) -> [S::f32s; V] {
    let vectors = S::as_simd_f32s(&lanes.0).0;
    std::array::from_fn(
        #[inline(always)]
        |v| vectors[v],
    )
}

/// A mask as one bit per lane. AVX-512 masks have bits already; other masks have as many bytes per
/// lane as a number.
#[inline(always)]
fn bits<S: Simd>(mask: S::m32s) -> u32 {
    let bytes = pulp::bytemuck::bytes_of(&mask);
    if let [low, high] = bytes
        && S::F32_LANES == 16
    {
        return u32::from(u16::from_le_bytes([*low, *high]));
    }
    let width = bytes.len() / S::F32_LANES;
    let mut bits = 0;
    for lane in 0..S::F32_LANES {
        bits |= u32::from(bytes[lane * width] & 1) << lane;
    }
    bits
}

/// <a, v>, as eight sums side by side.
#[inline(always)]
fn dot(atom: &[f32], vector: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let ((a8, a1), (v8, v1)) = (atom.as_chunks::<8>(), vector.as_chunks::<8>());
    for (a, v) in a8.iter().zip(v8) {
        for lane in 0..8 {
            sums[lane] += f64::from(a[lane]) * v[lane];
        }
    }
    let rest: f64 = a1.iter().zip(v1).map(|(a, v)| f64::from(*a) * v).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::super::super::testdata::random;
    use super::super::super::{Dictionary, Tolerance};
    use super::*;
    use crate::numeric::parallel;
    use ndarray::{Array2, ArrayView1};
    use proptest::prelude::*;
    use rand::Rng;

    /// The scores of all atoms in double precision.
    fn scores(dictionary: &Dictionary, fit: &ActiveSet, rule: SelectionRule) -> Vec<f64> {
        let along = |atom: u32, v: &[f64]| -> f64 {
            let atom = dictionary.row(atom).iter();
            atom.zip(v).map(|(a, v)| f64::from(*a) * v).sum()
        };
        let of = |atom| {
            let mut left = 1.0;
            for i in (0..fit.support.len()).filter(|_| rule == SelectionRule::Oomp) {
                left -= along(atom, fit.direction(i)).powi(2);
            }
            along(atom, fit.residual()).powi(2) / left.max(f64::from(FLOOR)) / fit.left()
        };
        (0..dictionary.len() as u32).map(of).collect()
    }

    /// Asserts that each atom of each pose's code is the best of all, and the first of equal atoms.
    fn assert_best(atoms: &Array2<f64>, poses: &Array2<f64>) {
        let dictionary = Dictionary::from_rows(atoms.view()).unwrap();
        let tree = BallTree::new(dictionary.atoms());
        let (n, d) = atoms.dim();
        for rule in [SelectionRule::Oomp, SelectionRule::Omp] {
            let mut search = TreeSearch::new(&tree, dictionary.flat(), rule);
            for pose in poses.outer_iter() {
                let (mut fit, mut excluded) = (ActiveSet::new(4.min(n).min(d), d), Vec::new());
                let weights = None::<ArrayView1<'_, f64>>;
                fit.start(pose, weights, Tolerance::Never).unwrap();
                search.start();
                while fit.stop.is_none() && excluded.len() < 4 {
                    let scores = scores(&dictionary, &fit, rule);
                    let free = |atom: &usize| !excluded.contains(&(*atom as u32));
                    let most = (0..n).filter(free).fold(0.0, |m: f64, a| m.max(scores[a]));
                    let Some(atom) = search.best(&fit, &excluded) else {
                        // Where nothing is left but rounding.
                        assert!(most <= 1e-20, "{most}");
                        break;
                    };
                    assert!(free(&(atom as usize)));
                    // The sums of this test are rounded otherwise. A remainder may be as small as
                    // FLOOR.
                    assert!(scores[atom as usize] >= most * (1.0 - 1e-8) - 1e-20);
                    let equal = |a: &usize| dictionary.row(*a as u32) == dictionary.row(atom);
                    assert_eq!((0..n).filter(free).find(equal), Some(atom as usize));
                    excluded.push(atom);
                    if fit.push(atom, dictionary.row(atom)) {
                        search.add_direction(&fit);
                    }
                }
            }
        }
    }

    /// Three hidden dimensions and a little noise in all others.
    fn flat(n: usize, d: usize, seed: u64) -> Array2<f64> {
        let mixed = random(n, 3, seed + 2) + 0.2;
        mixed.dot(&random(3, d, seed + 1)) + random(n, d, seed + 3) * 0.005
    }

    #[test]
    fn the_best_atom_is_found_whatever_the_shape() {
        for (n, d) in [
            (1, 1),
            (1, 5),
            (3, 2),
            (17, 3),
            (300, 1),
            (257, 31),
            (40, 33),
        ] {
            assert_best(&random(n, d, 9), &random(30, d, 10));
        }
        // Three layers of balls, the last of each not full; then bounds that exclude next to
        // nothing.
        assert_best(&flat(40_000, 40, 1), &flat(3, 40, 1));
        assert_best(&random(1500, 69, 6), &random(10, 69, 7));
        let mut poses = flat(20, 12, 8) * 3.0;
        poses.row_mut(3).fill(0.0);
        assert_best(&flat(200, 12, 8), &poses);
    }

    #[test]
    fn vectors_of_any_width_find_the_same() {
        let dictionary = Dictionary::from_rows(random(1_100, 12, 1).view()).unwrap();
        let tree = BallTree::new(dictionary.atoms());
        let mut search = TreeSearch::new(&tree, dictionary.flat(), SelectionRule::Oomp);
        for pose in random(20, 12, 2).outer_iter() {
            let mut fit = ActiveSet::new(3, 12);
            let weights = None::<ArrayView1<'_, f64>>;
            fit.start(pose, weights, Tolerance::Never).unwrap();
            search.start();
            for _ in 0..3 {
                let taken = fit.support.clone();
                let best = search.best(&fit, &taken).unwrap();
                let of = |best: Best| best.atom.unwrap();
                assert_eq!(
                    of(search.search(&fit, &taken).with_simd(pulp::Scalar)),
                    best
                );
                assert_eq!(
                    of(search.search(&fit, &taken).with_simd(pulp::Scalar128b)),
                    best
                );
                assert_eq!(
                    of(search.search(&fit, &taken).with_simd(pulp::Scalar256b)),
                    best
                );
                assert_eq!(
                    of(search.search(&fit, &taken).with_simd(pulp::Scalar512b)),
                    best
                );
                assert!(fit.push(best, dictionary.row(best)));
                search.add_direction(&fit);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        /// Clustered, repeated and negated atoms: many scores are equal or nearly equal.
        #[test]
        fn the_best_of_nearly_equal_atoms_is_found(
            seed in 0u64..1000,
            n in 1usize..700,
            d in 1usize..80,
            clusters in 1usize..30,
            apart in prop::sample::select(vec![0.0, 1e-8, 1e-7, 1e-6, 1e-4, 1e-2, 0.3]),
            noise in prop::sample::select(vec![0.0, 1e-7, 1e-3, 0.1]),
        ) {
            let centers = match seed % 2 {
                0 => random(clusters, d, seed),
                _ => flat(clusters, d, seed),
            };
            let mut g = parallel::rng(seed, 4);
            let near = |m: usize, apart: f64, g: &mut rand_chacha::ChaCha8Rng| {
                let mut rows = random(m, d, g.random()) * apart;
                for mut row in rows.outer_iter_mut() {
                    let sign = if g.random() { 1.0 } else { -1.0 };
                    row.scaled_add(sign, &centers.row(g.random_range(0..clusters)));
                }
                rows
            };
            let atoms = near(n, apart, &mut g);
            let poses = near(15, noise, &mut g) + near(15, noise, &mut g) * 0.7;
            assert_best(&atoms, &poses);
        }
    }
}

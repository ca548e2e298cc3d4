//! What a search knows of the keys of a leaf's atoms, by products that may leave out what is beyond heads.

use super::ball_tree::{LEAF, Lanes, Leaf};
use super::micro_gemm::{Products, vectors};
use super::panel_kernel::{self, FLOOR, add_product};
use super::pca_projection::LEVELS;
use super::single_search::{BELOW, Sweep};
use pulp::Simd;

/// In place of a level, for products of full atoms.
pub const NOTHING_BEYOND: usize = LEVELS.len();

/// Bounds of the largest score in a leaf.
pub struct Keys {
    /// Lower bound.
    pub least: f32,
    pub nearly: f32,
    /// Upper bound.
    pub most: f32,
}

/// The error terms of the bounds of atoms.
struct Bounds<S: Simd, const N: usize> {
    level: usize,
    /// Norms of the N vectors beyond the PCA coordinates used.
    beyond: [S::f32s; N],
    product: S::f32s,
    rest: S::f32s,
}

impl<S: Simd, const N: usize, const V: usize> Sweep<'_, S, N, V> {
    /// Whether an atom of a leaf can reach the key, by the first PCA coordinates.
    #[inline(always)]
    pub fn may_be_best(&self, leaf: &Leaf, sums: &Products<S, N, V>) -> bool {
        let simd = self.simd;
        let bounds = self.bounds(0);
        let key = simd.splat_f32s(self.key * BELOW);
        let mut some = false;
        for v in 0..V {
            let (over, under) = self.at_most(&bounds, leaf, sums, v);
            some |= panel_kernel::any::<S>(
                simd.greater_than_or_equal_f32s(over, simd.mul_f32s(key, under)),
            );
        }
        some
    }

    /// Bounds of the largest score of a leaf's atoms, without those already taken.
    #[inline(always)]
    pub fn keys(&self, leaf: usize, sums: &Products<S, N, V>, level: usize) -> Keys {
        let simd = self.simd;
        let atoms = self.leaf(leaf);
        let bounds = self.bounds(level);
        let mut free = Lanes([1.0; LEAF]);
        for taken in self.sought.taken {
            if self.leaves.place(*taken) as usize == leaf {
                for lane in 0..LEAF {
                    if atoms.atoms[lane] == *taken {
                        free.0[lane] = 0.0;
                    }
                }
            }
        }
        let mut largest = [simd.splat_f32s(0.0); 3];
        for v in 0..V {
            let of = [
                self.at_least(&bounds, atoms, sums, v),
                self.nearly(sums, v),
                self.at_most(&bounds, atoms, sums, v),
            ];
            let free = vectors::<S>(&free)[v];
            for i in 0..3 {
                let key = simd.div_f32s(simd.mul_f32s(of[i].0, free), of[i].1);
                largest[i] = simd.max_f32s(largest[i], key);
            }
        }
        Keys {
            least: simd.reduce_max_f32s(largest[0]) * BELOW,
            nearly: simd.reduce_max_f32s(largest[1]),
            most: simd.reduce_max_f32s(largest[2]) * (2.0 - BELOW),
        }
    }

    /// Approximate c² and e.
    #[inline(always)]
    fn nearly(&self, sums: &Products<S, N, V>, v: usize) -> (S::f32s, S::f32s) {
        let simd = self.simd;
        let mut e = simd.splat_f32s(1.0);
        for n in 1..if self.optimised { N } else { 1 } {
            e = add_product(simd, simd.neg_f32s(sums[n][v]), sums[n][v], e);
        }
        let floor = simd.splat_f32s(FLOOR);
        (
            simd.mul_f32s(sums[0][v], sums[0][v]),
            simd.max_f32s(e, floor),
        )
    }

    #[inline(always)]
    fn bounds(&self, level: usize) -> Bounds<S, N> {
        let simd = self.simd;
        let mut beyond = [simd.splat_f32s(0.0); N];
        for n in 0..N {
            beyond[n] = simd.splat_f32s(match level {
                NOTHING_BEYOND => 0.0,
                _ => self.heads[n].beyond[level],
            });
        }
        Bounds {
            level: level % LEVELS.len(),
            beyond,
            product: simd.splat_f32s(self.noise.product),
            rest: simd.splat_f32s(self.noise.rest),
        }
    }

    /// Upper bound of c² and lower bound of e, for a vector of atoms.
    #[inline(always)]
    fn at_most(
        &self,
        bounds: &Bounds<S, N>,
        leaf: &Leaf,
        sums: &Products<S, N, V>,
        v: usize,
    ) -> (S::f32s, S::f32s) {
        let simd = self.simd;
        let tail = vectors::<S>(&leaf.tails[bounds.level])[v];
        let c = simd.add_f32s(simd.abs_f32s(sums[0][v]), bounds.product);
        let c = add_product(simd, tail, bounds.beyond[0], c);
        let mut e = simd.sub_f32s(simd.splat_f32s(1.0), bounds.rest);
        for n in 1..if self.optimised { N } else { 1 } {
            let p = add_product(simd, tail, bounds.beyond[n], simd.abs_f32s(sums[n][v]));
            e = add_product(simd, simd.neg_f32s(p), p, e);
        }
        let floor = simd.splat_f32s(FLOOR);
        (simd.mul_f32s(c, c), simd.max_f32s(e, floor))
    }

    /// Lower bound of c² and upper bound of e; 0 and 1 for empty places.
    #[inline(always)]
    fn at_least(
        &self,
        bounds: &Bounds<S, N>,
        leaf: &Leaf,
        sums: &Products<S, N, V>,
        v: usize,
    ) -> (S::f32s, S::f32s) {
        let simd = self.simd;
        let zero = simd.splat_f32s(0.0);
        let tail = vectors::<S>(&leaf.tails[bounds.level])[v];
        let less = simd.neg_f32s(tail);
        let c = simd.sub_f32s(simd.abs_f32s(sums[0][v]), bounds.product);
        let c = simd.max_f32s(add_product(simd, less, bounds.beyond[0], c), zero);
        let mut e = simd.add_f32s(simd.splat_f32s(1.0), bounds.rest);
        for n in 1..if self.optimised { N } else { 1 } {
            let p = add_product(simd, less, bounds.beyond[n], simd.abs_f32s(sums[n][v]));
            let p = simd.max_f32s(p, zero);
            e = add_product(simd, simd.neg_f32s(p), p, e);
        }
        let floor = simd.splat_f32s(FLOOR);
        (simd.mul_f32s(c, c), simd.max_f32s(e, floor))
    }
}

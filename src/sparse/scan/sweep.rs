//! The search of one pose, step by step; see [`super::pruned`].

use super::super::Rule;
use super::heads::{Head, LEVELS, PART, PARTS};
use super::kernel::{self, FLOOR, add_product};
use super::leaves::{Balls, FAR, LEAF, Lanes, Leaf, Leaves, NEAR, NO_ATOM};
use super::path::Noise;
use super::pruned::{Found, Sought};
use pulp::Simd;

/// Leaves that are looked into before it is known which are worth it, and branches that they are chosen from.
pub const START_LEAVES: usize = 4;
const START_BRANCHES: usize = 8;
/// A key counts for so much less that rounding a product with it makes it no larger.
const BELOW: f32 = 1.0 - 4e-6;
/// So many leaves are met, at most, and this share of all; then a scan costs less.
const LEAST_MET: usize = 8;
const SHARE_MET: usize = 4;

/// A key to be reached, and √(|r|² − key).
#[derive(Clone, Copy)]
struct Bar<S: Simd> {
    key: S::f32s,
    beside: S::f32s,
}

/// What balls have to reach, and what rounding may change.
struct Bars<S: Simd> {
    far: Bar<S>,
    near: Bar<S>,
    product: S::f32s,
    rest: S::f32s,
}

/// Of sixteen balls |<m, r>| and |m|² beside the directions.
#[derive(Clone, Copy)]
pub struct Measured<S: Simd, const V: usize> {
    along: [S::f32s; V],
    left: [S::f32s; V],
}

impl<S: Simd, const V: usize> Measured<S, V> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        Measured {
            along: [simd.splat_f32s(0.0); V],
            left: [simd.splat_f32s(0.0); V],
        }
    }
}

/// The best of many balls: of those in each lane one.
struct Leaders {
    score: Lanes,
    ball: [usize; LEAF],
}

impl Leaders {
    const NONE: Leaders = Leaders {
        score: Lanes([-1.0; LEAF]),
        ball: [0; LEAF],
    };

    /// Meets the balls of group `i`.
    #[inline(always)]
    fn meet(&mut self, score: &Lanes, i: usize) {
        for lane in 0..LEAF {
            if score.0[lane] > self.score.0[lane] {
                self.score.0[lane] = score.0[lane];
                self.ball[lane] = i * LEAF + lane;
            }
        }
    }

    /// The best K of the `all` balls there are, the best first.
    #[inline(always)]
    fn best<const K: usize>(mut self, all: usize) -> [Option<usize>; K] {
        let mut best = [None; K];
        for best in &mut best {
            let higher = |a: usize, b: usize| match self.score.0[b] > self.score.0[a] {
                true => b,
                false => a,
            };
            let lane = (0..LEAF).fold(0, higher);
            let is_one = self.score.0[lane] >= 0.0 && self.ball[lane] < all;
            *best = is_one.then_some(self.ball[lane]);
            self.score.0[lane] = -1.0;
        }
        best
    }
}

/// The search of a pose with N directions, its residual's the first; V vectors hold a leaf's lanes.
pub struct Sweep<'s, S, const N: usize, const V: usize> {
    simd: S,
    leaves: &'s Leaves,
    sought: Sought<'s>,
    heads: [&'s Head; N],
    /// The bound that is tried first: the more is taken away the longer a head has to be. (Kept, not a constant: loops of a
    /// length that the compiler knows it takes apart so that sums wait for one another.)
    level: usize,
    parts: usize,
    noise: Noise,
    /// What is left of an atom counts.
    optimised: bool,
    /// The best so far.
    key: f32,
    pub best: u32,
    /// How many leaves may be met yet. Where they are too many the search is given up.
    left: usize,
    /// Leaves that were met.
    met: usize,
}

impl<'s, S: Simd, const N: usize, const V: usize> Sweep<'s, S, N, V> {
    #[inline(always)]
    pub fn new(simd: S, leaves: &'s Leaves, sought: Sought<'s>) -> Self {
        Sweep {
            simd,
            leaves,
            sought,
            heads: std::array::from_fn(|n| &sought.path.heads[n]),
            level: usize::from(N > 1),
            parts: leaves.balls[0].heads.len(),
            noise: sought.path.noise(),
            optimised: N > 1 && sought.rule == Rule::Optimised,
            key: 0.0,
            best: NO_ATOM,
            left: leaves.leaves.len() / SHARE_MET + LEAST_MET,
            met: 0,
        }
    }

    /// Looks into leaves that are likely good: that of an atom, and those whose centres are. Keeps what it measured of the
    /// branches.
    #[inline(always)]
    pub fn start(&mut self, branches: &mut [Measured<S, V>], atom: Option<u32>) {
        if let Some(atom) = atom {
            self.meet(self.leaves.place(atom) as usize);
        }
        for leaf in self.likely(branches).into_iter().flatten() {
            self.look_into(leaf);
        }
    }

    /// The leaves with the best centres, nearly, the best first: those in the branches with the best.
    #[inline(always)]
    pub fn likely(&self, branches: &mut [Measured<S, V>]) -> [Option<usize>; START_LEAVES] {
        let mut leaders = Leaders::NONE;
        for (i, (balls, kept)) in self.leaves.branches.iter().zip(branches).enumerate() {
            *kept = self.measure(balls);
            leaders.meet(&self.score(kept), i);
        }
        let good: [Option<usize>; START_BRANCHES] = leaders.best(self.leaves.balls.len());
        let mut leaders = Leaders::NONE;
        for branch in good.into_iter().flatten() {
            let measured = self.measure(&self.leaves.balls[branch]);
            leaders.meet(&self.score(&measured), branch);
        }
        leaders.best(self.leaves.leaves.len())
    }

    #[inline(always)]
    pub fn found(&self) -> Found {
        match self.best {
            _ if self.is_given_up() => Found::Unpruned,
            NO_ATOM => Found::Nothing,
            atom => Found::Atom(atom),
        }
    }

    /// Rows that were multiplied, nearly: `looks` leaves were looked into.
    pub fn spent(&self, looks: usize) -> usize {
        let balls = self.leaves.branches.len() + self.leaves.balls.len() / 2;
        let heads = (balls * self.parts + looks * (self.level + 1)) * PART;
        (heads + self.met * self.sought.path.width()) * N
    }

    #[inline(always)]
    fn is_given_up(&self) -> bool {
        self.left == 0
    }

    /// Of each ball |<m, r>| and |m|² beside the directions.
    #[inline(always)]
    fn measure(&self, balls: &Balls) -> Measured<S, V> {
        let simd = self.simd;
        let mut sums = [[simd.splat_f32s(0.0); V]; N];
        for (p, part) in balls.heads[..self.parts].iter().enumerate() {
            add::<S, N, V>(simd, &mut sums, self.heads, p, part);
        }
        let mut measured = Measured::none(simd);
        for v in 0..V {
            let mut left = vectors::<S>(&balls.norms)[v];
            if self.optimised {
                for n in 1..N {
                    left = add_product(simd, simd.neg_f32s(sums[n][v]), sums[n][v], left);
                }
            }
            measured.along[v] = simd.abs_f32s(sums[0][v]);
            measured.left[v] = left;
        }
        measured
    }

    /// How good centres are. Only for a start: it need not be told well.
    #[inline(always)]
    fn score(&self, measured: &Measured<S, V>) -> Lanes {
        let simd = self.simd;
        let mut score = Lanes::ZERO;
        for v in 0..V {
            let (along, left) = (measured.along[v], measured.left[v]);
            let under = simd.max_f32s(left, simd.splat_f32s(NEAR * NEAR));
            vectors_mut::<S>(&mut score)[v] = simd.div_f32s(simd.mul_f32s(along, along), under);
        }
        score
    }

    /// Marks the leaves that may hold the best atom. `branches` are measured.
    #[inline(always)]
    pub fn open(&self, branches: &[Measured<S, V>], leaves: &mut [[u16; LEAF]], mark: u16) {
        let bars = self.bars();
        for (i, (balls, measured)) in self.leaves.branches.iter().zip(branches).enumerate() {
            let excess = self.excess(&bars, balls, measured);
            for (lane, _) in excess.0.iter().enumerate().filter(|(_, e)| **e >= 0.0) {
                let branch = i * LEAF + lane;
                let balls = &self.leaves.balls[branch];
                let measured = self.measure(balls);
                let excess = self.excess(&bars, balls, &measured);
                // Without a branch of the program: whether a leaf is open cannot be foretold.
                for (leaf, excess) in leaves[branch].iter_mut().zip(excess.0) {
                    *leaf |= mark * u16::from(excess >= 0.0);
                }
            }
        }
    }

    /// By how much each ball may hold more than the key; negative if it cannot.
    #[inline(always)]
    fn excess(&self, bars: &Bars<S>, balls: &Balls, measured: &Measured<S, V>) -> Lanes {
        let simd = self.simd;
        let mut excess = Lanes::ZERO;
        for v in 0..V {
            let (along, left) = (measured.along[v], measured.left[v]);
            let radius = vectors::<S>(&balls.radii)[v];
            let is_far = simd.greater_than_f32s(left, vectors::<S>(&balls.far)[v]);
            let key = simd.select_f32s(is_far, bars.far.key, bars.near.key);
            let beside = simd.select_f32s(is_far, bars.far.beside, bars.near.beside);
            let reach = add_product(simd, beside, radius, simd.add_f32s(along, bars.product));
            let wide = simd.sub_f32s(left, bars.rest);
            let wide = add_product(simd, simd.neg_f32s(radius), radius, wide);
            let more = simd.sub_f32s(simd.mul_f32s(reach, reach), simd.mul_f32s(key, wide));
            let near = simd.sub_f32s(vectors::<S>(&balls.near)[v], left);
            vectors_mut::<S>(&mut excess)[v] = match self.optimised {
                true => simd.max_f32s(more, near),
                false => more,
            };
        }
        excess
    }

    #[inline(always)]
    fn bars(&self) -> Bars<S> {
        let simd = self.simd;
        Bars {
            far: self.bar(FAR),
            near: self.bar(NEAR),
            product: simd.splat_f32s(self.noise.product),
            rest: simd.splat_f32s(self.noise.rest),
        }
    }

    /// What a ball whose vectors are at least `gap` long beside the directions has to reach: rounding tells less in it the
    /// more is left of them.
    #[inline(always)]
    fn bar(&self, gap: f32) -> Bar<S> {
        let noise = self.noise;
        let root = match self.optimised {
            false => self.key.sqrt() - noise.product,
            true => {
                let exact = (1.0 - noise.rest / (gap * gap)).max(0.0);
                self.key.sqrt() * exact.sqrt() - noise.product / gap
            }
        };
        let key = root.max(0.0).powi(2) * BELOW;
        let beside = (self.sought.path.left * (2.0 - BELOW) - key).max(0.0);
        Bar {
            key: self.simd.splat_f32s(key),
            beside: self.simd.splat_f32s(beside.sqrt() * (2.0 - BELOW)),
        }
    }

    /// Meets a leaf unless the heads of its atoms rule all of them out.
    #[inline(always)]
    pub fn look_into(&mut self, leaf: usize) {
        if self.is_given_up() {
            return;
        }
        let simd = self.simd;
        let atoms = &self.leaves.leaves[leaf];
        let mut sums = [[simd.splat_f32s(0.0); V]; N];
        let level = self.level;
        for p in 0..=level {
            add::<S, N, V>(simd, &mut sums, self.heads, p, &atoms.heads[p]);
        }
        if !self.may_be_best(atoms, level, &sums) {
            return;
        }
        for p in level + 1..PARTS {
            add::<S, N, V>(simd, &mut sums, self.heads, p, &atoms.heads[p]);
        }
        if self.may_be_best(atoms, LEVELS.len() - 1, &sums) {
            self.meet(leaf);
        }
    }

    /// Whether an atom of a leaf can be the best, by its head's products up to a level.
    #[inline(always)]
    fn may_be_best(&self, leaf: &Leaf, level: usize, sums: &[[S::f32s; V]; N]) -> bool {
        let simd = self.simd;
        let beyond = |n: usize| simd.splat_f32s(self.heads[n].beyond[level]);
        let (product, key) = (
            simd.splat_f32s(self.noise.product),
            simd.splat_f32s(self.key * BELOW),
        );
        let mut some = false;
        for v in 0..V {
            let tail = vectors::<S>(&leaf.tails[level])[v];
            let c = simd.add_f32s(simd.abs_f32s(sums[0][v]), product);
            let c = add_product(simd, tail, beyond(0), c);
            let mut e = simd.splat_f32s(1.0 - self.noise.rest);
            for n in 1..if self.optimised { N } else { 1 } {
                let p = add_product(simd, tail, beyond(n), simd.abs_f32s(sums[n][v]));
                e = add_product(simd, simd.neg_f32s(p), p, e);
            }
            let (over, under) = (
                simd.mul_f32s(c, c),
                simd.max_f32s(e, simd.splat_f32s(FLOOR)),
            );
            some |=
                kernel::any::<S>(simd.greater_than_or_equal_f32s(over, simd.mul_f32s(key, under)));
        }
        some
    }

    /// Meets the atoms of a leaf as a scan does.
    #[inline(always)]
    fn meet(&mut self, leaf: usize) {
        let (simd, path) = (self.simd, self.sought.path);
        let d = path.width();
        self.met += 1;
        self.left -= 1;
        let rows = &self.leaves.whole[leaf * d..][..d];
        let mut sums = [[simd.splat_f32s(0.0); V]; N];
        let mut of = [&path.vectors[..d]; N];
        for n in 1..N {
            of[n] = &path.vectors[n * d..][..d];
        }
        for (k, row) in rows.iter().enumerate() {
            let mut numbers = [0.0; N];
            for n in 0..N {
                numbers[n] = of[n][k];
            }
            multiply::<S, N, V>(simd, &mut sums, numbers, row);
        }
        let mut keys = Lanes::ZERO;
        let mut some = false;
        for v in 0..V {
            let (mut c, mut e) = (sums[0][v], simd.splat_f32s(1.0));
            for n in 1..N {
                let p = sums[n][v];
                c = add_product(simd, simd.splat_f32s(path.parts[n - 1]), p, c);
                e = add_product(simd, simd.neg_f32s(p), p, e);
            }
            let under = match self.optimised {
                true => simd.max_f32s(e, simd.splat_f32s(FLOOR)),
                false => simd.splat_f32s(1.0),
            };
            let key = simd.div_f32s(simd.mul_f32s(c, c), under);
            some |=
                kernel::any::<S>(simd.greater_than_or_equal_f32s(key, simd.splat_f32s(self.key)));
            vectors_mut::<S>(&mut keys)[v] = key;
        }
        if some {
            self.choose(&keys, leaf);
        }
    }

    /// Takes the best of a leaf's atoms if it is better than the best so far: the first of equals.
    #[inline(always)]
    fn choose(&mut self, keys: &Lanes, leaf: usize) {
        let atoms = &self.leaves.leaves[leaf].atoms;
        for (key, atom) in keys.0.iter().zip(atoms) {
            let (key, atom) = (*key, *atom);
            let better = key > self.key || (key == self.key && key > 0.0 && atom < self.best);
            if better && !self.sought.taken.contains(&atom) {
                (self.key, self.best) = (key, atom);
            }
        }
    }
}

/// Adds the products of part `p` of some atoms' heads with those of N vectors.
#[inline(always)]
fn add<S: Simd, const N: usize, const V: usize>(
    simd: S,
    sums: &mut [[S::f32s; V]; N],
    heads: [&Head; N],
    p: usize,
    rows: &[Lanes; PART],
) {
    // Sums of their own, so that parts need not wait for one another.
    let mut part = [[simd.splat_f32s(0.0); V]; N];
    for (k, row) in rows.iter().enumerate() {
        let mut of = [0.0; N];
        for n in 0..N {
            of[n] = heads[n].along[p][k];
        }
        multiply::<S, N, V>(simd, &mut part, of, row);
    }
    for n in 0..N {
        for v in 0..V {
            sums[n][v] = simd.add_f32s(sums[n][v], part[n][v]);
        }
    }
}

/// Adds the products of a row of lanes with a number of each of N vectors: as the kernel of scans sums them.
#[inline(always)]
fn multiply<S: Simd, const N: usize, const V: usize>(
    simd: S,
    sums: &mut [[S::f32s; V]; N],
    of: [f32; N],
    row: &Lanes,
) {
    let row = vectors::<S>(row);
    for n in 0..N {
        let q = simd.splat_f32s(of[n]);
        for v in 0..V {
            sums[n][v] = add_product(simd, row[v], q, sums[n][v]);
        }
    }
}

#[inline(always)]
fn vectors<S: Simd>(lanes: &Lanes) -> &[S::f32s] {
    S::as_simd_f32s(&lanes.0).0
}

#[inline(always)]
fn vectors_mut<S: Simd>(lanes: &mut Lanes) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(&mut lanes.0).0
}

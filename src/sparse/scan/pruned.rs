//! The best atom of one pose by bounds: of most atoms a few numbers tell that they cannot be it.
//!
//! 1. Atoms that are likely good give a key that the best has at least.
//! 2. Of each leaf the centre's c and e tell whether any atom within the radius can reach that key. In the space that is
//!    left beside the directions taken, a ball of radius ρ about m is seen from 0 within the angle asin(ρ / |m|), and no atom
//!    in it has a larger c²/e than a vector that much nearer to the residual than m:
//!    (|<m, r>| + ρ √(|r|² − key))² < key (|m|² − ρ²) rules the ball out.
//! 3. Of each atom of the leaves that are left a head, then a longer one, bound c from above and e from below.
//! 4. Where an atom is left its leaf is met as a scan meets it: the same sums in the same order, the same key.
//!
//! Every bound allows for the rounding of the scan, so the atom is the one that the scan finds, always.

use super::super::Rule;
use super::kernel::{self, FLOOR, add_product};
use super::leaves::{FAR, LEAF, LEVELS, Lanes, Leaf, Leaves, NEAR, NO_ATOM, PART};
use super::path::{Noise, Path};
use pulp::{Simd, WithSimd};

/// Directions of a pose, its residual's too, that a search can do with; beyond, a scan costs less.
pub const DIRECTIONS: usize = 4;
/// Poses that are sought for together, at most: bits of a mask.
pub const TOGETHER: usize = 16;
/// Leaves that are looked into before it is known which are worth it.
const STARTS: usize = 4;
/// A key counts for so much less that rounding a product with it makes it no larger.
const BELOW: f32 = 1.0 - 4e-6;
/// So many leaves are met, at most, and this share of all; then a scan costs less.
const LEAST_MET: usize = 8;
const SHARE_MET: usize = 4;

/// Searches of one dictionary: room that is made once.
pub struct Pruned<'a> {
    leaves: &'a Leaves,
    /// Of each leaf |<m, r>| and |m|² beside the directions, for one pose.
    along: Vec<Lanes>,
    left: Vec<Lanes>,
    /// Of each leaf, which poses look into it.
    open: Vec<[u16; LEAF]>,
}

/// What is sought of a pose.
#[derive(Clone, Copy)]
pub struct Sought<'a> {
    pub path: &'a Path,
    pub rule: Rule,
    /// Atoms that are not to be taken.
    pub taken: &'a [u32],
    /// Atoms that are likely good.
    pub likely: &'a [u32],
}

/// What is found: the best atom of all that are not taken, the first of equals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    Atom(u32),
    /// Nothing is along any atom.
    Nothing,
    /// The bounds tell too little of this pose: a scan costs less.
    Unpruned,
}

impl<'a> Pruned<'a> {
    /// Room for searches.
    pub fn new(leaves: &'a Leaves) -> Self {
        let centres = leaves.centres.len();
        Pruned {
            leaves,
            along: vec![Lanes::ZERO; centres],
            left: vec![Lanes::ZERO; centres],
            open: vec![[0; LEAF]; centres],
        }
    }

    /// The best atoms of at most [`TOGETHER`] poses that have taken equally many.
    pub fn best(&mut self, sought: &[Sought<'_>], found: &mut Vec<Found>) {
        debug_assert!(sought.len() <= TOGETHER);
        found.clear();
        kernel::widest(Search {
            room: self,
            sought,
            likely: None,
            found,
        });
    }

    /// The leaf whose centre is most along a pose.
    pub fn nearest(&mut self, path: &Path, rule: Rule) -> usize {
        let mut nearest = 0;
        kernel::widest(Search {
            room: self,
            sought: &[Sought {
                path,
                rule,
                taken: &[],
                likely: &[],
            }],
            likely: Some(&mut nearest),
            found: &mut Vec::new(),
        });
        nearest
    }
}

struct Search<'s, 'a> {
    room: &'s mut Pruned<'a>,
    sought: &'s [Sought<'s>],
    /// Only this is asked for.
    likely: Option<&'s mut usize>,
    found: &'s mut Vec<Found>,
}

impl WithSimd for Search<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // So many vectors hold a leaf's lanes.
        match S::F32_LANES {
            16 => self.of_directions::<S, 1>(simd),
            8 => self.of_directions::<S, 2>(simd),
            4 => self.of_directions::<S, 4>(simd),
            _ => self.of_directions::<S, LEAF>(simd),
        }
    }
}

impl Search<'_, '_> {
    #[inline(always)]
    fn of_directions<S: Simd, const V: usize>(self, simd: S) {
        match self.sought.first().map_or(0, |s| s.path.heads.len()) {
            1 => self.go::<S, 1, V>(simd),
            2 => self.go::<S, 2, V>(simd),
            3 => self.go::<S, 3, V>(simd),
            4 => self.go::<S, 4, V>(simd),
            _ => {}
        }
    }

    #[inline(always)]
    fn go<S: Simd, const N: usize, const V: usize>(self, simd: S) {
        let room = self.room;
        let mut sweeps: Vec<Sweep<'_, S, N, V>> = Vec::with_capacity(self.sought.len());
        for sought in self.sought {
            let mut sweep = Sweep::new(simd, room.leaves, *sought);
            let nearest = sweep.measure(room);
            if let Some(likely) = self.likely {
                *likely = nearest[0];
                return;
            }
            let before = sweeps.last().map_or(NO_ATOM, |s| s.best);
            sweep.begin(nearest, before);
            sweep.open(room, 1 << sweeps.len());
            sweeps.push(sweep);
        }
        // A leaf is looked into by all poses that may want it, while it is in the cache nearest.
        for (i, masks) in room.open.iter_mut().enumerate() {
            if *masks == [0; LEAF] {
                continue;
            }
            for (lane, mask) in masks.iter_mut().enumerate() {
                while *mask != 0 {
                    sweeps[mask.trailing_zeros() as usize].look_into(i * LEAF + lane);
                    *mask &= *mask - 1;
                }
            }
        }
        for sweep in &sweeps {
            self.found.push(sweep.found());
        }
    }
}

/// A key to be reached, and √(|r|² − key).
#[derive(Clone, Copy)]
struct Bar {
    key: f32,
    beside: f32,
}

/// The search of a pose with N directions, its residual's the first; V vectors hold a leaf's lanes.
struct Sweep<'s, S, const N: usize, const V: usize> {
    simd: S,
    leaves: &'s Leaves,
    sought: Sought<'s>,
    noise: Noise,
    /// What is left of an atom counts.
    optimised: bool,
    /// The best so far.
    key: f32,
    best: u32,
    /// How many leaves may be met yet; nothing once they were too many.
    left: Option<usize>,
}

impl<'s, S: Simd, const N: usize, const V: usize> Sweep<'s, S, N, V> {
    #[inline(always)]
    fn new(simd: S, leaves: &'s Leaves, sought: Sought<'s>) -> Self {
        Sweep {
            simd,
            leaves,
            sought,
            noise: sought.path.noise(),
            optimised: N > 1 && sought.rule == Rule::Optimised,
            key: 0.0,
            best: NO_ATOM,
            left: Some(leaves.leaves.len() / SHARE_MET + LEAST_MET),
        }
    }

    /// Meets leaves that are likely good.
    #[inline(always)]
    fn begin(&mut self, nearest: [usize; STARTS], before: u32) {
        for atom in self.sought.likely {
            self.meet(self.leaves.place(*atom) as usize);
        }
        if before != NO_ATOM {
            self.meet(self.leaves.place(before) as usize);
        }
        for leaf in nearest
            .into_iter()
            .filter(|l| *l < self.leaves.leaves.len())
        {
            self.look_into(leaf);
        }
    }

    #[inline(always)]
    fn found(&self) -> Found {
        match (self.left, self.best) {
            (None, _) => Found::Unpruned,
            (_, NO_ATOM) => Found::Nothing,
            (_, atom) => Found::Atom(atom),
        }
    }

    /// Of every leaf |<m, r>| and |m|² beside the directions; gives leaves whose centres are good, the best first.
    #[inline(always)]
    fn measure(&self, room: &mut Pruned<'_>) -> [usize; STARTS] {
        let simd = self.simd;
        let mut best = [simd.splat_f32s(-1.0); V];
        let mut place = [simd.splat_f32s(0.0); V];
        let kept = room.along.iter_mut().zip(&mut room.left);
        for (i, (centres, kept)) in room.leaves.centres.iter().zip(kept).enumerate() {
            let mut sums = [[simd.splat_f32s(0.0); V]; N];
            for (p, part) in centres.heads.iter().enumerate() {
                add::<S, N, V>(simd, &mut sums, self.sought.path, p, part);
            }
            let here = simd.splat_f32s(f32::from_bits(i as u32));
            for v in 0..V {
                let along = simd.abs_f32s(sums[0][v]);
                let mut left = vectors::<S>(&centres.norms)[v];
                if self.optimised {
                    for n in 1..N {
                        left = add_product(simd, simd.neg_f32s(sums[n][v]), sums[n][v], left);
                    }
                }
                vectors_mut::<S>(kept.0)[v] = along;
                vectors_mut::<S>(kept.1)[v] = left;
                // Only for a start: how good a centre is need not be told well.
                let over = simd.mul_f32s(along, along);
                let under = simd.max_f32s(left, simd.splat_f32s(NEAR * NEAR));
                let good = simd.div_f32s(over, under);
                let better = simd.greater_than_f32s(good, best[v]);
                best[v] = simd.select_f32s(better, good, best[v]);
                place[v] = simd.select_f32s(better, here, place[v]);
            }
        }
        let (mut good, mut places) = (Lanes::ZERO, Lanes::ZERO);
        vectors_mut::<S>(&mut good).copy_from_slice(&best);
        vectors_mut::<S>(&mut places).copy_from_slice(&place);
        let mut found = [0; STARTS];
        for found in &mut found {
            let lane = (0..LEAF).fold(0, |a, b| if good.0[b] > good.0[a] { b } else { a });
            *found = places.0[lane].to_bits() as usize * LEAF + lane;
            good.0[lane] = -1.0;
        }
        found
    }

    /// Marks the leaves that may hold the best atom.
    #[inline(always)]
    fn open(&self, room: &mut Pruned<'_>, mark: u16) {
        let (simd, noise) = (self.simd, self.noise);
        let (bar, near) = (self.bar(FAR), self.bar(NEAR));
        let [key, near_key] = [bar, near].map(|b| simd.splat_f32s(b.key));
        let [beside, near_beside] = [bar, near].map(|b| simd.splat_f32s(b.beside));
        let [product, rest] = [noise.product, noise.rest].map(|v| simd.splat_f32s(v));
        let kept = room.along.iter().zip(&room.left).zip(&mut room.open);
        for (centres, (kept, open)) in room.leaves.centres.iter().zip(kept) {
            let mut may = Lanes::ZERO;
            for v in 0..V {
                let (along, left) = (vectors::<S>(kept.0)[v], vectors::<S>(kept.1)[v]);
                let radius = vectors::<S>(&centres.radii)[v];
                let is_far = simd.greater_than_f32s(left, vectors::<S>(&centres.far)[v]);
                let key = simd.select_f32s(is_far, key, near_key);
                let beside = simd.select_f32s(is_far, beside, near_beside);
                let reach = add_product(simd, beside, radius, simd.add_f32s(along, product));
                let wide = simd.sub_f32s(left, rest);
                let wide = add_product(simd, simd.neg_f32s(radius), radius, wide);
                let excess = simd.sub_f32s(simd.mul_f32s(reach, reach), simd.mul_f32s(key, wide));
                let near = simd.sub_f32s(vectors::<S>(&centres.near)[v], left);
                vectors_mut::<S>(&mut may)[v] = match self.optimised {
                    true => simd.max_f32s(excess, near),
                    false => excess,
                };
            }
            // Without a branch: whether a leaf is open cannot be foretold.
            for (open, excess) in open.iter_mut().zip(may.0) {
                *open |= mark * u16::from(excess >= 0.0);
            }
        }
    }

    /// What a ball whose vectors are at least `gap` long beside the directions has to reach: rounding tells less in it the
    /// more is left of them.
    #[inline(always)]
    fn bar(&self, gap: f32) -> Bar {
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
            key,
            beside: beside.sqrt() * (2.0 - BELOW),
        }
    }

    /// Meets a leaf unless the heads of its atoms rule all of them out.
    #[inline(always)]
    fn look_into(&mut self, leaf: usize) {
        let simd = self.simd;
        let mut sums = [[simd.splat_f32s(0.0); V]; N];
        let mut from = 0;
        let atoms = &self.leaves.leaves[leaf];
        for level in 0..LEVELS.len() {
            // The more is taken away the longer a head has to be.
            if level == usize::from(N == 1) {
                continue;
            }
            for p in from..LEVELS[level] {
                add::<S, N, V>(simd, &mut sums, self.sought.path, p, &atoms.heads[p]);
            }
            from = LEVELS[level];
            if !self.may_be_best(atoms, level, &sums) {
                return;
            }
        }
        self.meet(leaf);
    }

    /// Whether an atom of a leaf can be the best, by its head's products up to a level.
    #[inline(always)]
    fn may_be_best(&self, leaf: &Leaf, level: usize, sums: &[[S::f32s; V]; N]) -> bool {
        let simd = self.simd;
        let beyond = |n: usize| simd.splat_f32s(self.sought.path.heads[n].beyond[level]);
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
        self.left = self.left.and_then(|left| left.checked_sub(1));
        if self.left.is_none() {
            return;
        }
        let (simd, path) = (self.simd, self.sought.path);
        let d = path.width();
        let rows = &self.leaves.whole[leaf * d..][..d];
        let mut sums = [[simd.splat_f32s(0.0); V]; N];
        let vectors: [&[f32]; N] = std::array::from_fn(
            #[inline(always)]
            |n| &path.vectors[n * d..][..d],
        );
        for (k, row) in rows.iter().enumerate() {
            let of = vectors.map(
                #[inline(always)]
                |q| q[k],
            );
            multiply::<S, N, V>(simd, &mut sums, of, row);
        }
        let mut keys = Lanes::ZERO;
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
            vectors_mut::<S>(&mut keys)[v] = simd.div_f32s(simd.mul_f32s(c, c), under);
        }
        let atoms = &self.leaves.leaves[leaf].atoms;
        for (key, atom) in keys.0.into_iter().zip(*atoms) {
            let better = key > self.key || (key == self.key && key > 0.0 && atom < self.best);
            if better && !self.sought.taken.contains(&atom) {
                (self.key, self.best) = (key, atom);
            }
        }
    }
}

/// Adds the products of part `p` of heads with those of the path's first N vectors.
#[inline(always)]
fn add<S: Simd, const N: usize, const V: usize>(
    simd: S,
    sums: &mut [[S::f32s; V]; N],
    path: &Path,
    p: usize,
    rows: &[Lanes; PART],
) {
    let heads: [&[f32; PART]; N] = std::array::from_fn(
        #[inline(always)]
        |n| &path.heads[n].along[p],
    );
    for k in 0..PART {
        multiply::<S, N, V>(
            simd,
            sums,
            heads.map(
                #[inline(always)]
                |h| h[k],
            ),
            &rows[k],
        );
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

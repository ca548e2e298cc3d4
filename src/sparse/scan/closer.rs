//! Atoms that may be the best, looked at closer: by longer heads, then as a scan meets them.

use super::super::Rule;
use super::block::{vectors, vectors_mut};
use super::heads::LEVELS;
use super::kernel::{FLOOR, add_product};
use super::lead::LEADS;
use super::leaves::{LEAF, Lanes};
use super::meet;
use super::path::Noise;
use super::pruned::Sought;
use super::sieve::Sieve;
use super::sweep::BELOW;
use crate::simd;
use pulp::{Simd, WithSimd};

/// Atoms that are looked at side by side: a sum is a chain, and several of them need not wait for one another.
const AT_ONCE: usize = LEADS;
/// And so many heads.
const LOOKS: usize = 8;

/// The search of one pose.
pub struct Closer<'s> {
    sieve: &'s Sieve,
    atoms: &'s [f32],
    sought: &'s Sought<'s>,
    heads: &'s [Lanes],
    whole: &'s [Lanes],
    noise: Noise,
    pub is_optimised: bool,
    key: f32,
    atom: u32,
    /// Places of atoms that were met first.
    first: [u32; LEADS],
}

impl<'s> Closer<'s> {
    /// `vectors`: those of the pose side by side, their heads and as they are.
    pub fn new(
        sieve: &'s Sieve,
        atoms: &'s [f32],
        sought: &'s Sought<'s>,
        vectors: (&'s [Lanes], &'s [Lanes]),
    ) -> Self {
        Closer {
            sieve,
            atoms,
            sought,
            heads: vectors.0,
            whole: vectors.1,
            noise: sought.path.sifting_noise(),
            is_optimised: sought.rule == Rule::Optimised && sought.path.heads.len() > 1,
            key: 0.0,
            atom: 0,
            first: [0; LEADS],
        }
    }

    /// The best key of the atoms at some places, likely the best; none where it is nothing.
    pub fn start(&mut self, likely: [u32; LEADS]) -> Option<f32> {
        let last = self.sieve.heads.len() as u32 - 1;
        self.first = likely.map(|place| place.min(last));
        let places = self.first;
        simd::eights(Meeting {
            closer: self,
            places: &places,
            by_heads: false,
        });
        (self.key > 0.0).then_some(self.key)
    }

    /// The best of the atoms at some places, and of those before: the first of equals.
    pub fn best(&mut self, some: &[u32]) -> u32 {
        simd::eights(Meeting {
            closer: self,
            places: some,
            by_heads: true,
        });
        self.atom
    }

    /// The products of the pose's vectors with some atoms' numbers, each a chain as in a scan.
    #[inline(always)]
    fn chains<S: Simd, const V: usize, const L: usize>(
        simd: S,
        rows: &[Lanes],
        atoms: [&[f32]; L],
    ) -> [Lanes; L] {
        let mut sums = [[simd.splat_f32s(0.0); V]; L];
        let atoms = atoms.map(|a| &a[..rows.len()]);
        for (k, row) in rows.iter().enumerate() {
            let row = vectors::<S>(row);
            for l in 0..L {
                let by = simd.splat_f32s(atoms[l][k]);
                for v in 0..V {
                    sums[l][v] = add_product(simd, row[v], by, sums[l][v]);
                }
            }
        }
        let mut all = [Lanes::ZERO; L];
        for l in 0..L {
            for v in 0..V {
                vectors_mut::<S>(&mut all[l])[v] = sums[l][v];
            }
        }
        all
    }

    /// Whether the atom at a place may reach the key, by the products of its longer head.
    #[inline(always)]
    fn may_reach(&self, place: u32, products: &Lanes) -> bool {
        let tail = self.sieve.heads[place as usize].beyond[LEVELS.len() - 1];
        let path = self.sought.path;
        let beyond = |n: usize| path.heads[n].beyond[LEVELS.len() - 1];
        let most = products.0[0].abs() + self.noise.product + tail * beyond(0);
        let mut left = 1.0;
        if self.is_optimised {
            left -= self.noise.rest;
            for n in 1..path.heads.len() {
                let most = products.0[n].abs() + tail * beyond(n);
                left -= most * most;
            }
        }
        most * most >= self.key * BELOW * left.max(FLOOR)
    }

    /// Takes an atom if it is better.
    #[inline(always)]
    fn choose(&mut self, atom: u32, key: f32) {
        if key > self.key || (key == self.key && key > 0.0 && atom < self.atom) {
            (self.key, self.atom) = (key, atom);
        }
    }
}

/// Atoms at some places are met.
struct Meeting<'c, 's> {
    closer: &'c mut Closer<'s>,
    places: &'c [u32],
    /// Only those whose heads tell that they may be the best.
    by_heads: bool,
}

impl WithSimd for Meeting<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            8 => self.go::<S, 1>(simd),
            4 => self.go::<S, 2>(simd),
            _ => self.go::<S, LEAF>(simd),
        }
    }
}

impl Meeting<'_, '_> {
    #[inline(always)]
    fn go<S: Simd, const V: usize>(self, simd: S) {
        match self.by_heads {
            true => self.closer.look::<S, V>(simd, self.places),
            false => self.closer.meet::<S, V>(simd, self.places),
        }
    }
}

impl<'s> Closer<'s> {
    #[inline(always)]
    fn look<S: Simd, const V: usize>(&mut self, simd: S, places: &[u32]) {
        let mut some = [0; AT_ONCE];
        let mut count = 0;
        for few in places.chunks(LOOKS) {
            let mut heads = [self.head(few[0]); LOOKS];
            for l in 1..few.len() {
                heads[l] = self.head(few[l]);
            }
            let sums = Self::chains::<S, V, LOOKS>(simd, self.heads, heads);
            for (place, sums) in few.iter().zip(&sums) {
                if self.may_reach(*place, sums) && !self.first.contains(place) {
                    some[count] = *place;
                    count += 1;
                    if count == AT_ONCE {
                        self.meet::<S, V>(simd, &some);
                        count = 0;
                    }
                }
            }
        }
        if count > 0 {
            self.meet::<S, V>(simd, &some[..count]);
        }
    }

    /// Meets the atoms at up to [`AT_ONCE`] places.
    #[inline(always)]
    fn meet<S: Simd, const V: usize>(&mut self, simd: S, places: &[u32]) {
        let mut whole = [self.atom_at(places[0]); AT_ONCE];
        for l in 1..places.len() {
            whole[l] = self.atom_at(places[l]);
        }
        let sums = Self::chains::<S, V, AT_ONCE>(simd, self.whole, whole);
        let path = self.sought.path;
        let mut side_by_side = [[simd.splat_f32s(0.0); V]; LEAF];
        for (n, vectors_of) in side_by_side.iter_mut().enumerate() {
            let mut lanes = Lanes::ZERO;
            for l in 0..AT_ONCE {
                lanes.0[l] = sums[l].0[n];
            }
            vectors_of.copy_from_slice(vectors::<S>(&lanes));
        }
        let sums = &side_by_side[..path.heads.len()];
        let keys = meet::keys(simd, sums, &path.parts, self.is_optimised);
        for (place, key) in places.iter().zip(keys.0) {
            let atom = self.sieve.atoms[*place as usize];
            if !self.sought.taken.contains(&atom) {
                self.choose(atom, key);
            }
        }
    }

    fn head(&self, place: u32) -> &'s [f32] {
        self.sieve.heads[place as usize].along.as_flattened()
    }

    fn atom_at(&self, place: u32) -> &'s [f32] {
        let d = self.sought.path.width();
        &self.atoms[self.sieve.atoms[place as usize] as usize * d..][..d]
    }
}

//! Atoms that may be the best, looked at closer.
//!
//! All their numbers, in sums that need not wait for one another, tell their keys but for rounding. Where more than one may be the
//! best by that, those are met as a scan meets them: the same sums in the same order, the same keys.

use super::ball_tree::{LEAF, Lanes};
use super::branch_and_bound::{DIRECTIONS, Query};
use super::exact_score;
use super::micro_gemm::{vectors, vectors_mut};
use super::packed_atoms::PLACES;
use super::panel_kernel::{FLOOR, add_product};
use super::quantized_table::QuantizedTable;
use super::query::RoundingError;
use super::single_search::BELOW;
use super::warm_start::LEADS;
use crate::numeric::simd;
use pulp::{Simd, WithSimd};

/// Atoms that are met side by side: a sum is a chain, and several of them need not wait for one another.
const AT_ONCE: usize = 4;

/// An atom that was looked at, and what its key is at least and at most, as a scan finds it.
#[derive(Debug, Clone, Copy)]
struct Seen {
    atom: u32,
    least: f32,
    most: f32,
}

/// Room for searches.
#[derive(Default)]
pub struct Room {
    seen: Vec<Seen>,
    /// A pose's vectors side by side.
    vectors: Vec<Lanes>,
}

/// The search of one pose.
pub struct Closer<'s> {
    sieve: &'s QuantizedTable,
    /// (n, D)
    atoms: &'s [f32],
    sought: &'s Query<'s>,
    noise: RoundingError,
    room: &'s mut Room,
}

impl<'s> Closer<'s> {
    /// Of what is sought among atoms (n, D).
    pub fn new(
        sieve: &'s QuantizedTable,
        atoms: &'s [f32],
        sought: &'s Query<'s>,
        room: &'s mut Room,
    ) -> Self {
        room.seen.clear();
        Closer {
            sieve,
            atoms,
            sought,
            noise: sought.path.noise(),
            room,
        }
    }

    /// What the key of the best of the atoms at some places, and of those looked at before, is at least.
    pub fn least(&mut self, places: &[u32]) -> f32 {
        simd::dispatch8_job(Looking {
            closer: self,
            places,
        });
        (self.room.seen.iter()).fold(0.0, |least, seen| least.max(seen.least))
    }

    /// The best of the atoms at some places, and of those looked at before, the first of equals; none where they have no keys.
    pub fn best(&mut self, places: &[u32]) -> Option<u32> {
        let least = self.least(places) * BELOW;
        self.room.seen.retain(|seen| seen.most >= least);
        match self.room.seen[..] {
            [one] if one.least > 0.0 => Some(one.atom),
            _ => simd::dispatch8_job(Meeting(self)),
        }
    }

    fn atom(&self, atom: u32) -> &'s [f32] {
        let d = self.sought.path.width();
        &self.atoms[atom as usize * d..][..d]
    }

    /// What the key of an atom is at least and at most by its products with the pose's vectors, whatever a scan rounds.
    #[inline(always)]
    fn seen<const N: usize>(&self, atom: u32, products: [f32; N]) -> Seen {
        // The scan's c comes of the signal.
        let (mut c, mut e) = (products[0], 1.0);
        for (product, part) in products[1..].iter().zip(&self.sought.path.parts) {
            c += part * product;
            e -= product * product;
        }
        let (over, under) = (c.abs() + self.noise.product, c.abs() - self.noise.product);
        let (more, less) = match self.sought.is_optimised() {
            true => (e + self.noise.rest, e - self.noise.rest),
            false => (1.0, 1.0),
        };
        let under = under.max(0.0);
        Seen {
            atom,
            least: BELOW * under * under / more.max(FLOOR),
            most: over * over / (BELOW * less.max(FLOOR)),
        }
    }
}

/// The atoms at some places are looked at.
struct Looking<'c, 's> {
    closer: &'c mut Closer<'s>,
    places: &'c [u32],
}

impl WithSimd for Looking<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Sums of fewer lanes would round more than is allowed for.
        match S::F32_LANES {
            ..4 => self.of_directions(pulp::Scalar256b),
            _ => self.of_directions(simd),
        }
    }
}

impl Looking<'_, '_> {
    #[inline(always)]
    fn of_directions<S: Simd>(self, simd: S) {
        match self.closer.sought.path.heads.len() {
            1 => self.go::<S, 1>(simd),
            2 => self.go::<S, 2>(simd),
            3 => self.go::<S, 3>(simd),
            _ => self.go::<S, DIRECTIONS>(simd),
        }
    }

    #[inline(always)]
    fn go<S: Simd, const N: usize>(self, simd: S) {
        let Looking { closer, places } = self;
        let path = closer.sought.path;
        let mut vectors = [&path.vectors[..path.width()]; N];
        for n in 1..N {
            vectors[n] = &path.vectors[n * path.width()..][..path.width()];
        }
        for place in places {
            let atom = closer.sieve.atoms[*place as usize];
            // The first are those that lead, looked at before all others; no other atom is at two places.
            let is_seen = (closer.room.seen.iter().take(LEADS)).any(|seen| seen.atom == atom);
            if !is_seen && !closer.sought.taken.contains(&atom) {
                let products = products::<S, N>(simd, closer.atom(atom), vectors);
                let seen = closer.seen(atom, products);
                closer.room.seen.push(seen);
            }
        }
    }
}

/// The products of an atom with some vectors, lanes summed side by side.
#[inline(always)]
fn products<S: Simd, const N: usize>(simd: S, atom: &[f32], vectors: [&[f32]; N]) -> [f32; N] {
    let (d, lanes) = (atom.len(), S::F32_LANES);
    let mut sums = [simd.splat_f32s(0.0); N];
    let whole = S::as_simd_f32s(atom).0;
    let vectors_of = vectors.map(|v| &S::as_simd_f32s(v).0[..whole.len()]);
    for (i, a) in whole.iter().enumerate() {
        for n in 0..N {
            sums[n] = simd.mul_add_e_f32s(*a, vectors_of[n][i], sums[n]);
        }
    }
    if d < lanes {
        return vectors.map(|v| v.iter().zip(atom).map(|(v, a)| v * a).sum());
    }
    // What does not fill a vector is the end of the last one that does.
    let rest = d % lanes;
    if rest > 0 {
        let last = |v: &[f32]| S::as_simd_f32s(&v[d - lanes..]).0[0];
        let is_new = simd.greater_than_or_equal_f32s(
            S::as_simd_f32s(&PLACES.0[..lanes]).0[0],
            simd.splat_f32s((lanes - rest) as f32),
        );
        let a = simd.select_f32s(is_new, last(atom), simd.splat_f32s(0.0));
        for n in 0..N {
            sums[n] = simd.mul_add_e_f32s(a, last(vectors[n]), sums[n]);
        }
    }
    sums.map(|sum| simd.reduce_sum_f32s(sum))
}

/// Atoms that were seen are met.
struct Meeting<'c, 's>(&'c mut Closer<'s>);

impl WithSimd for Meeting<'_, '_> {
    type Output = Option<u32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<u32> {
        self.0.lay();
        match S::F32_LANES {
            8 => self.0.meet::<S, 1>(simd),
            4 => self.0.meet::<S, 2>(simd),
            _ => self.0.meet::<S, LEAF>(simd),
        }
    }
}

impl Closer<'_> {
    /// Lays the pose's vectors side by side.
    fn lay(&mut self) {
        let path = self.sought.path;
        let rows = &mut self.room.vectors;
        rows.clear();
        rows.resize(path.width(), Lanes::ZERO);
        for (n, vector) in path.vectors.chunks_exact(path.width()).enumerate() {
            (rows.iter_mut().zip(vector)).for_each(|(row, v)| row.0[n] = *v);
        }
    }

    /// The best of the atoms that were seen.
    #[inline(always)]
    fn meet<S: Simd, const V: usize>(&self, simd: S) -> Option<u32> {
        let (mut best, mut atom) = (0.0, None);
        for few in self.room.seen.chunks(AT_ONCE) {
            let keys = self.keys::<S, V>(simd, few);
            for (seen, key) in few.iter().zip(keys.0) {
                if key > best || (key == best && atom.is_some_and(|atom| seen.atom < atom)) {
                    (best, atom) = (key, Some(seen.atom));
                }
            }
        }
        atom
    }

    /// The keys of up to [`AT_ONCE`] atoms, as a scan finds them.
    #[inline(always)]
    fn keys<S: Simd, const V: usize>(&self, simd: S, few: &[Seen]) -> Lanes {
        let mut atoms = [self.atom(few[0].atom); AT_ONCE];
        for l in 1..few.len() {
            atoms[l] = self.atom(few[l].atom);
        }
        let sums = chains::<S, V>(simd, &self.room.vectors, atoms);
        let mut side_by_side = [[simd.splat_f32s(0.0); V]; LEAF];
        for (n, vectors_of) in side_by_side.iter_mut().enumerate() {
            let mut lanes = Lanes::ZERO;
            for l in 0..AT_ONCE {
                lanes.0[l] = sums[l].0[n];
            }
            vectors_of.copy_from_slice(vectors::<S>(&lanes));
        }
        let path = self.sought.path;
        let sums = &side_by_side[..path.heads.len()];
        exact_score::keys(simd, sums, &path.parts, self.sought.is_optimised())
    }
}

/// The products of a pose's vectors, side by side, with some atoms, each a chain as in a scan.
#[inline(always)]
fn chains<S: Simd, const V: usize>(
    simd: S,
    rows: &[Lanes],
    atoms: [&[f32]; AT_ONCE],
) -> [Lanes; AT_ONCE] {
    let mut sums = [[simd.splat_f32s(0.0); V]; AT_ONCE];
    let atoms = atoms.map(|a| &a[..rows.len()]);
    for (k, row) in rows.iter().enumerate() {
        let row = vectors::<S>(row);
        for l in 0..AT_ONCE {
            let by = simd.splat_f32s(atoms[l][k]);
            for v in 0..V {
                sums[l][v] = add_product(simd, row[v], by, sums[l][v]);
            }
        }
    }
    let mut all = [Lanes::ZERO; AT_ONCE];
    for l in 0..AT_ONCE {
        for v in 0..V {
            vectors_mut::<S>(&mut all[l])[v] = sums[l][v];
        }
    }
    all
}

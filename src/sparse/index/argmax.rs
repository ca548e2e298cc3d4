//! The best atom of those met so far.

use super::packed_atoms::PLACES;
use super::panel_kernel::any;
use pulp::Simd;

/// An atom is as good as its key: c² / e, rounded to f32. It is sought without a division: below this share of the key there
/// is nothing better.
const NEARLY: f32 = 1.0 - 1e-6;

/// The best atom for a pose: that with the largest key, the first of equals.
#[derive(Debug, Clone, Copy)]
pub struct Best {
    key: f32,
    /// No smaller share of e than this, as c², can make a larger key.
    enough: f32,
    atom: u32,
}

impl Best {
    /// None yet.
    pub const NONE: Best = Best {
        key: 0.0,
        enough: 0.0,
        atom: 0,
    };

    /// An atom that is known to be the best.
    pub fn of(atom: u32) -> Best {
        Best {
            key: f32::INFINITY,
            enough: f32::INFINITY,
            atom,
        }
    }

    /// Meets atoms with c² = `over` and e = `under`, `from` the first of them; atoms are met in their order.
    #[inline(always)]
    pub fn meet<S: Simd, const V: usize>(
        &mut self,
        simd: S,
        from: u32,
        over: [S::f32s; V],
        under: [S::f32s; V],
    ) {
        let enough = simd.splat_f32s(self.enough);
        // Loops, not closures: those are not always inlined, and then have no vectors.
        let mut perhaps = simd.greater_than_f32s(over[0], simd.mul_f32s(enough, under[0]));
        for v in 1..V {
            let bar = simd.mul_f32s(enough, under[v]);
            perhaps = simd.or_m32s(perhaps, simd.greater_than_f32s(over[v], bar));
        }
        // Seldom, after the first few atoms.
        if any::<S>(perhaps) {
            self.compare(simd, from, over, under);
        }
    }

    #[inline(always)]
    fn compare<S: Simd, const V: usize>(
        &mut self,
        simd: S,
        from: u32,
        over: [S::f32s; V],
        under: [S::f32s; V],
    ) {
        let mut keys = over;
        let mut most = simd.splat_f32s(self.key);
        for v in 0..V {
            keys[v] = simd.div_f32s(over[v], under[v]);
            // What is no number, of an atom that is taken, is not more.
            most = simd.select_f32s(simd.greater_than_f32s(keys[v], most), keys[v], most);
        }
        let most = simd.reduce_max_f32s(most);
        if most > self.key {
            self.key = most;
            let places = S::as_simd_f32s(&PLACES.0).0;
            let (all, mut first) = (simd.splat_f32s(most), simd.splat_f32s(f32::INFINITY));
            for v in 0..V {
                let is_it = simd.equal_f32s(keys[v], all);
                let place = simd.select_f32s(is_it, places[v], first);
                first = simd.min_f32s(first, place);
            }
            self.atom = from + simd.reduce_min_f32s(first) as u32;
            // Of numbers below the normal ones a share is not told so well.
            self.enough = match most > 1e-30 {
                true => most * NEARLY,
                false => 0.0,
            };
        }
    }

    /// Which it is; `None` where nothing is along any atom.
    pub fn atom(&self) -> Option<u32> {
        (self.key > 0.0).then_some(self.atom)
    }
}

#[cfg(test)]
mod tests {
    use super::super::packed_atoms::WIDTH;
    use super::*;
    use crate::numeric::parallel;
    use pulp::{Scalar, Scalar256b, Scalar512b, WithSimd};
    use rand::Rng;

    /// Two panels, one after the other.
    struct Met<'a>([(&'a [f32; WIDTH], &'a [f32; WIDTH]); 2]);

    impl Met<'_> {
        fn by<S: Simd, const V: usize>(self, simd: S) -> Option<u32> {
            let mut best = Best::NONE;
            for (panel, (over, under)) in (0..).zip(self.0) {
                let of = |all: &[f32; WIDTH]| -> [S::f32s; V] {
                    let all = S::as_simd_f32s(&all[..]).0;
                    std::array::from_fn(|v| all[v])
                };
                best.meet(simd, panel * WIDTH as u32, of(over), of(under));
            }
            best.atom()
        }
    }

    impl WithSimd for Met<'_> {
        type Output = Option<u32>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Option<u32> {
            match S::F32_LANES {
                16 => self.by::<S, 4>(simd),
                8 => self.by::<S, 8>(simd),
                4 => self.by::<S, 16>(simd),
                _ => self.by::<S, WIDTH>(simd),
            }
        }
    }

    #[test]
    fn the_first_of_the_best_is_found_on_vectors_of_any_width() {
        let mut generator = parallel::rng(1, 0);
        for round in 0..500 {
            let mut over = [[0.0f32; WIDTH]; 2];
            let mut under = [[1.0f32; WIDTH]; 2];
            // Many equal keys, atoms that are taken, and ones that are not seen.
            over.as_flattened_mut().iter_mut().for_each(|o| {
                *o = match generator.random_range(0..5) {
                    0 => f32::NAN,
                    1 => 0.0,
                    _ => generator.random_range(0..4) as f32 * 1e-3,
                }
            });
            under
                .as_flattened_mut()
                .iter_mut()
                .for_each(|u| *u = [1.0, 0.5, 1e-6, f32::INFINITY][generator.random_range(0..4)]);
            if round == 0 {
                over = [[f32::NAN; WIDTH]; 2];
            }
            let keys = over.as_flattened().iter().zip(under.as_flattened());
            let mut want = (0.0, None);
            for (atom, key) in (0u32..).zip(keys.map(|(o, u)| o / u)) {
                if key > want.0 {
                    want = (key, Some(atom));
                }
            }
            let met = || Met([(&over[0], &under[0]), (&over[1], &under[1])]);
            assert_eq!(crate::numeric::simd::dispatch_widest(met()), want.1);
            assert_eq!(met().with_simd(Scalar), want.1);
            assert_eq!(met().with_simd(Scalar256b), want.1);
            assert_eq!(met().with_simd(Scalar512b), want.1);
        }
    }
}

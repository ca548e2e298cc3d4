//! The best atom of those met so far.

use super::kernel::any;
use super::panels::Row;
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
        let higher = |v: usize| {
            let bar = simd.mul_f32s(enough, under[v]);
            simd.greater_than_f32s(over[v], bar)
        };
        let perhaps = (1..V).fold(higher(0), |some, v| simd.or_m32s(some, higher(v)));
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
        let mut keys = Row::ZERO;
        let mut most = simd.splat_f32s(self.key);
        for v in 0..V {
            let key = simd.div_f32s(over[v], under[v]);
            // What is no number, of an atom that is taken, is not more.
            most = simd.select_f32s(simd.greater_than_f32s(key, most), key, most);
            S::as_mut_simd_f32s(&mut keys.0).0[v] = key;
        }
        let most = simd.reduce_max_f32s(most);
        if most > self.key {
            self.key = most;
            let lane = keys.0.iter().position(|key| *key == most);
            self.atom = from + lane.unwrap_or_default() as u32;
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

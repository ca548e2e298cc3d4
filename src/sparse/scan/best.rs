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
        let mut perhaps = false;
        for v in 0..V {
            let bar = simd.mul_f32s(enough, under[v]);
            perhaps |= any::<S>(simd.greater_than_f32s(over[v], bar));
        }
        // Seldom, after the first few atoms.
        if perhaps {
            let mut keys = Row::ZERO;
            for v in 0..V {
                S::as_mut_simd_f32s(&mut keys.0).0[v] = simd.div_f32s(over[v], under[v]);
            }
            for (lane, key) in keys.0.iter().enumerate().take(V * S::F32_LANES) {
                if *key > self.key {
                    self.key = *key;
                    self.atom = from + lane as u32;
                }
            }
            // Of numbers below the normal ones a share is not told so well.
            self.enough = match self.key > 1e-30 {
                true => self.key * NEARLY,
                false => 0.0,
            };
        }
    }

    /// Which it is; `None` where nothing is along any atom.
    pub fn atom(&self) -> Option<u32> {
        (self.key > 0.0).then_some(self.atom)
    }
}

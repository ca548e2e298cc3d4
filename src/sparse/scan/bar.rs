//! The atoms that may reach a bar, whatever is beyond their heads.

use super::super::Rule;
use super::kernel::{self, any};
use super::lead::Weighed;
use super::panels::WIDTH;
use super::pruned::Sought;
use super::sweep::BELOW;
use super::weigh::{Reach, Reaches, vectors};
use pulp::{Simd, WithSimd};

/// What an atom has to reach.
pub struct Bar {
    key: f32,
    reach: Reach,
    /// What is left of an atom counts.
    is_optimised: bool,
}

impl Bar {
    /// A key, for what is sought.
    pub fn of(sought: &Sought<'_>, key: f32) -> Bar {
        // Ratios are compared by products, which round too.
        Bar {
            key: key * BELOW * BELOW,
            reach: Reach::of(sought.path),
            is_optimised: sought.rule == Rule::Optimised && sought.path.heads.len() > 1,
        }
    }
}

/// Finds the atoms that may reach a bar; whether they are few.
pub struct Sifting<'a> {
    pub bar: Bar,
    pub weighed: Weighed<'a>,
    /// So many atoms are few.
    pub few: usize,
    pub left: &'a mut Vec<u32>,
}

impl WithSimd for Sifting<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let key = simd.splat_f32s(self.bar.key);
        let reach = Reaches::of(simd, self.bar.reach);
        let weighed = self.weighed;
        let n = weighed.sieve.heads.len() as u32;
        for panel in 0..weighed.sieve.tails.len() {
            let row = panel * weighed.poses;
            if !any::<S>(simd.greater_than_or_equal_f32s(weighed.most[row].first::<S>(), key)) {
                continue;
            }
            let tails = vectors::<S>(&weighed.sieve.tails[panel]);
            let c = vectors::<S>(&weighed.correlations[row]);
            let e = vectors::<S>(&weighed.remainders[row]);
            let mut mask = 0;
            for v in 0..WIDTH / S::F32_LANES {
                let over = reach.over(simd, c[v], tails[v]);
                let bar = match self.bar.is_optimised {
                    true => simd.mul_f32s(key, reach.under(simd, e[v])),
                    false => key,
                };
                let some = kernel::bits(simd, simd.greater_than_or_equal_f32s(over, bar));
                mask |= u64::from(some) << (v * S::F32_LANES);
            }
            while mask != 0 {
                let place = (panel * WIDTH) as u32 + mask.trailing_zeros();
                mask &= mask - 1;
                if place < n {
                    self.left.push(place);
                }
            }
            if self.left.len() > self.few {
                return false;
            }
        }
        true
    }
}

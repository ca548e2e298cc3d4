//! What the products of a few vectors of atoms with a pose tell of them.

use super::filter_pass::{Look, Reach};
use super::packed_atoms::Row;
use super::panel_kernel::{FLOOR, add_product};
use pulp::Simd;

#[inline(always)]
pub fn vectors<S: Simd>(row: &Row) -> &[S::f32s] {
    S::as_simd_f32s(&row.0).0
}

/// A [`Look`]'s numbers in all lanes.
pub struct Splat<S: Simd> {
    before: S::f32s,
    now: S::f32s,
    beyond: S::f32s,
    rest: S::f32s,
    gap: S::f32s,
    reach: Reaches<S>,
}

/// A [`Reach`]'s numbers in all lanes.
pub struct Reaches<S: Simd> {
    beyond: S::f32s,
    product: S::f32s,
}

impl<S: Simd> Splat<S> {
    #[inline(always)]
    pub fn of(simd: S, look: &Look) -> Self {
        Splat {
            before: simd.splat_f32s(look.newest.before),
            now: simd.splat_f32s(look.newest.now),
            beyond: simd.splat_f32s(look.newest.beyond),
            rest: simd.splat_f32s(look.newest.rest),
            gap: simd.splat_f32s(look.gap),
            reach: Reaches::of(simd, look.reach),
        }
    }
}

impl<S: Simd> Reaches<S> {
    #[inline(always)]
    pub fn of(simd: S, reach: Reach) -> Self {
        Reaches {
            beyond: simd.splat_f32s(reach.beyond),
            product: simd.splat_f32s(reach.product),
        }
    }

    /// c² at most.
    #[inline(always)]
    pub fn over(&self, simd: S, c: S::f32s, tail: S::f32s) -> S::f32s {
        let most = simd.add_f32s(simd.abs_f32s(c), self.product);
        let most = add_product(simd, tail, self.beyond, most);
        simd.mul_f32s(most, most)
    }
}

/// What e counts for, by what is kept of it.
#[inline(always)]
pub fn under<S: Simd>(simd: S, e: S::f32s) -> S::f32s {
    simd.max_f32s(e, simd.splat_f32s(FLOOR))
}

/// The logarithm of c² / e, nearly: bits of positive numbers are that of their logarithms. It tells as well which atoms are likely
/// the best, and costs little beside the products.
#[inline(always)]
fn likely<S: Simd>(simd: S, c: S::f32s, e: S::f32s) -> S::i32s {
    let c = simd.transmute_i32s_f32s(simd.abs_f32s(c));
    simd.sub_i32s(simd.add_i32s(c, c), simd.transmute_i32s_f32s(e))
}

/// What is known of some vectors of atoms, by lanes the largest.
#[derive(Clone, Copy)]
pub struct Met<S: Simd> {
    /// The logarithm of c² over what e likely is.
    pub likely: S::i32s,
    /// In terms of what c² is at most, and e at least.
    most: S::f32s,
    under: S::f32s,
}

impl<S: Simd> Met<S> {
    /// The larger of two, without a division.
    #[inline(always)]
    fn with(self, simd: S, other: Met<S>) -> Met<S> {
        Met {
            likely: simd.max_i32s(self.likely, other.likely),
            most: simd.max_f32s(
                simd.mul_f32s(self.most, other.under),
                simd.mul_f32s(other.most, self.under),
            ),
            under: simd.mul_f32s(self.under, other.under),
        }
    }

    /// The largest key that any of the atoms may have.
    #[inline(always)]
    pub fn most(&self, simd: S) -> S::f32s {
        simd.div_f32s(self.most, self.under)
    }
}

/// What is kept of some vectors of atoms.
pub struct Kept<'a, S: Simd> {
    pub c: &'a mut [S::f32s],
    pub e: &'a mut [S::f32s],
    pub tails: &'a [S::f32s],
    /// By lanes the longest of those.
    pub longest: S::f32s,
}

/// What is done with products.
pub trait Use {
    /// Takes the products of V vectors.
    fn meet<S: Simd, const V: usize>(
        simd: S,
        look: &Splat<S>,
        products: &[S::f32s; V],
        kept: Kept<'_, S>,
    ) -> Met<S>;
}

/// Where e does not count: c alone tells.
pub struct Alone;

impl Use for Alone {
    #[inline(always)]
    fn meet<S: Simd, const V: usize>(
        simd: S,
        look: &Splat<S>,
        products: &[S::f32s; V],
        kept: Kept<'_, S>,
    ) -> Met<S> {
        let mut most = simd.splat_f32s(0.0);
        for v in 0..V {
            kept.c[v] = products[v];
            most = simd.max_f32s(most, simd.abs_f32s(products[v]));
        }
        let one = simd.splat_f32s(1.0);
        Met {
            likely: likely(simd, most, one),
            most: look.reach.over(simd, most, kept.longest),
            under: one,
        }
    }
}

/// Where e falls, by what an atom has along the newest direction: from 1 if that is the first.
pub struct Falling<const FROM_ONE: bool>;

impl<const FROM_ONE: bool> Use for Falling<FROM_ONE> {
    #[inline(always)]
    fn meet<S: Simd, const V: usize>(
        simd: S,
        look: &Splat<S>,
        products: &[S::f32s; V],
        kept: Kept<'_, S>,
    ) -> Met<S> {
        let Kept { c, e, tails, .. } = kept;
        let one = simd.splat_f32s(1.0);
        let mut all = Met {
            likely: simd.splat_i32s(i32::MIN),
            most: simd.splat_f32s(0.0),
            under: one,
        };
        for v in 0..V {
            let (product, tail) = (products[v], tails[v]);
            let before = simd.mul_f32s(c[v], look.before);
            let along = add_product(simd, simd.neg_f32s(product), look.now, before);
            let most = add_product(simd, tail, look.beyond, simd.abs_f32s(along));
            let before = simd.sub_f32s(if FROM_ONE { one } else { e[v] }, look.rest);
            let left = add_product(simd, simd.neg_f32s(most), most, before);
            (c[v], e[v]) = (product, left);
            let under = under(simd, left);
            let met = Met {
                likely: likely(simd, product, add_product(simd, tail, look.gap, under)),
                most: look.reach.over(simd, product, tail),
                under,
            };
            all = match v {
                0 => met,
                _ => all.with(simd, met),
            };
        }
        all
    }
}

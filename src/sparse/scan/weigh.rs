//! All atoms weighed by the first numbers of their heads, a few poses at a time.

use super::kernel::{FLOOR, add_product};
use super::lead::{self, Lead};
use super::pairs::{self, PAIRS, Rounded};
use super::panels::{Row, WIDTH, Wide};
use super::path::Path;
use super::sieve::{Sieve, short};
use pulp::{Simd, WithSimd};

/// Beyond it products with directions tell nothing of e: the sum of the squares of what they are off.
const MOST_OFF: f32 = 1e-4;

/// What is weighed for a pose: what is left of it.
pub struct Look {
    slot: usize,
    residual: Rounded,
    newest: Newest,
    gap: f32,
    reach: Reach,
}

/// Of a pose's newest direction q, whose product with an atom is that of what of the pose it took away, over its length.
#[derive(Default)]
struct Newest {
    /// 1 / <q, r>.
    by: f32,
    /// The length of what of it is beyond the head.
    beyond: f32,
}

/// What c may be more than its head tells, and e less.
#[derive(Clone, Copy)]
pub struct Reach {
    /// The length of what of the residual is beyond the head.
    beyond: f32,
    /// Rounding.
    product: f32,
    rest: f32,
}

impl Reach {
    /// For a pose on its way.
    pub fn of(path: &Path) -> Reach {
        let noise = path.noise();
        let rounding = pairs::rounding();
        let mut squared = path.left.max(0.0);
        let product = noise.product + rounding * squared.sqrt();
        // Products with directions are off by what those with the residuals before and after are. Of e twice itself goes with
        // what each is off, and the squares of the products add up to 1 at most, or e is nothing anyway.
        let mut off = 0.0;
        for part in path.parts.iter().rev() {
            let after = squared.sqrt();
            squared += part * part;
            off += (rounding * (after + squared.sqrt()) / part).powi(2);
        }
        let rest = match off < MOST_OFF {
            true => noise.rest + 2.1 * off.sqrt(),
            false => f32::INFINITY,
        };
        Reach {
            beyond: short(&path.heads[0]).1,
            product,
            rest,
        }
    }
}

impl Look {
    /// At what is left of a pose; its newest direction is new, or it is not.
    pub fn at(path: &Path, slot: usize, is_new: bool) -> Look {
        let newest = match path.parts.last() {
            Some(part) if is_new && *part != 0.0 => Newest {
                by: -1.0 / part,
                beyond: short(&path.heads[path.heads.len() - 1]).1,
            },
            _ => Newest::default(),
        };
        Look {
            slot,
            residual: pairs::of_vector(short(&path.heads[0]).0),
            newest,
            gap: lead::gap(path),
            reach: Reach::of(path),
        }
    }
}

/// What is done with the products.
#[derive(Clone, Copy)]
pub enum Step {
    /// c is the product itself, e is 1.
    First,
    /// c changes.
    Plain,
    /// And e falls.
    Optimised,
}

/// What is kept.
pub struct State<'a> {
    /// By panels, then poses.
    pub correlations: &'a mut [Row],
    pub remainders: &'a mut [Row],
    /// The largest key that any atom of a panel may have, by lanes; by poses, then panels.
    pub most: &'a mut [Wide],
    pub poses: usize,
}

/// All atoms are weighed for a few poses.
pub struct Weighing<'a> {
    pub step: Step,
    pub sieve: &'a Sieve,
    pub looks: &'a [Look],
    pub state: State<'a>,
    /// One a look.
    pub leads: &'a mut [Lead],
}

impl WithSimd for Weighing<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.of_step::<S, 6, 4>(simd),
            8 => self.of_step::<S, 6, 2>(simd),
            _ => self.of_step::<S, 4, 4>(simd),
        }
    }
}

impl Weighing<'_> {
    #[inline(always)]
    fn of_step<S: Simd, const POSES: usize, const VECTORS: usize>(self, simd: S) {
        match self.step {
            Step::First => self.go::<S, First, POSES, VECTORS>(simd),
            Step::Plain => self.go::<S, Plain, POSES, VECTORS>(simd),
            Step::Optimised => self.go::<S, Optimised, POSES, VECTORS>(simd),
        }
    }

    #[inline(always)]
    fn go<S: Simd, U: Use, const POSES: usize, const VECTORS: usize>(mut self, simd: S) {
        for lead in &mut *self.leads {
            (lead.lanes, lead.vectors) = (S::F32_LANES, VECTORS);
        }
        let count = self.looks.len();
        let whole = count - count % POSES;
        for panel in 0..self.sieve.tails.len() {
            for from in (0..whole).step_by(POSES) {
                self.few::<S, U, POSES, VECTORS>(simd, panel, from);
            }
            for from in whole..count {
                self.few::<S, U, 1, VECTORS>(simd, panel, from);
            }
        }
    }

    #[inline(always)]
    fn few<S: Simd, U: Use, const POSES: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        panel: usize,
        from: usize,
    ) {
        let (lanes, panels) = (S::F32_LANES, self.sieve.tails.len());
        let looks: &[Look; POSES] = self.looks[from..].first_chunk().expect("so many looks");
        let leads: &mut [Lead; POSES] =
            (self.leads[from..].first_chunk_mut()).expect("a lead a look");
        let rows = &self.sieve.rows[panel * PAIRS..][..PAIRS];
        let tails = vectors::<S>(&self.sieve.tails[panel]);
        for at in (0..WIDTH / lanes).step_by(VECTORS) {
            let mut sums = [[simd.splat_i32s(0); VECTORS]; POSES];
            for (k, row) in rows.iter().enumerate() {
                let row = &S::as_simd_i32s(&row.0).0[at..at + VECTORS];
                for p in 0..POSES {
                    let by = simd.splat_i32s(looks[p].residual.pairs[k]);
                    for v in 0..VECTORS {
                        sums[p][v] = pairs::add_products(simd, row[v], by, sums[p][v]);
                    }
                }
            }
            for p in 0..POSES {
                let look = Splat::of(simd, &looks[p]);
                let row = panel * self.state.poses + looks[p].slot;
                let c = &mut S::as_mut_simd_f32s(&mut self.state.correlations[row].0).0
                    [at..at + VECTORS];
                let e =
                    &mut S::as_mut_simd_f32s(&mut self.state.remainders[row].0).0[at..at + VECTORS];
                let place = simd.splat_i32s((panel * WIDTH + at * lanes) as i32);
                let product = look.product(simd, sums[p][0]);
                let mut met = U::meet(simd, product, &look, tails[at], &mut c[0], &mut e[0]);
                for v in 1..VECTORS {
                    let product = look.product(simd, sums[p][v]);
                    let more = U::meet(simd, product, &look, tails[at + v], &mut c[v], &mut e[v]);
                    met = met.with(simd, more);
                }
                let most = &mut self.state.most[looks[p].slot * panels + panel];
                let (most, largest) = (most.first_mut::<S>(), simd.div_f32s(met.most, met.under));
                *most = match at {
                    0 => largest,
                    _ => simd.max_f32s(largest, *most),
                };
                let Lead { keys, places, .. } = &mut leads[p];
                let keys = &mut S::as_mut_simd_i32s(&mut keys.0).0[0];
                let places = &mut S::as_mut_simd_i32s(&mut places.0).0[0];
                let is_more = simd.greater_than_i32s(met.likely, *keys);
                *keys = simd.max_i32s(met.likely, *keys);
                *places = simd.select_i32s(is_more, place, *places);
            }
        }
    }
}

#[inline(always)]
pub fn vectors<S: Simd>(row: &Row) -> &[S::f32s] {
    S::as_simd_f32s(&row.0).0
}

/// A [`Look`]'s numbers in all lanes.
struct Splat<S: Simd> {
    unit: S::f32s,
    by: S::f32s,
    beyond: S::f32s,
    gap: S::f32s,
    reach: Reaches<S>,
}

/// A [`Reach`]'s numbers in all lanes.
pub struct Reaches<S: Simd> {
    beyond: S::f32s,
    product: S::f32s,
    rest: S::f32s,
}

impl<S: Simd> Splat<S> {
    #[inline(always)]
    fn of(simd: S, look: &Look) -> Self {
        Splat {
            unit: simd.splat_f32s(look.residual.unit),
            by: simd.splat_f32s(look.newest.by),
            beyond: simd.splat_f32s(look.newest.beyond),
            gap: simd.splat_f32s(look.gap),
            reach: Reaches::of(simd, look.reach),
        }
    }

    /// A vector of sums as products.
    #[inline(always)]
    fn product(&self, simd: S, sums: S::i32s) -> S::f32s {
        simd.mul_f32s(pairs::in_single(simd, sums), self.unit)
    }
}

impl<S: Simd> Reaches<S> {
    #[inline(always)]
    pub fn of(simd: S, reach: Reach) -> Self {
        Reaches {
            beyond: simd.splat_f32s(reach.beyond),
            product: simd.splat_f32s(reach.product),
            rest: simd.splat_f32s(reach.rest),
        }
    }

    /// c² at most.
    #[inline(always)]
    pub fn over(&self, simd: S, c: S::f32s, tail: S::f32s) -> S::f32s {
        let most = simd.add_f32s(simd.abs_f32s(c), self.product);
        let most = add_product(simd, tail, self.beyond, most);
        simd.mul_f32s(most, most)
    }

    /// e at least, by what is kept of it.
    #[inline(always)]
    pub fn under(&self, simd: S, e: S::f32s) -> S::f32s {
        simd.max_f32s(simd.sub_f32s(e, self.rest), simd.splat_f32s(FLOOR))
    }
}

/// The logarithm of c² / e, nearly: bits of positive numbers are that of their logarithms. It tells as well which atoms are likely
/// the best, and costs little beside the products.
#[inline(always)]
fn likely<S: Simd>(simd: S, c: S::f32s, e: S::f32s) -> S::i32s {
    let c = simd.transmute_i32s_f32s(simd.abs_f32s(c));
    simd.sub_i32s(simd.add_i32s(c, c), simd.transmute_i32s_f32s(e))
}

/// What is known of a vector of atoms, or of several, by lanes the largest.
#[derive(Clone, Copy)]
struct Met<S: Simd> {
    /// The logarithm of c² over what e likely is.
    likely: S::i32s,
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
}

/// What is done with a vector of products.
trait Use {
    fn meet<S: Simd>(
        simd: S,
        product: S::f32s,
        look: &Splat<S>,
        tail: S::f32s,
        c: &mut S::f32s,
        e: &mut S::f32s,
    ) -> Met<S>;
}

struct First;

impl Use for First {
    #[inline(always)]
    fn meet<S: Simd>(
        simd: S,
        product: S::f32s,
        look: &Splat<S>,
        tail: S::f32s,
        c: &mut S::f32s,
        e: &mut S::f32s,
    ) -> Met<S> {
        (*c, *e) = (product, simd.splat_f32s(1.0));
        plain(simd, product, look, tail)
    }
}

struct Plain;

impl Use for Plain {
    #[inline(always)]
    fn meet<S: Simd>(
        simd: S,
        product: S::f32s,
        look: &Splat<S>,
        tail: S::f32s,
        c: &mut S::f32s,
        _: &mut S::f32s,
    ) -> Met<S> {
        *c = product;
        plain(simd, product, look, tail)
    }
}

/// Where e does not count.
#[inline(always)]
fn plain<S: Simd>(simd: S, c: S::f32s, look: &Splat<S>, tail: S::f32s) -> Met<S> {
    let one = simd.splat_f32s(1.0);
    Met {
        likely: likely(simd, c, one),
        most: look.reach.over(simd, c, tail),
        under: one,
    }
}

struct Optimised;

impl Use for Optimised {
    #[inline(always)]
    fn meet<S: Simd>(
        simd: S,
        product: S::f32s,
        look: &Splat<S>,
        tail: S::f32s,
        c: &mut S::f32s,
        e: &mut S::f32s,
    ) -> Met<S> {
        let along = simd.mul_f32s(simd.sub_f32s(*c, product), look.by);
        let most = add_product(simd, tail, look.beyond, simd.abs_f32s(along));
        let left = add_product(simd, simd.neg_f32s(most), most, *e);
        (*c, *e) = (product, left);
        let rest = add_product(simd, tail, look.gap, left);
        let rest = simd.max_f32s(rest, simd.splat_f32s(FLOOR));
        Met {
            likely: likely(simd, product, rest),
            most: look.reach.over(simd, product, tail),
            under: look.reach.under(simd, left),
        }
    }
}

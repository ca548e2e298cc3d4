//! All atoms weighed by the first numbers of their heads, a few poses at a time.

use super::heads::Head;
use super::kernel::{FLOOR, add_product};
use super::lead::Lead;
use super::panels::{Row, WIDTH, Wide};
use super::path::Path;
use super::sieve::{SHORT, Sieve, short};
use pulp::{Simd, WithSimd};

/// What is weighed for a pose.
pub struct Look {
    slot: usize,
    /// Of the newest vector, the residual's or a direction's.
    direction: [f32; SHORT],
    /// −<q, r> of it.
    part: f32,
    /// The length of what of it is beyond the head.
    beyond: f32,
    reach: Reach,
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
        let noise = path.sifting_noise();
        Reach {
            beyond: short(&path.heads[0]).1,
            product: noise.product,
            rest: noise.rest,
        }
    }
}

impl Look {
    /// At the newest of a path's vectors; at none if that is not new.
    pub fn at(path: &Path, slot: usize, is_new: bool) -> Look {
        let newest = path.heads.len() - 1;
        let head: &Head = &path.heads[newest];
        let mut look = Look {
            slot,
            direction: [0.0; SHORT],
            part: 0.0,
            beyond: 0.0,
            reach: Reach::of(path),
        };
        if is_new {
            let (numbers, beyond) = short(head);
            look.direction.copy_from_slice(numbers);
            look.beyond = beyond;
            look.part = path.parts.last().copied().unwrap_or(0.0);
        }
        look
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

/// What is kept, by panels, then poses.
pub struct State<'a> {
    pub correlations: &'a mut [Row],
    pub remainders: &'a mut [Row],
    /// The largest key that any atom of a panel may have, by lanes.
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
        let lanes = S::F32_LANES;
        let looks: &[Look; POSES] = self.looks[from..].first_chunk().expect("so many looks");
        let leads: &mut [Lead; POSES] =
            (self.leads[from..].first_chunk_mut()).expect("a lead a look");
        let rows = &self.sieve.rows[panel * SHORT..][..SHORT];
        let tails = vectors::<S>(&self.sieve.tails[panel]);
        for at in (0..WIDTH / lanes).step_by(VECTORS) {
            let mut sums = [[simd.splat_f32s(0.0); VECTORS]; POSES];
            for (k, row) in rows.iter().enumerate() {
                let row = &vectors::<S>(row)[at..at + VECTORS];
                for p in 0..POSES {
                    let by = simd.splat_f32s(looks[p].direction[k]);
                    for v in 0..VECTORS {
                        sums[p][v] = add_product(simd, row[v], by, sums[p][v]);
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
                let place = simd.splat_f32s((panel * WIDTH + at * lanes) as f32);
                let mut met = U::meet(simd, sums[p][0], &look, tails[at], &mut c[0], &mut e[0]);
                for v in 1..VECTORS {
                    let more =
                        U::meet(simd, sums[p][v], &look, tails[at + v], &mut c[v], &mut e[v]);
                    met = met.with(simd, more);
                }
                let most = self.state.most[row].first_mut::<S>();
                let largest = simd.div_f32s(met.most, met.under);
                *most = match at {
                    0 => largest,
                    _ => simd.max_f32s(largest, *most),
                };
                let lead = &mut leads[p];
                let (over, under) = (lead.over.first_mut::<S>(), lead.under.first_mut::<S>());
                let here = simd.mul_f32s(met.over, *under);
                let before = simd.mul_f32s(*over, met.under);
                let is_more = simd.greater_than_f32s(here, before);
                *over = simd.select_f32s(is_more, met.over, *over);
                *under = simd.select_f32s(is_more, met.under, *under);
                let places = lead.places.first_mut::<S>();
                *places = simd.select_f32s(is_more, place, *places);
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
    part: S::f32s,
    beyond: S::f32s,
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
            part: simd.splat_f32s(look.part),
            beyond: simd.splat_f32s(look.beyond),
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

/// What is known of a vector of atoms, or of several, by lanes the largest: in terms of c², and e at least.
struct Met<S: Simd> {
    over: S::f32s,
    /// c² at most.
    most: S::f32s,
    under: S::f32s,
}

impl<S: Simd> Met<S> {
    /// The larger ratios of two: without a division, as there are few of those at a time.
    #[inline(always)]
    fn with(self, simd: S, other: Met<S>) -> Met<S> {
        let larger =
            |a, b| simd.max_f32s(simd.mul_f32s(a, other.under), simd.mul_f32s(b, self.under));
        Met {
            over: larger(self.over, other.over),
            most: larger(self.most, other.most),
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
        let here = add_product(simd, look.part, product, *c);
        *c = here;
        plain(simd, here, look, tail)
    }
}

/// Where e does not count.
#[inline(always)]
fn plain<S: Simd>(simd: S, c: S::f32s, look: &Splat<S>, tail: S::f32s) -> Met<S> {
    Met {
        over: simd.mul_f32s(c, c),
        under: simd.splat_f32s(1.0),
        most: look.reach.over(simd, c, tail),
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
        let here = add_product(simd, look.part, product, *c);
        let most = add_product(simd, tail, look.beyond, simd.abs_f32s(product));
        let left = add_product(simd, simd.neg_f32s(most), most, *e);
        (*c, *e) = (here, left);
        Met {
            over: simd.mul_f32s(here, here),
            most: look.reach.over(simd, here, tail),
            under: look.reach.under(simd, left),
        }
    }
}

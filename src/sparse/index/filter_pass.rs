//! All atoms weighed by the first numbers of their heads, a few poses at a time.

use super::filter_score::{Alone, Falling, Kept, Splat, Use, vectors};
use super::int16_quantization::{self, PAIRS, Rounded};
use super::packed_atoms::{Row, WIDTH, Wide};
use super::quantized_table::{QuantizedTable, short};
use super::query::OmpQuery;
use super::warm_start::{self, Lead};
use pulp::{Simd, WithSimd};

/// Beyond it products with directions tell nothing of e: the sum of the squares of what they are off.
const MOST_OFF: f32 = 1e-4;

/// By shorter parts nothing is divided: what they tell is beyond [`MOST_OFF`] by far.
const LEAST_PART: f32 = 1e-12;

/// What is weighed for a pose: what is left of it.
pub struct Look {
    slot: usize,
    pub residual: Rounded,
    pub newest: Newest,
    /// See [`warm_start::gap`].
    pub gap: f32,
    pub reach: Reach,
}

/// Of a pose's newest direction q, whose product with an atom is that of what of the pose it took away, over its length.
#[derive(Default)]
pub struct Newest {
    /// Over <q, r>: the units of the products before and now.
    pub before: f32,
    pub now: f32,
    /// The length of what of it is beyond the head.
    pub beyond: f32,
    /// What e falls by for rounding.
    pub rest: f32,
}

/// What is kept beside the products of a pose: what 1 counts in them, and what e was lessened by for rounding.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    pub unit: f32,
    pub rest: f32,
}

impl Scale {
    /// Before anything is weighed.
    pub const NONE: Scale = Scale {
        unit: 1.0,
        rest: 0.0,
    };
}

/// What c may be more than its head tells, in a unit.
#[derive(Clone, Copy)]
pub struct Reach {
    /// The length of what of the residual is beyond the head.
    pub beyond: f32,
    /// Rounding.
    pub product: f32,
}

impl Reach {
    /// For a pose on its way.
    pub fn of(path: &OmpQuery, unit: f32) -> Reach {
        let product =
            path.noise().product + int16_quantization::rounding() * path.left.max(0.0).sqrt();
        Reach {
            beyond: short(&path.heads[0]).1 / unit,
            product: product / unit,
        }
    }
}

/// What e may be less than products tell.
fn rest(path: &OmpQuery) -> f32 {
    let rounding = int16_quantization::rounding();
    let mut squared = path.left.max(0.0);
    // Products with directions are off by what those with the residuals before and after are. Of e twice itself goes with
    // what each is off, and the squares of the products add up to 1 at most, or e is nothing anyway.
    let mut off = 0.0;
    for part in path.parts.iter().rev() {
        let after = squared.sqrt();
        squared += part * part;
        off += (rounding * (after + squared.sqrt()) / part).powi(2);
    }
    match off < MOST_OFF {
        true => path.noise().rest + 2.1 * off.sqrt(),
        false => f32::INFINITY,
    }
}

impl Look {
    /// At what is left of a pose; its newest direction is new, or it is not. `scale` is that of what is kept, and will be.
    pub fn at(path: &OmpQuery, slot: usize, is_new: bool, scale: &mut Scale) -> Look {
        let residual = int16_quantization::of_vector(short(&path.heads[0]).0);
        let before = *scale;
        *scale = Scale {
            unit: residual.unit,
            rest: rest(path),
        };
        let rest = match before.rest < f32::INFINITY {
            true => scale.rest - before.rest,
            // It is beyond all already.
            false => 0.0,
        };
        let newest = match path.parts.last() {
            Some(part) if is_new && part.abs() > LEAST_PART => Newest {
                before: -before.unit / part,
                now: -scale.unit / part,
                beyond: short(&path.heads[path.heads.len() - 1]).1,
                rest,
            },
            _ => Newest {
                rest,
                ..Newest::default()
            },
        };
        Look {
            slot,
            newest,
            gap: warm_start::gap(path),
            reach: Reach::of(path, residual.unit),
            residual,
        }
    }
}

/// What is done with the products.
#[derive(Clone, Copy)]
pub enum Step {
    /// They are c, and e does not count.
    Alone,
    /// They are c, and e falls from 1.
    Second,
    /// And e falls from what it was.
    Later,
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
    pub sieve: &'a QuantizedTable,
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
            Step::Alone => self.go::<S, Alone, POSES, VECTORS>(simd),
            Step::Second => self.go::<S, Falling<true>, POSES, VECTORS>(simd),
            Step::Later => self.go::<S, Falling<false>, POSES, VECTORS>(simd),
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
                        sums[p][v] = int16_quantization::add_products(simd, row[v], by, sums[p][v]);
                    }
                }
            }
            let mut longest = tails[at];
            for tail in &tails[at + 1..at + VECTORS] {
                longest = simd.max_f32s(longest, *tail);
            }
            for p in 0..POSES {
                let look = Splat::of(simd, &looks[p]);
                let row = panel * self.state.poses + looks[p].slot;
                let c = S::as_mut_simd_f32s(&mut self.state.correlations[row].0).0;
                let e = S::as_mut_simd_f32s(&mut self.state.remainders[row].0).0;
                let kept = Kept {
                    c: &mut c[at..at + VECTORS],
                    e: &mut e[at..at + VECTORS],
                    tails: &tails[at..at + VECTORS],
                    longest,
                };
                let mut products = [simd.splat_f32s(0.0); VECTORS];
                for v in 0..VECTORS {
                    products[v] = int16_quantization::in_single(simd, sums[p][v]);
                }
                let met = U::meet(simd, &look, &products, kept);
                let most = &mut self.state.most[looks[p].slot * panels + panel];
                let (most, here) = (most.first_mut::<S>(), met.most(simd));
                *most = match at {
                    0 => here,
                    _ => simd.max_f32s(here, *most),
                };
                let place = simd.splat_i32s((panel * WIDTH + at * lanes) as i32);
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

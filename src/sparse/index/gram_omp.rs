//! The steps of one pose after its first, by rows of the Gram matrix: c and e of the pose stay in the cache nearest.

use super::argmax::LaneArgmax;
use super::packed_atoms::{PLACES, Row, WIDTH};
use super::panel_kernel::{self, Next, Optimised, Plain, Use, Vectors};
use super::{DenseScan, PackedAtoms, SelectionRule, Term};
use crate::numeric::simd;
use pulp::{Simd, WithSimd};

/// What is kept of the pose that is followed.
pub struct GramOmp {
    remainders: Vec<Row>,
    fresh: bool,
}

impl GramOmp {
    /// Room for a pose.
    pub fn new(panels: &PackedAtoms) -> GramOmp {
        GramOmp {
            remainders: vec![Row::ZERO; panels.iter().len()],
            fresh: true,
        }
    }

    /// Begins with a pose that has its first correlations.
    pub fn begin(&mut self) {
        self.fresh = true;
    }

    /// A step of pose `pose` of a scan: the newest direction is the sum of `terms`, of which the residual had `−part`. Gives
    /// the best atom, if there is one.
    pub fn next(
        &mut self,
        scan: &mut DenseScan<'_>,
        pose: usize,
        (terms, part): (&[Term<'_>], f32),
        (rule, last): (SelectionRule, bool),
    ) -> Option<u32> {
        let fresh = self.fresh;
        self.fresh &= last;
        let mut best = None;
        simd::dispatch_widest(Follow {
            step: Next { rule, fresh, last },
            terms,
            part,
            correlations: &mut scan.correlations[pose..],
            stride: scan.poses,
            remainders: &mut self.remainders,
            best: &mut best,
        });
        best
    }
}

/// All panels for one pose.
struct Follow<'a> {
    step: Next,
    terms: &'a [Term<'a>],
    part: f32,
    /// The pose's rows are `stride` apart.
    correlations: &'a mut [Row],
    stride: usize,
    remainders: &'a mut [Row],
    best: &'a mut Option<u32>,
}

impl WithSimd for Follow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.step.rule, self.step.fresh, self.step.last) {
            (SelectionRule::Omp, _, false) => self.of_terms::<S, Plain<true, false>>(simd),
            (SelectionRule::Omp, _, true) => self.of_terms::<S, Plain<true, true>>(simd),
            (_, true, false) => self.of_terms::<S, Optimised<true, true, false>>(simd),
            (_, true, true) => self.of_terms::<S, Optimised<true, true, true>>(simd),
            (_, false, false) => self.of_terms::<S, Optimised<true, false, false>>(simd),
            (_, false, true) => self.of_terms::<S, Optimised<true, false, true>>(simd),
        }
    }
}

impl Follow<'_> {
    #[inline(always)]
    fn of_terms<S: Simd, U: Use>(self, simd: S) {
        // So many vectors hold a panel's atoms.
        match S::F32_LANES {
            16 => self.go::<S, U, 4>(simd),
            8 => self.go::<S, U, 8>(simd),
            4 => self.go::<S, U, 16>(simd),
            _ => self.go::<S, U, WIDTH>(simd),
        }
    }

    #[inline(always)]
    fn go<S: Simd, U: Use, const VECTORS: usize>(self, simd: S) {
        let part = simd.splat_f32s(self.part);
        let places = vectors::<S>(&PLACES);
        let mut best = [LaneArgmax::none(simd); VECTORS];
        let correlations = self.correlations.iter_mut().step_by(self.stride);
        for (panel, (c, e)) in correlations.zip(self.remainders).enumerate() {
            let mut products = [simd.splat_f32s(0.0); VECTORS];
            for (weight, row) in self.terms {
                let (weight, row) = (simd.splat_f32s(*weight), vectors::<S>(&row[panel]));
                for v in 0..VECTORS {
                    products[v] = panel_kernel::add_product(simd, weight, row[v], products[v]);
                }
            }
            let panel = simd.splat_f32s((panel * WIDTH) as f32);
            for v in 0..VECTORS {
                let state = Vectors {
                    c: panel_kernel::vector::<S>(c, v),
                    e: Some(panel_kernel::vector::<S>(e, v)),
                    floor: None,
                };
                if let Some((over, under)) = U::meet(simd, products[v], part, state) {
                    best[v].compare(simd, over, under, simd.add_f32s(panel, places[v]));
                }
            }
        }
        *self.best = LaneArgmax::best(simd, best);
    }
}

#[inline(always)]
fn vectors<S: Simd>(row: &Row) -> &[S::f32s] {
    S::as_simd_f32s(&row.0).0
}
